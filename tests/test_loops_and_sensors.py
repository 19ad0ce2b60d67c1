"""Wheel loops and sensors of the simulated robot."""

import math

import numpy as np
import paper_equations as paper
import pytest

from youbot_env.backend import FLOAT
from youbot_env.model import Model
from youbot_env.parameters import Parameters
from youbot_env.platform import youbot
from youbot_env.simulation import AnalyticPlant, Sensors, WheelLoop
from youbot_env.simulation.sensors import IDEAL

SIZES = paper.Sizes()


NAMES = ("m0", "I0", "I1", "a_x", "a_y", "mu1", "mu2")


VALUES = dict(zip(NAMES, (35.3, 4.4, 6e-3, 0.016, -0.026, 0.11, 5.78e-3), strict=True))


MODEL = Model(youbot(), Parameters(**VALUES))


def drive_by_loops(model, twists, loop=WheelLoop(), dt=0.01):  # noqa: B008  frozen
    """Torques (N, n) and wheel speeds (N, n) while wheel loops follow body velocities."""
    plant, integral = AnalyticPlant(model, dt), (0.0,) * len(model.platform.wheels)
    torques, speeds = [], []
    for twist in twists:
        speed = plant.wheel_velocity
        torque, integral = loop.torque(
            model.platform.geometry.wheel_velocity(tuple(twist)), tuple(speed.tolist()), integral,
            dt, FLOAT,
        )  # fmt: skip
        torques.append(torque)
        speeds.append(speed)
        plant.step(np.array(torque))
    return np.array(torques), np.array(speeds)


@pytest.mark.parametrize("effects", [{}, {"wheel_coulomb_friction": 0.3, "floor_slope": 0.01}])
def test_wheel_loops_hold_a_speed_but_for_the_droop_of_their_leak(effects):
    twist, loop = (0.25, 0.1, -0.3), WheelLoop()
    torques, speeds = drive_by_loops(MODEL.with_effects(effects), [twist] * 6000)
    wanted = paper.jacobian(SIZES) @ twist
    # The platform turns, so that on a slope the torques go on changing.
    droop = torques[-1] / (loop.kp + loop.ki * loop.leak)
    np.testing.assert_allclose(wanted - speeds[-1], droop, atol=6e-3 if effects else 1e-4)
    assert np.abs(droop).max() < 0.012 * np.abs(wanted).max()
    error = np.abs(speeds - wanted).max(axis=1)
    assert error[30:].max() < 0.25 * np.abs(wanted).max()  # after 0.3 s
    assert speeds.max() < 1.25 * wanted.max()  # and without much overshoot


def test_perfect_integrators_hold_a_speed_without_error():
    twist = (0.25, 0.1, -0.3)
    _, speeds = drive_by_loops(MODEL, [twist] * 500, WheelLoop(leak=math.inf))
    np.testing.assert_allclose(speeds[-1], paper.jacobian(SIZES) @ twist, atol=1e-4)


def test_what_wheels_hold_against_each_other_leaks_away():
    against = np.array([1.0, 1.0, -1.0, -1.0]) / 4
    twists = [(0.6, 0.3, 0.5)] * 4000  # from rest at once, so that the start reaches the limit
    torques, _ = drive_by_loops(MODEL, twists, WheelLoop(leak=math.inf))
    assert np.abs(torques[100:] @ against).min() > 0.1  # for ever
    held = drive_by_loops(MODEL, twists)[0] @ against
    fall = held[600:1100] / held[100:600]  # over 5 s, the leak
    np.testing.assert_allclose(fall, math.exp(-1.0), rtol=2e-2)


def test_wheel_loops_follow_slow_motions_closely():
    t = np.arange(0, 10, 0.01)
    twists = np.column_stack([0.3 * np.sin(t), 0.2 * np.cos(1.3 * t), 0.5 * np.sin(0.7 * t)])
    _, speeds = drive_by_loops(MODEL, twists)
    wanted = twists @ paper.jacobian(SIZES).T
    error = (speeds - wanted)[100:]
    assert np.sqrt(np.mean(error**2)) < 0.1 * np.sqrt(np.mean(wanted**2))


