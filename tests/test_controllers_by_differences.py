"""Matrices and signs of the controllers against differences of motions worked out beside them."""

from dataclasses import asdict

import numpy as np
import paper_equations as paper
import pytest
from scipy.optimize import fsolve

from controllers import make
from controllers.lqr import error_dynamics
from controllers.optimal.problem import step_functions
from controllers.optimal.rti import linear_stage, sweep_step
from youbot_env.model_file import load_model
from youbot_env.plant import ModelStructure

PAPER = load_model("paper")
SIZES, VALUES = paper.Sizes(), asdict(PAPER.parameters)
SMALL = 1e-5


def turned(angle, vector):
    c, s = np.cos(angle), np.sin(angle)
    return np.array([c * vector[0] - s * vector[1], s * vector[0] + c * vector[1]])


def slope_of_errors(errors, torque, twist):
    """Rates of the errors (6,) of a robot at the origin that follows a steady twist.

    Robot and reference move in the world for an instant either way, by the paper's equations.
    """
    v = np.append(turned(errors[2], twist[:2]), twist[2]) - errors[3:]
    a = paper.acceleration(SIZES, VALUES, v, paper.wrench(SIZES, torque))

    def after(dt):
        robot, heading, speed = v[:2] * dt, v[2] * dt, v + a * dt
        wanted = errors[:2] + turned(errors[2], twist[:2]) * dt
        yaw = errors[2] + twist[2] * dt - heading
        apart = np.append(turned(yaw, twist[:2]), twist[2]) - speed
        return np.concatenate([turned(-heading, wanted - robot), [yaw], apart])

    return (after(SMALL) - after(-SMALL)) / (2 * SMALL)


def differences(function, at, step=1e-5):
    """Jacobian of a function by central differences."""
    steps = step * np.eye(len(at))
    return np.array([(function(at + d) - function(at - d)) / (2 * step) for d in steps]).T


@pytest.mark.parametrize(
    "twist", [(0.0, 0.0, 0.0), (0.4, -0.3, 0.8), (-0.2, 0.5, -2.0)], ids=["rest", "left", "right"]
)
def test_error_dynamics_of_the_regulator(twist):
    a, b = (np.array(m) for m in error_dynamics(ModelStructure.of(PAPER))(twist, PAPER.values()))
    twist, still = np.array(twist), np.zeros(6)
    wanted = differences(lambda e: slope_of_errors(e, np.zeros(4), twist), still)
    np.testing.assert_allclose(a, wanted, atol=1e-5)
    pushed = differences(lambda u: slope_of_errors(still, u, twist), np.zeros(4))
    np.testing.assert_allclose(b, pushed, rtol=1e-6, atol=1e-6)


def test_gains_of_the_regulator_are_least_in_its_cost():
    """No neighbour of the gains costs less from a random error, with the weights of its settings.

    At a node of the grid; velocities beyond the grid have the gains of its edge.
    """
    from scipy.linalg import expm

    controller = make("lqr", PAPER)
    s = controller.settings
    node = np.array([s.schedule_speed, -s.schedule_speed, 0.0])
    a, b = (np.array(m) for m in error_dynamics(ModelStructure.of(PAPER))(node, PAPER.values()))
    held = expm(np.block([[a, b], [np.zeros((4, 10))]]) * s.dt)[:6]
    weights = np.array([s.position, s.position, s.yaw, s.velocity, s.velocity, s.yaw_rate])

    def cost(gain):
        e, total = np.array([0.02, -0.03, 0.05, 0.1, -0.1, 0.2]), 0.0
        for _ in range(600):
            u = gain @ e
            total += np.sum((e / weights) ** 2) + np.sum((u / s.torque) ** 2)
            e = held[:, :6] @ e + held[:, 6:] @ u
        return total

    gain = controller.gain(node[None])[0]
    best, rng = cost(gain), np.random.default_rng(0)
    for _ in range(10):
        assert cost(gain * (1 + 0.1 * rng.standard_normal(gain.shape))) > best
    limit = np.array([[s.schedule_speed, s.schedule_speed, s.schedule_yaw_rate]])
    edge = controller.gain(limit)
    np.testing.assert_allclose(controller.gain(10.0 * limit), edge)
    assert np.abs(edge[0] - gain).max() > 0.01


