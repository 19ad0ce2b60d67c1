"""Comparison of controllers: robots, runs, statistics, claims, and that nobody sees the truth."""

import gc
import math
import types
from dataclasses import replace

import gymnasium as gym
import numpy as np
import pytest

from controllers import controller_names, find, make
from controllers.evaluation import solver_check, tornado
from controllers.evaluation.claims import Claim, claims
from controllers.evaluation.motions import REFERENCES, Motion
from controllers.evaluation.plan import Block, default_blocks, make_jobs
from controllers.evaluation.results import Results
from controllers.evaluation.run import Run, drive, make_env, measure, run_all
from controllers.evaluation.statistics import bootstrap, gap_closed, mean, ratio
from controllers.evaluation.subjects import (
    IDENTIFIED,
    INFORMED,
    MODELS,
    NOMINAL,
    ORACLE,
    Subject,
    draw_subjects,
)
from youbot_env.model import Model
from youbot_env.model_file import load_model
from youbot_env.references import Reference
from youbot_env.simulation import AnalyticPlant, Sensors

HIDDEN = {"wheel_coulomb_friction": 0.2, "yaw_scrub_friction": 2.0}
SHORT = Motion("eight", 2.0, length=1.5)


@pytest.fixture(scope="module")
def subject() -> Subject:
    """A robot whose identified models are stand-ins."""
    drawn = draw_subjects("analytic", 1, load_model("paper"), HIDDEN, 3)[0]
    nominal = load_model("nominal")
    beliefs = {NOMINAL: nominal, IDENTIFIED: load_model("paper"), INFORMED: load_model("paper")}
    return replace(drawn, beliefs=beliefs, half_widths={"m0": 0.5})


# Robots


def test_robots_are_possible_stay_the_same_and_are_shared_by_the_plants():
    paper = load_model("paper")
    few, many = (draw_subjects("analytic", n, paper, HIDDEN, 5) for n in (2, 4))
    others = draw_subjects("rollers", 2, paper, HIDDEN, 5)
    for a, b, c in zip(few, many, others, strict=False):
        assert a.truth.values() == b.truth.values() == c.truth.values()
        assert a.seed == b.seed == c.seed
    assert len({s.truth.parameters.m0 for s in many}) == 4
    for one in many:
        one.truth.check()
        assert 0.84 < one.truth.parameters.m0 / paper.parameters.m0 < 1.16
        assert 0.84 < one.truth.effects[0].values["fc"] / 0.2 < 1.16
    other = draw_subjects("analytic", 1, paper, HIDDEN, 6)[0]
    assert other.truth.values() != few[0].truth.values()
    with pytest.raises(ValueError, match=r"unknown plant 'roller'.*analytic"):
        draw_subjects("roller", 1, paper, HIDDEN, 5)


def reached(root) -> list:
    """Everything that can be reached from an object, without modules, classes and functions."""
    closed = (types.ModuleType, type, types.FunctionType, types.BuiltinFunctionType)
    closed += (types.MethodType, types.FrameType, property)
    seen, waiting = {}, [root]
    while waiting:
        item = waiting.pop()
        if id(item) in seen or isinstance(item, closed):
            continue
        seen[id(item)] = item
        waiting += gc.get_referents(item)
    return list(seen.values())


def assert_no_truth(root, truth: Model) -> None:
    secret = set(truth.parameters.as_dict().values()) | set(truth.values())
    objects = reached(root)
    assert len(objects) > 20
    for item in objects:
        assert not isinstance(item, gym.Env | gym.Wrapper | AnalyticPlant | Subject | Reference)
        if isinstance(item, Model):
            assert item.parameters != truth.parameters
        if isinstance(item, float):
            assert item not in secret
        if isinstance(item, np.ndarray) and item.dtype == float:
            assert not np.isin(item, list(secret)).any()


@pytest.mark.parametrize("name", controller_names())
def test_a_controller_that_drives_a_robot_cannot_reach_what_is_true_of_it(name, subject):
    try:
        controller = make(name, subject.model(IDENTIFIED))
    except (ImportError, ValueError) as error:  # no torch, or no policy trained yet
        pytest.skip(str(error))
    env = make_env(subject, controller, Sensors())
    drive(controller, env, replace(SHORT, length=0.1), subject.seed)
    assert_no_truth(controller, subject.truth)
    # The walk would have found it.
    with pytest.raises(AssertionError):
        assert_no_truth([controller, env], subject.truth)
    with pytest.raises(AssertionError):
        assert_no_truth(make(name, subject.model(ORACLE)), subject.truth)


