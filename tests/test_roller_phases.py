"""Where the rollers of each wheel are: told by the wheels, taken into diagnosis, log by log."""

from dataclasses import replace

import numpy as np
import pytest

from ident import diagnose
from ident.dead_reckoning import wheel_angles
from ident.kinematics.ripple import PITCH, ripple_share, roller_phases, with_phases_of
from ident.log import Log
from youbot_env.model_file import load_model
from youbot_env.references import SmoothRandom, calibration_sequence
from youbot_env.simulation import Sensors, record_closed_loop

PHASES = {"phi0_fl": 0.45, "phi0_fr": -0.3, "phi0_rl": 0.1, "phi0_rr": -0.5}
CLOSE = 0.06  # rad; half a row at the highest wheel speed and noise of the speeds
BEGIN = 4.0  # s; by then every wheel has turned to another place


def apart(one, other):
    """How far phases are from each other at most, rollers apart or not."""
    gap = np.asarray(one) - np.asarray(other)
    return np.abs(gap - PITCH * np.round(gap / PITCH)).max()


@pytest.fixture(scope="module")
def logs():
    robot = load_model("paper").with_effects(
        {"roller_ripple": {"size": 0.8, **PHASES}, "wheel_coulomb_friction": 0.15}
    )
    found = []
    motions = ((calibration_sequence(seconds=80.0), 80.0), (SmoothRandom(0.35, 1.5), 44.0))
    for seed, (motion, seconds) in enumerate(motions):
        times = np.arange(round(seconds * 100)) / 100
        channels = record_closed_loop(robot, motion, times, Sensors(), seed=seed + 1)
        found.append(Log(f"log{seed}", robot.platform, **channels))
    return found


def test_phases_are_told_by_the_wheels(logs):
    assert apart(roller_phases(logs[0]), list(PHASES.values())) < CLOSE
    assert apart(roller_phases(logs[1]), list(PHASES.values())) < CLOSE


def test_a_log_that_begins_elsewhere_is_brought_to_the_same_phases(logs):
    late = logs[1].part(BEGIN, 44.0)
    turned = wheel_angles(logs[1])[round(BEGIN * 100)]
    assert np.abs(turned).max() > 1.0
    same = with_phases_of(logs[0], late)
    assert apart(same.wheel_angle[0], turned) < 2 * CLOSE
    assert with_phases_of(logs[0], logs[1]) is logs[1]


def test_wheels_without_ripple_tell_no_phases():
    log = Log.load("youbot_fit")
    assert ripple_share(log) > 0.9
    assert roller_phases(log) is None  # rollers of the bundled robot begin in the middle
    robot = load_model("paper")
    times = np.arange(3000) / 100
    channels = record_closed_loop(robot, SmoothRandom(0.35, 1.5), times, Sensors(), seed=1)
    ideal = Log("ideal", robot.platform, **channels)
    assert roller_phases(ideal) is None
    assert with_phases_of(log, ideal) is ideal


def test_diagnosis_finds_the_ripple_of_rollers_that_begin_anywhere(logs):
    found = diagnose(logs[0], test=logs[1].part(BEGIN, 44.0))
    assert {step.best.identifier for step in found.named} == {
        "wheel_coulomb_friction",
        "roller_ripple",
    }
    (ripple,) = [a.values for a in found.model.effects if a.identifier == "roller_ripple"]
    assert ripple["size"] == pytest.approx(0.8, abs=0.03)
    assert apart([ripple[name] for name in PHASES], list(PHASES.values())) < CLOSE
    assert found.errors.after < 0.2 * found.errors.before


def test_what_contradicts_as_rollers_do_not_is_not_theirs():
    log = Log.load("youbot_fit")
    swinging = log.wheel_velocity.copy()
    swinging[:, 0] += np.sin(9.0 * log.time)  # one wheel swings by the clock
    assert ripple_share(replace(log, wheel_velocity=swinging)) < 0.5
