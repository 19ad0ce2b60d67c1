"""Kinematic calibration finds what was hidden in the kinematics, and says what it cannot find."""

import json
import subprocess
import sys
import warnings
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ident.kinematics import calibrate_kinematics
from ident.kinematics.fit import fit
from ident.kinematics.wheels import parameter_names, rolling
from ident.kinematics.windows import MOUNT, cut_windows, integrate, sparse
from ident.log import Log
from youbot_env.backend import NUMPY
from youbot_env.channels import channel_columns
from youbot_env.model import Model
from youbot_env.model_file import load_model
from youbot_env.platform import Platform, mecanum, omni3, youbot
from youbot_env.recording import record_motion
from youbot_env.references import make_reference
from youbot_env.simulation import AnalyticPlant, Sensors
from youbot_env.simulation.sensors import IDEAL

ROOT = Path(__file__).parents[1]
DATA = ROOT.parent / "shared" / "data"
RADII = {"e_fl": 0.01, "e_fr": -0.01, "e_rl": 0.005, "e_rr": 0.0}
STEEPER = {"e_fl": -0.01, "e_fr": 0.01, "e_rl": 0.01, "e_rr": -0.01}
MOUNTED = (0.03, -0.02, 0.05, 0.035)  # m, m, rad, s
TRUTH = np.array([0.01, -0.01, 0.005, 0.0, 0.015, 0.01, *MOUNTED])


def measured(
    platform: Platform,
    time: np.ndarray,
    speed: np.ndarray,
    pose: np.ndarray,
    seed: int = 0,
    mount: tuple = (0.0, 0.0, 0.0, 0.0),
    sensors: Sensors | None = None,
) -> Log:
    """What sensors show of wheel speeds (N, n) and poses (N, 3) of O."""
    sensors = sensors or Sensors()
    x, y, turn, delay = mount
    late = np.stack([np.interp(time - delay, time, part) for part in pose.T], axis=1)
    c, s = np.cos(late[:, 2]), np.sin(late[:, 2])
    late += np.stack([c * x - s * y, s * x + c * y, np.full_like(c, turn)], axis=1)
    wheels, camera = (
        np.random.default_rng(child) for child in np.random.SeedSequence(seed).spawn(2)
    )
    return Log(
        "made",
        platform,
        time,
        sensors.read_wheel_velocity(speed, wheels),
        pose=sensors.read_pose(late, camera),
    )


def rolled(
    motion: str,
    platform: Platform | None = None,
    seconds: float = 40.0,
    dt: float = 0.01,
    **options,
) -> tuple:
    """Time, wheel speeds and poses of a robot that follows a motion exactly, without slip."""
    platform = platform or youbot()
    time = np.arange(round(seconds / dt)) * dt
    motion = make_reference(motion, **options).sample(time, seed=3)
    twist = np.stack(motion.twist(NUMPY), axis=1)
    return time, twist @ platform.jacobian_array.T, np.stack(motion.pose, axis=1)


def exact_record(model: Model, seconds: float) -> tuple:
    """Time, wheel speeds and poses of a plant that follows a random motion, without noise."""
    plant = AnalyticPlant(model, 0.01)
    columns = record_motion(plant, make_reference("smooth_random"), seconds, seed=0)
    names = channel_columns(model.platform)
    channels = (names[channel] for channel in ("wheel_velocity", "pose"))
    return columns["time"], *(np.stack([columns[n] for n in group], axis=1) for group in channels)


@pytest.fixture(scope="module")
def driven():
    """Exact record of a plant with wrong radii, base and roller angles."""
    model = load_model("paper").with_effects(
        {
            "wheel_radius_error": RADII,
            "base_geometry_error": 0.015,
            "roller_angle_error": STEEPER,
        }
    )
    return model, *exact_record(model, 60.0)


