"""The answer of an identification in a sentence and in rows, for terminal and page alike."""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ident.diagnosis.judge import inertia_is_seen
from ident.free_run import FreeRun, free_run
from ident.identification import Identification, equation_error
from ident.log import Log
from ident.regression import Regression, build_regression
from ident.results import Quantity, listed_names
from ident.unexplained import Unexplained
from youbot_env.model import Model
from youbot_env.parameters import MEANING, UNITS

AXES = (("V_X", "m/s"), ("V_Y", "m/s"), ("Omega", "rad/s"))
SURELY_BIASED = 0.01  # p value
# Free-run errors that differ by less are equal for a log of a minute.
TOLERANCE = 1.05


@dataclass(frozen=True)
class Outcome:
    """An identification judged by free run against the model it started from.

    Attributes:
        result: the identification.
        before: the model it started from, without effects that were added.
        logs: what both are judged on.
        before_run, after_run: free runs on that log.
        floor: free-run error that noise of the sensors and rolling leave, as a share of the motion.
        forces: shares of the drive's force that either leaves at the measured motion, where this
            is steady and a free run tells nothing; else None.
    """

    result: Identification
    before: Model
    logs: tuple[Log, ...]
    before_run: FreeRun
    after_run: FreeRun
    floor: float
    forces: tuple[float, float] | None = None

    @classmethod
    def of(cls, result: Identification, before: Model) -> Outcome:
        """Judge on the test logs, or on the fitted ones where there are none."""
        logs = result.tests or result.logs
        before = replace(before, platform=logs[0].platform)
        after, forces = result.test_run or result.fit_run, None
        if not inertia_is_seen(logs, before):
            models = before, result.model
            rows = [Regression.join([build_regression(log, m) for log in logs]) for m in models]
            forces = tuple(
                float(equation_error(row, m)[3]) for row, m in zip(rows, models, strict=True)
            )
        left = result.unexplained
        wide = result.rolling or (left is not None and left.likely)
        # What widens the intervals is no noise.
        model = replace(result.model, covariance=None) if wide else result.model
        floor = Unexplained.of(logs, model, after).floor
        return cls(result, before, logs, free_run(logs, before), after, floor, forces)

    @property
    def log(self) -> Log:
        """The (first) log that both are judged on."""
        return self.logs[0]

    @property
    def judged_on(self) -> str:
        """Names of the logs that both are judged on."""
        return listed_names(self.logs)

    @property
    def label(self) -> str:
        """What the model it started from is called beside the identified one."""
        return "before" if self.before.name == self.result.model.name else self.before.name

    @property
    def held_out(self) -> bool:
        """Whether the log was kept out of the fit."""
        return self.result.test is not None

    @property
    def better(self) -> bool:
        """Whether the identified model predicts at least as well as the one before."""
        before, after = self.forces or (self.before_run.nrmse, self.after_run.nrmse)
        return bool(after <= TOLERANCE * before)

    @property
    def doubts(self) -> list[str]:
        """What is odd about the result, and what its intervals do not hold."""
        left, found = self.result.unexplained, list(self.result.doubts)
        if self.result.rolling:
            found.append(
                "the wheels roll on finite rollers, which the model lacks; the intervals are "
                "widened by what that does to the values: add roller_ripple"
            )
        if left is not None and left.likely:
            lacks = "lacks" if left.certain else "may lack"
            return [
                *found,
                f"the model {lacks} something, and the intervals are widened by what that may have "
                f"done to the values (free-run error of the fit {percent(left.error)} where noise "
                f"and rolling leave {percent(left.floor)}): run diagnose",
            ]
        error = self.after_run.nrmse
        if self.forces or not Unexplained(error, self.floor).certain:
            return found
        return [
            *found,
            f"the intervals do not hold what the model leaves unexplained ({percent(error)} where "
            f"noise and rolling leave {percent(self.floor)}, {self.judged_on}): run diagnose",
        ]

    @property
    def problems(self) -> list[str]:
        """What forbids the use of the identified model; empty when nothing does."""
        found = [d for d in self.result.doubts if d.startswith("impossible")]
        if not self.better:
            found.append(f"on {self.judged_on} it predicts worse than the model it started from")
        return found

    @property
    def verdict(self) -> str:
        """How well the identified model predicts, in a sentence."""
        kind = "the held-out log" if self.held_out else "the log it was fitted to,"
        if len(self.logs) > 1 or self.log.runs:
            kind = "the held-out logs" if self.held_out else "the logs it was fitted to,"
        if self.forces:
            before, after = map(percent, self.forces)
            return (
                f"Drive's force left unexplained on {kind} {self.judged_on}: {self.label} "
                f"{before}, identified {after}. The motion is steady: a free run cannot judge."
            )
        before, after = percent(self.before_run.nrmse), percent(self.after_run.nrmse)
        return (
            f"Free-run error on {kind} {self.judged_on}: {self.label} {before}, identified {after}."
        )

    def as_dict(self) -> dict:
        """What ``--json`` says about the judgement."""
        runs = {"before": self.before_run, "after": self.after_run}
        free_runs = {
            name: {
                **dict(zip(("vx", "vy", "yaw_rate"), run.rmse.tolist(), strict=True)),
                "nrmse": run.nrmse,
            }
            for name, run in runs.items()
        }
        return {
            "verdict": self.verdict,
            "judged_on": {"log": self.judged_on, "untouched": self.held_out, **free_runs},
            "unexplained_force": dict(zip(("before", "after"), self.forces, strict=True))
            if self.forces
            else None,
            "noise_floor": self.floor,
            "doubts": self.doubts,
            "problems": self.problems,
        }