def test_loop_law_is_proportional_and_integral():
    loop, dt = WheelLoop(kp=0.5, ki=2.0, limit=10.0, leak=math.inf), 0.02
    integral = (0.0, 0.0)
    errors = np.array([[1.0, -0.4], [0.5, 0.3], [-0.2, 0.1]])
    for k, error in enumerate(errors):
        torque, integral = loop.torque(tuple(error), (0.0, 0.0), integral, dt, FLOAT)
        total = 0.5 * error + 2.0 * dt * errors[: k + 1].sum(axis=0)
        np.testing.assert_allclose(torque, total, rtol=1e-12)


def test_loops_do_not_wind_up():
    loop = WheelLoop(limit=1.0)
    far, near = [(5.0, 0.0, 0.0)] * 500, [(0.1, 0.0, 0.0)] * 300
    torques, speeds = drive_by_loops(MODEL, far + near, loop)
    np.testing.assert_allclose(torques[100:500], 1.0)  # at the limit, all the time
    assert torques.max() <= 1.0
    assert torques[500].max() < 0.0  # and off it with the first sample of the new reference
    # A loop that had integrated those 5 s of error would hold the limit for as long.
    wanted = 0.1 / SIZES.R
    assert np.abs(speeds[550:] - wanted).max() < 0.15 * speeds[499].max()
    np.testing.assert_allclose(speeds[-1], wanted, rtol=0.02)


def test_sensors_have_the_noise_and_the_steps_they_state():
    sensors, rng, count = Sensors(), np.random.default_rng(0), 40_000
    truth = rng.uniform(-3, 3, (count, 4))
    for read, noise, step in (
        (sensors.read_wheel_velocity, sensors.wheel_velocity, sensors.wheel_velocity_step),
        (sensors.read_wheel_torque, sensors.wheel_torque, sensors.wheel_torque_step),
    ):
        shown = read(truth, np.random.default_rng(1))
        ticks = shown / step
        np.testing.assert_allclose(ticks, np.round(ticks), atol=1e-6)
        error = shown - truth
        np.testing.assert_allclose(error.std(axis=0), math.hypot(noise, step / 12**0.5), rtol=0.02)
        np.testing.assert_allclose(error.mean(axis=0), 0.0, atol=4 * noise / count**0.5)
        correlation = np.corrcoef(np.vstack([error.T, np.roll(error[:, 0], 1)]))
        assert np.abs(correlation - np.eye(5)).max() < 0.025  # white, and apart between wheels
        quartiles = np.quantile(error, [0.25, 0.75]) / noise
        np.testing.assert_allclose(quartiles, [-0.674, 0.674], rtol=0.05)  # normal
    pose = sensors.read_pose(np.zeros((count, 3)), rng)
    np.testing.assert_allclose(pose.std(axis=0), [1e-3, 1e-3, 2e-3], rtol=0.03)


def test_sensors_round_to_the_nearest_step():
    sensors = Sensors(wheel_velocity=0.0, wheel_velocity_step=0.5)
    shown = sensors.read_wheel_velocity(np.array([0.2, 0.3, -0.8]), np.random.default_rng(0))
    np.testing.assert_array_equal(shown, [0.0, 0.5, -1.0])


def test_ideal_sensors_show_the_truth_and_equal_seeds_the_same():
    truth, rng = np.random.default_rng(0).normal(size=(50, 4)), np.random.default_rng(1)
    np.testing.assert_array_equal(IDEAL.read_wheel_velocity(truth, rng), truth)
    np.testing.assert_array_equal(IDEAL.read_wheel_torque(truth, rng), truth)
    np.testing.assert_array_equal(IDEAL.read_pose(truth[:, :3], rng), truth[:, :3])
    reads = [Sensors().read_wheel_torque(truth, np.random.default_rng(seed)) for seed in (5, 5, 6)]
    np.testing.assert_array_equal(reads[0], reads[1])
    assert not np.array_equal(reads[0], reads[2])
