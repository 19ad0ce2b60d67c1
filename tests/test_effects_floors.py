"""Laws of floors, casters and gears against formulas written by hand."""

import math

import numpy as np
import pytest

from ident.diagnosis.trials import trials
from ident.log import Log
from ident.sensitivity import Linearised
from ident.signals import measure
from youbot_env.backend import FLOAT
from youbot_env.effects import Signals, effect_names, get_effect, left_out
from youbot_env.effects.base import GRAVITY
from youbot_env.model_file import load_model
from youbot_env.plant import ModelStructure
from youbot_env.references import SmoothRandom
from youbot_env.simulation import IDEAL, Sensors, record_closed_loop

PAPER = load_model("paper")
PLATFORM = PAPER.platform
WHEELS = np.array([(wheel.x, wheel.y) for wheel in PLATFORM.wheels])
# Speeds at which every smooth sign has its full size.
MOTIONS = np.random.default_rng(7).uniform(0.2, 0.6, (20, 3)) * np.random.default_rng(8).choice(
    (-1.0, 1.0), (20, 3)
)


def added(effects, v, pose=(0.0, 0.0, 0.0), angle=(0.0,) * 4):
    """Wrench on the body that effects add, N, N, N m."""
    total = []
    for model in (PAPER.with_effects(effects), PAPER):
        structure = ModelStructure.of(model, track_wheels=True)
        robot = structure.bind(model.values())
        s = robot.signals(0.0, tuple(v), pose, angle, (0.0,) * 4, FLOAT)
        total.append(np.array(robot.wrench((0.0,) * 4, s, structure.rest().internal, FLOAT)))
    return total[0] - total[1]


def turned(yaw):
    """Columns: the body's axes in the world."""
    return np.array([[math.cos(yaw), -math.sin(yaw)], [math.sin(yaw), math.cos(yaw)]])


def test_a_caster_drags_where_it_stands():
    place = np.array([-0.28, 0.06])
    for v in MOTIONS:
        moved = v[:2] + v[2] * np.array([-place[1], place[0]])
        force = -9.0 * moved / np.linalg.norm(moved)
        expected = *force, place[0] * force[1] - place[1] * force[0]
        found = added({"caster_drag": {"fc": 9.0, "px": place[0], "py": place[1]}}, v)
        np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_a_caster_in_the_middle_is_dry_friction_of_the_body():
    caster = {"caster_drag": {"fc": 9.0, "px": 0.0, "py": 0.0}}
    for v in MOTIONS:
        np.testing.assert_allclose(added(caster, v), added({"body_dry_friction": 9.0}, v))


def test_dry_friction_by_direction_has_its_own_level_either_way():
    values = {"forward": 0.1, "backward": 0.3}
    jacobian = PLATFORM.jacobian_array
    for v in MOTIONS:
        speed = jacobian @ v
        if np.abs(speed).min() < 2.0:
            continue
        torque = np.where(speed > 0, -0.1, 0.3)
        found = added({"direction_dependent_friction": values}, v)
        np.testing.assert_allclose(found, jacobian.T @ torque, rtol=1e-6, atol=1e-9)
    np.testing.assert_allclose(added({"direction_dependent_friction": values}, (0.0,) * 3), 0.0)


def test_a_carpet_resists_by_direction_in_the_world():
    values = {"cx": 70.0, "cy": 30.0, "cxy": 10.0, "nx": 12.0, "ny": -5.0}
    ribs, nap = np.array([[70.0, 10.0], [10.0, 30.0]]), np.array([12.0, -5.0])
    for v, yaw in zip(MOTIONS, np.linspace(-3.0, 3.0, len(MOTIONS)), strict=True):
        axes = turned(yaw)
        moved = axes @ v[:2]
        force = -ribs @ moved + (nap @ moved) / np.linalg.norm(moved) * moved
        found = added({"carpet": values}, v, (1.0, 2.0, yaw))
        np.testing.assert_allclose(found, (*axes.T @ force, 0.0), rtol=1e-4)
        assert found @ v < 0.0
    assert get_effect("carpet").plausible(values)
    assert not get_effect("carpet").plausible(values | {"nx": 60.0})


