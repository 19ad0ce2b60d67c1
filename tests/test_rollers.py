import math

import numpy as np
import pytest

from youbot_env import dynamics
from youbot_env.effects import effect_names, get_effect
from youbot_env.model import Model
from youbot_env.parameters import Parameters
from youbot_env.platform import omni3, youbot
from youbot_env.simulation import AnalyticPlant

mujoco = pytest.importorskip("mujoco")

from youbot_env.rollers import RollersPlant  # noqa: E402
from youbot_env.rollers.shape import rate_ratio, roller_count, roller_ellipsoids  # noqa: E402

PAPER = Parameters(35.3, 4.4, 6e-3, 0.016, -0.026, 0.11, 5.78e-3)
MODEL = Model(youbot(), PAPER)
OMNI = Model(omni3(), Parameters(6.0, 0.12, 2e-3, 0.01, 0.005, 0.02, 1e-3))


@pytest.fixture(scope="module")
def plant():
    return RollersPlant(MODEL)


def holding_torque(model, v):
    """Smallest shaft torques that hold the velocity v of the analytic model, N m."""
    theta = model.parameters.theta(model.platform)
    wrench = np.array(dynamics.friction(model.platform.geometry, theta, tuple(v)))
    wrench += np.array(dynamics.centripetal(theta, tuple(v)))
    return np.linalg.pinv(model.platform.jacobian_array).T @ wrench


def drive(plant, torque, seconds):
    """Velocities and wheel speeds, one row a sample, under constant torques."""
    rows = []
    for _ in range(round(seconds / plant.dt)):
        plant.step(torque)
        rows.append(np.concatenate([plant.velocity, plant.wheel_velocity]))
    return np.array(rows)


def settled(plant, v, seconds=1.6):
    """Mean velocity and mean odometry (pinv(J) of wheel speeds) in the steady motion near v."""
    plant.reset(velocity=v)
    mean = drive(plant, holding_torque(plant.model, v), seconds)[40:].mean(axis=0)
    return mean[:3], np.linalg.pinv(plant.platform.jacobian_array) @ mean[3:]


@pytest.mark.parametrize(
    ("axis", "speed", "tolerance", "gain", "gain_tolerance"),
    [
        (0, 0.3, 0.02, 1.0, 0.002),
        (0, -0.3, 0.02, 1.0, 0.002),
        (1, 0.3, 0.08, 1 / 1.05, 0.01),
        (1, -0.3, 0.08, 1 / 1.05, 0.01),
        (2, 0.8, 0.08, 1 / 1.03, 0.015),
        (2, -0.8, 0.08, 1 / 1.03, 0.015),
    ],
)
def test_every_direction_reaches_its_analytic_speed(
    plant, axis, speed, tolerance, gain, gain_tolerance
):
    v = np.zeros(3)
    v[axis] = speed
    mean, odometry = settled(plant, v)
    assert mean[axis] == pytest.approx(speed, rel=tolerance)
    assert mean[axis] / odometry[axis] == pytest.approx(gain, abs=gain_tolerance)
    others = np.delete(mean * [1.0, 1.0, plant.platform.lever], axis)
    assert np.abs(others).max() < 0.02 * abs(speed)


@pytest.mark.parametrize("v", [(0.3, 0, 0), (0, 0.3, 0), (0, 0, 1.0), (-0.2, 0.1, 0.5)])
def test_omni_wheels_roll_as_their_table_says(v):
    plant = RollersPlant(OMNI)
    mean, odometry = settled(plant, v, 1.0)
    reach = plant.platform.lever
    assert np.linalg.norm((mean - odometry) * [1, 1, reach]) < 0.01 * np.linalg.norm(
        np.array(v) * [1, 1, reach]
    )
    assert mean @ np.array(v) > 0.8 * np.dot(v, v)


def test_start_from_rest_shows_the_inertia_of_the_model(plant):
    for wrench in ((40.0, 0, 0), (0, 40.0, 0), (0, 0, 12.0)):
        torque = np.linalg.pinv(MODEL.platform.jacobian_array).T @ wrench
        analytic = AnalyticPlant(MODEL, plant.dt)
        analytic.reset()
        plant.reset()
        for _ in range(3):
            analytic.step(torque)
            plant.step(torque)
        axis = int(np.argmax(wrench))
        assert plant.velocity[axis] == pytest.approx(analytic.velocity[axis], rel=0.03)


def test_compiled_masses_are_those_of_theta(plant):
    theta = PAPER.theta(MODEL.platform)
    plant.reset()
    mujoco.mj_forward(plant.mj_model, plant.mj_data)
    full = np.zeros((plant.mj_model.nv, plant.mj_model.nv))
    mujoco.mj_fullM(plant.mj_model, plant.mj_data, full)
    wheel = plant._bodies.wheels[1]
    assert full[0, 0] == pytest.approx(theta.m0)
    assert full[5, 5] == pytest.approx(theta.I0, rel=1e-6)
    assert full[wheel, wheel] == pytest.approx(theta.I1)
    assert full[1, 5] == pytest.approx(theta.max, rel=1e-3)
    assert full[0, 5] == pytest.approx(-theta.may, rel=1e-3)


