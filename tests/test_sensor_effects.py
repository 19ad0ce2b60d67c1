"""Effects of the recording: they spoil what happened, and are undone again."""

from dataclasses import replace

import numpy as np
import pytest

from ident.log import Log
from ident.restored import restored
from youbot_env.effects import effect_names, get_effect
from youbot_env.measurement import Dense, DriveInput, slope
from youbot_env.model_file import load_model
from youbot_env.platform import youbot

PLATFORM = youbot()
SENSORS = [name for name in effect_names() if get_effect(name).link == "sensor"]
STEP, ROW = 1e-3, 0.01
TIME = np.arange(0.0, 12.0, STEP)
ROWS = slice(None, None, round(ROW / STEP))
# What a law of the recording is at nothing, where its typical size is something.
NEUTRAL = dict.fromkeys(("d", "T", "b", "k", "angle", "px", "py", "q", "kind"), 0.0)


def happened(columns, seed):
    """Smooth signals (K, columns) of some sines up to 2 Hz."""
    rng = np.random.default_rng(seed)
    rate, phase = rng.uniform(1.0, 12.0, (columns, 3)), rng.uniform(0, 6, (columns, 3))
    return np.sin(rate * TIME[:, None, None] + phase).sum(axis=2) + 0.3


CHANNELS = {"wheel_torque": happened(4, 1), "wheel_velocity": 3 * happened(4, 2),
            "body_velocity": 0.3 * happened(3, 3)}  # fmt: skip