def test_hidden_errors_of_a_simulated_robot_are_found(driven):
    model, *record = driven
    log = measured(model.platform, *record, mount=MOUNTED)
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        found = calibrate_kinematics(log)
    values = found.fit.values
    assert np.abs(values[:4] - TRUTH[:4]).max() < 1e-3
    assert values[4] == pytest.approx(0.015, abs=2e-3)
    assert values[5] == pytest.approx(0.01, abs=2e-3)
    assert np.abs(values[6:8] - MOUNTED[:2]).max() < 2e-3
    assert values[8] == pytest.approx(MOUNTED[2], abs=2e-3)
    assert values[9] == pytest.approx(MOUNTED[3], abs=2e-3)
    radius = found.parameters["wheel_radius_fr"]
    assert radius.value == pytest.approx(0.0475 * 0.99, rel=1e-3)
    assert radius.ci95[0] < radius.value < radius.ci95[1] < 0.0475
    assert found.undetermined == ()
    assert not found.ripple.seen
    # Noise of one pose is 1 mm and 2 mrad; what is left of the errors hides below it.
    assert found.fit.noise[0] == pytest.approx(1e-3, rel=0.1)
    assert found.fit.noise[1] == pytest.approx(2e-3, rel=0.1)
    assert (
        found.drifts["after"].position_per_metre < 0.3 * found.drifts["before"].position_per_metre
    )
    assert found.drifts["after"].heading_per_turn < 0.3 * found.drifts["before"].heading_per_turn


def test_result_serves_as_effects_and_as_platform(driven):
    model, *record = driven
    found = calibrate_kinematics(measured(model.platform, *record, mount=MOUNTED))
    nominal = load_model("paper")
    as_effects = nominal.with_effects(found.effects())
    as_platform = found.model(nominal)
    speeds = []
    for made in (as_effects, as_platform, model):
        plant = AnalyticPlant(made, 0.01)
        plant.reset(velocity=(0.2, -0.3, 0.4))
        speeds.append(plant.wheel_velocity)
    np.testing.assert_allclose(speeds[0], speeds[1], rtol=1e-9)
    np.testing.assert_allclose(speeds[0], speeds[2], atol=0.01)  # of 14 rad/s
    assert found.platform().lever == pytest.approx(found.parameters["lever"].value, rel=0.02)


def test_held_out_log_is_judged_with_the_calibration_of_the_other(driven):
    model, time, speed, pose = driven
    log = measured(model.platform, time, speed, pose, mount=MOUNTED)
    fitted, held_out = log.part(0.0, 40.0), log.part(40.0, 60.0)
    found = calibrate_kinematics(fitted, test=held_out)
    assert (
        found.drifts["test_after"].position_per_metre
        < 0.4 * found.drifts["test_before"].position_per_metre
    )
    driven_way = np.hypot(*np.diff(pose[4030:5970, :2], axis=0).T).sum()
    assert found.drifts["test_after"].way == pytest.approx(driven_way, rel=0.01)


def test_intervals_hold(driven):
    model, *record = driven
    values, halves = [], []
    for seed in range(12):
        estimate = fit(
            cut_windows(measured(model.platform, *record, seed, MOUNTED), 2.0), model.platform
        )
        values.append(estimate.values)
        halves.append([estimate.uncertainty(row)[1] for row in np.eye(len(TRUTH))])
    inside = np.abs(np.array(values) - TRUTH) < np.array(halves)
    assert 0.88 < inside.mean() <= 1.0
    # Not by being wide: half widths are about two standard deviations of the estimates.
    ratio = np.mean(halves, axis=0) / np.std(values, axis=0)
    assert 1.5 < np.median(ratio) < 4.0


