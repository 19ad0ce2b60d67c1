"""Kinematics: rows of J and G from the paper and from rigid-body geometry; impossible tables."""

import math
from dataclasses import replace

import numpy as np
import paper_equations as paper
import pytest

from youbot_env import dynamics
from youbot_env.backend import NUMPY, casadi_ops
from youbot_env.parameters import Parameters
from youbot_env.platform import Platform, Wheel, mecanum, omni3, wheel_rows, youbot

SIZES = paper.Sizes()
PAPER = Parameters(m0=35.3, I0=4.4, I1=6e-3, a_x=0.016, a_y=-0.026, mu1=0.11, mu2=5.78e-3)


def test_youbot_has_the_dimensions_of_the_paper():
    platform = youbot()
    half_track, half_base, R, r, m1 = SIZES
    places = {wheel.name: (wheel.x, wheel.y) for wheel in platform.wheels}
    x, y = half_base, half_track
    assert places == {"fl": (x, y), "fr": (x, -y), "rl": (-x, y), "rr": (-x, -y)}
    angles = [math.degrees(wheel.roller_angle) for wheel in platform.wheels]
    assert angles == [-45, 45, 45, -45]
    assert (platform.wheel_radius, platform.roller_radius, platform.wheel_mass) == (R, r, m1)
    assert platform.lever == pytest.approx(SIZES.L, rel=1e-14)
    assert platform.reach == pytest.approx(math.hypot(x, y))


def test_rows_are_those_of_equation_3():
    rng = np.random.default_rng(0)
    for sizes in (SIZES, *(paper.Sizes.drawn(rng) for _ in range(20))):
        geometry = mecanum("any", *sizes).geometry
        np.testing.assert_allclose(geometry.jacobian, paper.jacobian(sizes), rtol=1e-14)
        np.testing.assert_allclose(
            geometry.roller_jacobian, paper.roller_jacobian(sizes), rtol=1e-14
        )
        torque = rng.normal(size=4)
        np.testing.assert_allclose(
            geometry.wrench(tuple(torque)), paper.wrench(sizes, torque), rtol=1e-12
        )


def test_contact_point_moves_only_as_its_roller_allows():
    """The floor point of a rolling wheel: at rest along the roller axis, r gamma' across it."""
    rng = np.random.default_rng(1)
    for _ in range(100):
        wheel = Wheel("w", *rng.uniform(-0.4, 0.4, 2), rng.uniform(-1.2, 1.2), rng.uniform(-3, 3))
        R, r, v = 0.06, 0.02, rng.normal(size=3)
        rolling, roller = wheel_rows(wheel, R, r)
        centre = v[:2] + v[2] * np.array([-wheel.y, wheel.x])
        heading = np.array([math.cos(wheel.heading), math.sin(wheel.heading)])
        left = np.array([-heading[1], heading[0]])
        contact = centre - R * np.dot(rolling, v) * heading
        axis = math.cos(wheel.roller_angle) * heading + math.sin(wheel.roller_angle) * left
        across = np.array([-axis[1], axis[0]])
        assert contact @ axis == pytest.approx(0.0, abs=1e-13)
        assert contact @ across == pytest.approx(-r * np.dot(roller, v), abs=1e-13)


def test_four_wheels_of_a_moving_body_agree():
    platform, rng = youbot(), np.random.default_rng(2)
    for v in rng.normal(size=(20, 3)):
        speeds = platform.geometry.wheel_velocity(tuple(v))
        assert np.dot([1, 1, -1, -1], speeds) == pytest.approx(0.0, abs=1e-12)
    assert platform.geometry.wrench((1.0, 1.0, -1.0, -1.0)) == (0.0, 0.0, 0.0)


@pytest.mark.parametrize("platform", [youbot(), omni3()], ids=lambda p: p.name)
def test_torques_and_wrench_have_the_same_power(platform):
    geometry, rng = platform.geometry, np.random.default_rng(3)
    for _ in range(20):
        v, torque = tuple(rng.normal(size=3)), tuple(rng.normal(size=len(platform.wheels)))
        for rates, forces in (
            (geometry.wheel_velocity(v), geometry.wrench(torque)),
            (geometry.roller_velocity(v), geometry.roller_wrench(torque)),
        ):
            assert np.dot(torque, rates) == pytest.approx(np.dot(forces, v), rel=1e-12)


def test_friction_of_the_youbot_is_exactly_diagonal():
    platform = youbot()
    matrix = dynamics.damping_matrix(platform.geometry, PAPER.theta(platform))
    xx, xy, xo, yy, yo, oo = matrix
    assert (xy, xo, yo) == (0.0, 0.0, 0.0)
    expected = paper.friction(SIZES, PAPER.mu1, PAPER.mu2)
    np.testing.assert_allclose((xx, yy, oo), expected, rtol=1e-13)
    np.testing.assert_allclose((xx, yy, oo), (195.0, 431.0, 42.0), rtol=2e-3)
    mass = dynamics.mass_matrix(platform.geometry, PAPER.theta(platform))
    constants = (mass[0] / xx, mass[3] / yy, mass[5] / oo)
    np.testing.assert_allclose(constants, (0.24, 0.11, 0.14), atol=5e-3)


