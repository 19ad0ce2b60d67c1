"""Dynamics against eq. (4) to (7) written out, and Newton's laws; the backends agree."""

import numpy as np
import paper_equations as paper
import pytest

from youbot_env import dynamics
from youbot_env.backend import weighted_sum
from youbot_env.dynamics import Theta
from youbot_env.parameters import Parameters, from_x, lumps, to_x, x_scale
from youbot_env.platform import mecanum, omni3, youbot

SIZES = paper.Sizes()
PAPER = Parameters(m0=35.3, I0=4.4, I1=6e-3, a_x=0.016, a_y=-0.026, mu1=0.11, mu2=5.78e-3)
UNITS = np.eye(7)


def draw_parameters(rng, wheels_weigh):
    """Some robot's parameters by name; any that give a positive mass matrix."""
    m0 = wheels_weigh + rng.uniform(1, 60)
    a_x, a_y = rng.uniform(-0.1, 0.1, 2)
    return {
        "m0": m0,
        "I0": m0 * (a_x**2 + a_y**2) + rng.uniform(0.05, 5),
        "I1": rng.uniform(0, 0.05),
        "a_x": a_x,
        "a_y": a_y,
        "mu1": rng.uniform(0, 0.5),
        "mu2": rng.uniform(0, 0.02),
    }


def draw_theta(rng, platform):
    weight = len(platform.wheels) * platform.wheel_mass
    return Parameters(**draw_parameters(rng, weight)).theta(platform)


def left_side(geometry, theta, v, a):
    """Inverse dynamics: the generalized forces that velocities v and accelerations a need."""
    inertia = dynamics.momentum(geometry, theta, tuple(a))
    rest = dynamics.centripetal(theta, tuple(v)), dynamics.friction(geometry, theta, tuple(v))
    return np.array(inertia) + rest[0] + rest[1]


def test_forward_dynamics_are_equation_4():
    rng = np.random.default_rng(0)
    for k in range(300):
        sizes = SIZES if k % 2 else paper.Sizes.drawn(rng)
        platform = mecanum("any", *sizes)
        p = draw_parameters(rng, 4 * sizes.m1)
        theta = Parameters(**p).theta(platform)
        v, torque = rng.normal(size=3) * [2, 2, 4], 5 * rng.normal(size=4)
        inertia = dynamics.prepare(platform.geometry, theta)
        ours = dynamics.acceleration(inertia, tuple(v), platform.geometry.wrench(tuple(torque)))
        expected = paper.acceleration(sizes, p, v, paper.wrench(sizes, torque))
        np.testing.assert_allclose(ours, expected, rtol=1e-11, atol=1e-12 * np.abs(expected).max())


def test_inverse_dynamics_are_the_left_side_of_equation_4():
    rng = np.random.default_rng(1)
    for _ in range(100):
        p = draw_parameters(rng, 4 * SIZES.m1)
        theta = Parameters(**p).theta(youbot())
        v, a = rng.normal(size=(2, 3))
        expected = paper.mass_matrix(SIZES, p) @ a + paper.remaining(SIZES, p, v)
        ours = left_side(youbot().geometry, theta, v, a)
        np.testing.assert_allclose(ours, expected, rtol=1e-12, atol=1e-10)


@pytest.mark.parametrize("platform", [youbot(), omni3()], ids=lambda p: p.name)
def test_forward_undoes_inverse(platform):
    rng = np.random.default_rng(2)
    for _ in range(100):
        theta, (v, a) = draw_theta(rng, platform), rng.normal(size=(2, 3))
        forces = tuple(left_side(platform.geometry, theta, v, a))
        inertia = dynamics.prepare(platform.geometry, theta)
        np.testing.assert_allclose(
            dynamics.acceleration(inertia, tuple(v), forces), a, rtol=1e-9, atol=1e-10
        )