def test_it_rolls_down_a_slope_of_the_world():
    model = MODEL.with_effects({"floor_slope": {"sx": 0.1, "sy": -0.05}})
    plant, analytic = RollersPlant(model), AnalyticPlant(model)
    for robot in (plant, analytic):
        robot.reset(pose=(1.0, 2.0, math.pi / 2))
        for _ in range(100):
            robot.step(np.zeros(4))
    moved, expected = plant.pose - (1, 2, math.pi / 2), analytic.pose - (1, 2, math.pi / 2)
    assert moved[0] > 0
    assert moved[1] < 0
    np.testing.assert_allclose(moved[:2], expected[:2], rtol=0.1)


def test_dry_friction_takes_its_share_of_the_speed(plant):
    v, fc = (0.4, 0.0, 0.0), 0.2
    torque = holding_torque(MODEL, v)
    braked = RollersPlant(MODEL.with_effects({"wheel_coulomb_friction": fc}))
    speeds = []
    for robot in (plant, braked):
        robot.reset(velocity=v)
        speeds.append(drive(robot, torque, 2.0)[-50:, 0].mean())
    wheel = MODEL.platform.wheel_radius
    expected = 4 * fc / wheel / (4 * PAPER.mu1 / wheel**2)
    assert speeds[0] - speeds[1] == pytest.approx(expected, rel=0.05)


def test_coasting_only_loses_energy(plant):
    theta, geometry = PAPER.theta(MODEL.platform), MODEL.platform.geometry
    plant.reset(velocity=(0.5, 0.3, 1.0))
    v = drive(plant, np.zeros(4), 0.6)[:, :3]
    energy = np.array([dynamics.kinetic_energy(geometry, theta, tuple(row)) for row in v])
    assert np.all(np.diff(energy[::5]) < 0)
    assert energy[-1] < 0.05 * energy[0]
    plant.reset(velocity=(0.5, 0, 0))
    constant = (PAPER.m0 + 4 * PAPER.I1 / 0.0475**2) / (4 * PAPER.mu1 / 0.0475**2)
    v = drive(plant, np.zeros(4), round(constant, 2))
    assert v[-1, 0] == pytest.approx(0.5 / math.e, rel=0.06)


def test_a_robot_at_rest_stays_at_rest(plant):
    plant.reset(pose=(0.3, -0.2, 1.0))
    drive(plant, np.zeros(4), 2.0)
    assert np.abs(plant.pose - (0.3, -0.2, 1.0)).max() < 1e-5
    assert np.abs(plant.velocity).max() < 1e-5


def test_reset_repeats_a_trajectory_bit_for_bit():
    model = MODEL.with_effects({"wheel_coulomb_friction": 0.1, "actuator_lag": 0.02,
                                "actuator_delay": 0.013})  # fmt: skip
    plant, twin = RollersPlant(model), RollersPlant(model)
    commands = np.random.default_rng(3).normal(0, 1, (40, 4))
    runs = []
    for robot in (plant, plant, twin):
        robot.reset(pose=(1, 0, 0.5), velocity=(0.1, 0.1, 0.2), wheel_angle=0.3)
        for command in commands:
            robot.step(command)
        runs.append(np.concatenate([robot.pose, robot.velocity, robot.wheel_angle]))
    assert np.array_equal(runs[0], runs[1])
    assert np.array_equal(runs[0], runs[2])


def test_a_smooth_floor_slips_beyond_its_friction():
    """A wheel needs 59 N a m/s sideways; at f = 0.2 it has 17 N, enough for 0.29 m/s."""
    plant = RollersPlant(MODEL, floor_friction=0.2)
    ratios = {}
    for speed in (0.15, 0.5):
        mean, odometry = settled(plant, (0, speed, 0), 1.2)
        ratios[speed] = mean[1] / odometry[1]
    assert ratios[0.15] > 0.93
    assert ratios[0.5] < 0.75


def test_drives_delay_and_lag_the_command():
    plant = RollersPlant(MODEL.with_effects({"actuator_delay": 0.025}))
    command, delivered = np.array([0.4, -0.3, 0.2, 0.1]), []
    for _ in range(4):
        plant.step(command)
        delivered.append(plant.delivered_torque)
    assert np.all(np.array(delivered[:2]) == 0)
    np.testing.assert_allclose(delivered[2:], [command, command])
    plant = RollersPlant(MODEL.with_effects({"actuator_lag": 0.02}))
    plant.step(command)
    np.testing.assert_allclose(plant.delivered_torque, command * (1 - math.exp(-0.5)))