def means(torque):
    """Means over the rows' intervals (N - 1, n), by the trapezoidal rule between samples."""
    middle = 0.5 * (torque[1:] + torque[:-1])
    return middle[: len(middle) // 10 * 10].reshape(-1, 10, torque.shape[1]).mean(axis=1)


def recorded(effects):
    """A log of what happened, through instruments in the order of their chain."""
    model = load_model("nominal").with_effects(effects)
    dense = Dense(PLATFORM, {"time": TIME, **CHANNELS})
    for active in sorted(model.effects, key=lambda active: active.effect.order):
        active.effect.record(active.effect.arrange(active.values, PLATFORM), dense)
    rows = {name: values[ROWS] for name, values in dense.channels.items()}
    if dense.hold == "averaged":
        inside = means(dense.channels["wheel_torque"])
        rows["wheel_torque"] = np.concatenate([inside[:1], inside])
    return model, Log("log", PLATFORM, **rows)


EXACT = means(CHANNELS["wheel_torque"])


def torque_error(log):
    # Before the first row and after the last nobody knows the torque.
    return np.abs(log.wheel_torque[: len(EXACT)] - EXACT)[30:-30].max()


@pytest.mark.parametrize(
    ("effects", "bound"),
    [
        ({"drive_hold": "sampled"}, 6e-3),
        ({"drive_hold": "averaged"}, 6e-3),
        ({"drive_hold": "sampled", "drive_offset": 0.023}, 6e-3),
        ({"drive_hold": "sampled", "drive_offset": -0.017}, 6e-3),
        ({"drive_hold": "averaged", "drive_offset": 0.05}, 6e-3),
        ({"drive_hold": "sampled", "drive_filter": 0.02}, 1.2e-2),
        ({"drive_hold": "sampled", "drive_filter": 0.012, "drive_offset": 0.031}, 1.2e-2),
    ],
)
def test_the_drive_is_restored_to_the_impulse_of_every_interval(effects, bound):
    model, log = recorded(effects)
    assert torque_error(restored(log, model)) < bound
    # The torque changes by up to 0.2 N m from row to row: as they stand the rows are far off.
    assert torque_error(log) > 0.1


def test_rows_are_held_where_nobody_says_otherwise():
    log = recorded({"drive_hold": "sampled"})[1]
    assert log.pose is None
    same = restored(log, load_model("nominal"))
    assert same.command is log.command
    assert same.wheel_velocity is log.wheel_velocity
    assert same.pose[0] == pytest.approx(0.0)
    assert DriveInput(log.time, log.command).means() is log.command


def test_held_rows_and_means_of_intervals_are_exact_whatever_the_rows_are():
    rng = np.random.default_rng(4)
    time, rows = np.cumsum(rng.uniform(0.5, 1.5, 200)) * ROW, rng.normal(size=(200, 4))
    means = DriveInput(time, rows, "averaged").means()
    np.testing.assert_allclose(means[:-1], rows[1:], rtol=0, atol=1e-12)
    # A held row that is late by exactly its interval acts as the mean over the time before does.
    time = np.arange(200) * ROW
    late = DriveInput(time, rows, "held", ROW).means()
    np.testing.assert_allclose(late[:-2], rows[1:-1], rtol=0, atol=1e-9)


@pytest.mark.parametrize(
    ("effects", "channel", "bound"),
    [
        ({"velocity_filter": 0.02}, "wheel_velocity", 0.12),
        ({"velocity_filter": 0.02}, "body_velocity", 0.012),
        ({"gyro_bias": 0.05}, "body_velocity", 1e-12),
        ({"gyro_scale": 0.1}, "body_velocity", 1e-12),
        ({"sensor_mounting": {"angle": 0.4, "px": 0.2, "py": -0.1}}, "body_velocity", 1e-12),
        ({"sensor_mounting": 1.6, "gyro_bias": 0.02, "gyro_scale": -0.05}, "body_velocity", 1e-12),
    ],
)
def test_velocities_are_restored(effects, channel, bound):
    model, log = recorded(effects)
    exact = CHANNELS[channel][ROWS]
    found = getattr(restored(log, model), channel)
    assert np.abs(found - exact)[20:-20].max() < bound
    assert np.abs(getattr(log, channel) - exact)[20:-20].max() > 4 * bound


def test_a_sensor_away_from_the_centre_shows_the_velocity_of_its_place():
    effects = {"sensor_mounting": {"angle": np.pi / 2, "px": 0.2, "py": -0.1}}
    vx, vy, yaw_rate = CHANNELS["body_velocity"][ROWS].T
    shown = recorded(effects)[1].body_velocity
    # By hand: V + Omega x p = (vx + 0.1 Om, vy + 0.2 Om); the sensor's own x axis is body Y.
    np.testing.assert_allclose(shown[:, 0], vy + 0.2 * yaw_rate, atol=1e-12)
    np.testing.assert_allclose(shown[:, 1], -(vx + 0.1 * yaw_rate), atol=1e-12)


def test_a_filter_lags_by_its_time_constant_and_an_offset_by_its_size():
    ramp = np.repeat(TIME[:, None], 4, axis=1)
    for name in ("drive_filter", "drive_offset"):
        dense = Dense(PLATFORM, {"time": TIME, "wheel_torque": ramp.copy()})
        effect = get_effect(name)
        effect.record(effect.arrange(effect.complete(0.03, PLATFORM), PLATFORM), dense)
        lag = (ramp - dense.channels["wheel_torque"])[2000:]
        np.testing.assert_allclose(lag, 0.03, atol=1e-3)


def test_steps_of_the_speeds_are_whole_multiples():
    log = recorded({"speed_quantisation": 0.25})[1]
    np.testing.assert_allclose(np.remainder(log.wheel_velocity / 0.25, 1.0), 0.0, atol=1e-9)


def test_what_a_log_states_goes_before_what_a_model_says():
    model, log = recorded({"drive_hold": "sampled", "drive_offset": 0.02})
    wrong = load_model("nominal").with_effects({"drive_hold": "held", "drive_offset": -0.05})
    told = replace(log, recording={a.identifier: a.values for a in model.effects})
    expected = restored(log, model).wheel_torque
    np.testing.assert_array_equal(restored(told, wrong).wheel_torque, expected)
    np.testing.assert_array_equal(restored(told, load_model("nominal")).wheel_torque, expected)
    assert restored(told, wrong).recording == {}


@pytest.mark.parametrize("name", SENSORS)
def test_at_nothing_a_sensor_changes_nothing(name):
    effect = get_effect(name)
    model, log = recorded({name: {p.name: NEUTRAL[p.name] for p in effect.parameters}})
    for channel in ("wheel_velocity", "body_velocity"):
        np.testing.assert_array_equal(getattr(log, channel), CHANNELS[channel][ROWS])
        np.testing.assert_allclose(
            getattr(restored(log, model), channel), CHANNELS[channel][ROWS], atol=1e-12
        )
    np.testing.assert_array_equal(restored(log, model).wheel_torque, log.wheel_torque)


def test_words_stand_for_choices():
    effect = get_effect("drive_hold")
    assert effect.complete("averaged", PLATFORM) == {"kind": 2.0}
    assert effect.parameters[0].shown(1.0) == "sampled"
    with pytest.raises(ValueError, match="held, sampled, averaged"):
        effect.complete("frozen", PLATFORM)
    with pytest.raises(ValueError, match="none of held, sampled, averaged"):
        effect.complete(0.5, PLATFORM)


def test_slopes_of_straight_lines_are_exact_and_average_noise():
    rng = np.random.default_rng(5)
    time = np.cumsum(rng.uniform(0.005, 0.015, 400))
    line = np.stack([2.0 * time, 1.0 - time], axis=1)
    np.testing.assert_allclose(slope(time, line, 0.05)[5:-5], [[2.0, -1.0]] * 390, atol=1e-9)
    noise = rng.normal(size=(400, 1))
    assert slope(time, noise, 0.05).std() < 0.5 * np.gradient(noise[:, 0], time).std()
