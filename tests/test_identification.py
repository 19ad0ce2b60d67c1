"""Identification: truth is recovered, estimators agree, intervals hold, holds are exact."""

import time
from dataclasses import replace

import numpy as np
import pytest
from shared_data import shared

from ident.consistency import lump_weights
from ident.estimators import instrumental_variables, least_squares, reference_motion
from ident.filters import FirstOrderFilter, delayed_hold, linear_hold
from ident.free_run import free_run
from ident.identification import identify
from ident.log import Log
from ident.recursive import RecursiveLeastSquares, history, sample_times
from ident.regression import build_regression
from youbot_env.effects import Effect, Parameter, get_effect, register
from youbot_env.model_file import load_model
from youbot_env.parameters import lumps, to_x
from youbot_env.references import SmoothRandom, calibration_sequence
from youbot_env.simulation import IDEAL, Sensors, record_closed_loop

PAPER, NOMINAL = load_model("paper"), load_model("nominal")
TRUE_X = np.array(to_x(PAPER.parameters.theta(PAPER.platform), PAPER.platform))


def record(model=PAPER, sensors=IDEAL, seconds=112.0, rate=100.0, seed=0, reference=None) -> Log:
    times = np.arange(round(seconds * rate)) / rate
    reference = reference or calibration_sequence(seconds=seconds)
    return Log(
        "log", model.platform, **record_closed_loop(model, reference, times, sensors, seed=seed)
    )


@pytest.fixture(scope="module")
def clean():
    return record()


@pytest.fixture(scope="module")
def noisy():
    return record(sensors=Sensors(), seed=3)


def x_of(values):
    return np.array(to_x(type(PAPER.parameters.theta(PAPER.platform))(*values[:7]), PAPER.platform))


def test_clean_log_gives_every_entry_of_x_within_a_thousandth(clean):
    regression = build_regression(clean, NOMINAL)
    np.testing.assert_allclose(x_of(least_squares(regression).values), TRUE_X, rtol=1e-3)
    _, track = history(regression, np.array(NOMINAL.values()), np.full(7, 1e4))
    np.testing.assert_allclose(x_of(track[-1]), TRUE_X, rtol=1e-3)


def test_noisy_log_gives_lumps_within_a_hundredth(noisy):
    regression = build_regression(noisy, NOMINAL)
    instruments = build_regression(noisy, NOMINAL, transform=reference_motion).H
    true = np.array(list(lumps(TRUE_X).values()))
    for estimate in (least_squares(regression), instrumental_variables(regression, instruments)):
        found = np.array(list(lumps(x_of(estimate.values)).values()))
        np.testing.assert_allclose(found, true, rtol=1e-2)


def test_recursive_form_agrees_with_batch_and_single_updates_with_many(noisy):
    regression = build_regression(noisy, NOMINAL)
    batch = least_squares(regression).values
    one, many = (RecursiveLeastSquares(np.zeros(7), np.full(7, 1e8)) for _ in range(2))
    dt = sample_times(regression)
    many.update_many(regression.H, regression.y, dt)
    for H, y, step in zip(regression.H, regression.y, dt, strict=True):
        one.update(H, y, step)
    np.testing.assert_allclose(one.estimate, many.estimate, rtol=1e-9)
    np.testing.assert_allclose(many.estimate, batch, rtol=1e-6)


def test_forgetting_follows_a_change_and_agrees_between_forms(noisy):
    regression = build_regression(noisy, NOMINAL)
    dt = sample_times(regression)
    y = regression.y.copy()
    half = len(y) // 2
    y[half:] += regression.H[half:] @ np.array([10.0, 0, 0, 0, 0, 0, 0])
    forgets, remembers, one = (
        RecursiveLeastSquares(np.zeros(7), np.full(7, 1e6), f) for f in (0.1, 0.0, 0.1)
    )
    for estimator in (forgets, remembers):
        estimator.update_many(regression.H, y, dt)
    for H, z, step in zip(regression.H, y, dt, strict=True):
        one.update(H, z, step)
    np.testing.assert_allclose(one.estimate, forgets.estimate, rtol=1e-6)
    true = PAPER.parameters.m0 + 10.0
    assert abs(forgets.estimate[0] - true) < 0.5 * abs(remembers.estimate[0] - true)


@pytest.mark.parametrize("rate", [50.0, 100.0, 1000.0])
def test_filter_of_a_straight_line_is_exact_at_every_rate(rate):
    t = np.arange(0, 3, 1 / rate)
    a, u = 10.0, 2.0 + 3.0 * t
    exact = 2.0 + 3.0 * (t - 1 / a) + (0.0 - 2.0 + 3.0 / a) * np.exp(-a * t)
    np.testing.assert_allclose(linear_hold(u, t, a), exact, atol=1e-12)


def test_filter_of_held_steps_is_exact_and_jitter_changes_nothing():
    rng = np.random.default_rng(0)
    t = np.cumsum(rng.uniform(0.005, 0.015, 2000))
    u, a, state = rng.normal(size=len(t)), 10.0, 0.0
    filtered = FirstOrderFilter(t, a).hold(u[:-1], u[:-1])
    for k in range(len(t) - 1):
        assert filtered[k] == pytest.approx(state, abs=1e-9)
        keep = np.exp(-a * (t[k + 1] - t[k]))
        state = keep * state + (1 - keep) * u[k]


def test_filtered_rate_is_the_rate_of_the_filtered_signal():
    t = np.arange(0, 5, 1e-3)
    u = np.sin(2 * t)
    grid = FirstOrderFilter(t, 10.0)
    np.testing.assert_allclose(grid.rate(u), grid.linear(2 * np.cos(2 * t)), atol=2e-5)


