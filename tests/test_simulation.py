"""Simulation: energy, exact solutions, wheel loops, sensors, and steps that fit the model."""

import math

import numpy as np
import paper_equations as paper
import pytest
from scipy.integrate import solve_ivp

from youbot_env import dynamics
from youbot_env.effects.wheel_coulomb_friction import WIDTH
from youbot_env.model import Model
from youbot_env.parameters import ImpossibleParameters, Parameters
from youbot_env.platform import omni3, youbot
from youbot_env.simulation import AnalyticPlant, choose_substeps
from youbot_env.simulation.analytic import STEP_FRACTION, fastest_rate

SIZES = paper.Sizes()
NAMES = ("m0", "I0", "I1", "a_x", "a_y", "mu1", "mu2")
VALUES = dict(zip(NAMES, (35.3, 4.4, 6e-3, 0.016, -0.026, 0.11, 5.78e-3), strict=True))
MODEL = Model(youbot(), Parameters(**VALUES))
OMNI = Model(omni3(), Parameters(6.0, 0.12, 2e-3, 0.01, 0.005, 0.02, 1e-3))
REDUNDANT = np.array([1.0, 1.0, -1.0, -1.0])


def energy(model, v):
    theta = model.parameters.theta(model.platform)
    return dynamics.kinetic_energy(model.platform.geometry, theta, tuple(v))


def losses(model, v):
    """Power that wheels and rollers turn into heat, W, for velocities (..., 3)."""
    p, geometry = model.parameters, model.platform.geometry
    wheels, rollers = (
        v @ np.transpose(geometry.jacobian),
        v @ np.transpose(geometry.roller_jacobian),
    )
    power = p.mu1 * wheels**2 + p.mu2 * rollers**2
    for active in model.effects:
        assert active.identifier == "wheel_coulomb_friction"
        power = power + active.values["fc"] * wheels * np.tanh(wheels / WIDTH)
    return power.sum(axis=-1)


