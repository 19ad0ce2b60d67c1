"""Do 95 % intervals hold the truth?  Many simulated robots, each identified from its own log."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from youbot_cli import console
from youbot_cli.names import HOLDS

if TYPE_CHECKING:
    from ident.benchmark.cases import Case as HiddenCase
    from ident.log import Log
    from youbot_env.model import Model

LOOP_RATE = 1000.0  # Hz
SLOWEST_LOOPS = 25.0  # Hz; below it loops that run at the log's rate go unstable
OFFSETS = (-30.0, 30.0)  # ms
CONDITIONS = ("own", "foreign")
# Kinds of robots by the part of the benchmark of hidden effects that draws them.
KINDS = {
    "ideal rollers": "nothing",
    "an effect that the model lacks": "single",
    "real rollers": "rollers",
}


@dataclass(frozen=True)
class Case:
    """One way to record.

    Attributes:
        rate: rows a second, Hz.
        jitter: uniform scatter of their times, in sample times.
        hold: ``sampled`` or ``averaged`` torques of loops at 1 kHz, or ``held`` from row to row.
        offset: how late the clock of the torques is, s: a row at t shows the torque of t - offset.
    """

    rate: float
    jitter: float = 0.0
    hold: str = "sampled"
    offset: float = 0.0

    def __str__(self) -> str:
        parts = [f"{self.rate:g} Hz"]
        if self.jitter:
            parts.append(f"jitter {self.jitter:.0%}".replace("%", " %"))
        if self.hold != "sampled":
            parts.append(self.hold)
        if self.offset:
            parts.append(f"torques {1e3 * self.offset:+g} ms")
        return ", ".join(parts)


CASES = (Case(100.0), Case(50.0), Case(100.0, 0.3))
METHODS = ("instrumental variables", "least squares", "ordinary least squares")


def benchmark(
    robots: Annotated[int, typer.Option(min=2, max=100_000, help="Robots of each case.")] = 200,
    seconds: Annotated[float, typer.Option(help="Length of each log, s.")] = 112.0,
    rate: Annotated[
        list[float] | None, typer.Option(help="Rows a second, Hz; again for more.")
    ] = None,
    hold: Annotated[
        list[str] | None, typer.Option(help=f"One of {', '.join(HOLDS)}; again for more.")
    ] = None,
    offset: Annotated[
        list[float] | None,
        typer.Option(help="How late the torques of the rows are, ms; again for more."),
    ] = None,
    conditions: Annotated[
        str,
        typer.Option(
            help="own; or foreign: recorded as other laboratories might, on real rollers "
            "too and with effects that the model lacks."
        ),
    ] = "own",
    seed: console.Seed = 0,
    json: console.Json = None,
    force: console.Force = False,
) -> None:
    """Measure coverage, bias and speed of identification on simulated robots.

    Every --rate is run with every --hold and every --offset.
    """
    console.check_results(json, force=force)
    if conditions not in CONDITIONS:
        raise ValueError(f"--conditions {conditions}: choose one of {', '.join(CONDITIONS)}")
    if conditions == "foreign":
        if rate or hold or offset:
            raise ValueError("--conditions foreign draws rates, holds and offsets: leave them out")
        benchmark_foreign(robots, seed, json)
        return
    cases = chosen_cases(rate, hold, offset)
    result = {"cases": {}, "robots": robots, "seconds": seconds}
    total = robots * len(cases)
    with console.progress("robots", total) as show:
        for number, case in enumerate(cases):
            done = number * robots
            result["cases"][str(case)] = run_case(
                robots, seconds, case, seed, lambda k, done=done: show(done + k)
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


def benchmark_foreign(robots: int, seed: int, json: Path | None) -> None:
    """How often intervals of the base parameters hold the truth on logs of other laboratories."""
    kinds = {kind: foreign_cases(kind, robots, seed) for kind in KINDS}
    result = {"conditions": "foreign", "robots": robots, "kinds": {}}
    with console.progress("robots", robots * len(kinds)) as show:
        done = 0
        for kind, cases in kinds.items():
            answers = []
            for case in cases:
                answers += base_answers(case)
                done += 1
                show(done)
            result["kinds"][kind] = summary(answers)
    rows = [(kind, *figures.values()) for kind, figures in result["kinds"].items()]
    headings = ("robots", "intervals", "hold %", "of lumps %", "half width %", "not given")
    console.table(f"\nforeign conditions, {robots} robots of each kind", headings, rows)
    result["provenance"] = console.provenance(seed)
    console.write_json(json, result)


def foreign_cases(kind: str, robots: int, seed: int) -> list[HiddenCase]:
    """Cases of one kind; the effects of the library take turns."""
    from ident.benchmark.cases import Case as HiddenCase
    from ident.benchmark.hidden import EFFECTS

    part = KINDS[kind]
    hidden = [(EFFECTS[k % len(EFFECTS)],) if part == "single" else () for k in range(robots)]
    return [HiddenCase(part, one, 1.0, k, seed, foreign=True) for k, one in enumerate(hidden)]


def base_answers(case: HiddenCase) -> list[dict]:
    """Of every base parameter and lump of one robot: its interval and whether that holds."""
    import numpy as np

    from ident.benchmark.cases import record_case
    from ident.consistency import lump_weights
    from ident.identification import identify
    from youbot_env.model_file import load_model

    recorded, nominal = record_case(case), load_model("nominal")
    tests = [recorded.verify] if recorded.conditions.second else []
    try:
        found = identify(recorded.fit, nominal, test=tests)
    except ValueError as error:  # refused with a reason, which is an answer
        return [{"name": "", "refused": str(error)}]
    theta = shared_by_wheels(recorded.truth)
    true = theta.parameters.as_dict() | {
        name: float(weights @ np.array(theta.values()))
        for name, (weights, _) in lump_weights(theta).items()
    }
    answers = []
    for name, quantity in (found.parameters | found.lumps).items():
        low, high = quantity.ci95 or (np.nan, np.nan)
        size = abs(true[name]) if name not in ("a_x", "a_y") else theta.platform.lever
        answers.append({
            "name": name,
            "lump": name in found.lumps,
            "given": quantity.ci95 is not None,
            "holds": bool(low <= true[name] <= high),
            "half": 0.5 * (high - low) / size,
        })  # fmt: skip
    return answers


def shared_by_wheels(truth: Model) -> Model:
    """The ideal robot that a log shows: what all wheels share of a contrast is not the contrast's.

    A wheel of less friction lowers the mean that mu1 is; drives that deliver more than they report
    make a robot lighter in the units of its torques.
    """
    import numpy as np

    means = {
        active.identifier: float(np.mean(list(active.values.values())))
        for active in truth.effects
        if active.identifier in ("wheel_friction_asymmetry", "torque_gain")
    }
    ideal = replace(truth, effects=())
    values = np.array(ideal.values()) / (1.0 + means.get("torque_gain", 0.0))
    values[ideal.names().index("mu1")] += means.get("wheel_friction_asymmetry", 0.0)
    return ideal.with_values(values)


def summary(answers: list[dict]) -> dict:
    """Figures of one kind of robot, percent."""
    import numpy as np

    given = [one for one in answers if one.get("given")]
    lumps = [one["holds"] for one in given if one["lump"]]
    return {
        "intervals": len(given),
        "hold": 100 * float(np.mean([one["holds"] for one in given])),
        "lumps_hold": 100 * float(np.mean(lumps)),
        "half_width": 100 * float(np.median([one["half"] for one in given])),
        "not_given": len(answers) - len(given),
    }


def chosen_cases(
    rates: list[float] | None, holds: list[str] | None, offsets: list[float] | None
) -> tuple[Case, ...]:
    """All combinations of what was given, or the usual cases.

    Raises:
        ValueError: names the option, its value and what to give instead.
    """
    if not (rates or holds or offsets):
        return CASES
    for hold in holds or ():
        if hold not in HOLDS:
            raise ValueError(f"--hold {hold}: choose one of {', '.join(HOLDS)}")
    for rate in rates or ():
        if not 5.0 <= rate <= LOOP_RATE:
            raise ValueError(f"--rate {rate:g} Hz: give 5 to {LOOP_RATE:g} Hz")
    for offset in offsets or ():
        if not OFFSETS[0] <= offset <= OFFSETS[1]:
            raise ValueError(f"--offset {offset:g} ms: give {OFFSETS[0]:g} to {OFFSETS[1]:g} ms")
    cases = tuple(
        Case(rate, 0.0, hold, 1e-3 * offset)
        for rate in rates or (100.0,)
        for hold in holds or ("sampled",)
        for offset in offsets or (0.0,)
        if hold != "held" or rate >= SLOWEST_LOOPS  # slower loops are unstable: no such logs
    )
    if not cases:
        raise ValueError(
            f"--hold held: the loops run at the log's rate; give a --rate of {SLOWEST_LOOPS:g} Hz "
            "or more"
        )
    return cases


def run_case(robots: int, seconds: float, case: Case, seed: int, show: Callable) -> dict:
    """Identify every robot of one case; coverage, median error and bias of the lumps, percent."""
    import numpy as np

    from ident.benchmark.robots import draw_robots
    from ident.consistency import lump_weights
    from youbot_env.model_file import load_model

    nominal, truths = load_model("nominal"), draw_robots(robots, seed)
    weights = {lump: row for lump, (row, _) in lump_weights(nominal).items()}
    inside, error = ({m: {lump: [] for lump in weights} for m in METHODS} for _ in range(2))
    for k, truth in enumerate(truths):
        log = record(truth, seconds, case, seed + k)
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


def record(truth: Model, seconds: float, case: Case, seed: int) -> Log:
    """Record calibration motions I, III, II, IV with the sensors' noise."""
    import numpy as np

    from ident.log import Log
    from youbot_env.measurement import instruments
    from youbot_env.references import calibration_sequence
    from youbot_env.simulation import Sensors, record_closed_loop

    count = round(seconds * case.rate)
    jitter = case.jitter * np.random.default_rng(seed).uniform(-0.5, 0.5, count)
    times = (np.arange(count) + jitter) / case.rate
    held, late = case.hold == "held", truth.with_effects({"drive_offset": case.offset})
    channels = record_closed_loop(
        truth, calibration_sequence(seconds=seconds), times, Sensors(), seed=seed,
        loop_rate=None if held else LOOP_RATE, row="sampled" if held else case.hold,
        instrument=instruments(late.effects, truth.platform) if case.offset else None,
    )  # fmt: skip
    return Log(truth.name, truth.platform, **channels)


