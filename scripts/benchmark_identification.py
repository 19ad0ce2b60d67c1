"""Do 95 % intervals hold the truth?  Many simulated robots, each identified from its own log."""

from __future__ import annotations

import time
from pathlib import Path
from typing import Annotated

import console
import numpy as np
import typer
from scipy import stats

from ident.benchmark.robots import draw_robots
from ident.estimators import instrumental_variables, least_squares, reference_motion
from ident.identification import with_estimate
from ident.log import Log
from ident.physical import lump_weights
from ident.recursive import RecursiveLeastSquares
from ident.regression import build_regression
from youbot_env.model import Model
from youbot_env.model_file import load_model
from youbot_env.references import calibration_sequence
from youbot_env.simulation import Sensors, record_closed_loop

CASES = {
    "100 Hz": (100.0, 0.0),
    "50 Hz": (50.0, 0.0),
    "100 Hz, jitter 30 %": (100.0, 0.3),
}
METHODS = ("instrumental variables", "least squares", "ordinary least squares")


def benchmark(
    robots: Annotated[int, typer.Option(min=2, help="Robots of each case.")] = 200,
    seconds: Annotated[float, typer.Option(help="Length of each log, s.")] = 112.0,
    seed: console.Seed = 0,
    json: console.Json = None,
) -> None:
    """Measure coverage, bias and speed of identification on simulated robots."""
    console.check_writable(json)
    result = {"cases": {}, "robots": robots, "seconds": seconds}
    total = robots * len(CASES)
    with console.progress("robots", total) as show:
        for number, (case, (rate, jitter)) in enumerate(CASES.items()):
            done = number * robots
            result["cases"][case] = run_case(
                robots, seconds, rate, jitter, seed, lambda k, done=done: show(done + k)
            )
    for case, methods in result["cases"].items():
        rows = []
        for method in METHODS:
            for lump, figures in methods[method].items():
                rows.append((f"{method}, {lump}", *figures.values()))
        headings = ("lump", "coverage %", "median error %", "bias %")
        console.table(f"\n{case}, {robots} robots, {seconds:g} s", headings, rows)
    result["speed"] = speed(seed)
    console.table("\nspeed", ("what", "figure"), result["speed"].items())
    result["provenance"] = console.provenance(seed)
    console.write_json(json, result)


def run_case(robots: int, seconds: float, rate: float, jitter: float, seed: int, show) -> dict:
    """Identify every robot of one case; coverage, median error and bias of the lumps, percent."""
    nominal, truths = load_model("nominal"), draw_robots(robots, seed)
    weights = {lump: row for lump, (row, _) in lump_weights(nominal).items()}
    inside, error = ({m: {lump: [] for lump in weights} for m in METHODS} for _ in range(2))
    for k, truth in enumerate(truths):
        log = record(truth, seconds, rate, jitter, seed + k)
        for method, (values, covariance, quantile) in estimates(log, nominal).items():
            for lump, row in weights.items():
                true, value = row @ np.array(truth.values()), row @ values
                half = quantile * np.sqrt(row @ covariance @ row)
                inside[method][lump].append(abs(value - true) <= half)
                error[method][lump].append(value / true - 1.0)
        show(k + 1)
    return {
        method: {
            lump: {
                "coverage": 100 * float(np.mean(inside[method][lump])),
                "median_error": 100 * float(np.median(np.abs(error[method][lump]))),
                "bias": 100 * float(np.mean(error[method][lump])),
            }
            for lump in weights
        }
        for method in METHODS
    }


def record(truth: Model, seconds: float, rate: float, jitter: float, seed: int) -> Log:
    """Record calibration motions I, III, II, IV with the sensors' noise."""
    count = round(seconds * rate)
    late = jitter * np.random.default_rng(seed).uniform(-0.5, 0.5, count)
    times = (np.arange(count) + late) / rate
    channels = record_closed_loop(
        truth, calibration_sequence(seconds=seconds), times, Sensors(), seed=seed
    )
    return Log(truth.name, truth.platform, **channels)


def estimates(log: Log, nominal: Model) -> dict:
    """(values, covariance, quantile) by method; the last with the intervals of white residuals."""
    regression = build_regression(log, nominal)
    instruments = build_regression(log, nominal, transform=reference_motion).H
    plain = least_squares(regression)
    robust = instrumental_variables(regression, instruments)
    H, _ = regression.rows
    residual = regression.residual(plain.values).ravel()
    white = np.linalg.inv(H.T @ H) * (residual @ residual) / (len(residual) - H.shape[1])
    return {
        robust.method: (robust.values, robust.covariance, robust.quantile),
        plain.method: (plain.values, plain.covariance, plain.quantile),
        METHODS[2]: (plain.values, white, float(stats.norm.ppf(0.975))),
    }


def speed(seed: int) -> dict[str, float]:
    """Seconds of a complete fit of 140 s at 1 kHz, and samples a second of the recursive form."""
    nominal = load_model("nominal")
    log = record(load_model("paper"), 140.0, 1000.0, 0.0, seed)
    times = []
    for _ in range(3):
        start = time.perf_counter()
        regression = build_regression(log, nominal)
        instruments = build_regression(log, nominal, transform=reference_motion).H
        with_estimate(nominal, instrumental_variables(regression, instruments), "identified")
        times.append(time.perf_counter() - start)
    guess = np.array(nominal.values())
    dt, batch = np.full(len(regression.y), 1e-3), []
    for _ in range(5):
        estimator = RecursiveLeastSquares(guess, np.ones(7))
        start = time.perf_counter()
        estimator.update_many(regression.H, regression.y, dt)
        batch.append(len(dt) / (time.perf_counter() - start))
    start, count = time.perf_counter(), 20_000
    for H, y in zip(regression.H[:count], regression.y[:count], strict=True):
        estimator.update(H, y, 1e-3)
    single = count / (time.perf_counter() - start)
    return {
        "complete fit of 140 s at 1 kHz, s": min(times),
        "batch, million samples/s": max(batch) / 1e6,
        "single updates, thousand/s": single / 1e3,
    }


if __name__ == "__main__":
    console.run(benchmark, f"--robots 20 --json {Path('docs/benchmarks/identification.json')}")
