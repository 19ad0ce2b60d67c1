"""What equal strokes have in common, of made-up robots that turn while they drive straight."""

from dataclasses import replace

import numpy as np
import pytest
from shared_data import shared

from ident.log import Log
from ident.repeats import repeats
from youbot_env.platform import youbot

COUNT, ROWS = 6, 100


def strokes(common, apart, seed=0):
    """Equal strokes to the left with yaw rates, rad/s, that are common and that are not."""
    rng, platform = np.random.default_rng(seed), youbot()
    shape = np.sin(np.pi * np.arange(ROWS) / ROWS)
    rest = np.zeros(ROWS)
    push = np.tile(np.r_[shape, rest], COUNT)
    yaw = np.concatenate(
        [np.r_[(common + apart * rng.normal()) * shape, rest] for _ in range(COUNT)]
    )
    velocity = np.stack([0 * push, 0.5 * push, yaw], axis=1)
    jacobian = platform.jacobian_array
    torque = 10.0 * push[:, None] * jacobian[:, 1] / np.sum(jacobian[:, 1] ** 2)
    return Log(
        "strokes",
        platform,
        np.arange(len(push)) * 0.01,
        velocity @ jacobian.T,
        wheel_torque=torque,
        body_velocity=velocity,
    )


@pytest.mark.parametrize(("common", "apart", "share"), [(0.2, 0.0, 1.0), (0.2, 0.1, 0.8)])
def test_the_common_share_is_that_of_the_mean_square(common, apart, share):
    found = [r.share for s in range(20) for r in repeats([strokes(common, apart, s)])]
    assert abs(np.mean(found) - share) < 0.06


def test_chance_alone_does_not_repeat():
    found = [r.share for s in range(20) for r in repeats([strokes(0.0, 0.2, s)])]
    assert np.mean(found) < 0.15
    (one,) = repeats([strokes(0.0, 0.2)])
    assert "no law of the motion" in str(one)
    assert (one.stroke, one.axis, one.count) == ("left", "yaw rate", COUNT)


def test_straight_strokes_are_not_mentioned():
    assert repeats([strokes(0.01, 0.0)]) == []


def test_two_strokes_are_too_few():
    log = strokes(0.2, 0.0)
    assert repeats([log.part(0.0, 2.0 * 2 * ROWS * 0.01)]) == []


def test_strokes_that_are_driven_otherwise_are_not_equal():
    log = strokes(0.2, 0.0)
    torque = log.wheel_torque.copy()
    torque[2 * ROWS :] = -torque[2 * ROWS :]
    assert {r.count for r in repeats([replace(log, wheel_torque=torque)])} == {COUNT - 1}


def test_the_yaw_of_sideways_strokes_of_a_real_robot_repeats():
    log = Log.load(shared("ftc-mecanum", "r1", "y.csv"), "R=0.048 r=0.012 l=0.14 h=0.14")
    found = {r.stroke: r.share for r in repeats([log]) if r.axis == "yaw rate"}
    assert found["left"] > 0.7
    assert found["right"] > 0.7
