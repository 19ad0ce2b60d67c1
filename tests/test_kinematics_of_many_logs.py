"""One kinematic calibration of many logs: short, along one axis, each with its own pose frame."""

import json
import warnings
from dataclasses import replace

import numpy as np
import pytest
from test_kinematics import MOUNTED, measured, rolled

from ident.kinematics import calibrate_kinematics
from ident.kinematics.windows import cut_windows
from ident.pooling import MANY_RUNS, joined
from youbot_env.backend import NUMPY
from youbot_env.platform import mecanum, youbot
from youbot_env.references import SmoothRandom

# The robot differs from its table: radius by 1 %, places of the wheels by 2 %.
REAL = mecanum("youbot", 0.15 * 1.02, 0.2355 * 1.02, 0.0475 * 1.01, 0.014, 1.4)
AXES = {"ahead": (1, 0, 0), "sideways": (0, 1, 0), "turning": (0, 0, 1), "round": (1, 1, 1)}


def moved(pose, rng):
    """The pose in another frame of the world."""
    turn, shift = rng.uniform(-3, 3), rng.uniform(-5, 5, 2)
    c, s = np.cos(turn), np.sin(turn)
    place = pose[:, :2] @ np.array([[c, s], [-s, c]]) + shift
    return np.column_stack([place, pose[:, 2] + turn])


def run(name, axes, seed, seconds=8.0, rate=100):
    """A run along some axes at random, in a pose frame of its own."""
    time = np.arange(round(seconds * rate)) / rate
    twist = np.stack(SmoothRandom(0.35, 1.5).sample(time, seed=seed).twist(NUMPY), axis=1) * axes
    yaw = np.concatenate([[0.0], np.cumsum(0.5 * (twist[1:, 2] + twist[:-1, 2]) / rate)])
    c, s = np.cos(yaw), np.sin(yaw)
    v = np.column_stack([c * twist[:, 0] - s * twist[:, 1], s * twist[:, 0] + c * twist[:, 1]])
    place = np.vstack([np.zeros(2), np.cumsum(0.5 * (v[1:] + v[:-1]) / rate, axis=0)])
    log = measured(youbot(), time, twist @ REAL.jacobian_array.T, np.column_stack([place, yaw]),
                   seed=seed, mount=MOUNTED)  # fmt: skip
    pose = moved(log.pose, np.random.default_rng(seed))
    return replace(log, pose=pose, name=name, digest=name)


@pytest.fixture(scope="module")
def runs():
    return [run(f"{name}{k}", axes, 10 * k + n)
            for k in range(3) for n, (name, axes) in enumerate(AXES.items())]  # fmt: skip


def calibrated(logs, **options):
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", UserWarning)
        return calibrate_kinematics(logs, **options)


def test_runs_along_one_axis_tell_together_what_none_tells_alone(runs):
    alone = calibrated(runs[0])
    assert alone.undetermined
    found = calibrated(runs, test=[run("t1", (1, 1, 1), 91), run("t2", (1, 1, 1), 92)])
    assert found.undetermined == ()
    assert found.left_out == {}
    assert found.log == "ahead0 and 11 more"
    assert found.test == "t1 and 1 more"
    for name, truth in (("wheel_radius", 0.0475 * 1.01), ("lever", 0.3855 * 1.02)):
        low, high = found.parameters[name].ci95
        assert found.parameters[name].value == pytest.approx(truth, rel=2e-3)
        assert low < truth < high
    for name, truth in zip(("offset_x", "offset_y", "offset_yaw", "delay"), MOUNTED, strict=True):
        assert found.mount[name].value == pytest.approx(truth, abs=3e-3)
    assert found.drifts["test_after"].position_per_metre < (
        0.5 * found.drifts["test_before"].position_per_metre
    )


def test_logs_that_are_of_no_use_are_left_out_with_the_reason(runs):
    bad = {
        "mirrored": replace(runs[3], name="mirrored", pose=runs[3].pose * [1.0, -1.0, 1.0]),
        "blind": replace(runs[3], name="blind", pose=None),
        "short": replace(runs[3].part(0.0, 2.0), name="short"),
    }
    good, found = calibrated(runs), calibrated([*runs[:6], *bad.values(), *runs[6:]])
    assert list(found.left_out) == ["blind", "short", "mirrored"]
    assert "no pose" in found.left_out["blind"]
    assert "no contiguous piece" in found.left_out["short"]
    assert "pose" in found.left_out["mirrored"]
    assert found.fit.values == pytest.approx(good.fit.values, abs=1e-12)
    with pytest.raises(ValueError, match="none of the 2 logs can be used"):
        calibrated([bad["blind"], bad["short"]])


def test_jumps_of_the_pose_and_other_rates_are_no_matter(runs):
    jump = np.outer(np.arange(800) >= 400, (0.4, 0.2, 0.0))
    jumped = replace(runs[3], pose=runs[3].pose + jump, starts=(0, 400))
    slow = run("slow", (1, 1, 1), 77, seconds=12.0, rate=30)
    good, found = calibrated(runs), calibrated([*runs[:3], jumped, *runs[4:], slow])
    for name in ("wheel_radius", "lever"):
        assert found.parameters[name].value == pytest.approx(good.parameters[name].value, rel=2e-3)
    assert found.left_out == {}


def test_of_many_runs_each_is_one_independent_witness():
    """A run of one direction is wrong by the same in all of its windows."""
    time, speed, pose = rolled("smooth_random", seconds=5.0)
    many = [replace(measured(youbot(), time, speed, pose, seed=k), name=f"r{k}")
            for k in range(MANY_RUNS)]  # fmt: skip
    assert set(cut_windows(joined(many), 2.0).run) == set(range(MANY_RUNS))
    assert len(calibrated(many).fit.information) == MANY_RUNS
    assert len(calibrated(many[:-1]).fit.information) == 38  # stretches of time


def test_the_command_takes_files_folders_and_patterns(script, tmp_path, runs):
    (tmp_path / "runs").mkdir()
    drive = {"wheel_torque": None, "reference": None}
    for log in runs[:8]:
        replace(log, **drive).save(tmp_path / "runs" / f"{log.name}.csv")
    blind = replace(runs[8], pose=None, name="blind", wheel_torque=0.1 * runs[8].wheel_velocity)
    blind.save(tmp_path / "runs" / "blind.csv")
    (tmp_path / "runs" / "bad.csv").write_text("time,a\n0,1\n")
    for log in runs[9:]:
        replace(log, **drive).save(tmp_path / f"{log.name}.csv")
    status, out, errors = script(
        "calibrate_kinematics.py", "runs", "--test", "side*.csv", "round2.csv", "--json", "r.json"
    )
    assert status == 0, errors
    assert "left out: bad.csv cannot be used" in errors
    assert "left out: blind: log 'blind' has no pose" in errors
    assert "Kinematics" in out
    answer = json.loads((tmp_path / "r.json").read_text())
    assert list(answer["left_out"]) == ["blind"]
    assert len(answer["provenance"]["logs"]) == 10
    assert answer["parameters"]["wheel_radius"]["value"] == pytest.approx(0.047975, rel=3e-3)
