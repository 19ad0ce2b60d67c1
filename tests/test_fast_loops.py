"""Wheel loops that run faster than the log, and what its rows then hold."""

import numpy as np
import pytest

from youbot_env.backend import FLOAT, NUMPY
from youbot_env.channels import channel_columns
from youbot_env.model_file import load_model
from youbot_env.recording import record_motion
from youbot_env.references import Eased, calibration_sequence, make_reference
from youbot_env.simulation import (
    IDEAL,
    AnalyticPlant,
    LoopInstants,
    Sensors,
    WheelLoop,
    record_closed_loop,
)

PAPER = load_model("paper")
EFFECTS = {"wheel_coulomb_friction": 0.2, "actuator_delay": 0.0034}
COLUMNS = channel_columns(PAPER.platform)
# Only wheel speeds are noisy, so that a row's torque can be compared with the command.
SPEED_NOISE = Sensors(wheel_torque=0.0, wheel_torque_step=0.0)
EIGHT = make_reference("eight")


def compiled(seconds, sensors=IDEAL, model=PAPER, reference=EIGHT, times=None, **options):
    """A record in one compiled call; 100 Hz unless times are given."""
    times = np.arange(round(100 * seconds)) / 100 if times is None else times
    return record_closed_loop(model, reference, times, sensors, seed=5, **options)


def stepped(seconds, sensors=IDEAL, model=PAPER, reference=EIGHT, plant=AnalyticPlant, **options):
    """The same sample by sample, as channels."""
    columns = record_motion(plant(model), reference, seconds, None, sensors, 5, **options)
    channels = {"time": columns["time"]}
    for channel in ("wheel_velocity", "wheel_torque", "pose", "reference"):
        channels[channel] = np.column_stack([columns[name] for name in COLUMNS[channel]])
    return channels


RECORDERS = pytest.mark.parametrize("take", [compiled, stepped])


class Keep:
    """An instrument that changes nothing and keeps what it saw."""

    def __call__(self, dense):
        self.dense = dense
        return dense


@RECORDERS
def test_loops_at_the_rate_of_the_log_are_those_that_hold_each_torque(take):
    held, same = (take(3.0, Sensors(), loop_rate=rate) for rate in (None, 100.0))
    for channel, values in held.items():
        np.testing.assert_array_equal(same[channel], values)
    fast = take(3.0, Sensors(), loop_rate=1000.0)
    assert np.abs(fast["wheel_torque"] - held["wheel_torque"]).max() > 0.05


@RECORDERS
def test_equal_seeds_give_equal_rows(take):
    first, second = (take(2.0, Sensors(), loop_rate=500.0, row="averaged") for _ in range(2))
    for channel, values in first.items():
        np.testing.assert_array_equal(second[channel], values)


@RECORDERS
def test_a_sampled_row_holds_reading_and_command_of_one_instant(take):
    keep = Keep()
    rows = take(3.0, SPEED_NOISE, loop_rate=1000.0, instrument=keep)
    dense, loop, integral = keep.dense, WheelLoop(), (0.0,) * 4
    assert len(dense["time"]) == 2991  # from the first row to the last
    np.testing.assert_allclose(dense["time"], np.arange(2991) / 1000, atol=1e-12)
    for channel in ("time", "wheel_velocity", "wheel_torque", "reference"):
        np.testing.assert_array_equal(rows[channel], dense[channel][::10])
    # The commands are the loop's answer to these very readings.
    wanted = dense["reference"] @ PAPER.platform.jacobian_array.T
    for k, speed in enumerate(dense["wheel_velocity"]):
        torque, integral = loop.torque(tuple(wanted[k]), tuple(speed), integral, 1e-3, FLOAT)
        np.testing.assert_allclose(dense["wheel_torque"][k], torque, atol=1e-9)
    grain = SPEED_NOISE.wheel_velocity_step
    ticks = dense["wheel_velocity"] / grain
    np.testing.assert_allclose(ticks, np.round(ticks), atol=1e-6)


@RECORDERS
def test_an_averaged_row_is_the_mean_of_the_commands_before_it(take):
    keep = Keep()
    rows = take(3.0, SPEED_NOISE, loop_rate=1000.0, row="averaged", instrument=keep)
    command = keep.dense["wheel_torque"]
    means = command[:-1].reshape(-1, 10, 4).mean(axis=1)
    np.testing.assert_allclose(rows["wheel_torque"][1:], means, atol=1e-12)
    np.testing.assert_array_equal(rows["wheel_torque"][0], 0.0)
    np.testing.assert_array_equal(rows["wheel_velocity"], keep.dense["wheel_velocity"][::10])


@pytest.mark.parametrize("row", ["sampled", "averaged"])
@pytest.mark.parametrize("loop_rate", [None, 1000.0])
def test_both_recorders_agree_without_noise(loop_rate, row):
    options = {
        "model": PAPER.with_effects(EFFECTS), "reference": calibration_sequence(seconds=12.0),
        "loop_rate": loop_rate, "row": row,
    }  # fmt: skip
    one, other = compiled(12.0, **options), stepped(12.0, **options)
    for channel, values in one.items():
        np.testing.assert_allclose(other[channel], values, atol=1e-9)