def estimates(log: Log, nominal: Model) -> dict:
    """(values, covariance, quantile) by method; the last with the intervals of white residuals."""
    import numpy as np
    from scipy.special import ndtri

    from ident.identification import identify

    result = identify(log, nominal)
    found = {e.method: (e.values, e.covariance, e.quantile) for e in result.estimates.values()}
    plain, regression = result.estimates[METHODS[1]], result.regression
    H, _ = regression.rows
    residual = regression.residual(plain.values).ravel()
    white = np.linalg.inv(H.T @ H) * (residual @ residual) / (len(residual) - H.shape[1])
    return found | {METHODS[2]: (plain.values, white, float(ndtri(0.975)))}


def speed(seed: int) -> dict[str, float]:
    """Seconds of a complete fit of 140 s at 1 kHz, and samples a second of the recursive form."""
    import numpy as np

    from ident.identification import identify
    from ident.recursive import RecursiveLeastSquares
    from youbot_env.model_file import load_model

    nominal = load_model("nominal")
    log = record(load_model("paper"), 140.0, Case(1000.0), seed)
    times = []
    for _ in range(3):
        start = time.perf_counter()
        regression = identify(log, nominal).regression
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


def start() -> None:
    """Run the command line."""
    console.run(benchmark, f"--robots 20 --json {Path('docs/benchmarks/identification.json')}")