def test_a_patch_of_floor_brakes_the_wheels_that_stand_on_it():
    edge = {"dmu": 0.2, "angle": 0.7, "dist": 0.3}
    normal = np.array([math.cos(0.7), math.sin(0.7)])
    jacobian, seen = PLATFORM.jacobian_array, set()
    for v, yaw, way in zip(MOTIONS, np.linspace(-3, 3, 20), np.linspace(-0.1, 0.7, 20),
                           strict=True):  # fmt: skip
        centre = way * normal + 0.4 * np.array([-normal[1], normal[0]])
        behind = (centre + WHEELS @ turned(yaw).T) @ normal - 0.3
        if np.abs(behind).min() < 0.12:
            continue
        seen.add(int(np.sum(behind > 0)))
        torque = np.where(behind > 0, -0.2 * (jacobian @ v), 0.0)
        found = added({"floor_patch": edge}, v, (*centre, yaw))
        np.testing.assert_allclose(found, jacobian.T @ torque, rtol=2e-3, atol=0.05)
    assert {0, 4} < seen


def test_a_ramp_pulls_back_beyond_its_foot():
    ramp = {"ramp": {"s": 0.03, "angle": 2.0, "dist": 1.0}}
    weight = PAPER.parameters.m0 * GRAVITY * 0.03
    normal = np.array([math.cos(2.0), math.sin(2.0)])
    for yaw in (0.0, 1.2, -2.5):
        for way, share in ((0.0, 0.0), (1.0, 0.5), (2.0, 1.0)):
            found = added(ramp, (0.0,) * 3, (*(way * normal), yaw))
            force = turned(yaw).T @ (-share * weight * normal)
            # The wheels are no part of what a_x and a_y are of.
            held = 1.0 - len(WHEELS) * PLATFORM.wheel_mass / PAPER.parameters.m0
            a_x, a_y = held * PAPER.parameters.a_x, held * PAPER.parameters.a_y
            moment = a_x * force[1] - a_y * force[0]
            np.testing.assert_allclose(found, (*force, moment), rtol=1e-2, atol=1e-2)


def test_bristles_are_a_spring_before_they_slide():
    effect = get_effect("presliding_friction")
    p = effect.arrange({"fc": 0.2, "bend": 0.04}, PLATFORM)

    def after(state, v, h):
        s = Signals(PLATFORM, PLATFORM.geometry, PAPER.parameters.theta(PLATFORM), 0.0, v,
                    (0.0,) * 3, (0.0,) * 4, (0.0,) * 4)  # fmt: skip
        s.state = state
        s.state = effect.evolve(p, (), s, h, FLOAT)
        return np.array(s.state), np.array(effect.shaft(p, s, FLOAT)), s.wheel_velocity

    # A turn by a hundredth of the bend: stiffness Fc / bend.
    _, torque, speed = after((0.0,) * 4, (0.019, 0.0, 0.0), 1e-3)
    np.testing.assert_allclose(torque, -0.2 / 0.04 * np.array(speed) * 1e-3, rtol=0.01)
    # A long way: sliding friction against each wheel; and one bend after it reverses half is back.
    slid, torque, speed = after((0.0,) * 4, (0.0, 0.3, 0.0), 2.0)
    np.testing.assert_allclose(torque, -0.2 * np.sign(speed), rtol=1e-9)
    state, _, speed = after(tuple(slid), (0.0, -0.3, 0.0), 0.04 * 0.0475 / 0.3)
    np.testing.assert_allclose(state, np.sign(speed) * (1.0 - 2.0 * math.exp(-1.0)), rtol=1e-6)
    # In two steps as in one.
    once, _, _ = after((0.3, -0.2, 0.9, 0.0), (0.02, 0.01, 0.1), 0.05)
    half, _, _ = after((0.3, -0.2, 0.9, 0.0), (0.02, 0.01, 0.1), 0.025)
    np.testing.assert_allclose(after(tuple(half), (0.02, 0.01, 0.1), 0.025)[0], once, rtol=1e-6)