def test_every_effect_acts_or_is_refused_by_name():
    torque = holding_torque(MODEL, (0.2, 0.2, 0.2))
    for identifier in effect_names():
        model, effect = MODEL.with_effects({identifier: None}), get_effect(identifier)
        if identifier in ("roller_ripple", "wheel_slip"):
            with pytest.warns(UserWarning, match=f"{identifier} left out"):
                assert RollersPlant(model).model.effects == ()
            continue
        if effect.acts("kinematics") or effect.acts("slip"):
            with pytest.raises(ValueError, match=identifier):
                RollersPlant(model)
            continue
        plant = RollersPlant(model)
        plant.reset(velocity=(0.2, 0.2, 0.2))
        plain = drive(plant, torque, 0.1)
        assert np.abs(plain[:, :3]).max() < 1.0, identifier


def test_the_floor_of_a_slipping_model_is_as_slippery():
    with pytest.warns(UserWarning, match="wheel_slip"):
        plant = RollersPlant(MODEL.with_effects({"wheel_slip": 0.2}))
    told = RollersPlant(MODEL, floor_friction=0.2)
    np.testing.assert_array_equal(plant.mj_model.geom_friction, told.mj_model.geom_friction)


def test_roller_friction_acts_sideways_and_not_forward():
    torque_x, torque_y = (holding_torque(MODEL, v) for v in ((0.3, 0, 0), (0, 0.3, 0)))
    rough = RollersPlant(MODEL.with_effects({"roller_coulomb_friction": 0.05}))
    analytic = AnalyticPlant(MODEL.with_effects({"roller_coulomb_friction": 0.05}))
    speeds = []
    for robot in (rough, analytic):
        row = []
        for axis, torque in enumerate((torque_x, torque_y)):
            robot.reset(velocity=(0.3, 0, 0) if axis == 0 else (0, 0.3, 0))
            row.append(drive(robot, torque, 1.2)[60:, axis].mean())
        speeds.append(row)
    assert speeds[1][1] < 0.26
    np.testing.assert_allclose(speeds[0], speeds[1], rtol=0.04)


def test_a_payload_changes_the_masses_on_the_way():
    values = {"dm": 10.0, "dI": 0.5, "dpx": 0.0, "dpy": 0.0, "t0": 0.1}
    plant = RollersPlant(MODEL.with_effects({"payload_change": values}))
    before = plant.mj_model.body_subtreemass[0]
    drive(plant, np.zeros(4), 0.2)
    assert plant.mj_model.body_subtreemass[0] - before == pytest.approx(10.0, rel=1e-3)
    plant.reset()
    assert plant.mj_model.body_subtreemass[0] == pytest.approx(before)


def test_yaw_is_not_wrapped(plant):
    plant.reset(pose=(0, 0, 3.0), velocity=(0, 0, 1.0))
    drive(plant, holding_torque(MODEL, (0, 0, 1.0)), 0.5)
    assert plant.pose[2] == pytest.approx(3.5, abs=0.05)


def test_rollers_fill_the_cylinder_of_the_wheel():
    for platform, gap in ((youbot(), 3e-5), (omni3(), 4e-5)):
        radius, depth = platform.wheel_radius, platform.wheel_radius - platform.roller_radius
        edge = math.pi / roller_count(platform)
        q = np.linspace(-1.5 * edge, 1.5 * edge, 3001)
        delta = platform.wheels[0].roller_angle
        lean = (math.cos(delta) * np.sin(q)) ** 2
        hulls = [
            depth * np.cos(q) + np.sqrt(a**2 + (b**2 - a**2) * lean)
            for a, b in roller_ellipsoids(platform, delta)
        ]
        assert np.max(hulls) < radius + 1e-9
        assert np.max(hulls, axis=0)[np.abs(q) <= edge].min() > radius - gap
    assert roller_count(youbot()) == 6
    assert rate_ratio(youbot(), 0.0) == 1.0


def test_impossible_arguments_are_named():
    with pytest.raises(ValueError, match=r"0\.0105"):
        RollersPlant(MODEL, dt=0.0105)
    with pytest.raises(ValueError, match="floor_friction"):
        RollersPlant(MODEL, floor_friction=0.0)
    light = Parameters(35.3, 4.4, 1e-4, 0.016, -0.026, 0.11, 5.78e-3)
    with pytest.raises(ValueError, match="I1"):
        RollersPlant(Model(youbot(), light))


def test_picture_follows_the_robot(plant):
    plant.reset()
    try:
        image = plant.render(160, 120)
    except RuntimeError as error:
        pytest.skip(str(error))
    assert image.shape == (120, 160, 3)
    assert image.dtype == np.uint8
    orange = image[..., 0] > 1.5 * image[..., 2]
    assert 0.02 < orange.mean() < 0.5
    plant.reset(pose=(5.0, 3.0, 0.0))
    moved = plant.render(160, 120)
    assert (moved[..., 0] > 1.5 * moved[..., 2]).mean() == pytest.approx(orange.mean(), rel=0.1)