def test_derivatives_are_exact():
    rng = np.random.default_rng(5)
    platform = youbot()
    values = rng.uniform(-0.02, 0.02, len(parameter_names(platform)))
    exact = rolling(platform, values)
    step = 1e-6
    for k in range(len(values)):
        ends = [
            rolling(platform, values + sign * step * np.eye(len(values))[k]) for sign in (1, -1)
        ]
        for part, slope in (
            ("odometry", "odometry_slope"),
            ("contradiction", "contradiction_slope"),
        ):
            change = (getattr(ends[0], part) - getattr(ends[1], part)).ravel() / (2 * step)
            np.testing.assert_allclose(getattr(exact, slope)[:, k], change, atol=1e-7)
    speed, lengths = rng.normal(size=(2, 50, 4)), np.full((2, 49), 0.02)
    W = exact.odometry
    way = integrate(lengths, speed, W)
    for i, j in np.ndindex(W.shape):
        moved = W.copy()
        moved[i, j] += step
        other = integrate(lengths, speed, moved, slopes=False)
        change = (other.place - way.place) / step
        np.testing.assert_allclose(way.place_slope[:, :, :, i, j], change, atol=1e-4)


def test_motion_without_turning_leaves_base_and_offset_open():
    log = measured(youbot(), *rolled("III"), mount=MOUNTED)
    with pytest.warns(UserWarning, match="base geometry"):
        found = calibrate_kinematics(log)
    assert "x offset of the sensor" in found.undetermined[0]
    assert any("hardly moves in yaw" in words for words in found.undetermined)
    for quantity in (found.parameters["lever"], found.mount["offset_x"], found.gains["yaw"]):
        assert quantity.ci95 is None
    assert found.parameters["base_error"].value == pytest.approx(0.0, abs=1e-4)
    # What translation shows is found as well as ever.
    assert found.mount["offset_yaw"].value == pytest.approx(MOUNTED[2], abs=1e-3)
    assert found.mount["delay"].value == pytest.approx(MOUNTED[3], abs=2e-3)
    assert found.parameters["wheel_radius"].ci95 is not None


def test_turning_on_the_spot_does_not_tell_where_the_sensor_looks():
    time, _, pose = rolled("I")
    pose[:, :2] = 0.0
    twist = np.gradient(pose[:, 2], time)[:, None] * [0.0, 0.0, 1.0]
    log = measured(youbot(), time, twist @ youbot().jacobian_array.T, pose)
    with pytest.warns(UserWarning, match="yaw offset of the sensor"):
        found = calibrate_kinematics(log)
    assert found.mount["offset_yaw"].ci95 is None
    assert found.parameters["wheel_radius"].ci95 is None  # only R over L is seen
    assert found.gains["yaw"].value == pytest.approx(1.0, abs=2e-3)


def test_rollers_show_as_gains_and_not_as_radii():
    phases = {"phi0_fl": 0.1, "phi0_fr": -0.4, "phi0_rl": 0.5, "phi0_rr": 0.3}
    model = load_model("paper").with_effects({"roller_ripple": {"size": 1.0, **phases}})
    log = measured(model.platform, *exact_record(model, 40.0))
    found = calibrate_kinematics(log)
    assert found.finite_rollers
    assert found.ripple.seen
    assert found.ripple.size == pytest.approx(1.0, abs=0.03)
    np.testing.assert_allclose(found.ripple.phases, list(phases.values()), atol=0.02)
    # A roller carries the wheel over the chord of its arc: 2 sin(30 deg) in place of 60 deg.
    assert found.gains["forward"].value == pytest.approx(1.0, abs=2e-3)
    assert 1 / found.gains["sideways"].value == pytest.approx(np.pi / 3, abs=3e-3)
    assert np.abs(found.fit.values[:6]).max() < 3e-3
    assert "not a wrong radius" in found.remarks[0]
    assert found.effects()["roller_ripple"]["size"] == found.ripple.size
    followed, after = (found.drifts[name].heading_per_turn for name in ("followed", "after"))
    assert followed < 0.5 * after
    # Ideal rollers in place of them take it for steeper rollers.
    nearest = calibrate_kinematics(log, finite_rollers=False)
    assert nearest.parameters["roller_angle_error"].value > 0.015
    assert nearest.gains["sideways"].value == pytest.approx(found.gains["sideways"].value, abs=3e-3)
    assert "not a wrong radius" in nearest.remarks[0]