def percent(share: float) -> str:
    """A share with two digits that count."""
    if not math.isfinite(share):
        return "without bound"
    value = 100.0 * share
    return f"{value:.{_decimals(value)}f} %"


def rounded(value: float, se: float | None) -> str:
    """A value with the digits its standard error leaves standing."""
    return f"{value:.4g}" if se is None else f"{value:.{_decimals(se)}f}"


def interval(quantity: Quantity) -> str:
    """The 95 % interval, or a dash."""
    if quantity.ci95 is None:
        return "-"
    low, high = (rounded(end, quantity.se) for end in quantity.ci95)
    return f"{low} ... {high}"


def parameter_rows(outcome: Outcome) -> list[tuple[str, ...]]:
    """Name, value before, identified value, interval, unit, source, numbers of doubts."""
    result, before, rows = outcome.result, outcome.before.parameters.as_dict(), []
    for name, quantity in result.parameters.items():
        marks = [str(k) for k, doubt in enumerate(outcome.doubts, 1) if name in subjects(doubt)]
        value = rounded(quantity.value, quantity.se)
        cells = (name, f"{before[name]:.4g}", value, interval(quantity), quantity.unit)
        rows.append((*cells, quantity.source, ", ".join(marks)))
    return rows


def effect_rows(outcome: Outcome) -> list[tuple[str, ...]]:
    """The same of the parameters of effects."""
    result, rows = outcome.result, []
    known = {a.identifier: a.values for a in outcome.before.effects}
    for identifier, values in result.effects.items():
        for flat, quantity in values.items():
            old = known.get(identifier, {}).get(flat)
            shown = "-" if old is None else f"{old:.4g}"
            value = rounded(quantity.value, quantity.se)
            cells = (f"{identifier}.{flat}", shown, value, interval(quantity), quantity.unit)
            rows.append((*cells, quantity.source, ""))
    return rows


def lump_rows(outcome: Outcome) -> list[tuple[str, ...]]:
    """Name, value before, identified value, interval, unit."""
    from youbot_env.parameters import lumps, to_x

    before, platform = outcome.before.parameters, outcome.before.platform
    old = lumps(to_x(before.theta(platform), platform))
    return [
        (name, f"{old[name]:.4g}", rounded(q.value, q.se), interval(q), q.unit)
        for name, q in outcome.result.lumps.items()
    ]


def error_rows(outcome: Outcome) -> list[tuple[str, ...]]:
    """Axis, unit, rms of the motion, free-run rms error before and after."""
    spread = outcome.before_run.measured.std(axis=0)
    columns = zip(AXES, spread, outcome.before_run.rmse, outcome.after_run.rmse, strict=True)
    return [
        (axis, unit, rounded(moved, moved / 10), rounded(old, old), rounded(new, new))
        for (axis, unit), moved, old, new in columns
    ]


def agreement(outcome: Outcome) -> tuple[tuple[str, ...], list[tuple[str, ...]]]:
    """Head and rows of the estimators' values side by side, in the parameters of the equation."""
    result = outcome.result
    units, plain = parameter_units(result.model), result.estimates["least squares"]
    robust = result.estimates.get("instrumental variables")
    rows = []
    for k, name in enumerate(plain.names):
        se = plain.standard_errors[k] or None
        cells = [name, rounded(plain.values[k], se), rounded(result.track[1][-1, k], se)]
        if robust is not None:
            error = robust.standard_errors[k]
            cells.append(rounded(robust.values[k], error or None))
            gap = robust.values[k] - plain.values[k]
            cells.append(f"{round(gap / error, 1) + 0.0:+.1f}" if error > 0 else "-")
        rows.append((*cells, units[name]))
    extra = () if robust is None else ("instrumental variables", "difference, se")
    return ("parameter", "least squares", "recursive", *extra, "unit"), rows


def agreement_note(result: Identification) -> str:
    """What the comparison of the estimators means."""
    if result.hausman is None:
        return (
            "No instrumental variables: a log has no reference columns, or they were not asked for."
        )
    p = f"p = {result.hausman:.2g}"
    if result.hausman < SURELY_BIASED:
        return (
            f"Least squares and instrumental variables differ by more than chance ({p}): noise in "
            "the measured velocities, or physics that the model lacks, bends least squares."
        )
    return f"Least squares and instrumental variables agree within chance ({p})."


def parameter_units(model: Model) -> dict[str, str]:
    """Units of ``model.names()``."""
    units = {**UNITS, "max": "kg m", "may": "kg m"}
    for active in model.effects:
        for flat in active.values:
            units[f"{active.identifier}.{flat}"] = active.effect.parameter_of(flat).unit
    return units


def determined(result: Identification, name: str) -> bool:
    """Whether the logs determine a value of ``model.names()``."""
    name = {"max": "a_x", "may": "a_y"}.get(name, name)
    effect, _, flat = name.rpartition(".")
    quantity = result.effects[effect][flat] if effect else result.parameters[name]
    return quantity.se is not None


def subjects(doubt: str) -> tuple[str, ...]:
    """Names of the parameters that a doubt speaks of."""
    words = doubt.removeprefix("impossible: ")
    if words.startswith("centre of mass"):
        return ("a_x", "a_y")
    return tuple(name for name in MEANING if words.split()[0] == name)


def _decimals(size: float) -> int:
    """Decimals that show two digits of a number of this size."""
    if not (math.isfinite(size) and size != 0):
        return 2
    return int(np.clip(1 - math.floor(math.log10(abs(size))), 0, 9))