def test_a_log_and_what_is_identified_from_it_hold_nothing_of_the_truth(subject):
    from youbot_cli import evaluate_robots

    nominal = load_model("nominal")
    log = evaluate_robots.record(subject, 12.0, nominal.platform)
    assert_no_truth(log, subject.truth)
    known = evaluate_robots.calibrated(subject, 12.0, nominal)
    assert set(known.beliefs) == set(MODELS) - {ORACLE}
    assert_no_truth(known.beliefs, subject.truth)
    assert known.model(ORACLE).parameters == subject.truth.parameters
    # It was identified, not guessed: nearer to the truth than the data sheet, intervals stated.
    truth, near = subject.truth.parameters, known.model(INFORMED).parameters
    assert (
        abs(near.mu1 / truth.mu1 - 1)
        < 0.03
        < abs(load_model("nominal").parameters.mu1 / truth.mu1 - 1)
    )
    assert 0 < known.half_widths["wheel_coulomb_friction.fc"] < 0.05


# Runs


def test_runs_pair_and_repeat(subject):
    first, again = (run_all(subject, "computed_torque", ORACLE, [SHORT], Sensors()) for _ in "ab")
    timeless = {"solve_median": 0.0, "solve_p99": 0.0}
    assert replace(first[0], **timeless) == replace(again[0], **timeless)
    informed, ignorant = (
        run_all(subject, "computed_torque", m, [SHORT])[0] for m in (ORACLE, NOMINAL)
    )
    assert 5 * informed.position < ignorant.position
    assert informed.position < first[0].position  # without noise
    assert (first[0].plant, first[0].robot, first[0].fallbacks) == ("analytic", 0, 0)


def test_measured_velocities_smooth_the_measured_pose(subject):
    velocities = []
    for pose_time in (0.2, 0.0):
        controller = make("computed_torque", subject.model(ORACLE), pose_time=pose_time)
        env = make_env(subject, controller, Sensors())
        trace = drive(controller, env, replace(SHORT, length=3.0), subject.seed)
        velocities.append(measure(trace, 0.01, 4.0, 0.3)["velocity"])
    assert 2 * velocities[0] < velocities[1]


def test_a_lost_run_counts_with_the_error_at_which_it_is_lost(subject):
    class Idle(type(make("kinematic", NOMINAL))):
        def act(self, seen, memory):
            return np.ones((1, 3)), memory

    controller = Idle(load_model(NOMINAL), find("kinematic").Settings())
    trace = drive(controller, make_env(subject, controller), Motion("eight", 0.5), 0)
    assert trace.lost
    figures = measure(trace, 0.01, 4.0, 0.3)
    assert (figures["position"], figures["velocity"]) == (1.0, 0.3)


def test_motions_last_whole_half_periods_and_stay_possible():
    for w in (0.5, 1.0, 3.0, 4.0):
        halves = Motion("eight", w).seconds * w / math.pi
        assert halves == pytest.approx(round(halves))
        assert 4.0 <= Motion("eight", w).seconds <= 12.6
        _, rate, _ = Motion("eight", w).reference.sample(np.arange(0, 20, 0.01))
        assert np.abs(rate[2]).max() <= 0.81
        assert np.hypot(*rate[:2]).max() == pytest.approx(0.3, rel=0.01)
    assert Motion("circle", 0.1).seconds == 12.6
    with pytest.raises(ValueError, match="'spiral'"):
        Motion("spiral", 1.0)
    with pytest.raises(ValueError, match="speed 2"):
        Motion("eight", 1.0, 2.0)


def test_every_job_of_a_plan_runs_once_and_controllers_without_model_once():
    blocks = default_blocks(("kinematic", "lqr", "mpc"), REFERENCES, ("analytic", "rollers"))
    jobs = make_jobs(blocks, {"analytic": 2, "rollers": 1})
    cells = [(j.plant, j.robot, j.controller, j.model, m) for j in jobs for m in j.motions]
    assert len(cells) == len(set(cells))
    assert {j.model for j in jobs if j.controller == "kinematic"} == {NOMINAL}
    assert {j.model for j in jobs if j.controller == "mpc"} == set(MODELS)
    followed = {m.name for j in jobs for m in j.motions if j.controller == "mpc"}
    assert followed == set(REFERENCES)
    full = Block("analytic", ("lqr",), (ORACLE,), ("step", "eight"), (1.0, 2.0))
    assert len(make_jobs([full], {"analytic": 3})) == 3
    assert len(full.motions) == 4


# Statistics


def test_figures_and_their_intervals():
    rng = np.random.default_rng(0)
    nominal = 10 + rng.normal(size=40)
    oracle = nominal - 8
    identified = nominal - 6 + 0.3 * rng.normal(size=40)
    share = gap_closed(nominal, identified, oracle)
    assert share.value == pytest.approx(np.mean(nominal - identified) / 8)
    assert share.low < 0.75 < share.high
    # Pairing keeps the spread between robots out: 0.3 / 8 / sqrt(40), twice to each side.
    assert share.high - share.low < 0.04
    assert ratio(nominal, oracle).value == pytest.approx(nominal.mean() / oracle.mean())
    assert mean([2.0, 2.0, 2.0])[:3] == (2.0, 2.0, 2.0)
    assert math.isnan(mean([2.0]).low)