@pytest.mark.parametrize("platform", [youbot(), omni3()], ids=lambda p: p.name)
def test_equations_are_linear_in_theta(platform):
    rng, geometry = np.random.default_rng(3), platform.geometry
    for _ in range(30):
        weights, (v, a) = rng.normal(size=7), rng.normal(size=(2, 3))
        columns = [left_side(geometry, Theta(*unit.tolist()), v, a) for unit in UNITS]
        whole = left_side(geometry, Theta(*weights.tolist()), v, a)
        np.testing.assert_allclose(np.transpose(columns) @ weights, whole, rtol=1e-11, atol=1e-9)


def test_columns_at_unit_theta_are_the_regressor_of_equation_7():
    rng = np.random.default_rng(4)
    for k in range(50):
        sizes = SIZES if k == 0 else paper.Sizes.drawn(rng)
        platform, (v, a) = mecanum("any", *sizes), rng.normal(size=(2, 3))
        columns = [left_side(platform.geometry, Theta(*u.tolist()), v, a) for u in UNITS]
        rows = np.transpose(columns) * np.array([[sizes.L], [sizes.L], [1.0]])
        ours = rows / np.array(x_scale(platform))
        np.testing.assert_allclose(ours, paper.regressor(sizes, v, a), rtol=1e-11, atol=1e-12)


def test_x_of_the_paper():
    x = to_x(PAPER.theta(youbot()), youbot())
    np.testing.assert_allclose(x, [5.246, 4.4, 1.581, 0.1832, -0.2977, 28.98, 13.08], rtol=4e-4)
    sums = lumps(x)
    assert sums["x1+x3"] == pytest.approx(5.246 + 1.581, rel=1e-3)
    assert sums["x2+x3"] == pytest.approx(4.4 + 1.581, rel=1e-3)
    assert (sums["x6"], sums["x7"]) == (x[5], x[6])


@pytest.mark.parametrize("platform", [youbot(), omni3()], ids=lambda p: p.name)
def test_parameters_theta_and_x_go_there_and_back(platform):
    rng, weight = np.random.default_rng(5), len(platform.wheels) * platform.wheel_mass
    for _ in range(20):
        given = Parameters(**draw_parameters(rng, weight))
        theta = given.theta(platform)
        again = from_x(to_x(theta, platform), platform)
        np.testing.assert_allclose(again, theta, rtol=1e-12)
        decoded = Parameters.from_theta(again, platform)
        np.testing.assert_allclose(
            list(decoded.as_dict().values()), list(given.as_dict().values()), rtol=1e-12
        )
    assert theta.max == pytest.approx((given.m0 - weight) * given.a_x)


@pytest.mark.parametrize("platform", [youbot(), omni3()], ids=lambda p: p.name)
def test_point_masses_obey_newton(platform):
    """A robot without spin inertia and friction is a free rigid body under the wrench."""
    rng = np.random.default_rng(6)
    for _ in range(30):
        mass, place = rng.uniform(0.1, 5, 12), rng.uniform(-0.3, 0.3, (12, 2))
        m0, first = mass.sum(), mass @ place
        theta = Theta(m0, float(mass @ np.sum(place**2, axis=1)), 0.0, *first.tolist(), 0.0, 0.0)
        v, wrench = rng.normal(size=3), rng.normal(size=3) * 10
        inertia = dynamics.prepare(platform.geometry, theta)
        ax, ay, turn = dynamics.acceleration(inertia, tuple(v), tuple(wrench))
        # Acceleration of O seen in an inertial frame that coincides with the body's now.
        origin = np.array([ax - v[2] * v[1], ay + v[2] * v[0]])
        across = np.column_stack([-place[:, 1], place[:, 0]])
        each = origin + turn * across - v[2] ** 2 * place
        force = (mass[:, None] * each).sum(axis=0)
        moment = np.sum(mass * (place[:, 0] * each[:, 1] - place[:, 1] * each[:, 0]))
        np.testing.assert_allclose([*force, moment], wrench, rtol=1e-9, atol=1e-9)
        speeds = v[:2] + v[2] * across
        energy = 0.5 * np.sum(mass * np.sum(speeds**2, axis=1))
        ours = dynamics.kinetic_energy(platform.geometry, theta, tuple(v))
        assert ours == pytest.approx(energy, rel=1e-12)


