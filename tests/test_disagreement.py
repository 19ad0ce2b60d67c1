"""Logs to judge by of another load, floor or battery say so; other motions do not."""

import json
from dataclasses import replace

import numpy as np
import pytest

from ident.diagnosis.diagnose import diagnose
from ident.disagreement import disagreements, may_disagree, may_judge, not_used, with_disagreements
from ident.log import Log
from ident.pooling import joined
from ident.recording import find_recordings
from youbot_env.model_file import load_model
from youbot_env.references import SmoothRandom, calibration_sequence
from youbot_env.simulation import Sensors, record_closed_loop

PAPER = load_model("paper")
DRY = {"wheel_coulomb_friction": 0.15}
# Clocks that need not be found; the logs have them.
KNOWN = {"drive_hold": {"kind": 0.0}, "drive_offset": {"d": 0.0}}


def record(model, seed, motion=None, seconds=30.0):
    motion = motion or SmoothRandom(0.35, 1.5)
    times = np.arange(seconds * 100) / 100
    channels = record_closed_loop(model, motion, times, Sensors(), seed=seed)
    return Log(f"log{seed}", model.platform, **channels)


def heavier(factor):
    values = list(PAPER.values())
    values[PAPER.names().index("m0")] *= factor
    return PAPER.with_values(values).with_effects(DRY)


def late(log, rows):
    """The log with torques that come so many rows late, or early."""
    moved = replace(log, wheel_torque=np.roll(log.wheel_torque, rows, axis=0))
    return moved.part(0.2, log.time[-1] - 0.2)


def told(fitted, log, known=KNOWN):
    (record,) = find_recordings([replace(log, recording=known)], PAPER)
    found = disagreements([replace(fitted, recording=KNOWN)], [record.log], PAPER)
    (judged,) = with_disagreements([log], found)
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


@pytest.mark.parametrize("rows", [4, -4])
def test_a_late_clock_is_no_load_and_hides_none(fitted, rows):
    """Torques 40 ms late or early: what counts is the log once its clock is known."""
    assert told(fitted, late(record(PAPER.with_effects(DRY), 2), rows), known={}) == []
    (words,) = told(fitted, late(record(heavier(1 + 5 / 35.3), 2), rows), known={})
    assert "a mass of +4." in words
    assert "another payload" in words


def test_of_many_short_logs_that_which_differs_is_told(fitted):
    names = ("a", "b", "c")
    robots = (PAPER.with_effects(DRY), heavier(1.2), PAPER.with_effects(DRY))
    runs = [replace(record(r, k + 2, seconds=18.0), name=n, recording=KNOWN)
            for k, (n, r) in enumerate(zip(names, robots, strict=True))]  # fmt: skip

    def found(*logs):
        return disagreements([replace(fitted, recording=KNOWN)], [joined(logs)], PAPER)

    assert list(found(*runs)) == ["b"]
    assert may_judge(joined(runs), found(*runs))
    (log,) = with_disagreements([joined(runs)], found(*runs))
    assert [finding.where for finding in log.findings] == ["b, against the fitted logs"]
    heavy = [replace(runs[1], name="b"), replace(record(heavier(1.2), 9, seconds=18.0), name="d",
                                                 recording=KNOWN)]  # fmt: skip
    assert list(found(*heavy)) == ["b", "d"]
    assert not may_judge(joined(heavy), found(*heavy))
    assert "; b, d were not used to judge: the robot is not" in not_used(found(*heavy))


@pytest.mark.parametrize("number", range(4))
def test_a_single_run_that_differs_is_reason_to_look_closer(fitted, number):
    same, known = PAPER.with_effects(DRY), [replace(fitted, recording=KNOWN)]
    robots = [heavier(1.2) if k == number else same for k in range(4)]
    runs = [replace(record(r, k + 2, seconds=18.0), recording=KNOWN) for k, r in enumerate(robots)]
    assert may_disagree(known, [joined(runs)], PAPER)
    others = [replace(record(same, k + 20, seconds=18.0), recording=KNOWN) for k in range(4)]
    assert not may_disagree(known, [joined(others)], PAPER)


def test_the_finding_stands_in_text_and_json(script, tmp_path, fitted):
    same = late(record(PAPER.with_effects(DRY), 3), 4)
    logs = {"a": fitted, "b": record(heavier(1.2), 2), "c": same}
    paths = [log.save(tmp_path / f"{name}.csv") for name, log in logs.items()]
    status, out, _ = script(
        "identify.py", paths[0], "--test", *paths[1:], "--json", "r.json", "--out", "m.yaml"
    )
    assert status == 0
    assert "the robot is not the one of the fitted log" in " ".join(out.split())
    found = json.loads((tmp_path / "r.json").read_text())["findings"]
    assert [(f["log"], f["name"]) for f in found] == [("b", "differs")]


def test_compare_judges_by_the_logs_that_are_kept_out(script, tmp_path, fitted):
    paths = [fitted.save(tmp_path / "a.csv"), record(heavier(1.2), 2).save(tmp_path / "b.csv")]
    words = ("--model", "paper", "nominal", "--json", "r.json", "--report", "page")
    status, out, errors = script("compare.py", paths[0], "--test", paths[1], *words)
    assert status == 0, errors
    text, found = " ".join(out.split()), json.loads((tmp_path / "r.json").read_text())
    assert "predicts b best" in text
    assert "the robot is not the one of the fitted log" in text
    assert found["log"] == "b"
    assert [(f["log"], f["name"]) for f in found["findings"]] == [("b", "differs")]
    assert found["fitted"]["log"] == "a"
    errors = {m["model"]: m["free_run"]["nrmse"] for m in found["models"]}
    assert 0 < found["fitted"]["nrmse"]["paper"] < errors["paper"]
    assert len(found["provenance"]["logs"]) == 2
    page = (tmp_path / "page" / "index.html").read_text()
    assert "a all %" in page
    assert "b (--test) all %" in page


def test_a_log_of_another_robot_does_not_judge(fitted):
    robot = PAPER.with_effects({"wheel_coulomb_friction": 0.3})
    found = diagnose(fitted, "nominal", record(robot, 2))
    assert [name["effect"] for name in found.as_dict()["named"]] == list(DRY)
    assert "was not used to judge: the robot is not the one of the fitted log" in found.reason
    assert list(found.differs) == ["log2"]


def test_an_effect_that_hides_the_difference_is_taken_in():
    """Torques that clip in one motion and not in the other look like no single number."""
    clips = PAPER.with_effects({"torque_saturation": 1.0})
    fitted, log = record(clips, 1, SmoothRandom(0.4, 1.5)), record(clips, 2, SmoothRandom(0.3, 1.0))
    weaker = replace(log, wheel_torque=1.2 * log.wheel_torque)
    fitted, log, weaker = (replace(one, recording=KNOWN) for one in (fitted, log, weaker))
    assert told(fitted, weaker) == []
    assert disagreements([fitted], [log], clips) == {}
    assert list(disagreements([fitted], [weaker], clips)) == [weaker.name]


def test_friction_of_each_wheel_counts_as_one_number(fitted):
    """An effect that was found wheel by wheel, in the model that both logs are read with."""
    each = {f"fc_{wheel}": 0.15 for wheel in ("fl", "fr", "rl", "rr")}
    found = PAPER.with_effects({"wheel_coulomb_friction": each})
    other = record(PAPER.with_effects({"wheel_coulomb_friction": 0.3}), 2)
    known = [replace(log, recording=KNOWN) for log in (fitted, other)]
    (finding,) = disagreements(known[:1], known[1:], found).values()
    assert "dry friction of the wheels of +0.15 N m" in finding.what
