"""Logs to judge by of another load, floor or battery say so; other motions do not."""

import json
from dataclasses import replace

import numpy as np
import pytest

from ident.diagnosis.verdict import diagnose
from ident.disagreement import with_disagreement
from ident.log import Log
from youbot_env.model_file import load_model
from youbot_env.references import SmoothRandom, calibration_sequence
from youbot_env.simulation import Sensors, record_closed_loop

PAPER = load_model("paper")
DRY = {"wheel_coulomb_friction": 0.15}


def record(model, seed, motion=None, seconds=30.0):
    motion = motion or SmoothRandom(0.35, 1.5)
    times = np.arange(seconds * 100) / 100
    channels = record_closed_loop(model, motion, times, Sensors(), seed=seed)
    return Log(f"log{seed}", model.platform, **channels)


def heavier(factor):
    values = list(PAPER.values())
    values[PAPER.names().index("m0")] *= factor
    return PAPER.with_values(values).with_effects(DRY)


def told(fitted, log):
    (judged,) = with_disagreement([fitted], [log], PAPER)
    return [str(finding) for finding in judged.findings if finding.name == "differs"]


@pytest.fixture(scope="module")
def fitted():
    motion = calibration_sequence(seconds=60.0)
    return record(PAPER.with_effects(DRY), 1, motion, 60.0)


def test_a_payload_is_told_with_its_mass(fitted):
    (words,) = told(fitted, record(heavier(1.2), 2))
    assert "a mass of +7" in words
    assert "kg" in words
    assert "+20 %" in words
    assert "dry friction" not in words


def test_another_floor_is_told_with_its_friction(fitted):
    (words,) = told(fitted, record(PAPER.with_effects({"wheel_coulomb_friction": 0.3}), 2))
    assert "dry friction of the wheels of +0.15 N m" in words
    assert "mass" not in words


def test_another_battery_is_told_by_its_pull(fitted):
    log = record(PAPER.with_effects(DRY), 2)
    (words,) = told(fitted, replace(log, wheel_torque=1.2 * log.wheel_torque))
    assert "pull of the drive of +20 %" in words


@pytest.mark.parametrize(
    "hidden",
    [
        DRY,
        {"actuator_delay": 0.03},
        {"floor_slope": {"sx": 0.02, "sy": 0.01}},
        {"wheel_slip": None},
    ],
    ids=lambda hidden: next(iter(hidden)),
)
@pytest.mark.parametrize("motion", [SmoothRandom(0.35, 1.5), SmoothRandom(0.15, 0.5)], ids="fs")
def test_another_motion_of_the_same_robot_agrees(hidden, motion):
    robot = PAPER.with_effects(hidden)
    fitted = record(robot, 1, calibration_sequence(seconds=60.0), 60.0)
    assert told(fitted, record(robot, 2, motion)) == []


def test_the_finding_stands_in_text_and_json(script, tmp_path, fitted):
    paths = [fitted.save(tmp_path / "a.csv"), record(heavier(1.2), 2).save(tmp_path / "b.csv")]
    status, out, _ = script(
        "identify.py", paths[0], "--test", paths[1], "--json", "r.json", "--out", "m.yaml"
    )
    assert status == 0
    assert "the robot is not the one of the fitted log" in " ".join(out.split())
    found = json.loads((tmp_path / "r.json").read_text())["findings"]
    assert [(f["log"], f["name"]) for f in found] == [("b", "differs")]


def test_a_log_of_another_robot_does_not_judge(fitted):
    robot = PAPER.with_effects({"wheel_coulomb_friction": 0.3})
    found = diagnose(fitted, "nominal", record(robot, 2))
    assert [name["effect"] for name in found.as_dict()["named"]] == list(DRY)
    assert "was not used to judge: the robot is not the one of the fitted log" in found.reason


def test_an_effect_that_hides_the_difference_is_taken_in():
    """Torques that clip in one motion and not in the other look like no single number."""
    clips = PAPER.with_effects({"torque_saturation": 1.0})
    fitted, log = record(clips, 1, SmoothRandom(0.4, 1.5)), record(clips, 2, SmoothRandom(0.3, 1.0))
    weaker = replace(log, wheel_torque=1.2 * log.wheel_torque)
    assert told(fitted, weaker) == []
    names = [[f.name for f in with_disagreement([fitted], [one], clips)[0].findings]
             for one in (log, weaker)]  # fmt: skip
    assert names == [[], ["differs"]]