def test_delayed_hold_keeps_the_impulse():
    t, rng = np.arange(0, 2, 0.01), np.random.default_rng(1)
    u = rng.normal(size=(len(t), 4))
    late = delayed_hold(u, t, 0.013)
    np.testing.assert_allclose(late[1], 0.3 * u[0] + 0.7 * u[0], atol=1e-12)
    np.testing.assert_allclose(late[50], 0.3 * u[48] + 0.7 * u[49], atol=1e-12)


def test_free_run_of_the_truth_is_exact_and_of_the_nominal_is_not(clean):
    assert free_run(clean, PAPER).nrmse < 1e-6
    assert free_run(clean, NOMINAL).nrmse > 0.1


def test_effects_are_estimated_with_the_rest():
    hidden = {"wheel_coulomb_friction": 0.2, "floor_slope": {"sx": 0.01, "sy": -0.02}}
    log = record(PAPER.with_effects(hidden), Sensors(), seed=5)
    result = identify(log, add=("wheel_coulomb_friction", "floor_slope"))
    assert result.effects["wheel_coulomb_friction"]["fc"].value == pytest.approx(0.2, rel=0.02)
    assert result.effects["floor_slope"]["sx"].value == pytest.approx(0.01, rel=0.03)
    assert result.effects["floor_slope"]["sy"].value == pytest.approx(-0.02, rel=0.03)
    assert result.parameters["m0"].value == pytest.approx(35.3, rel=0.03)


def test_free_run_refinement_finds_a_delay():
    log = record(PAPER.with_effects({"actuator_delay": 0.023}), Sensors(), seconds=40.0, seed=2)
    result = identify(log, add={"actuator_delay": 0.01})
    assert result.method == "free run"
    assert result.effects["actuator_delay"]["d"].value == pytest.approx(0.023, abs=1e-3)


def test_an_effect_of_the_users_own_serves_simulator_and_regression(monkeypatch):
    monkeypatch.setattr("youbot_env.effects._EXTRA", {})

    class HeadWind(Effect):
        identifier = "head_wind"
        title = "Wind along world x"
        equation = r"F = -w\,R(\psi)^{\mathsf T} e_x"
        link = "body"
        parameters = (Parameter("w", "N", "force", 4.0, (-50.0, 50.0)),)
        needs_pose = True

        def body(self, p, s, ops):
            c, n = ops.cos_sin(s.pose[2])
            return -p.w * c, p.w * n, 0.0 * n

    register(HeadWind)
    assert get_effect("head_wind").link == "body"
    log = record(PAPER.with_effects({"head_wind": 5.0}), Sensors(), seconds=60.0)
    found = identify(log, add=("head_wind",))
    assert found.effects["head_wind"]["w"].value == pytest.approx(5.0, rel=0.03)
    assert free_run(log, found.model).nrmse < 0.5 * free_run(log, identify(log).model).nrmse


def test_intervals_cover_about_as_often_as_they_say():
    weights = {name: row for name, (row, _) in lump_weights(NOMINAL).items()}
    inside, truth = [], np.array(PAPER.values())
    for seed in range(24):
        log = record(sensors=Sensors(), seed=100 + seed)
        regression = build_regression(log, NOMINAL)
        instruments = build_regression(log, NOMINAL, transform=reference_motion).H
        estimate = instrumental_variables(regression, instruments)
        for row in weights.values():
            value, se = estimate.combination(row)
            inside.append(abs(value - row @ truth) < estimate.quantile * se)
    assert 0.86 <= np.mean(inside) <= 1.0


def test_one_motion_alone_says_what_it_cannot_see():
    from youbot_env.references import MotionIII

    log = record(sensors=Sensors(), seconds=40.0, reference=MotionIII())
    result = identify(log)
    assert result.parameters["I0"].ci95 is None or result.observability.rank < 7
    assert any("x2" in words for words in result.observability.words)


def test_logs_of_the_same_robot_are_fitted_together():
    parts = [
        record(sensors=Sensors(), seconds=30.0, seed=1),
        record(sensors=Sensors(), seconds=30.0, seed=2, reference=SmoothRandom(0.4, 1.5)),
    ]
    # A clock that has to be found for every log adds an error with each of them.
    known = {"drive_hold": {"kind": 0.0}, "drive_offset": {"d": 0.0}}
    parts = [replace(part, recording=known) for part in parts]
    together = identify(parts)
    alone = [identify(part) for part in parts]
    assert together.lumps["x1+x3"].se < min(a.lumps["x1+x3"].se for a in alone)


def test_a_method_that_needs_a_reference_says_so(noisy):
    from dataclasses import replace

    with pytest.raises(ValueError, match="reference"):
        identify(replace(noisy, reference=None), method="iv")
    with pytest.raises(ValueError, match="'guess'"):
        identify(noisy, method="guess")


def test_robot_with_real_rollers_from_elsewhere():
    log = Log.load(shared("roller-robot", "a-nothing-hidden.train.csv"))
    test = Log.load(shared("roller-robot", "a-nothing-hidden.test.csv"))
    start = time.perf_counter()
    result = identify(log, test=test)
    assert time.perf_counter() - start < 20.0  # 2 s on a quiet core; only a runaway is caught here
    assert result.parameters["m0"].value == pytest.approx(32.6, rel=0.15)
    assert result.test_run.nrmse < 0.08


def test_voltage_driven_robot_from_elsewhere():
    log = Log.load(shared("ftc-mecanum", "red_field_deposit.csv"))
    result = identify(log)
    assert any("voltage" in words for words in result.invisible)
    vx, vy, _ = result.fit_run.rmse
    assert vx < 0.075
    assert vy < 0.075
