"""What single laws of the library promise: limits, balances and agreement with each other."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ident.log import Log
from ident.regression import build_regression
from youbot_env.backend import FLOAT
from youbot_env.effects import Signals, get_effect
from youbot_env.effects.base import GRAVITY
from youbot_env.effects.rolling_resistance import static_loads
from youbot_env.model import Model
from youbot_env.model_file import load_model
from youbot_env.parameters import Parameters
from youbot_env.plant import ModelStructure
from youbot_env.platform import Geometry, Platform, Wheel, omni3, wheel_rows, youbot

PLATFORM = youbot()
PAPER = Parameters(m0=35.3, I0=4.4, I1=6e-3, a_x=0.016, a_y=-0.026, mu1=0.11, mu2=5.78e-3)
CENTRED = replace(PAPER, a_x=0.0, a_y=0.0)
REDUNDANT = np.array([1, 1, -1, -1])


def robot_with(effects, parameters=PAPER):
    model = Model(PLATFORM, parameters).with_effects(effects)
    return ModelStructure.of(model, track_wheels=True).bind(model.values())


def motion(robot, v, torque=(0.0,) * 4, t=0.0, pose=(0.0,) * 3, angle=(0.0,) * 4):
    """Body acceleration and wheel speeds of a robot without drive states."""
    s = robot.signals(t, v, pose, angle, torque, FLOAT)
    delivered, internal = robot.deliver(s, ((),) * len(robot.effects), 0.0, FLOAT)
    change = robot.acceleration(robot.wrench(delivered, s, internal, FLOAT), s)
    return np.array(change), np.array(robot.wheel_velocity(s, FLOAT))


def geometry_of(effects, angle=(0.0,) * 4):
    zero = (0.0, 0.0, 0.0)
    return robot_with(effects).signals(0.0, zero, zero, angle, (0.0,) * 4, FLOAT).geometry


def test_rows_at_any_roller_phase_leave_the_contact_at_rest():
    """Rigid bodies in space: wheel turning about its axis, roller about its own, contact stays."""
    rng = np.random.default_rng(0)
    for _ in range(50):
        delta, q = rng.uniform(-1, 1), rng.uniform(-math.pi / 6, math.pi / 6)
        big, small = 0.05, 0.012
        wheel = Wheel("w", *rng.uniform(-0.3, 0.3, 2), delta, rng.uniform(-3, 3))
        velocity = rng.uniform(-1, 1, 3)
        rolling, roller = wheel_rows(wheel, big, small, phase=q)
        spin, turn = np.dot(rolling, velocity), np.dot(roller, velocity)
        heading = np.array([math.cos(wheel.heading), math.sin(wheel.heading), 0.0])
        axle, up = np.array([-heading[1], heading[0], 0.0]), np.array([0.0, 0.0, 1.0])
        # Turned by q about the axle, the middle of the roller has moved back and up.
        back, down = (
            heading * math.cos(q) - up * math.sin(q),
            -up * math.cos(q) - heading * math.sin(q),
        )
        axis = back * math.cos(delta) + axle * math.sin(delta)
        middle = (big - small) * down
        # The floor is touched below the point of the roller axis that lies under the axle.
        under = middle + axis * -np.dot(middle, heading) / np.dot(axis, heading)
        contact = np.array([*under[:2], -big])
        centre = np.array([wheel.x, wheel.y, 0.0])
        body = np.array([*velocity[:2], 0.0]) + np.cross(velocity[2] * up, centre + contact)
        total = body + np.cross(spin * axle, contact) + np.cross(turn * axis, contact - middle)
        np.testing.assert_allclose(total[:2], 0.0, atol=1e-12)


def test_roller_ripple_swings_sideways_and_not_forward():
    angles = np.linspace(0.0, 2 * math.pi, 6000, endpoint=False)
    rows = np.array([geometry_of({"roller_ripple": 1.0}, (a,) * 4).jacobian for a in angles])
    ideal = PLATFORM.jacobian_array
    np.testing.assert_allclose(rows[:, :, 0], np.broadcast_to(ideal[:, 0], rows.shape[:2]))
    gain = rows[:, :, 1] / ideal[:, 1]
    np.testing.assert_allclose(gain.mean(axis=0), 1.049, atol=5e-4)
    np.testing.assert_allclose([gain.min(), gain.max()], [1.0, 2 / math.sqrt(3)], atol=1e-4)
    np.testing.assert_allclose(rows[:1000], rows[1000:2000], rtol=1e-9)  # six periods a turn
    lever = (rows[:, 0, 2] - ideal[0, 2]) * PLATFORM.wheel_radius
    jump = np.abs(np.diff(lever)).max()
    np.testing.assert_allclose(jump, 2 * 0.0335 * math.tan(math.pi / 6), rtol=1e-2)
    still = geometry_of({"roller_ripple": 0.0}, (0.4,) * 4)
    np.testing.assert_allclose(still.jacobian, ideal, rtol=1e-14)
    late = geometry_of({"roller_ripple": {"phi0": 0.2}})
    np.testing.assert_allclose(
        late.jacobian, geometry_of({"roller_ripple": 1.0}, (0.2,) * 4).jacobian
    )


@pytest.mark.parametrize("size", [0.5, 0.73, 1.0])
def test_friction_of_the_rollers_is_the_same_number_with_and_without_ripple(size):
    """Measured on real rollers, true mu2 5.2e-3: 4.9e-3 with ripple in the model, 3.6e-3 before."""
    phase = np.linspace(-math.pi / 6, math.pi / 6, 3001)
    rates = np.array(
        [geometry_of({"roller_ripple": size}, (q,) * 4).roller_jacobian for q in phase]
    )
    # Sideways at a constant speed the wheel runs through a phase in proportion to cos(phase); a
    # ripple of another size than 1 hardly changes that.
    power = np.average(rates[:, :, 1] ** 2, axis=0, weights=np.cos(phase))
    ideal = np.array(PLATFORM.geometry.roller_jacobian)[:, 1] ** 2
    np.testing.assert_allclose(power, ideal, rtol=3e-4)  # means over grids of phases
    assert np.ptp(rates[:, 0, 1] ** 2) > 0.3 * ideal[0]  # it still swings


def test_roller_ripple_refuses_rollers_that_make_no_round_wheel():
    with pytest.raises(ValueError, match="round wheel"):
        get_effect("roller_ripple").complete(None, omni3(roller_radius=0.005))


def test_deviations_of_the_kinematics_add_up():
    sizes = {"roller_angle_error": 0.03, "wheel_radius_error": {"e": 0.02}}
    rows = [
        wheel_rows(w, 1.02 * PLATFORM.wheel_radius, PLATFORM.roller_radius, 0.03)
        for w in PLATFORM.wheels
    ]
    expected = Geometry.from_rows(*zip(*rows, strict=True))
    both = geometry_of(sizes)
    for got, wanted in zip(both, expected, strict=True):
        np.testing.assert_allclose(got, wanted, rtol=1e-12, atol=1e-9)


def test_base_geometry_error_is_a_larger_platform():
    wheels = tuple(replace(w, x=1.05 * w.x, y=1.05 * w.y) for w in PLATFORM.wheels)
    larger = Platform("larger", wheels, PLATFORM.wheel_radius, PLATFORM.roller_radius)
    got = geometry_of({"base_geometry_error": 0.05})
    for ours, wanted in zip(got, larger.geometry, strict=True):
        np.testing.assert_allclose(ours, wanted, rtol=1e-12, atol=1e-12)


def test_wheel_radius_error_breaks_the_redundancy_in_proportion_to_forward_speed():
    robot = robot_with({"wheel_radius_error": {"e_fl": 0.03}})
    for speed in (0.2, 0.4):
        _, wheels = motion(robot, (speed, 0.0, 0.0))
        np.testing.assert_allclose(
            REDUNDANT @ wheels, speed / PLATFORM.wheel_radius * (1 / 1.03 - 1), rtol=1e-12
        )


@pytest.mark.parametrize("platform", [PLATFORM, omni3()], ids=lambda platform: platform.name)
def test_static_loads_carry_the_weight(platform):
    theta = PAPER.theta(platform)
    loads = static_loads(platform, theta, FLOAT)
    np.testing.assert_allclose(sum(loads), GRAVITY * theta.m0)
    for axis, moment in (("x", theta.max), ("y", theta.may)):
        tilt = sum(load * getattr(w, axis) for load, w in zip(loads, platform.wheels, strict=True))
        np.testing.assert_allclose(tilt, GRAVITY * moment)
    level = static_loads(platform, CENTRED.theta(platform), FLOAT)
    np.testing.assert_allclose(level, GRAVITY * theta.m0 / len(platform.wheels))


@pytest.mark.parametrize(("floor", "speed"), [(0.5, 0.73), (0.3, 0.44)])
def test_wheels_slip_sideways_from_the_speed_the_floor_allows(floor, speed):
    """Steady sideways motion asks 8 mu2/r^2 / 4 = 59 N per m/s of each wheel."""

    def share_lost(v):
        wheel_speed = np.array([-1, 1, 1, -1]) * v / PLATFORM.wheel_radius
        need = PLATFORM.wheel_radius * 8 * PAPER.mu2 / PLATFORM.roller_radius**2 * v / 4
        torque = np.sign(wheel_speed) * need + PAPER.mu1 * wheel_speed
        robot = robot_with({"wheel_slip": floor}, CENTRED)
        change, wheels = motion(robot, (0.0, v, 0.0), tuple(torque))
        np.testing.assert_allclose(change, 0.0, atol=1e-9)  # both sides of the balance fade alike
        slip = wheels - wheel_speed
        assert abs(REDUNDANT @ slip) < 1e-9
        return np.abs(slip * PAPER.mu1 / need)

    np.testing.assert_allclose(share_lost(speed), 1 - 2**-0.125, rtol=0.05)
    assert share_lost(0.5 * speed).max() < 1e-3
    assert share_lost(2.0 * speed).min() > 0.45


def test_slip_bounds_the_floor_force_and_never_gives_energy():
    effect, rng = get_effect("wheel_slip"), np.random.default_rng(1)
    p = effect.arrange(effect.complete(0.3, PLATFORM), PLATFORM)
    theta = PAPER.theta(PLATFORM)
    loads = np.array(static_loads(PLATFORM, theta, FLOAT))
    lost_power = []
    for _ in range(200):
        v = tuple(rng.uniform(-1, 1, 3))
        torque = np.array(rng.uniform(-8, 8, 4))
        s = Signals(PLATFORM, PLATFORM.geometry, theta, 0.0, v, (0,) * 3, (0,) * 4, tuple(torque))
        rolling, rollers = np.array(s.geometry.jacobian), np.array(s.geometry.roller_jacobian)
        slip = np.array(effect.slip(p, s, FLOAT))
        wheel_speed = np.array(s.wheel_velocity) + slip
        arriving = torque - theta.mu1 * np.array(s.wheel_velocity) + effect.shaft(p, s, FLOAT)
        bearing = -theta.mu2 * np.array(s.roller_velocity) + effect.roller(p, s, FLOAT)
        np.testing.assert_allclose(arriving, torque - theta.mu1 * wheel_speed, atol=1e-12)
        force = rolling[:, :2] * arriving[:, None] + rollers[:, :2] * bearing[:, None]
        assert (np.hypot(*force.T) <= 0.3 * loads * (1 + 1e-12)).all()
        # Motors' power less friction in wheels and rollers less what the body receives.
        on_body = np.array(s.geometry.wrench(arriving)) + s.geometry.roller_wrench(bearing)
        wheels = torque @ wheel_speed - theta.mu1 * wheel_speed @ wheel_speed
        lost_power.append(wheels - bearing @ bearing / theta.mu2 - on_body @ v)
    assert min(lost_power) > -1e-9
    assert max(lost_power) > 1.0


def test_slip_sees_what_is_left_of_the_torque_whatever_the_order_of_the_model():
    torque, v = (3.0, 3.0, 3.0, 3.0), (0.3, 0.05, 0.1)
    first = {"wheel_slip": 0.3, "wheel_coulomb_friction": 0.5}
    second = dict(reversed(first.items()))
    results = [np.concatenate(motion(robot_with(e), v, torque)) for e in (first, second)]
    np.testing.assert_array_equal(*results)
    _, slipping = motion(robot_with({"wheel_slip": 0.3}), v, torque)
    assert (results[0][3:] < slipping).all()  # less torque arrives, less slip


def test_load_dependent_friction_takes_a_share_of_the_delivered_torque():
    torque, v = (2.0, -1.0, 1.5, 1.0), (0.5, 0.0, 0.0)
    effects = {"wheel_coulomb_friction": 0.4, "torque_gain": {"e": 0.5}}
    lossy = motion(robot_with({**effects, "load_dependent_friction": 0.2}), v, torque)[0]
    left = tuple(1.5 * m - 0.2 * 1.5 * abs(m) - 0.4 for m in torque)
    np.testing.assert_allclose(lossy, motion(robot_with({}), v, left)[0], rtol=1e-12)


def test_time_laws_start_from_the_robot_and_end_settled():
    v, torque = (0.3, -0.2, 0.4), (1.0, 2.0, -1.0, 0.5)
    plain = motion(robot_with({}), v, torque)[0]
    for name in ("battery_sag", "friction_warmup"):
        np.testing.assert_allclose(motion(robot_with({name: 0.3}), v, torque)[0], plain)
    warm = replace(PAPER, mu1=0.7 * PAPER.mu1, mu2=0.7 * PAPER.mu2)
    np.testing.assert_allclose(
        motion(robot_with({"friction_warmup": 0.3}), v, torque, t=1e5)[0],
        motion(robot_with({}, warm), v, torque)[0],
    )
    np.testing.assert_allclose(
        motion(robot_with({"battery_sag": 0.3}), v, torque, t=1e5)[0],
        motion(robot_with({}), v, tuple(0.7 * m for m in torque))[0],
    )


def test_payload_makes_another_robot_of_it():
    v, torque = (0.3, -0.2, 0.4), (1.0, 2.0, -1.0, 0.5)
    m = PAPER.m0 - 4 * PLATFORM.wheel_mass
    loaded = replace(
        PAPER,
        m0=PAPER.m0 + 4.0,
        I0=PAPER.I0 + 0.3,
        a_x=(m * PAPER.a_x + 0.4) / (m + 4.0),
        a_y=(m * PAPER.a_y - 0.2) / (m + 4.0),
    )
    robot = robot_with({"payload_change": {"dm": 4, "dI": 0.3, "dpx": 0.4, "dpy": -0.2, "t0": 9}})
    for t, other in ((8.9, PAPER), (9.1, loaded)):
        np.testing.assert_allclose(
            motion(robot, v, torque, t=t)[0], motion(robot_with({}, other), v, torque)[0]
        )


def test_cable_is_slack_at_its_anchor_and_pulls_toward_it():
    effect = get_effect("cable_tether")
    p = effect.arrange(effect.complete({"k": 4.0, "fx": 2.0, "fy": -6.0}, PLATFORM), PLATFORM)

    def pull(x, y, yaw):
        theta, still = PAPER.theta(PLATFORM), (0.0, 0.0, 0.0)
        s = Signals(PLATFORM, PLATFORM.geometry, theta, 0.0, still, (x, y, yaw), (), ())
        return np.array(effect.body(p, s, FLOAT))

    np.testing.assert_allclose(pull(0.5, -1.5, 0.8), 0.0, atol=1e-12)
    np.testing.assert_allclose(pull(1.5, -1.5, 0.0), (-4.0, 0.0, 0.0), atol=1e-12)
    # Turned to the left by a quarter, the robot has the anchor on its left.
    np.testing.assert_allclose(pull(1.5, -1.5, math.pi / 2), (0.0, 4.0, 0.0), atol=1e-12)


def test_dead_zone_and_ripple_values():
    plain, dead = robot_with({}), robot_with({"torque_dead_zone": 0.2})
    zero = (0.0, 0.0, 0.0)
    np.testing.assert_array_equal(motion(dead, zero, (0.19, -0.19, 0.1, 0.0))[0], 0.0)
    np.testing.assert_allclose(
        motion(dead, zero, (1.0, -1.0, 0.5, 0.2))[0], motion(plain, zero, (0.8, -0.8, 0.3, 0.0))[0]
    )
    ripple = robot_with({"torque_ripple": {"a": 0.1, "b": 0.2, "k": 6.0}})
    quarter = math.pi / 12
    for angle, torque in ((0.0, 0.1), (quarter, 0.2), (2 * quarter, -0.1), (4 * quarter, 0.1)):
        np.testing.assert_allclose(
            motion(ripple, zero, angle=(angle,) * 4)[0],
            motion(plain, zero, (torque,) * 4)[0],
            atol=1e-12,
        )


def test_dry_friction_of_the_body_opposes_translation_with_one_force():
    effect = get_effect("body_dry_friction")
    p = effect.arrange({"fb": 12.0}, PLATFORM)
    for heading in (0.0, 0.9, 2.4, -1.3):
        v = (0.2 * math.cos(heading), 0.2 * math.sin(heading), 0.7)
        rest = ((0.0,) * 3, (0.0,) * 4, (0.0,) * 4)
        s = Signals(PLATFORM, PLATFORM.geometry, CENTRED.theta(PLATFORM), 0.0, v, *rest)
        fx, fy, moment = effect.body(p, s, FLOAT)
        assert (fx, fy) == pytest.approx((-12.0 * math.cos(heading), -12.0 * math.sin(heading)))
        assert moment == 0.0


def test_equations_of_a_log_take_ripple_and_friction_of_the_rollers_together():
    model = load_model("paper").with_effects(
        {"roller_ripple": 0.7, "roller_coulomb_friction": 0.01}
    )
    log = Log.load("youbot_test").part(0.0, 10.0)
    regression = build_regression(log, model)
    assert np.isfinite(regression.H).all()
    column = regression.H[..., regression.names.index("roller_coulomb_friction.tc")]
    assert np.abs(column[:, 1]).max() > 0.0