def test_a_wheel_at_another_place_is_more_than_the_values_can_explain():
    platform = youbot()
    moved = replace(platform, wheels=(replace(platform.wheels[0], y=0.16), *platform.wheels[1:]))
    time, speed, pose = rolled("smooth_random", moved)
    good = calibrate_kinematics(measured(moved, time, speed, pose))
    bad = calibrate_kinematics(measured(platform, time, speed, pose))
    assert good.fit.surplus.rank == bad.fit.surplus.rank == 3
    assert good.fit.surplus.widening == 1.0
    assert bad.fit.surplus.p_value < 0.01
    assert bad.fit.surplus.widening > 5.0
    assert any("do not explain everything" in words for words in bad.remarks)


def test_any_table_of_wheels_is_calibrated():
    platform = omni3()
    true = replace(platform, wheel_radius=1.01 * platform.wheel_radius)
    time, speed, pose = rolled("smooth_random", true)
    with pytest.warns(UserWarning, match="roller angle"):
        found = calibrate_kinematics(measured(platform, time, speed, pose))
    assert found.parameters["wheel_radius"].value == pytest.approx(true.wheel_radius, rel=1e-3)
    assert found.ripple is None
    assert found.fit.surplus.widening == 1.0


def test_held_poses_gaps_and_dense_records_are_understood():
    time, speed, pose = rolled("smooth_random")
    held = pose[np.arange(len(pose)) // 4 * 4]  # a camera of 25 Hz in a log of 100 Hz
    log = measured(youbot(), time, speed, held, sensors=IDEAL)
    assert calibrate_kinematics(log).mount["delay"].value == pytest.approx(0.0, abs=1e-3)
    keep = np.abs(time - 20.0) > 1.0
    gap = measured(youbot(), time[keep], speed[keep], pose[keep], mount=MOUNTED)
    gap = replace(gap, starts=(0, int(np.argmax(time[keep] > 20.0))))
    found = calibrate_kinematics(gap)
    assert found.mount["delay"].value == pytest.approx(MOUNTED[3], abs=2e-3)
    assert found.parameters["wheel_radius"].value == pytest.approx(0.0475, rel=1e-3)
    dense = measured(youbot(), *rolled("smooth_random", seconds=20.0, dt=1e-3), mount=MOUNTED)
    assert sparse(dense).dt == pytest.approx(8e-3)
    found = calibrate_kinematics(dense)
    assert found.mount["delay"].value == pytest.approx(MOUNTED[3], abs=2e-3)


def test_sensor_mounted_backwards_is_found():
    log = measured(youbot(), *rolled("smooth_random"), mount=(0.1, 0.05, 3.0, 0.0))
    mount = calibrate_kinematics(log).mount
    assert mount["offset_yaw"].value == pytest.approx(3.0, abs=2e-3)
    assert mount["offset_x"].value == pytest.approx(0.1, abs=2e-3)


def test_a_pose_from_the_wheels_is_suspected():
    found = calibrate_kinematics(measured(youbot(), *rolled("smooth_random"), sensors=IDEAL))
    assert any("computed from them" in words for words in found.remarks)


def test_bad_logs_are_refused_with_the_reason():
    time, speed, pose = rolled("smooth_random")
    log = measured(youbot(), time, speed, pose)
    without = replace(log, wheel_velocity=None, body_velocity=np.zeros_like(pose))
    with pytest.raises(ValueError, match="no wheel speeds"):
        calibrate_kinematics(without)
    with pytest.raises(ValueError, match="no pose"):
        calibrate_kinematics(replace(log, pose=None))
    with pytest.raises(ValueError, match="no contiguous piece"):
        calibrate_kinematics(log.part(0.0, 1.5))
    with pytest.raises(ValueError, match="signs, units and order"):
        calibrate_kinematics(replace(log, wheel_velocity=1.7 * speed))
    with pytest.raises(ValueError, match=r"has wheels .* give the platform of the log"):
        calibrate_kinematics(log, omni3())
    with pytest.raises(ValueError, match=r"determines no kinematic value|do not move"):
        calibrate_kinematics(measured(youbot(), time, 0.0 * speed, 0.0 * pose))
    with pytest.raises(ValueError, match="position of the pose moves"):
        calibrate_kinematics(replace(log, pose=log.pose * [1000.0, 1000.0, 1.0]))
    with pytest.raises(ValueError, match="pose"):
        calibrate_kinematics(replace(log, pose=log.pose * [1.0, 1.0, -1.0]))
    late = measured(youbot(), time, speed, pose, mount=(0.0, 0.0, 0.0, 0.6))
    with pytest.raises(ValueError, match="align the clocks"):
        calibrate_kinematics(late)


def test_command_prints_and_writes(tmp_path):
    platform = mecanum("youbot", 0.15, 0.2355, 0.0475 * 1.01, 0.014, 1.4)
    time, speed, pose = rolled("smooth_random", platform)
    log = measured(youbot(), time, speed, pose, mount=MOUNTED)
    log = replace(log, wheel_torque=0.1 * speed + np.gradient(speed, time, axis=0) * 0.03)
    path, out, answer = log.save(tmp_path / "a.csv"), tmp_path / "m.yaml", tmp_path / "a.json"
    arguments = [str(path), "--out", str(out), "--json", str(answer)]
    done = subprocess.run(
        [sys.executable, "scripts/calibrate_kinematics.py", *arguments],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert done.returncode == 0, done.stderr
    assert "forward" in done.stdout
    data = json.loads(answer.read_text())
    assert data["parameters"]["wheel_radius"]["value"] == pytest.approx(0.047975, rel=1e-3)
    assert load_model(out).platform.wheel_radius == pytest.approx(0.047975, rel=1e-3)
    assert set(data["mount"]) == set(MOUNT)


def test_bundled_log_of_rollers_has_the_radii_of_the_drawing():
    found = calibrate_kinematics(Log.load(ROOT / "ident" / "logs" / "youbot_fit.csv"))
    # Driven rollers creep: over ten logs of this robot the radius comes out 0.08 % small, and the
    # interval is 0.06 % to either side.
    for name, true, creep in (("wheel_radius", 0.0475, 1e-3), ("lever", 0.3855, 0.0)):
        low, high = found.parameters[name].ci95
        assert low < true
        assert high > (1 - creep) * true
        assert high - low < 0.004 * true
    radii = found.fit.values[:4]
    assert np.abs(radii).max() < 3e-3  # without the rollers' phases it is 10e-3
    assert 1 / found.gains["sideways"].value == pytest.approx(np.pi / 3, abs=4e-3)


@pytest.mark.skipif(not (DATA / "roller-robot").is_dir(), reason="logs are not present")
def test_robot_with_real_rollers():
    name = DATA / "roller-robot" / "a-nothing-hidden"
    log, test = Log.load(f"{name}.train.csv"), Log.load(f"{name}.test.csv")
    found = calibrate_kinematics(log, test=test)
    assert found.gains["forward"].value == pytest.approx(1.0, abs=0.01)
    # Rollers alone give 1.047 and 1.029; this robot creeps sideways under its load beyond that.
    assert 1.04 < 1 / found.gains["sideways"].value < 1.09
    assert 1.02 < 1 / found.gains["yaw"].value < 1.05
    assert found.ripple.seen
    assert "not a wrong radius" in found.remarks[0]
    low, high = found.parameters["wheel_radius"].ci95
    assert low < 0.0475 < high
    assert (
        found.drifts["test_after"].position_per_metre
        < 0.4 * found.drifts["test_before"].position_per_metre
    )
    assert (
        found.drifts["test_after"].heading_per_turn
        < 0.6 * found.drifts["test_before"].heading_per_turn
    )


@pytest.mark.skipif(not (DATA / "ftc-mecanum").is_dir(), reason="logs are not present")
def test_log_with_body_velocities_alone_is_refused():
    log = Log.load(DATA / "ftc-mecanum" / "square.csv")
    with pytest.raises(ValueError, match="no wheel speeds"):
        calibrate_kinematics(log)
