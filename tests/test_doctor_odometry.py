"""Factors, mount, clock and bias between two witnesses of one motion, against known truth."""

from types import SimpleNamespace

import numpy as np
import pytest
from shared_data import shared
from spoiled_logs import P, R, V, good_frame, scale, simulate
from test_doctor import ORDINARY, load, warnings

from ident.doctor.odometry import body_against, pose_against_wheels, wheel_twist
from ident.log import Log
from youbot_env.model_file import load_model
from youbot_env.platform import youbot
from youbot_env.references import make_reference
from youbot_env.simulation import Sensors, record_closed_loop

SECONDS, DT = 60.0, 0.01


@pytest.fixture(scope="module")
def robot() -> SimpleNamespace:
    """A minute of motion at 100 Hz; pose noise 1 mm, 2 mrad, wheel noise 0.02 rad/s."""
    model = load_model("nominal")
    motion = make_reference("multisine", speed=0.5)
    times = np.arange(round(SECONDS / DT)) * DT
    channels = record_closed_loop(model, motion, times, Sensors(), seed=11)
    channels["starts"] = (0,)
    return SimpleNamespace(platform=model.platform, **channels)


def changed(robot: SimpleNamespace, **channels) -> SimpleNamespace:
    return SimpleNamespace(**{**vars(robot), **channels})


def near(estimate, truth: float, widest: float) -> None:
    """Within four standard errors, and these are small."""
    assert abs(estimate.value - truth) < 4 * estimate.se + 1e-12
    assert estimate.se < widest


def late(values: np.ndarray, time: np.ndarray, shift: float) -> np.ndarray:
    return np.column_stack([np.interp(time - shift, time, v) for v in values.T])


def test_good_robot_shows_nothing(robot):
    found = pose_against_wheels(robot)
    for scale_ in (found.forward, found.sideways, found.yaw):
        near(scale_, 1.0, 1e-3)
    near(found.angle, 0.0, 1e-3)
    near(found.shift, 0.0, 1e-3)
    assert not found.bias.known  # nobody doubts the yaw of a pose
    near(found.lever_x, 0.0, 1e-3)
    near(found.lever_y, 0.0, 1e-3)


@pytest.mark.parametrize("shift", [-0.05, 0.003, 0.02])
def test_shift_of_the_pose(robot, shift):
    pose = late(robot.pose, robot.time, shift)
    found = pose_against_wheels(changed(robot, pose=pose))
    assert abs(found.shift.value - shift) < 1e-3
    assert found.shift.se < 5e-4


def test_pose_with_everything(robot):
    """Another unit, a turned heading, a tracked point off the centre, all at once."""
    angle, x, y, yaw = 0.3, 0.2, -0.1, robot.pose[:, 2]
    c, s = np.cos(yaw), np.sin(yaw)
    place = 1.1 * robot.pose[:, :2] + np.column_stack([c * x - s * y, s * x + c * y])
    pose = np.column_stack([place, yaw - angle])
    found = pose_against_wheels(changed(robot, pose=pose))
    near(found.forward, 1.1, 2e-3)
    near(found.sideways, 1.1, 2e-3)
    near(found.yaw, 1.0, 2e-3)
    near(found.angle, angle, 2e-3)
    # The lever is seen in the axes of the robot, turned back by the heading's offset.
    turned = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    expected = turned @ [x, y]
    assert abs(found.lever_x.value - expected[0]) < 3e-3
    assert abs(found.lever_y.value - expected[1]) < 3e-3


@pytest.mark.parametrize("source", ["wheels", "pose"])
def test_body_velocity_sensor(robot, source):
    """A sensor off the centre, turned by 2.5 deg; its gyro has a bias and reads 2 % too much."""
    angle, lever, bias, gain, shift = np.deg2rad(2.5), (0.2, -0.1), 0.015, 1.02, 0.008
    u, v, turn = wheel_twist(robot.wheel_velocity, robot.platform).T
    u, v = u - turn * lever[1], v + turn * lever[0]
    c, s = np.cos(angle), np.sin(angle)
    shown = np.column_stack([c * u + s * v, c * v - s * u, gain * turn + bias])
    shown = late(shown, robot.time, shift)
    shown += [0.005, 0.005, 0.003] * np.random.default_rng(4).standard_normal(shown.shape)
    found = body_against(changed(robot, body_velocity=shown), source)
    sign = 1 if source == "wheels" else -1
    assert abs(found.angle.value + sign * angle) < 2e-3
    assert abs(found.shift.value - sign * shift) < 1.5e-3
    assert abs(found.bias.value - sign * bias) < 1e-3
    assert abs(found.yaw.value - gain**sign) < 2e-3
    assert np.hypot(found.lever_x.value, found.lever_y.value) == pytest.approx(0.2236, abs=5e-3)
    for estimate in (found.angle, found.shift, found.bias, found.yaw, found.lever_x):
        assert estimate.se < 3e-3


