"""Output error: intervals that hold what they should, steps that survive bad guesses."""

import numpy as np
import pytest

from ident.free_run import cut_windows, free_run
from ident.log import Log
from ident.noise import drifted, torque_noise, white_variance
from ident.output_error import refine
from ident.sensitivity import Linearised
from youbot_env.model_file import load_model
from youbot_env.references import calibration_sequence
from youbot_env.simulation import IDEAL, Sensors, record_closed_loop

PAPER, NOMINAL = load_model("paper"), load_model("nominal")


def record(model, seconds, sensors, seed=1):
    times = np.arange(round(seconds * 100)) / 100
    channels = record_closed_loop(model, calibration_sequence(seconds=seconds), times, sensors,
                                  seed=seed)  # fmt: skip
    return Log("log", model.platform, **channels)


@pytest.fixture(scope="module")
def noisy():
    return record(PAPER, 60.0, Sensors())


def test_covariance_is_that_of_fits_without_one_window(noisy):
    full = refine([noisy], NOMINAL)
    count = full.windows
    values = []
    for window in range(count):
        keep = np.arange(count) != window
        values.append(refine([noisy], full.model, iterations=3, keep=[keep]).model.values())
    spread = np.array(values) - np.mean(values, axis=0)
    exact = np.sqrt(np.sum(spread**2, axis=0) * (count - 1) / count)
    # A little wider, as values that few windows carry have a wider Student's t.
    ratio = np.sqrt(np.diag(full.covariance)) / exact
    assert np.all((ratio > 0.93) & (ratio < 1.3))


def test_intervals_know_that_integrated_angles_drift(monkeypatch):
    a, b = 0.2, 0.1
    truth = PAPER.with_effects({"torque_ripple": {"a_fl": a, "b_fl": b, "k": 6.0}})
    log = record(truth, 60.0, Sensors(wheel_velocity=0.06))
    found = refine([log], truth)
    at = [found.model.names().index(f"torque_ripple.{name}_fl") for name in "ab"]
    error = (np.array(found.model.values()) - truth.values())[at]
    # The drift turns the phase: it moves a and b against each other.
    turn = np.array([b, -a]) / np.hypot(a, b)

    def sigma(covariance):
        return float(np.sqrt(turn @ covariance[np.ix_(at, at)] @ turn))

    known = sigma(found.covariance)
    assert abs(turn @ error) < 3.0 * known
    monkeypatch.setattr("ident.residuals.drifted", lambda sim, rng: sim)
    assert known > 1.5 * sigma(refine([log], found.model, iterations=1).covariance)


def test_only_laws_that_read_the_angle_feel_its_drift(noisy):
    rng = np.random.default_rng(0)
    for model, feels in ((PAPER.with_effects({"torque_ripple": {"a": 0.2}}), True), (PAPER, False)):
        sim = Linearised.of(noisy, model)
        assert bool(np.any(drifted(sim, rng).residual != sim.residual)) is feels


def test_noise_is_read_off_beneath_the_motion(noisy):
    sensors = Sensors()
    found = np.sqrt(white_variance(noisy, noisy.wheel_velocity))
    assert found == pytest.approx(sensors.wheel_velocity, rel=0.25)
    quiet = record(PAPER, 20.0, IDEAL)
    assert np.all(
        np.sqrt(white_variance(quiet, quiet.wheel_velocity)) < 0.2 * sensors.wheel_velocity
    )


def test_a_bad_guess_ends_at_the_same_values(noisy):
    near = refine([noisy], NOMINAL).model
    far = NOMINAL.with_values([4.0 * v for v in NOMINAL.values()[:3]] + [1.5, -1.0, 0.6, 0.03])
    found = refine([noisy], far, iterations=60)
    assert found.converged
    assert found.model.values() == pytest.approx(near.values(), rel=1e-3, abs=1e-4)


def test_windows_start_at_the_velocity_that_the_wheels_of_the_model_show():
    truth = PAPER.with_effects({"wheel_radius_error": {"e": 0.1, "e_rr": 0.05}})
    log = record(truth, 20.0, IDEAL)
    assert free_run(log, truth).nrmse < 0.02 * free_run(log, PAPER).nrmse


def test_a_guess_that_is_at_its_end_binds_nothing(noisy):
    values = dict(zip(NOMINAL.names(), NOMINAL.values(), strict=True))
    tiny = NOMINAL.with_values([*(values | {"I0": 0.01, "mu1": 1e-3}).values()])
    found, near = (refine([noisy], start, iterations=60).model for start in (tiny, NOMINAL))
    assert found.values() == pytest.approx(near.values(), rel=1e-2)


def test_noise_of_the_torques_is_what_the_speeds_do_not_explain(noisy):
    assert torque_noise(noisy) == pytest.approx(Sensors().wheel_torque, rel=0.15)
    assert np.all(torque_noise(record(PAPER, 20.0, IDEAL)) < 0.1 * Sensors().wheel_torque)


def test_noise_of_the_torques_does_not_bias_a_dead_zone(monkeypatch):
    truth = PAPER.with_effects({"torque_dead_zone": {"threshold": 0.1}})
    logs = [record(truth, 30.0, Sensors(wheel_torque=0.06), seed) for seed in range(6)]
    at = truth.names().index("torque_dead_zone.threshold")

    def errors():
        return np.array([refine([log], truth).model.values()[at] - 0.1 for log in logs])

    taken_back = errors()
    monkeypatch.setattr("ident.output_error.noisier", lambda logs, pairs: iter(()))
    left = errors()
    assert left.mean() > 4.0 * left.std(ddof=1) / np.sqrt(len(logs))  # else it tests nothing
    assert abs(taken_back.mean()) < 0.3 * left.mean()


def test_what_a_record_begins_with_is_left_out(noisy):
    windows = cut_windows(noisy, PAPER, 2.0)
    assert windows.index[0, 0] == 11  # 0.1 s of history, then the start of the window
    short = noisy.part(noisy.time[0], noisy.time[0] + 2.02)
    assert len(cut_windows(short, PAPER, 2.0).index) == 1