@pytest.mark.parametrize("platform", [youbot(), omni3()], ids=lambda p: p.name)
def test_power_balance_at_an_instant(platform):
    """Power of the forces is the change of kinetic energy and the losses of wheels and rollers."""
    rng, geometry = np.random.default_rng(7), platform.geometry
    for _ in range(50):
        theta, (v, a) = draw_theta(rng, platform), rng.normal(size=(2, 3))
        wheels, rollers = np.array(geometry.jacobian) @ v, np.array(geometry.roller_jacobian) @ v
        losses = theta.mu1 * wheels @ wheels + theta.mu2 * rollers @ rollers
        stored = np.dot(v, dynamics.momentum(geometry, theta, tuple(a)))
        power = np.dot(v, left_side(geometry, theta, v, a))
        assert power == pytest.approx(stored + losses, rel=1e-11)
        assert np.dot(v, dynamics.centripetal(theta, tuple(v))) == pytest.approx(0.0, abs=1e-11)


def test_centripetal_terms_know_nothing_of_spinning_wheels():
    v = (0.3, -0.2, 1.1)
    slow, fast = (Theta(30.0, 2.0, spin, 0.4, -0.2, 0.1, 0.01) for spin in (0.0, 1.0))
    assert dynamics.centripetal(slow, v) == dynamics.centripetal(fast, v)


@pytest.mark.parametrize("platform", [youbot(), omni3()], ids=lambda p: p.name)
def test_batches_floats_and_symbols_agree(platform):
    import casadi as ca

    rng, size, wheels = np.random.default_rng(8), 64, len(platform.wheels)
    thetas = np.array([draw_theta(rng, platform) for _ in range(size)])
    v, torque = rng.normal(size=(size, 3)), rng.normal(size=(size, wheels))

    def forward(theta, v, torque):
        geometry = platform.geometry
        inertia = dynamics.prepare(geometry, Theta(*theta))
        return dynamics.acceleration(inertia, tuple(v), geometry.wrench(tuple(torque)))

    batch = np.array(forward(thetas.T, v.T, torque.T)).T
    symbols = [ca.SX.sym(name, n) for name, n in (("theta", 7), ("v", 3), ("torque", wheels))]
    result = forward(*(ca.vertsplit(symbol) for symbol in symbols))
    function = ca.Function("forward", symbols, [ca.vertcat(*result)])
    for k in range(size):
        single = forward(thetas[k].tolist(), v[k].tolist(), torque[k].tolist())
        assert all(isinstance(component, float) for component in single)
        np.testing.assert_allclose(batch[k], single, rtol=1e-13, atol=1e-13)
        symbolic = function(thetas[k], v[k], torque[k]).full().ravel()
        np.testing.assert_allclose(symbolic, single, rtol=1e-12, atol=1e-12)


def test_symmetric_solve_is_that_of_linear_algebra():
    rng = np.random.default_rng(9)
    for k in range(50):
        root = rng.normal(size=(3, 3))
        matrix = root @ root.T + 0.1 * np.eye(3)
        if k % 2:
            matrix[0, 1] = matrix[1, 0] = 0.0  # as on the youBot, where it takes a shorter way
        if np.linalg.eigvalsh(matrix)[0] <= 0:
            continue
        upper, right = tuple(matrix[np.triu_indices(3)].tolist()), rng.normal(size=3)
        np.testing.assert_allclose(
            dynamics.symmetric_product(upper, tuple(right)), matrix @ right, rtol=1e-12, atol=1e-12
        )
        ours = dynamics.solve(dynamics.factorize(upper), tuple(right.tolist()))
        np.testing.assert_allclose(ours, np.linalg.solve(matrix, right), rtol=1e-9)


def test_weighted_sum_leaves_out_zeros():
    never = object()  # a component that cannot even be multiplied
    assert weighted_sum((0.0, 2.0, 1.0), (never, 3.0, 4.0)) == 10.0
    assert weighted_sum((0.0,), (never,)) == 0.0
    assert weighted_sum((1.0, 0.0), ("kept", never)) == "kept"
