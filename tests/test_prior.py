"""Estimates keep to what is known beforehand where logs say less, and only there."""

from dataclasses import replace

import numpy as np
import pytest

from ident.identification import identify
from ident.improvement import improve
from ident.log import Log
from ident.output_error import refine
from ident.prior import outside, prior_spreads
from ident.results import AT_BOUND, UNSEEN
from youbot_env.model_file import load_model
from youbot_env.references import Step, calibration_sequence, make_reference
from youbot_env.simulation import Sensors, record_closed_loop

NOMINAL = load_model("nominal")


@pytest.fixture(scope="module")
def straight():
    """Straight runs of a robot with dry friction: yaw moves by its noise only."""
    robot = load_model("paper").with_effects({"wheel_coulomb_friction": 0.4})
    channels = record_closed_loop(
        robot, Step(0.3, 0.4, 0.0), np.arange(2000) / 50, Sensors(), seed=3
    )
    return Log("straight", robot.platform, **channels)


def test_nothing_runs_away_on_straight_runs(straight):
    known = {"drive_hold": {"kind": 0.0}, "drive_offset": {"d": 0.0}}
    found = identify(replace(straight, recording=known), NOMINAL, method="ls")
    values = np.array(found.model.values())
    assert outside(found.model.names(), values, NOMINAL) == {}
    assert found.model.parameters.problems(found.model.platform) == []


@pytest.fixture(scope="module")
def circling():
    """A circle, as the paper's motion I: mass, yaw inertia and centre of mass are one number."""
    robot, times = load_model("paper"), np.arange(1250) / 50
    channels = record_closed_loop(robot, make_reference("I"), times, Sensors(), seed=3)
    known = {"drive_hold": {"kind": 0.0}, "drive_offset": {"d": 0.0}}
    return Log("circling", robot.platform, **channels, recording=known)


def test_a_fit_by_free_run_stays_where_a_log_says_nothing(circling):
    truth = load_model("paper").parameters
    names, free = NOMINAL.names(), refine([circling], NOMINAL)
    held = refine([circling], free.model, prior=NOMINAL)
    at = names.index("may")
    spread = prior_spreads(names, NOMINAL)
    assert abs(free.model.values()[at]) > 3 * spread[at]
    assert abs(held.model.values()[at]) < spread[at]
    assert held.model.parameters.problems(circling.platform) == []
    assert held.model.parameters.m0 == pytest.approx(truth.m0, rel=0.2)
    errors = np.sqrt(np.diag(held.covariance))
    assert errors[at] > 0.7 * spread[at]  # as little known as before
    # What is seen is where it was.
    for name in ("mu1", "mu2"):
        at = names.index(name)
        assert held.model.values()[at] == pytest.approx(free.model.values()[at], rel=0.01)
        assert errors[at] < 0.02 * spread[at]


def test_what_a_log_sees_is_not_pulled():
    robot, times = load_model("paper"), np.arange(1500) / 50
    motion = calibration_sequence(seconds=30.0)
    channels = record_closed_loop(robot, motion, times, Sensors(), seed=3)
    log = Log("all", robot.platform, **channels)
    free = refine([log], NOMINAL)
    held = refine([log], free.model, prior=NOMINAL)
    errors = np.sqrt(np.diag(free.covariance))
    assert np.all(np.abs(np.subtract(held.model.values(), free.model.values())) < 0.5 * errors)
    assert np.sqrt(np.diag(held.covariance)) == pytest.approx(errors, rel=0.15)


def test_improve_writes_nothing_as_known_that_the_log_does_not_tell(circling):
    found = improve([circling], NOMINAL)
    base = found.stages[-1].base
    for name in ("m0", "I0", "a_y", "x1+x3", "x2+x3"):
        assert base[name].ci95 is None
        assert base[name].source == UNSEEN
    assert base["mu1"].ci95 is not None
    assert found.problems == []
    assert "m0" not in found.model.standard_errors
    assert found.model.sources["m0"] == UNSEEN


def test_bounds_that_are_left_are_named():
    names, values = NOMINAL.names(), np.array(NOMINAL.values())
    assert outside(names, values, NOMINAL) == {}
    values[names.index("mu1")] = -0.05
    assert set(outside(names, values, NOMINAL)) == {"mu1"}
    assert np.all(prior_spreads(names, NOMINAL) > 0)


def test_a_size_beyond_its_bound_is_held_there_with_a_word():
    robot = load_model("paper")
    times = np.arange(3000) / 50
    motion = calibration_sequence(seconds=60.0)
    channels = record_closed_loop(robot, motion, times, Sensors(), seed=1)
    log = Log("plain", robot.platform, **channels)
    # The drive helps the turn: no friction against it, however small, is right.
    lever, push = robot.platform.lever, 4.0 * np.sign(log.velocity()[:, 2:3])
    turn = np.array([-1.0, 1.0, -1.0, 1.0]) * robot.platform.wheel_radius / (4 * lever)
    sides = np.sign(robot.platform.jacobian_array[:, 2])
    assert np.array_equal(np.sign(turn), sides)
    log = replace(log, wheel_torque=log.wheel_torque - push * turn)
    found = identify(log, NOMINAL, add=("yaw_scrub_friction",), method="ls")
    scrub = found.effects["yaw_scrub_friction"]["ts"]
    assert scrub.value == 0.0
    assert scrub.source == AT_BOUND
    assert any("yaw_scrub_friction.ts would come out at -" in doubt for doubt in found.doubts)
    assert found.lumps["x1+x3"].ci95 is not None
    # That it is held tells the friction beside it no better than had it been left out.
    sizes = {m: e.standard_errors[e.names.index("mu2")] for m, e in found.estimates.items()}
    without = identify(log, NOMINAL, method="ls").estimates["least squares"]
    assert sizes["least squares"] > without.standard_errors[without.names.index("mu2")]