@RECORDERS
def test_a_delay_between_loop_steps_is_exact(take):
    keep = Keep()
    delay, fine = EFFECTS["actuator_delay"], 2e-4
    rows = take(3.0, loop_rate=1000.0, model=PAPER.with_effects(EFFECTS), instrument=keep)
    command, late = keep.dense["wheel_torque"], round(delay / fine)
    # A robot without delay gets the commands of 17 of its steps ago.
    other = {"wheel_coulomb_friction": EFFECTS["wheel_coulomb_friction"]}
    plant = AnalyticPlant(PAPER.with_effects(other), fine)
    poses = []
    for k in range(5 * (len(command) - 1) + 1):
        if k % 50 == 0:
            poses.append(plant.pose)
        given = (k - late) // 5
        plant.step(command[given] if given >= 0 else np.zeros(4))
    np.testing.assert_allclose(rows["pose"], poses, atol=1e-9)


def test_jittered_rows_are_met_by_whole_loop_steps():
    late = np.random.default_rng(0).uniform(-0.15, 0.15, 300)
    times = (np.arange(300) + late) / 100
    at = LoopInstants.of(times, 1000.0)
    np.testing.assert_array_equal(at.time[at.row], times)
    np.testing.assert_array_equal(np.diff(at.row), np.rint(np.diff(times) * 1000))
    np.testing.assert_allclose(np.diff(at.time), at.step[:-1], atol=1e-12)
    assert np.abs(at.step - 1e-3).max() < 1e-4
    keep = Keep()
    rows = compiled(0, SPEED_NOISE, times=times, loop_rate=1000.0, row="averaged", instrument=keep)
    np.testing.assert_array_equal(rows["time"], times)
    for k in (1, 57, 299):
        between = keep.dense["wheel_torque"][at.row[k - 1] : at.row[k]]
        np.testing.assert_allclose(rows["wheel_torque"][k], between.mean(axis=0), atol=1e-12)


@RECORDERS
def test_an_instrument_sees_dense_channels_and_noise_comes_after_it(take):
    seen = {}

    def mute(dense):
        seen.update({name: values.shape for name, values in dense.items()})
        return dense | {"wheel_torque": 0 * dense["wheel_torque"], "pose": 0 * dense["pose"]}

    sensors = Sensors()
    rows = take(2.0, sensors, loop_rate=500.0, instrument=mute)
    assert seen == {
        "time": (996,), "wheel_velocity": (996, 4), "wheel_torque": (996, 4), "pose": (996, 3),
        "velocity": (996, 3), "reference": (996, 3),
    }  # fmt: skip
    assert np.std(rows["wheel_torque"]) == pytest.approx(sensors.wheel_torque, rel=0.1)
    assert np.std(rows["pose"][:, :2]) == pytest.approx(sensors.position, rel=0.15)


def test_dense_pose_and_velocity_are_the_true_motion():
    keep = Keep()
    compiled(4.0, Sensors(), loop_rate=1000.0, instrument=keep)
    pose, velocity = keep.dense["pose"], keep.dense["velocity"]
    rate = np.gradient(pose, 1e-3, axis=0)
    c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    body = np.column_stack([c * rate[:, 0] + s * rate[:, 1], c * rate[:, 1] - s * rate[:, 0],
                            rate[:, 2]])  # fmt: skip
    np.testing.assert_allclose(body[1:-1], velocity[1:-1], atol=2e-3)


def test_logged_reference_and_set_points_are_eased():
    keep = Keep()
    compiled(3.0, loop_rate=1000.0, instrument=keep)
    eased = Eased(of=EIGHT).sample(keep.dense["time"])
    np.testing.assert_allclose(keep.dense["reference"].T, eased.twist(NUMPY), atol=1e-12)
    assert np.abs(keep.dense["wheel_torque"][0]).max() == 0.0  # at rest, nothing is asked for yet
    assert np.abs(keep.dense["wheel_torque"]).max() < 3.0  # and the limit of 4 N m stays far


@pytest.mark.parametrize("loop_rate", [None, 1000.0])
@pytest.mark.parametrize("motion", ["smooth_random", "eight", "circle", "multisine", "calibration"])
def test_wheels_do_not_press_against_each_other(motion, loop_rate):
    reference = make_reference(motion)
    for seed in range(3):
        rows = record_closed_loop(
            PAPER, reference, np.arange(11200) / 100, Sensors(), seed=seed, loop_rate=loop_rate
        )
        against = rows["wheel_torque"][300:] @ np.array([1, 1, -1, -1]) / 4
        assert abs(against.mean()) < 0.02
        assert np.sqrt(np.mean(against**2)) < 0.03  # the noise of the torques is 0.015


def test_real_rollers_press_little_against_each_other():
    pytest.importorskip("mujoco")
    from youbot_env.rollers import RollersPlant

    # Two rounds of the eight after the first seconds; loops that never forget hold 0.6 N m.
    rows = stepped(28.14, Sensors(), plant=RollersPlant, loop_rate=1000.0)
    assert abs((rows["wheel_torque"][300:] @ np.array([1, 1, -1, -1]) / 4).mean()) < 0.05


@RECORDERS
def test_what_rows_cannot_be_is_refused(take):
    with pytest.raises(ValueError, match=r"loop_rate = 50 Hz is below the log's 100 Hz"):
        take(1.0, loop_rate=50.0)
    with pytest.raises(ValueError, match="row = 'held'; choose one of sampled, averaged"):
        take(1.0, row="held")