def seen_by(controller, error=(0, 0, 0), twists=((0.0, 0.0, 0.0),), velocity=(0, 0, 0)):
    """An observation of a robot that heads along x; the last twist lasts."""
    count = (controller.task.observation_space.shape[0] - 8) // 3
    twists = [*twists, *[twists[-1]] * (count - len(twists))]
    return np.concatenate([error, velocity, [1.0, 0.0], *twists])


def test_the_kinematic_controller_turns_the_reference_into_its_own_frame():
    controller = make("kinematic", PAPER)
    s = controller.settings
    limits = np.array([s.speed_limit, s.speed_limit, s.yaw_rate_limit])

    def commanded(error, *twists):
        controller.reset()
        return controller.predict(seen_by(controller, error, twists))[0] * limits

    # The reference looks 0.3 rad more to the left than the robot: its forward is ahead and left.
    ahead = commanded((0, 0, 0.3), (0.2, 0, 0))
    np.testing.assert_allclose(ahead[:2], (0.2 * np.cos(0.3), 0.2 * np.sin(0.3)), rtol=1e-6)
    left = commanded((0, 0, 0.3), (0, 0.2, 0.1))
    np.testing.assert_allclose(left[:2], (-0.2 * np.sin(0.3), 0.2 * np.cos(0.3)), rtol=1e-6)
    assert left[2] == pytest.approx(0.1 + s.yaw_gain * 0.3, rel=1e-6)
    back = commanded((0.01, -0.02, 0.03), (0.0, 0.0, 0.0))
    gains = (s.position_gain, s.position_gain, s.yaw_gain)
    np.testing.assert_allclose(back, np.multiply(gains, (0.01, -0.02, 0.03)), rtol=1e-6)
    sooner = make("kinematic", PAPER, preview=3, preview_stride=2)
    seen = seen_by(sooner, twists=((0.1, 0.0, 0.0), (0.3, -0.2, 0.4)))
    rising = sooner.predict(seen)[0] * limits
    np.testing.assert_allclose(rising, (0.15, -0.05, 0.1), rtol=1e-6)  # a quarter of the way


def test_computed_torque_answers_errors_with_its_bandwidth():
    """Where the reference rests the acceleration is w^2 e + 2 d w e', with the paper's masses."""
    controller = make("computed_torque", PAPER, bandwidth=5.0, damping=0.7, pose_time=0.0)
    mass = paper.mass_matrix(SIZES, VALUES)
    limit = controller.task.torque_limit
    for axis, size in ((0, 0.01), (1, -0.02), (2, 0.03)):
        error = np.zeros(3)
        error[axis] = size
        controller.reset()
        torque = limit * controller.predict(seen_by(controller, error))[0]
        wanted = mass @ (25.0 * error)
        np.testing.assert_allclose(paper.wrench(SIZES, torque), wanted, rtol=1e-5, atol=1e-5)
        assert torque @ (1, 1, -1, -1) == pytest.approx(0.0, abs=1e-6)
    velocity = np.array([0.2, -0.3, 0.4])
    controller.reset()
    torque = limit * controller.predict(seen_by(controller, velocity=velocity))[0]
    vx, vy, omega = velocity
    # The rates of V_X and V_Y hold what the turning of their axes adds.
    rates = -2 * 0.7 * 5.0 * velocity + (omega * vy, -omega * vx, 0.0)
    wanted = mass @ rates + paper.remaining(SIZES, VALUES, velocity)
    np.testing.assert_allclose(paper.wrench(SIZES, torque), wanted, rtol=1e-5)


class Listening:
    """Hands on to a solver and keeps what was asked and answered."""

    def __init__(self, solver):
        self.solver, self.asked, self.answered = solver, [], []

    def solve(self, request):
        self.asked.append(request._replace(deviations=request.deviations.copy(),
                                           du=request.du.copy()))  # fmt: skip
        self.answered.append(self.solver.solve(request))
        return self.answered[-1]


