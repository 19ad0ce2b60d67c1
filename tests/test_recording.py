"""What a log says about its own recording, and that no robot is blamed for it."""

from dataclasses import replace

import numpy as np
import pytest

from ident import compare, diagnose, identify
from ident.log import Log
from ident.recording import find_recordings
from ident.recording_words import in_words, nearest_hold
from youbot_env.measurement import HOLDS, instruments
from youbot_env.model_file import load_model
from youbot_env.references import SmoothRandom, calibration_sequence
from youbot_env.simulation import Sensors, record_closed_loop

PAPER, NOMINAL = load_model("paper"), load_model("nominal")


def record(model, motion, seconds, seed, rate=100.0, row="sampled", loop_rate=1000.0, spoil=None):
    """A log of a robot whose loops run at 1 kHz, through instruments."""
    sensors = NOMINAL.with_effects(spoil or {})
    channels = record_closed_loop(
        model, motion, np.arange(round(seconds * rate)) / rate, Sensors(), seed=seed,
        loop_rate=loop_rate, row=row, instrument=instruments(sensors.effects, model.platform),
    )  # fmt: skip
    return Log(f"log{seed}", model.platform, **channels)


def calibration(model=PAPER, seconds=60.0, seed=1, **how):
    return record(model, calibration_sequence(0.35, 1.0, seconds), seconds, seed, **how)


def random(model=PAPER, seconds=40.0, seed=2, **how):
    return record(model, SmoothRandom(0.4, 1.5), seconds, seed, **how)


def lumps_hold(result, truth=PAPER, widths=1.5):
    """Whether identified combinations of inertias are as true as their intervals say."""
    scale = 4 * truth.platform.lever**2 / 0.0475**2
    x3 = scale * truth.parameters.I1
    exact = {
        "x1+x3": truth.platform.lever**2 * truth.parameters.m0 + x3,
        "x2+x3": truth.parameters.I0 + x3,
    }
    for name, value in exact.items():
        q = result.lumps[name]
        assert abs(q.value - value) < widths * 0.5 * (q.ci95[1] - q.ci95[0]), name
    return True


@pytest.mark.parametrize(
    ("how", "lead"),
    [
        ({"loop_rate": None}, 0.0),
        ({}, 5e-3),
        ({"row": "averaged"}, 10e-3),
        ({"rate": 50.0}, 10e-3),
        ({"rate": 200.0}, 2.5e-3),
        ({"spoil": {"drive_offset": 0.02}}, 25e-3),
        ({"spoil": {"drive_offset": -0.03}}, -25e-3),
        ({"spoil": {"drive_filter": 0.012}}, 17e-3),
    ],
)
def test_the_lead_of_the_drive_is_found(how, lead):
    found = find_recordings([calibration(**how)], NOMINAL)[0]
    assert abs(found.lead - lead) < 3 * found.error + 1e-3
    assert found.error < 4e-3


def test_holds_are_told_by_their_leads():
    assert nearest_hold(0.2e-3, 1e-4, 0.01) == ("held", True)
    assert nearest_hold(4.6e-3, 1e-4, 0.01) == ("sampled", True)
    assert nearest_hold(10.3e-3, 1e-4, 0.01) == ("averaged", True)
    assert nearest_hold(17e-3, 1e-4, 0.01) == ("sampled", False)


@pytest.mark.parametrize(
    "how",
    [
        {"rate": 25.0},
        {"rate": 20.0, "row": "averaged"},
        {"spoil": {"drive_offset": 0.02}},
        {"spoil": {"drive_offset": -0.02}},
        {"spoil": {"velocity_filter": 0.012}},
    ],
)
def test_a_robot_is_identified_whatever_the_recording_was(how):
    assert lumps_hold(identify(calibration(seconds=112.0, **how), NOMINAL))


@pytest.mark.parametrize("row", ["sampled", "averaged"])
def test_slow_rows_bias_neither_clock_nor_inertia(row):
    quiet = Sensors(0.0, 0.0, 0.0, 0.0)
    times, motion = np.arange(1600) / 20.0, calibration_sequence(0.35, 1.0, 80.0)
    channels = record_closed_loop(PAPER, motion, times, quiet, loop_rate=1000.0, row=row)
    log = Log("slow", PAPER.platform, **channels)
    lead = {"sampled": 0.0245, "averaged": 0.05}[row]  # what a sample shows began a step before
    assert find_recordings([log], NOMINAL)[0].lead == pytest.approx(lead, abs=5e-4)
    kind = float(HOLDS.index(row))
    stated = {"drive_hold": {"kind": kind}, "drive_offset": {"d": lead - 0.025 * kind}}
    found = identify(replace(log, recording=stated), NOMINAL)
    parameters, lever = PAPER.parameters, PAPER.platform.lever
    exact = lever**2 * (parameters.m0 + 4 * parameters.I1 / 0.0475**2)
    assert found.lumps["x1+x3"].value == pytest.approx(exact, rel=4e-3)


