"""Estimates keep to what is known beforehand where logs say less, and only there."""

from dataclasses import replace

import numpy as np
import pytest

from ident.identification import identify
from ident.log import Log
from ident.prior import outside, prior_spreads
from ident.quantities import AT_BOUND
from youbot_env.model_file import load_model
from youbot_env.references import Step, calibration_sequence
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