def test_intervals_hold_the_truth_as_often_as_they_say():
    rng, inside = np.random.default_rng(1), []
    for _ in range(150):
        figure = bootstrap(lambda e, axis=-1: np.mean(e, axis=axis), rng.normal(5.0, 1.0, 20))
        inside.append(figure.low <= 5.0 <= figure.high)
    assert 0.86 < np.mean(inside) < 0.99


def invented(position: dict[tuple[str, str], float]) -> Results:
    """Results in which three robots have these errors, in m, at every frequency."""
    return Results(
        [
            Run("analytic", robot, controller, model, "eight", w, *[error * (1 + 0.1 * robot)] * 4,
                1.0, 0.0, 1e-3, 2e-3, 0, False)
            for (controller, model), error in position.items()
            for w in (0.5, 3.0)
            for robot in range(3)
        ]
    )  # fmt: skip


def test_claims_say_what_is_met_and_what_is_missed():
    errors = {("kinematic", NOMINAL): 0.010, ("mpc", NOMINAL): 0.009, ("mpc", ORACLE): 0.001}
    errors |= {("mpc", INFORMED): 0.0015, ("mpc", IDENTIFIED): 0.003}
    found = {c.text: c for c in claims(invented(errors))}
    assert all(isinstance(claim, Claim) for claim in found.values())
    below = "position below kinematic"
    met, missed = (found[f"mpc, {model}: {below}"] for model in (INFORMED, IDENTIFIED))
    assert met.met
    assert met.figure.value == pytest.approx(10 / 1.5)
    assert not missed.met
    share = found[f"mpc, {INFORMED}: gap to the oracle closed"]
    assert share.figure.value == pytest.approx(7.5 / 8)
    assert share.met
    assert not found[f"mpc, {IDENTIFIED}: gap to the oracle closed"].met
    # Equal errors at both frequencies are no growth.
    assert not found["kinematic: position error grows above 0.5 rad/s"].met
    assert not [text for text in found if text.startswith("computed_torque")]


# Wrong beliefs, predictive control


def test_a_wrong_belief_is_wrong_in_one_thing(subject):
    truth = dict(zip(subject.truth.names(), subject.truth.values(), strict=True))
    assert tornado.believed(subject, tornado.Change("", tornado.BASE)).values() == (
        subject.truth.values()
    )
    heavy = tornado.believed(subject, tornado.Change("m0", tornado.PERCENT, 1))
    assert heavy.parameters.m0 == pytest.approx(1.2 * subject.truth.parameters.m0)
    assert heavy.parameters.mu1 == subject.truth.parameters.mu1
    unsure = tornado.believed(subject, tornado.Change("m0", tornado.INTERVAL, -1))
    assert unsure.parameters.m0 == pytest.approx(subject.truth.parameters.m0 - 0.5)
    change = tornado.Change("wheel_coulomb_friction.fc", tornado.PERCENT, -1)
    light = dict(zip(truth, tornado.believed(subject, change).values(), strict=True))
    assert light.pop(change.name) == pytest.approx(0.8 * truth.pop(change.name))
    assert light == truth
    change = tornado.Change("yaw_scrub_friction", tornado.LEFT_OUT)
    left = tornado.believed(subject, change)
    assert [a.identifier for a in left.effects] == ["wheel_coulomb_friction"]


def test_costs_are_ranked_and_dry_friction_costs_more_than_the_centre_of_mass(subject, monkeypatch):
    monkeypatch.setattr(tornado, "MOTIONS", (SHORT,))
    found = tornado.costs([tornado.errors(subject)])
    added = [cost.added.value for cost in found]
    assert added == sorted(added, reverse=True)
    by_name = {(cost.name, cost.kind): cost.added.value for cost in found}
    assert by_name["wheel_coulomb_friction", tornado.LEFT_OUT] > 1e-3
    assert by_name["wheel_coulomb_friction", tornado.LEFT_OUT] > 5 * by_name["a_x", tornado.PERCENT]
    intervals = [name for name, kind in by_name if kind == tornado.INTERVAL]
    assert intervals == ["m0"]


def test_endurance_counts_every_answer_and_finds_hidden_failures(subject, monkeypatch):
    calm = solver_check.endurance(subject, 300)
    assert sum(calm["statuses"].values()) == calm["steps"] == 300
    assert calm["unreported_failures"] == 0
    assert calm["solve_cpu"]["median"] <= calm["solve_cpu"]["p99"] <= calm["solve_cpu"]["worst"]

    honest = solver_check.MPC._record

    def silent(self, solution, seconds):
        usable = honest(self, solution, seconds)
        if len(self.solves) == 20:
            self.solves.pop()
        return usable

    monkeypatch.setattr(solver_check.MPC, "_record", silent)
    assert solver_check.endurance(subject, 30)["unreported_failures"] > 0


def test_the_fast_solver_tracks_as_ipopt_does(subject):
    run = solver_check.against_exact(subject, Motion("eight", 3.0, 0.4, length=0.4))
    assert run["rti"]["fallbacks"] == run["ipopt"]["fallbacks"] == 0
    assert run["apart"] < 0.05


# The command
