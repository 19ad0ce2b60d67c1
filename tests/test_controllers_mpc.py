"""Predictive control: the problem, its two solvers, limits, failures and time."""

import time

import numpy as np
import pytest
from test_controllers import drive

from controllers import make, mpc
from controllers.optimal.ipopt import Ipopt
from controllers.optimal.problem import step_functions
from controllers.optimal.rti import RealTimeIteration
from controllers.optimal.solution import Request
from youbot_env.model_file import load_model
from youbot_env.plant import ModelStructure
from youbot_env.simulation import AnalyticPlant, Sensors

PAPER, NOMINAL = load_model("paper"), load_model("nominal")
STIFF = {"actuator_lag": 0.03, "wheel_coulomb_friction": 0.2, "torque_gain": None}
STEPS, PERIOD = 20, 0.05
SCALES = np.array([0.01, 0.01, 0.02, 0.1, 0.1, 0.2])
WEIGHTS = np.array([*SCALES**-2.0, 0.6**-2.0, 1e4, 0.8, 0.8, 1.6, 4.0])


def request(model, deviation, weights=WEIGHTS, omega=1.0):
    """Problem on a curved reference from a deviation of pose and velocity."""
    times = PERIOD * np.arange(STEPS + 1)
    twists = np.stack([0.3 * np.cos(omega * times), 0.2 * np.sin(times), 0.5 + 0 * times], axis=1)
    structure = ModelStructure.of(model)
    state = np.array(structure.flatten(structure.rest()))
    pose = np.array([0.2, -0.1, 0.4])
    state[:6] = np.concatenate([pose, twists[0]]) + deviation
    plan, du = np.zeros((STEPS + 1, 6)), np.zeros((STEPS, 4))
    values = np.array(model.values())
    return Request(state, pose, twists, twists, 0.0, PERIOD, values, weights, plan, du)


@pytest.mark.parametrize("effects", [{}, STIFF, {"roller_ripple": None, "cable_tether": 20.0}])
def test_the_discretised_model_is_the_plant(effects):
    """The error of one step falls with the third power of its length."""
    model = PAPER.with_effects(effects)
    structure, errors = ModelStructure.of(model), []
    stage, _ = step_functions(structure)
    command = np.array([2.0, 1.0, 1.5, 2.5])
    for h in (0.01, 0.005):
        plant = AnalyticPlant(model, h)
        plant.reset((0.3, 0.2, 0.5), (0.3, -0.1, 0.4))
        tracked = ModelStructure.of(model, track_wheels=True)
        before = tracked.unflatten(plant._stepper.state.tolist())
        plant.step(command)
        after = tracked.unflatten(plant._stepper.state.tolist())
        if not structure.track_wheels:
            before, after = (state._replace(wheel_angle=()) for state in (before, after))
        flat = structure.flatten(before)
        step = stage(model.values(), flat, after.velocity, command, 0.0, h)
        residual, reached = (np.asarray(part)[:, 0] for part in step)
        gap = reached - structure.flatten(after)
        errors.append(max(np.abs(residual).max(), np.abs(gap).max()))
    assert errors[0] < 2e-4
    assert errors[1] < errors[0] / 5


@pytest.mark.parametrize("effects", [{}, {"torque_offset": 0.3, "floor_slope": None}])
def test_on_the_reference_nothing_deviates(effects):
    model = PAPER.with_effects(effects)
    solution = RealTimeIteration(ModelStructure.of(model), STEPS).solve(request(model, np.zeros(6)))
    np.testing.assert_allclose(solution.deviations, 0.0, atol=1e-6)
    np.testing.assert_allclose(solution.du, 0.0, atol=1e-5)


@pytest.mark.parametrize("effects", [{}, STIFF], ids=["base", "stiff"])
@pytest.mark.parametrize("size", [0.3, 3.0], ids=["free", "limited"])
def test_repeated_iterations_arrive_at_the_solution_of_ipopt(effects, size):
    model = PAPER.with_effects(effects)
    fast, exact = (kind(ModelStructure.of(model), STEPS) for kind in (RealTimeIteration, Ipopt))
    problem = request(model, size * np.array([0.05, -0.05, 0.1, 0.1, 0.1, 0.1]))
    wanted = exact.solve(problem)
    assert wanted.solved
    for _ in range(8):
        got = fast.solve(problem)
        assert got.solved
        problem = problem._replace(deviations=got.deviations, du=got.du)
    np.testing.assert_allclose(got.du, wanted.du, atol=2e-3)
    np.testing.assert_allclose(got.deviations, wanted.deviations, atol=2e-4)
    largest = np.abs(got.reference + got.du).max()
    assert largest <= 4.0 + 1e-6
    assert (largest > 4.0 - 1e-6) == (size > 1)