def test_what_is_declared_is_taken_as_given(tmp_path):
    log = calibration(spoil={"drive_offset": 0.02}, seconds=40.0)
    path = log.save(tmp_path / "plain.csv")
    text = path.read_text(encoding="utf-8")
    path.write_text(f"# recording: drive_hold=sampled, drive_offset=0.02\n{text}", "utf-8")
    told = Log.load(path)
    assert told.recording == {"drive_hold": {"kind": 1.0}, "drive_offset": {"d": 0.02}}
    hold, clock = find_recordings([told], NOMINAL)[0].instruments
    assert (hold.value, hold.status, clock.status) == ("sampled", "declared", "declared")
    assert clock.value == pytest.approx(0.02)
    mine = Log.load(path, recording=["drive_hold=held", "velocity_filter=0.01"])
    assert mine.recording["drive_hold"] == {"kind": 0.0}
    assert mine.recording["velocity_filter"] == {"T": 0.01}


@pytest.mark.parametrize(
    ("line", "words"),
    [
        ("drive_hold=frozen", "held, sampled, averaged"),
        ("drive_offset=late", "give a number"),
        ("floor_slope=0.1", "is none of"),
        ("drive_offset=7", "outside"),
        ("drive_offset", "=VALUE"),
    ],
)
def test_a_declaration_that_cannot_be_is_refused(tmp_path, line, words):
    path = calibration(seconds=20.0).save(tmp_path / "log.csv")
    text = path.read_text(encoding="utf-8")
    path.write_text(f"# recording: {line}\n{text}", encoding="utf-8")
    with pytest.raises(ValueError, match=words):
        Log.load(path)


def test_a_pose_tells_that_wheel_speeds_are_late():
    late = {"spoil": {"velocity_filter": 0.012}}
    fit, test = calibration(**late), random(**late)
    found = diagnose(fit, NOMINAL, test)
    assert found.verdict == "nothing_missing"
    lag = [one for one in found.recording if one.what == "velocity_filter"]
    assert [one.log for one in lag] == [fit.name, test.name]
    assert all(abs(one.value - 0.012) < 1e-3 for one in lag)
    # Without the pose a late drive looks the same, and that is said.
    unseen = diagnose(replace(fit, pose=None), NOMINAL, replace(test, pose=None))
    assert unseen.verdict == "ambiguous"
    assert {"velocity_filter", "actuator_delay"} <= set(unseen.named[0].group)


def test_a_drive_that_is_late_is_not_put_down_to_the_clock():
    robot = PAPER.with_effects({"actuator_delay": 0.03})
    found = diagnose(calibration(robot), NOMINAL, random(robot))
    assert found.named[0].best.identifier in ("actuator_delay", "actuator_lag")
    assert "velocity_filter" not in found.named[0].group


@pytest.mark.parametrize("spoil", [{"drive_filter": 0.011}, {"drive_offset": 0.04}])
def test_a_late_torque_is_the_recordings(spoil):
    found = diagnose(calibration(spoil=spoil), NOMINAL, random(spoil=spoil))
    assert found.verdict == "nothing_missing"
    clocks = [one for one in found.recording if one.what == "drive_offset"]
    assert [one.log for one in clocks] == ["log1", "log2"]
    assert all(abs(one.value - next(iter(spoil.values()))) < 3e-3 for one in clocks)
    assert "late" in in_words(found.recording)[0]


def test_each_log_has_a_clock_of_its_own():
    fit, test = calibration(), random(spoil={"drive_offset": 0.04})
    found = diagnose(fit, NOMINAL, test)
    assert found.verdict == "nothing_missing"
    first, second = (one.value for one in found.recording if one.what == "drive_offset")
    assert abs(first) < 3e-3
    assert abs(second - 0.04) < 5e-3


def test_a_slope_needs_no_pose():
    robot = PAPER.with_effects({"floor_slope": {"sx": 0.012, "sy": -0.008}})
    logs = [replace(log, pose=None) for log in (calibration(robot), random(robot))]
    found = diagnose(logs[0], NOMINAL, logs[1])
    assert [step.best.identifier for step in found.named] == ["floor_slope"]
    size = found.named[0].sizes(found.model)
    assert size["sx"].value == pytest.approx(0.012, abs=1e-3)
    assert size["sy"].value == pytest.approx(-0.008, abs=1e-3)


def test_a_second_log_has_a_record_of_its_own():
    load = {"dm": 14.0, "dI": 0.4, "dpx": -1.4, "dpy": 0.9}
    robots = [PAPER.with_effects({"payload_change": {**load, "t0": t}}) for t in (35.0, 14.0)]
    found = diagnose(calibration(robots[0]), NOMINAL, random(robots[1]))
    assert found.verdict == "named"
    assert [step.best.identifier for step in found.named] == ["payload_change"]
    assert found.errors.after < 0.3 * found.errors.before
    own = [dict(zip(m.names(), m.values(), strict=True)) for m in found.models[-1]]
    assert own[0]["payload_change.t0"] == pytest.approx(35.0, abs=0.3)
    assert own[1]["payload_change.t0"] == pytest.approx(14.0, abs=0.3)
    assert own[0]["m0"] == own[1]["m0"]


def test_comparison_and_json_say_how_the_log_was_recorded():
    log = random(spoil={"drive_offset": 0.03})
    one = compare(log, [NOMINAL, PAPER])[1]
    clock = one.as_dict()["recording"][1]
    assert clock["what"] == "drive_offset"
    assert clock["value"] == pytest.approx(0.03, abs=5e-3)
    low, high = clock["ci95"]
    assert low < 0.03 < high
    # The right model explains the log only with its clock.
    assert one.run.nrmse < 0.02