def test_standard_errors_cover(robot):
    """Over fresh noise of the pose the estimates scatter as their standard errors say."""
    true = late(robot.pose, robot.time, 0.0)
    errors = []
    for seed in range(40):
        noise = np.random.default_rng(seed).standard_normal(true.shape) * [3e-3, 3e-3, 6e-3]
        found = pose_against_wheels(changed(robot, pose=true + noise))
        errors.append([(e.value, e.se) for e in (found.forward, found.shift, found.angle)])
    values, se = np.moveaxis(np.array(errors), 2, 0)
    ratio = np.std(values, axis=0) / np.mean(se, axis=0)
    assert np.all((ratio > 0.5) & (ratio < 1.6))


def test_unseen_axes_are_not_known():
    frame = simulate(ORDINARY["straight"], 20.0)
    time, pose = frame["time"].to_numpy(), frame.select(P).to_numpy()
    speeds = frame.select(V).to_numpy()
    found = pose_against_wheels(
        SimpleNamespace(time=time, starts=(0,), platform=youbot(), wheel_velocity=speeds, pose=pose)
    )
    assert set(found.scales) == {"forward"}


# What the doctor says


@pytest.mark.parametrize("columns", [[], P, R])
@pytest.mark.parametrize("factor", [0.8, 0.9, 1.1, 1.25])
def test_factor_of_all_wheels_is_told(tmp_path, factor, columns):
    log = load(tmp_path, scale(factor, *V)(good_frame()).drop(columns))
    (told,) = warnings(log)
    assert "on all axes alike" in told
    assert f"{1 / factor:.2f}" in told or f"{1 / factor:.1f}" in told
    assert ("look at the wheel speeds first" in told) == (not columns)


@pytest.mark.parametrize("motion", ["straight", "diagonal", "on the spot", "circle"])
def test_factor_shows_on_whatever_moves(tmp_path, motion):
    frame = scale(1.25, *V)(simulate(ORDINARY[motion], 20.0)).drop(R)
    assert any("0.80" in text for text in warnings(load(tmp_path, frame)))


@pytest.mark.parametrize("factor", [0.9, 1.1])
@pytest.mark.parametrize("columns", [[], R])
def test_scaled_time_is_told(tmp_path, factor, columns):
    log = load(tmp_path, scale(factor, "time")(good_frame()).drop(columns))
    (told,) = warnings(log)
    assert "on all axes alike" in told
    assert "time stamps scaled" in told
    assert ("by reference it is not" in told) == (not columns)


@pytest.mark.parametrize("columns", [[], P, R, P + R])
@pytest.mark.parametrize("factor", [0.9, 1.1])
def test_factor_of_one_wheel_is_told(tmp_path, factor, columns):
    log = load(tmp_path, scale(factor, V[1])(good_frame()).drop(columns))
    told = [text for text in warnings(log) if "neither reference" not in text]
    assert len(told) == 1
    assert f"wheel_velocity_fr: this wheel turns {factor:.1f}" in told[0]


def test_factor_of_one_wheel_on_a_straight_line(tmp_path):
    frame = scale(1.1, V[2])(simulate(ORDINARY["straight"], 20.0))
    told = [text for text in warnings(load(tmp_path, frame)) if "hardly any" not in text]
    assert len(told) == 1
    assert "wheel_velocity_rl: this wheel turns 1." in told[0]


def test_effects_of_the_library_are_left_to_it(tmp_path):
    """Wheels 5 % off, a lever 5 % off: effects that have names."""
    for spoil in (scale(1.05, V[0]), scale(0.95, *V), scale(1.05, "yaw")):
        assert not load(tmp_path, spoil(good_frame())).findings


def test_lever_and_slip_are_told_by_their_axis(tmp_path):
    yaw = warnings(load(tmp_path, scale(1.2, "yaw")(good_frame()).drop(R)))
    assert any("lever l + h" in text for text in yaw)


def test_shared_contradiction_is_told():
    log = Log.load(shared("broken-inputs", "wheels_x1.25_with_pose.csv"))
    assert any("0.800 times what the wheel speeds say, on all axes" in str(f) for f in log.findings)


def test_shared_sensor_is_measured():
    """A velocity sensor turned by 2.5 deg whose gyro reads 0.015 rad/s too much."""
    log = Log.load(shared("foreign-robot", "f07.train.parquet"))
    found = body_against(log)
    assert abs(found.angle.value + np.deg2rad(2.5)) < 1e-3
    assert abs(found.bias.value - 0.015) < 5e-4