def test_closed_loop_of_the_fast_solver_is_within_five_percent_of_ipopt():
    errors = {}
    for solver in ("rti", "ipopt"):
        controller = make("mpc", NOMINAL, solver=solver, torque_limit=3.0)
        errors[solver] = drive(controller, steps=70, settle=0, frequency=3.0, sensors=Sensors())
        assert controller.counts["fallback"] == 0
    assert errors["rti"] == pytest.approx(errors["ipopt"], rel=0.05)
    assert errors["rti"][0] > 2e-3  # a run that has something to correct


@pytest.mark.parametrize("frequency", [0.5, 1.5, 3.0])
def test_with_the_true_model_five_times_better_than_the_kinematic_controller(frequency):
    kinematic, _ = drive(make("kinematic", PAPER), frequency=frequency)
    controller = make("mpc", PAPER)
    assert 5 * drive(controller, frequency=frequency, steps=500)[0] < kinematic


def test_real_rollers_within_ten_millimetres_and_one_degree():
    position, yaw = drive(
        make("mpc", PAPER), reference="eight", frequency=0.5,
        env_id="YouBotRollers-v0", steps=450, settle=150,
    )  # fmt: skip
    assert position < 0.010
    assert np.degrees(yaw) < 1.0


def test_another_model_builds_nothing_and_new_effects_build_once():
    controller = make("mpc", NOMINAL)
    solver, law = controller.solver, controller.law
    controller.set_model(PAPER)
    assert controller.solver is solver
    assert controller.law is law
    controller.set_model(PAPER.with_effects({"torque_offset": 0.1}))
    extended = controller.solver
    assert extended is not solver
    assert make("mpc", NOMINAL.with_effects({"torque_offset": 0.2})).solver is extended
    assert make("mpc", PAPER).solver is solver


def test_values_of_the_model_reach_the_solver():
    right, wrong = (drive(make("mpc", m), steps=400)[0] for m in (PAPER, NOMINAL))
    assert 20 * right < wrong


def test_speed_limits_are_soft_and_torque_limits_hard():
    speeds = {}
    for limit in (0.35, 5.0):
        controller = make("mpc", PAPER, soft_speed=limit, soft_yaw_rate=5.0)
        plant, state, speeds[limit] = AnalyticPlant(PAPER), None, 0.0
        for _ in range(330):
            x, y, yaw, *velocity = plant.motion()
            c, s = np.cos(yaw), np.sin(yaw)
            error = [c * (0.9 - x) - s * y, s * (x - 0.9) - c * y, -yaw]
            seen = np.concatenate([error, velocity, [c, s], np.zeros(63)])
            action, state = controller.predict(seen, state)
            assert np.abs(action).max() <= 1.0
            plant.step(4.0 * action.astype(float))
            speeds[limit] = max(speeds[limit], np.abs(plant.velocity[:2]).max())
        assert controller.counts["fallback"] == 0
        assert controller.counts["solved at a limit"] > 5
        assert abs(plant.pose[0] - 0.9) < 0.05
    assert speeds[0.35] < 0.42 < 0.6 < speeds[5.0]


def test_a_late_solution_is_not_used_but_counted():
    controller = make("mpc", PAPER, time_limit=1e-9)
    substitute = make("computed_torque", PAPER, preview=20, preview_stride=5)
    seen = np.zeros(controller.task.observation_space.shape)
    seen[[0, 4, 6]] = 0.05, 0.1, 1.0
    action, state = controller.predict(seen)
    np.testing.assert_allclose(action, substitute.predict(seen)[0], atol=1e-6)
    assert controller.counts == {"late": 1, "fallback": 1}
    last = controller.solves[-1]
    assert (last.status, last.fallback) == ("late", True)
    assert last.seconds > 0
    assert not state[controller._plan].any()


