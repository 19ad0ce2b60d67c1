"""References: derivatives agree with the pose, motions I-IV have the paper's properties."""

import numpy as np
import pytest

from youbot_env.backend import NUMPY
from youbot_env.platform import youbot
from youbot_env.references import REFERENCES, Circle, Eased, calibration_sequence, make_reference

T = np.arange(0.0, 40.0, 1e-3)
# Where a hand changes the velocity within 0.3 s, differences over a millisecond are too coarse.
FINE = np.arange(0.0, 40.0, 2e-4)
NAMES = [name for name in REFERENCES if name != "step"]


@pytest.mark.parametrize("name", NAMES)
def test_rates_are_derivatives_of_the_pose(name):
    motion = make_reference(name).sample(FINE, seed=3)
    for part, derivative in ((motion.pose, motion.rate), (motion.rate, motion.acceleration)):
        for value, rate in zip(part, derivative, strict=True):
            numeric = np.gradient(value, FINE)
            # A sequence may change its velocity where two parts meet; everywhere else they agree.
            close = np.abs(numeric - rate)[2:-2] < 1e-4 * (1 + np.abs(rate[2:-2]))
            assert close.mean() > 0.999


@pytest.mark.parametrize("name", NAMES)
def test_eased_motion_has_the_right_derivatives(name):
    motion = Eased(of=make_reference(name)).sample(FINE[:15000], seed=3)
    for part, derivative in ((motion.pose, motion.rate), (motion.rate, motion.acceleration)):
        for value, rate in zip(part, derivative, strict=True):
            numeric = np.gradient(value, FINE[:15000])
            np.testing.assert_allclose(numeric[2:-2], rate[2:-2], atol=2e-5)


@pytest.mark.parametrize("name", REFERENCES)
def test_eased_motion_starts_at_rest_and_is_later_the_same(name):
    motion, eased = make_reference(name), Eased(of=make_reference(name), seconds=0.8)
    later = 0.8 * len(motion.joints)
    start, first = eased.sample(np.array([-0.1, 0.0]), 3), motion.sample(np.zeros(2), 3)
    np.testing.assert_array_equal(start.pose, first.pose)
    np.testing.assert_array_equal((start.rate, start.acceleration), 0.0)
    late = np.linspace(0.8, min([30.0, *motion.joints]) - 1.0, 200)  # before its parts join
    np.testing.assert_allclose(eased.sample(late, 3), motion.sample(late - 0.4, 3), atol=1e-12)
    assert eased.duration == pytest.approx(motion.duration + 0.4 + later)
    at_once = Eased(of=motion, seconds=0.0)
    np.testing.assert_array_equal(at_once.sample(late, 3), motion.sample(late, 3))


def test_eased_motion_stays_on_the_path_and_below_its_speed():
    motion = Eased(of=Circle(speed=0.3, frequency=0.5)).sample(T[:3000])
    x, y, _ = motion.pose
    np.testing.assert_allclose(np.hypot(x, y - 0.6), 0.6)
    speed = np.hypot(*motion.rate[:2])
    assert np.all(np.diff(speed) > -1e-12)
    assert speed[-1] == pytest.approx(0.3)
    assert np.diff(speed).max() / 1e-3 < 0.57  # m/s^2, 1.9 times the mean


@pytest.mark.parametrize("name", NAMES)
def test_twist_rate_is_the_derivative_of_the_twist(name):
    motion = make_reference(name).sample(FINE, seed=3)
    for value, rate in zip(motion.twist(NUMPY), motion.twist_rate(NUMPY), strict=True):
        close = np.abs(np.gradient(value, FINE) - rate)[2:-2] < 2e-4 * (1 + np.abs(rate[2:-2]))
        assert close.mean() > 0.999


def test_step_reverses_without_leaving_its_line():
    motion = make_reference("step", speed=0.2, frequency=1.0).sample(T)
    x, y, _ = motion.pose
    np.testing.assert_allclose(x, y, atol=1e-12)
    assert x.max() == pytest.approx(0.2 * np.pi / np.sqrt(2), rel=1e-3)
    assert set(np.round(np.hypot(*motion.rate[:2]), 12)) == {0.2}


@pytest.mark.parametrize(
    "name", ["circle", "eight", "multisine", "smooth_random", "joystick", "square", "III", "IV"]
)
def test_speed_is_respected(name):
    motion = make_reference(name, speed=0.4, frequency=1.0).sample(T, seed=1)
    assert np.hypot(*motion.rate[:2]).max() <= 0.4 * 1.0001