def test_metrics_are_products_of_the_rows():
    for platform in (youbot(), omni3()):
        geometry, upper = platform.geometry, np.triu_indices(3)
        for rows, metric in (
            (geometry.jacobian, geometry.wheel_metric),
            (geometry.roller_jacobian, geometry.roller_metric),
        ):
            full = np.transpose(rows) @ np.array(rows)
            np.testing.assert_allclose(metric, full[upper], atol=1e-9 * np.abs(full).max())


def test_omni3_is_isotropic():
    platform = omni3(reach=0.2, wheel_radius=0.05)
    xx, xy, xo, yy, yo, oo = platform.geometry.wheel_metric
    assert (xx, yy) == pytest.approx((1.5 / 0.05**2,) * 2)
    assert oo == pytest.approx(3 * (0.2 / 0.05) ** 2)
    assert (xy, xo, yo) == (0.0, 0.0, 0.0)
    # Turning on the spot, all wheels turn forward alike; driving ahead, the rear wheel stands.
    np.testing.assert_allclose(platform.geometry.wheel_velocity((0, 0, 1.0)), 0.2 / 0.05)
    left, rear, right = platform.geometry.wheel_velocity((1.0, 0.0, 0.0))
    assert rear == pytest.approx(0.0, abs=1e-12)
    assert left == pytest.approx(-right)


def test_rows_are_the_same_on_every_backend():
    import casadi as ca

    wheel, rng = Wheel("w", 0.2, -0.1, 0.8, 0.3), np.random.default_rng(4)
    offsets, phases = rng.uniform(-0.2, 0.2, 10), rng.uniform(-0.5, 0.5, 10)
    batch = wheel_rows(wheel, 0.05, 0.015, offsets, phases, NUMPY)
    offset, phase = ca.SX.sym("offset"), ca.SX.sym("phase")
    symbols = wheel_rows(wheel, 0.05, 0.015, offset, phase, casadi_ops())
    function = ca.Function("rows", [offset, phase], [ca.vertcat(*symbols[0], *symbols[1])])
    for k in range(10):
        single = np.concatenate(wheel_rows(wheel, 0.05, 0.015, offsets[k], phases[k]))
        ours = [np.broadcast_to(entry, 10)[k] for entry in (*batch[0], *batch[1])]
        np.testing.assert_allclose(ours, single, rtol=1e-13)
        np.testing.assert_allclose(
            function(offsets[k], phases[k]).full().ravel(), single, rtol=1e-13
        )


def test_contains_is_the_polygon_of_the_wheels():
    platform = youbot()
    assert platform.contains(0.0, 0.0)
    assert platform.contains(0.235, -0.149)
    assert not platform.contains(0.236, 0.0)
    assert not platform.contains(0.0, -0.151)
    assert omni3(0.2).contains(0.0, 0.05)
    assert not omni3(0.2).contains(-0.19, 0.1)


def table(**changes):
    base = youbot()
    given = {"name": "p", "wheels": base.wheels, "wheel_radius": 0.05, "roller_radius": 0.01}
    return Platform(**{**given, **changes})


IMPOSSIBLE = {
    "two wheels": ({"wheels": youbot().wheels[:2]}, "has 2 wheels; it needs 3"),
    "same name": (
        {"wheels": (*youbot().wheels, replace(youbot().wheels[0], x=0.0))},
        "repeats a wheel name .*fl.*rename",
    ),
    "radius": ({"wheel_radius": -0.05}, "wheel_radius = -0.05 must be positive"),
    "no radius": ({"roller_radius": math.nan}, "roller_radius = nan must be positive"),
    "mass": ({"wheel_mass": 0.0}, "wheel_mass = 0.0 must be positive"),
    "big roller": ({"roller_radius": 0.05}, "0.05 m must be smaller than wheel_radius = 0.05"),
    "roller along the axle": (
        {"wheels": tuple(replace(w, roller_angle=math.pi / 2) for w in youbot().wheels)},
        "roller_angle = 1.57.* 85 degrees",
    ),
    "all rollers parallel": (
        {"wheels": tuple(replace(w, roller_angle=0.0) for w in youbot().wheels)},
        "leave a body motion free",
    ),
    "place is no number": (
        {"wheels": (replace(youbot().wheels[0], x=math.nan), *youbot().wheels[1:])},
        "'p'",
    ),
}


@pytest.mark.parametrize("case", IMPOSSIBLE)
def test_impossible_tables_are_refused(case):
    changes, message = IMPOSSIBLE[case]
    with pytest.raises(ValueError, match=message):
        table(**changes)