def test_what_bristles_change_is_seen_in_traces_and_in_forces():
    bristles = PAPER.with_effects({"presliding_friction": {"fc": 0.05, "bend": 0.03}})
    times = np.arange(3000) / 100
    channels = record_closed_loop(bristles, SmoothRandom(0.3, 1.0), times, IDEAL, seed=1)
    log = Log("random", PLATFORM, **channels)
    sim = Linearised.of(log, PAPER)
    trace = sim.model_columns([(PAPER, bristles)])[..., 0]
    assert np.linalg.norm(sim.residual - trace) < 0.1 * np.linalg.norm(sim.residual)
    seen = [measure(log, model, origin=log.time[0]).interval_wrenches()[0]
            for model in (bristles, PAPER)]  # fmt: skip
    force = np.array(seen[0]) - np.array(seen[1])
    # Sliding for most of the time, as plain dry friction is.
    plain = PAPER.with_effects({"wheel_coulomb_friction": 0.05})
    dry = np.array(measure(log, plain, origin=log.time[0]).interval_wrenches()[0]) - seen[1]
    assert np.corrcoef(force[0], dry[0])[0, 1] > 0.9


def test_two_orders_of_ripple_add_up():
    effects = {"torque_ripple": {"a": 0.2, "b": 0.0, "k": 5.0},
               "torque_ripple_second": {"a": 0.1, "b": 0.05, "k": 11.0}}  # fmt: skip
    for angle in np.linspace(0.0, 3.0, 13):
        torque = 0.2 * math.cos(5 * angle) + 0.1 * math.cos(11 * angle)
        torque += 0.05 * math.sin(11 * angle)
        expected = PLATFORM.jacobian_array.T @ np.full(4, torque)
        found = added(effects, (0.0,) * 3, angle=(angle,) * 4)
        np.testing.assert_allclose(found, expected, atol=1e-12)


def test_a_second_order_is_looked_for_beside_the_first_only():
    times = np.arange(3000) / 100
    channels = record_closed_loop(PAPER, SmoothRandom(0.3, 1.0), times, Sensors(), seed=1)
    log = Log("random", PLATFORM, **channels)
    names = {trial.identifier for trial in trials(PAPER, [log])}
    assert "torque_ripple" in names
    assert not names & {"torque_ripple_second", "presliding_friction"}
    names = {t.identifier for t in trials(PAPER.with_effects({"torque_ripple": {}}), [log])}
    assert "torque_ripple" not in names
    assert "torque_ripple_second" in names
    with left_out("floor_patch"):
        assert "floor_patch" not in {trial.identifier for trial in trials(PAPER, [log])}


def test_what_looks_alike_says_so_on_both_sides():
    for name in ("caster_drag", "carpet", "floor_patch", "ramp", "direction_dependent_friction",
                 "torque_ripple_second", "presliding_friction"):  # fmt: skip
        for other in get_effect(name).confusables:
            assert name in get_effect(other).confusables, f"{other} does not name {name}"


def test_a_part_of_the_library_can_be_left_out_for_a_while():
    with left_out("carpet"):
        with left_out("ramp"):
            assert not {"carpet", "ramp"} & set(effect_names())
        assert "ramp" in effect_names()
        assert get_effect("carpet").identifier == "carpet"  # a robot may still have it
        with pytest.raises(ZeroDivisionError), left_out("ramp"):
            1 / 0  # noqa: B018
        assert "ramp" in effect_names()
    assert "carpet" in effect_names()