@pytest.mark.parametrize(
    "model",
    [MODEL, OMNI, MODEL.with_effects({"wheel_coulomb_friction": 0.2}, name="dry")],
    ids=["youbot", "omni3", "dry friction"],
)
def test_power_balance_over_ten_seconds(model):
    """Work of the shaft torques is the change of kinetic energy and the heat of the friction."""
    dt, hold = 1e-3, 10
    plant, rng = AnalyticPlant(model, dt), np.random.default_rng(0)
    size = len(model.platform.wheels)
    amplitude, phase = rng.uniform(0.2, 1.5, size), rng.uniform(0, 6, size)
    velocity, work = [plant.velocity], 0.0
    for k in range(10_000):
        # Held over pairs of samples, within which Simpson's rule may then be used.
        t = dt * hold * (k // hold)
        torque, angle = amplitude * np.sin(2.0 * t + phase), plant.wheel_angle
        plant.step(torque)
        work += torque @ (plant.wheel_angle - angle)
        velocity.append(plant.velocity)
    heat = losses(model, np.array(velocity))
    heat = dt / 3 * np.sum(heat[:-2:2] + 4 * heat[1:-1:2] + heat[2::2])
    assert energy(model, velocity[-1]) > 1e-4
    assert work == pytest.approx(heat + energy(model, velocity[-1]), rel=1e-5)


@pytest.mark.parametrize("model", [MODEL, OMNI], ids=["youbot", "omni3"])
def test_left_alone_it_slows_down_without_end(model):
    plant = AnalyticPlant(model)
    plant.reset(velocity=(0.5, -0.4, 1.5))
    levels = []
    for _ in range(300):
        levels.append(energy(model, plant.velocity))
        plant.step(np.zeros(len(model.platform.wheels)))
    assert np.all(np.diff(levels) < 0)
    assert levels[-1] < 1e-6 * levels[0]


@pytest.mark.parametrize("platform", [youbot(), omni3()], ids=lambda p: p.name)
def test_without_friction_and_spin_it_is_a_free_rigid_body(platform):
    model = Model(platform, Parameters(20.0, 1.5, 0.0, 0.05, -0.03, 0.0, 0.0))
    plant, theta = AnalyticPlant(model), model.parameters.theta(platform)

    def momenta():
        """Linear and angular momentum about the origin of the world."""
        x, y, yaw = plant.pose
        vx, vy, om = plant.velocity
        c, s = math.cos(yaw), math.sin(yaw)
        px, py = theta.m0 * vx - theta.may * om, theta.m0 * vy + theta.max * om
        wx, wy = c * px - s * py, s * px + c * py
        spin = theta.I0 * om + theta.max * vy - theta.may * vx
        return np.array([wx, wy, spin + x * wy - y * wx])

    plant.reset(pose=(1.0, -2.0, 0.7), velocity=(0.6, -0.3, 2.0))
    before, kinetic = momenta(), energy(model, plant.velocity)
    for _ in range(500):
        plant.step(np.zeros(len(platform.wheels)))
    assert abs(plant.pose[2]) > 5.0
    np.testing.assert_allclose(momenta(), before, rtol=1e-7)
    assert energy(model, plant.velocity) == pytest.approx(kinetic, rel=1e-8)


def test_torques_against_each_other_move_nothing():
    plant = AnalyticPlant(MODEL)
    for k in range(200):
        plant.step(3.0 * math.sin(0.1 * k) * REDUNDANT)
    np.testing.assert_array_equal(plant.motion(), np.zeros(6))
    plant.reset(velocity=(0.2, 0.1, -0.5))
    other = AnalyticPlant(MODEL)
    other.reset(velocity=(0.2, 0.1, -0.5))
    for k in range(100):
        torque = np.array([math.sin(0.05 * k), 0.4, -0.3, math.cos(0.07 * k)])
        plant.step(torque)
        other.step(torque + 2.0 * REDUNDANT)
    np.testing.assert_allclose(other.motion(), plant.motion(), atol=1e-12)


def exact(commands, dt, start, delay=0.0, lag=0.0, coulomb=0.0):
    """Motions (N + 1, 6) of the robot of eq. (4) by an integrator of high order.

    The torque that the lag makes of the command is integrated along; the interval is split where
    a delayed command arrives.
    """
    inverse = np.linalg.inv(paper.mass_matrix(SIZES, VALUES))
    J = paper.jacobian(SIZES)

    def rates(_, z, command):
        yaw, v, torque = z[2], z[3:6], z[6:10] if lag else command
        wheels = J @ v
        forces = paper.wrench(SIZES, torque - coulomb * np.tanh(wheels / WIDTH))
        change = inverse @ (forces - paper.remaining(SIZES, VALUES, v))
        c, s = math.cos(yaw), math.sin(yaw)
        moved = (c * v[0] - s * v[1], s * v[0] + c * v[1], v[2])
        return np.concatenate([moved, change, (command - torque) / lag if lag else np.zeros(4)])

    z, whole = np.concatenate([start, np.zeros(4)]), math.floor(delay / dt)
    part, rows = delay - whole * dt, [start]
    padded = np.vstack([np.zeros((whole + 1, 4)), commands])
    for k in range(len(commands)):
        for command, length in ((padded[k], part), (padded[k + 1], dt - part)):
            if length > 0:
                solved = solve_ivp(
                    rates, (0, length), z, "DOP853", first_step=length, args=(command,),
                    rtol=1e-12, atol=1e-11,
                )  # fmt: skip
                z = solved.y[:, -1]
        rows.append(z[:6])
    return np.array(rows)


CASES = {  # seconds, tolerance, effects, the same for ``exact``
    "plain": (10.0, 1e-6, {}, {}),
    "lag": (2.0, 1e-6, {"actuator_lag": 0.03}, {"lag": 0.03}),
    "delay": (2.0, 1e-6, {"actuator_delay": 0.013}, {"delay": 0.013}),
    "delay of two samples": (2.0, 1e-6, {"actuator_delay": 0.02}, {"delay": 0.02}),
    "delay and lag": (
        10.0, 1e-6, {"actuator_delay": 0.027, "actuator_lag": 0.02}, {"delay": 0.027, "lag": 0.02}
    ),
    # A wheel runs through the steep part of this law within less than a step.
    "dry friction": (1.0, 5e-5, {"wheel_coulomb_friction": 0.2}, {"coulomb": 0.2}),
}  # fmt: skip


@pytest.mark.parametrize("case", CASES)
def test_state_is_that_of_an_exact_integrator(case):
    seconds, tolerance, effects, physics = CASES[case]
    dt, rng = 0.01, np.random.default_rng(3)
    count = round(seconds / dt)
    time = dt * np.arange(count)[:, None]
    slow = np.sin(time * (0.9, 1.3, 1.7, 2.1) + (0, 1, 2, 3))
    commands = 1.2 * slow + rng.uniform(-0.5, 0.5, (count, 4))  # another torque every sample
    start = np.array([0.3, -0.2, 0.5, 0.2, -0.1, 0.4])
    plant = AnalyticPlant(MODEL.with_effects(effects), dt)
    plant.reset(start[:3], start[3:])
    rows = [plant.motion().copy()]
    for command in commands:
        plant.step(command)
        rows.append(plant.motion().copy())
    expected = exact(commands, dt, start, **physics)
    assert np.ptp(expected[:, 3:], axis=0).min() > 0.15
    np.testing.assert_allclose(rows, expected, atol=tolerance)


def test_wheel_angles_are_the_integral_of_wheel_speeds():
    plant = AnalyticPlant(MODEL, 0.01)
    speeds = [plant.wheel_velocity]
    for k in range(400):
        plant.step(np.array([1.0, 0.5, -0.4, 0.8]) * math.sin(0.05 * (k // 2)))
        speeds.append(plant.wheel_velocity)
    speeds = np.array(speeds)
    angle = 0.01 / 3 * np.sum(speeds[:-2:2] + 4 * speeds[1:-1:2] + speeds[2::2], axis=0)
    np.testing.assert_allclose(plant.wheel_angle, angle, rtol=1e-4)
    np.testing.assert_allclose(
        plant.wheel_velocity, paper.jacobian(SIZES) @ plant.velocity, atol=1e-12
    )


def test_fastest_rate_is_that_of_the_friction():
    centred = Parameters(**(VALUES | {"a_x": 0.0, "a_y": 0.0}))
    mass = np.diag(paper.mass_matrix(SIZES, centred.as_dict()))
    rates = np.array(paper.friction(SIZES, centred.mu1, centred.mu2)) / mass
    assert fastest_rate(Model(youbot(), centred)) == pytest.approx(rates.max(), rel=1e-6)


def test_stiff_effects_get_smaller_steps():
    assert choose_substeps(MODEL, 0.01) == 1
    assert choose_substeps(MODEL.with_effects({"actuator_lag": 0.001}), 0.01) == math.ceil(
        0.01 / 0.001 / STEP_FRACTION
    )
    steps = [
        choose_substeps(MODEL.with_effects({"wheel_coulomb_friction": size}), 0.01)
        for size in (0.1, 0.5, 2.5)
    ]
    assert steps[0] > 1
    assert np.all(np.diff(steps) > 0)
    # Ever more friction at rest: what drives it apart is the slope at zero, fc / WIDTH.
    steep = MODEL.with_effects({"wheel_coulomb_friction": 2.5})
    extra = 2.5 / WIDTH / VALUES["mu1"]
    assert fastest_rate(steep) > 0.3 * extra * fastest_rate(MODEL)
    assert choose_substeps(MODEL, 0.1) > 1


@pytest.mark.parametrize("size", [0.2, 1.5])
def test_steep_friction_neither_rings_nor_creeps(size):
    plant = AnalyticPlant(MODEL.with_effects({"wheel_coulomb_friction": size}))
    plant.reset(velocity=(0.3, 0.2, 0.5))
    speeds = []
    for _ in range(200):
        plant.step(np.zeros(4))
        speeds.append(np.abs(plant.wheel_velocity).max())
    assert np.all(np.diff(speeds) <= 1e-12)
    assert speeds[-1] < 1e-3


def test_reset_forgets_commands_on_their_way():
    plant = AnalyticPlant(MODEL.with_effects({"actuator_delay": 0.05, "actuator_lag": 0.05}))
    fresh = plant.motion().copy()
    for _ in range(20):
        plant.step(np.full(4, 2.0))
    assert plant.motion()[0] > 0
    plant.reset()
    assert plant.t == 0.0
    for _ in range(10):
        plant.step(np.zeros(4))
    np.testing.assert_array_equal(plant.motion(), fresh)


def test_set_model_gives_the_plant_of_that_model():
    plant, torque = AnalyticPlant(MODEL), np.array([1.0, 0.5, 0.2, 0.4])
    for effects in ({}, {"actuator_lag": 0.05}, {"actuator_lag": 0.02}, {"floor_slope": 0.02}):
        model = MODEL.with_effects(effects)
        plant.set_model(model)
        other = AnalyticPlant(model)
        for _ in range(30):
            plant.step(torque)
            other.step(torque)
        np.testing.assert_array_equal(plant.motion(), other.motion())
    with pytest.raises(ImpossibleParameters, match="m0 = -1 kg must be positive"):
        plant.set_model(Model(youbot(), Parameters(**(VALUES | {"m0": -1.0}))))


def test_yaw_is_not_wrapped():
    plant = AnalyticPlant(MODEL)
    plant.reset(pose=(0, 0, 3.0))
    for _ in range(1000):
        plant.step(np.array([-1.0, 1.0, -1.0, 1.0]))
    assert plant.pose[2] > 3 * math.pi