class Failing:
    """Hands on to a solver, except at the given calls."""

    def __init__(self, solver, fails):
        self.solver, self.fails, self.requests = solver, fails, []

    def solve(self, problem):
        self.requests.append(problem._replace(deviations=problem.deviations.copy()))
        solution = self.solver.solve(problem)
        if len(self.requests) in self.fails:
            return solution._replace(solved=False, status="broken", du=solution.du * np.nan)
        return solution


def test_after_a_failed_solve_the_warm_start_is_dropped_and_the_failure_counted():
    controller = make("mpc", PAPER)
    controller.solver = Failing(controller.solver, fails={3})
    seen, state = np.zeros(controller.task.observation_space.shape), None
    seen[[0, 6]] = 0.05, 1.0
    for _ in range(5):
        action, state = controller.predict(seen, state)
        assert np.isfinite(action).all()
    warm = [bool(np.any(problem.deviations)) for problem in controller.solver.requests]
    assert warm == [False, True, True, False, True]
    assert controller.counts["broken"] == controller.counts["fallback"] == 1
    assert [solve.fallback for solve in controller.solves] == [False, False, True, False, False]


def test_a_problem_without_a_finite_answer_is_reported_as_failed():
    problem = request(PAPER, np.zeros(6))
    solver = RealTimeIteration(ModelStructure.of(PAPER), STEPS)
    broken = solver.solve(problem._replace(values=np.zeros(7)))
    assert not broken.solved
    assert broken.status == "not finite"
    assert solver.solve(problem).solved


def test_every_step_is_recorded_under_noise_delay_and_saturation():
    robot = PAPER.with_effects({"actuator_delay": 0.03, "torque_saturation": 2.5})
    controller = make("mpc", robot, torque_limit=2.5)
    drive(controller, robot, "eight", 3.0, steps=400, sensors=Sensors())
    assert len(controller.solves) == 400
    assert controller.counts["solved"] + controller.counts["solved at a limit"] == 400
    assert controller.counts["solved at a limit"] > 20
    assert all(solve.iterations == 1 for solve in controller.solves)


def test_a_solve_takes_about_a_millisecond(monkeypatch):
    # Time of this thread on its core; that of other processes on a busy machine does not count.
    monkeypatch.setattr(mpc.time, "perf_counter", time.thread_time)
    controller = make("mpc", PAPER)
    drive(controller, steps=400, sensors=Sensors())
    seconds = [solve.seconds for solve in controller.solves]
    assert np.median(seconds) < 1e-3
    assert np.percentile(seconds, 99) < 3e-3


@pytest.mark.parametrize("solver", ["rti", "ipopt"])
def test_equal_runs_give_equal_actions_however_slow_the_machine(solver, monkeypatch):
    """A clock that jumps by up to a second from one look to the next changes nothing."""
    rng, now, streams = np.random.default_rng(0), [0.0], []

    def erratic():
        now[0] += rng.uniform(0.0, 1.0)
        return now[0]

    for clock in (None, erratic, erratic):
        if clock:
            monkeypatch.setattr(mpc.time, "perf_counter", clock)
        controller = make("mpc", NOMINAL, solver=solver, torque_limit=2.5)
        act, stream = controller.act, []

        def kept(seen, memory, act=act, stream=stream):
            action, memory = act(seen, memory)
            stream.append(action)
            return action, memory

        controller.act = kept
        drive(controller, steps=12 if solver == "ipopt" else 200, settle=0, frequency=3.0,
              sensors=Sensors())  # fmt: skip
        streams.append(np.array(stream))
        assert controller.counts["fallback"] == 0
    np.testing.assert_array_equal(streams[1], streams[0])
    np.testing.assert_array_equal(streams[2], streams[0])


def test_too_few_iterations_are_a_failed_solve_and_computed_torque_takes_over():
    controller = make("mpc", PAPER, iteration_limit=1, torque_limit=1.0)
    drive(controller, steps=40, settle=0, frequency=3.0)
    assert controller.counts["fallback"] > 5
    assert controller.counts["late"] == 0


def test_bad_settings_name_the_value():
    with pytest.raises(ValueError, match=r"solver = 'osqp'.*\['ipopt', 'rti'\]"):
        make("mpc", PAPER, solver="osqp")
    with pytest.raises(ValueError, match="time_limit = 0"):
        make("mpc", PAPER, time_limit=0)
    with pytest.raises(ValueError, match="iteration_limit = 0; give a whole"):
        make("mpc", PAPER, iteration_limit=0)