@pytest.mark.parametrize("stride", [1, 5])
def test_a_plan_is_taken_up_one_control_period_later(stride):
    controller = make("mpc", PAPER, preview_stride=stride)
    controller.solver = listening = Listening(controller.solver)
    seen, state = seen_by(controller, (0.05, -0.03, 0.1)), None
    for _ in range(2):
        _, state = controller.predict(seen, state)
    for name in ("deviations", "du"):
        plan, taken_up = getattr(listening.answered[0], name), getattr(listening.asked[1], name)
        rows = np.arange(len(plan))
        later = np.minimum(rows + 1 / stride, rows[-1])
        wanted = np.array([np.interp(later, rows, column) for column in plan.T]).T
        np.testing.assert_allclose(taken_up, wanted, atol=1e-9)
        assert np.abs(plan[0] - wanted[0]).max() > 1e-4  # it moves


@pytest.mark.parametrize(
    "effects",
    [{}, {"actuator_lag": 0.03, "quadratic_drag": 60.0, "floor_slope": None}],
    ids=["base", "more"],
)
def test_linearised_steps_are_differences_of_the_step(effects):
    """A and B of predictive control against the step solved anew from neighbouring states."""
    model = PAPER.with_effects(effects)
    structure = ModelStructure.of(model)
    values, h, t = np.array(model.values()), 0.05, 1.3
    step, need = step_functions(structure)
    pose, first, last = (np.array(x) for x in ((0.2, -0.1, 0.4), (0.3, 0.2, 0.5), (0.32, 0.1, 0.4)))
    size = structure.state_size
    extras = np.linspace(0.5, -0.5, size - 6)
    now = np.array([0.01, -0.02, 0.03, 0.05, -0.05, 0.1])
    bend = np.array([0.3, -0.2, 0.1, 0.4])
    x = np.concatenate([pose, first, extras]) + np.append(now, np.zeros(size - 6))
    path = np.concatenate([pose, first, extras])
    u = np.array(need(values, path, first, last, t, h, 4.0)).ravel() + bend

    def solved(state, command):
        def missing(v):
            return np.array(step(values, state, v, command, t, h)[0]).ravel()

        v = fsolve(missing, state[3:6], xtol=1e-13)
        return np.array(step(values, state, v, command, t, h)[1]).ravel()

    end = solved(x, u)
    then = np.append(np.zeros(3), end[3:6] - last)
    a, b, gap, commands, *_ = (
        np.array(part)
        for part in linear_stage(structure)(
            pose, first, last, first, last, extras, now, then, bend, t, h, values, 4.0
        )
    )
    np.testing.assert_allclose(commands.ravel() + bend, u, atol=1e-12)
    np.testing.assert_allclose(a, differences(lambda y: solved(y, u), x), atol=1e-6)
    np.testing.assert_allclose(b, differences(lambda w: solved(x, w), u), atol=1e-6)
    np.testing.assert_allclose(gap.ravel()[3:6], 0.0, atol=1e-9)  # the trajectory is a motion


def test_a_backward_sweep_is_the_regulator_of_one_step():
    """Cost to go and gains by completing the square, written with plain matrices."""
    import casadi as ca

    rng, size, wheels = np.random.default_rng(3), 6, 4
    a, b = rng.normal(size=(size, size)), rng.normal(size=(size, wheels))
    half = rng.normal(size=(size, size))
    p, lean = half @ half.T, rng.normal(size=size)
    c, g, s = rng.normal(size=size), rng.normal(size=size), rng.normal(size=wheels)
    q, r = rng.uniform(0.1, 1.0, size), 0.7
    sweep = sweep_step(ca.Sparsity.dense(size, size), ca.Sparsity.dense(size, wheels))
    cost, slope, gain, shift = (
        np.array(part) for part in sweep(np.tril(p), lean, a, b, c, q, g, r, s)
    )

    def total(x, u):
        after = a @ x + b @ u + c
        return (
            0.5 * after @ p @ after + lean @ after + 0.5 * x @ (q * x) + g @ x
            + 0.5 * r * u @ u + s @ u
        )  # fmt: skip

    def least(x):
        return total(x, gain @ x + shift.ravel())

    for _ in range(5):
        x = rng.normal(size=size)
        u = gain @ x + shift.ravel()
        np.testing.assert_allclose(differences(lambda w, x=x: np.atleast_1d(total(x, w)), u), 0.0,
                                   atol=1e-6)  # fmt: skip
        symmetric = np.tril(cost) + np.tril(cost, -1).T
        wanted = 0.5 * x @ symmetric @ x + slope.ravel() @ x
        assert least(x) - least(np.zeros(size)) == pytest.approx(wanted, rel=1e-9)