def test_motion_one_and_two_turn_about_their_points():
    lever = youbot().lever
    for name, index in (("I", 0), ("II", 1)):
        vx, vy, om = make_reference(name).sample(T).twist(NUMPY)
        forward, other = (vx, vy) if index == 0 else (vy, vx)
        np.testing.assert_allclose(forward, lever * om, atol=1e-12)
        np.testing.assert_allclose(other, 0.0, atol=1e-12)


def test_turns_have_no_mean_cube_of_the_yaw_rate():
    period = 2 * np.pi / 0.5
    t = np.linspace(0, period, 20001)[:-1]
    for name in ("I", "II"):
        om = make_reference(name, frequency=0.5).sample(t).rate[2]
        assert abs(np.mean(om)) < 1e-9
        assert abs(np.mean(om**3)) < 1e-9


def test_motion_four_keeps_its_centre_on_a_line_at_constant_speed():
    motion = make_reference("IV", speed=0.3).sample(T)
    np.testing.assert_allclose(np.hypot(*motion.rate[:2]), 0.3)
    vx, vy, om = motion.twist(NUMPY)
    ax, ay, _ = motion.twist_rate(NUMPY)
    np.testing.assert_allclose(ax, vy * om, atol=1e-12)
    np.testing.assert_allclose(ay, -vx * om, atol=1e-12)


def test_sequence_joins_its_parts():
    motion = make_reference("calibration", seconds=40.0).sample(T)
    for value in motion.pose:
        assert np.abs(np.diff(value)).max() < 5e-3


def test_circle_starts_at_the_origin_whatever_it_draws():
    for seed in range(5):
        motion = Circle(speed=(0.1, 0.6), frequency=(0.2, 2.0), random_phase=True).sample(
            np.zeros(1), seed
        )
        np.testing.assert_allclose([motion.pose[0][0], motion.pose[1][0]], 0.0, atol=1e-12)


def test_wrong_requests_name_the_value():
    with pytest.raises(ValueError, match="'spiral'"):
        make_reference("spiral")
    with pytest.raises(ValueError, match="speed = -1"):
        make_reference("circle", speed=-1)
    with pytest.raises(ValueError, match="seconds = -1"):
        Eased(of=Circle(), seconds=-1)
    with pytest.raises(TypeError, match="radius"):
        make_reference("circle", radius=1.0)


def test_eased_parts_join_at_rest_and_at_their_times():
    sequence = calibration_sequence(seconds=40.0)
    eased = Eased(of=sequence, seconds=1.0)
    assert sequence.joints == (10.0, 20.0, 30.0)
    assert eased.duration == 40.0 + 3.5
    # Each joint is reached a second later than the one before it: 11, 22, 33 s.
    at = np.array([11.0, 22.0, 33.0])
    rest = eased.sample(at)
    np.testing.assert_allclose(np.array(rest.rate), 0.0, atol=1e-12)
    np.testing.assert_allclose(np.array(rest.acceleration), 0.0, atol=1e-9)
    joined = sequence.sample(np.array(sequence.joints))
    np.testing.assert_allclose(np.array(rest.pose), np.array(joined.pose), atol=1e-12)
    # The velocity never jumps, which that of the bare sequence does.
    time = np.arange(0.0, 43.0, 1e-3)
    steps = [np.abs(np.diff(np.array(m.rate), axis=1)).max() for m in (eased.sample(time),
             sequence.sample(time))]  # fmt: skip
    assert steps[0] < 2e-3 < 0.1 < steps[1]


def test_a_square_comes_back_and_rests_between_its_sides():
    square = make_reference("square", speed=0.3, frequency=0.5)
    period = square.draw(np.random.default_rng(0))[0]
    pose = np.array(square.sample(np.array([0.0, period, 2 * period])).pose)
    np.testing.assert_allclose(pose, 0.0, atol=1e-9)
    rate = np.abs(square.sample(T).rate)
    assert np.count_nonzero(rate > 1e-9, axis=0).max() == 1  # one axis at a time
    assert 0.1 < np.mean(rate.max(axis=0) == 0.0) < 0.4


def test_a_joystick_stays_near_and_goes_on_after_its_period():
    stick = make_reference("joystick", speed=0.4, frequency=1.5)
    motion = stick.sample(np.arange(0.0, 300.0, 0.01), seed=2)
    assert np.hypot(*motion.pose[:2]).max() < 6.0
    assert np.abs(motion.rate)[:, -10000:].max() > 0.1
