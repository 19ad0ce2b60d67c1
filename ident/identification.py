"""From measured logs to an identified model: the one call behind ``youbot identify``."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.special import stdtrit

from ident.consistency import doubts, invisible
from ident.diagnosis.judge import inertia_is_seen
from ident.disagreement import disagreements, with_disagreements
from ident.doctor.finding import Finding
from ident.estimators import CLUSTERS, Estimate, durbin_wu_hausman
from ident.free_run import FreeRun, free_run
from ident.identifiability import Observability, Seen, observe_regression
from ident.instruments import without_instruments
from ident.linear_estimation import LinearEstimation
from ident.log import Log
from ident.method_choice import MethodChoice, choose_method
from ident.output_error import OutputError, refine
from ident.pooling import as_list, pooled
from ident.prior import kept_possible
from ident.recording import Recording, find_recordings, with_free_clocks
from ident.recording_words import Instrument
from ident.recursive import history
from ident.regression import CORNER, Regression, build_regression
from ident.results import Quantity, Shown, annotated, listed_names, quantities, quantity_columns
from ident.threads import one_thread
from ident.unexplained import Unexplained, rolling_shift, widening
from youbot_env.model import Model
from youbot_env.model_file import load_model

# Standard deviations of the recursive estimator's first guess, in sizes of the nominal values: wide
# enough that the guess is forgotten within the first seconds.
GUESS = 1e4
RELINEARIZATIONS = 3
FREE_RUN = "free run"


@dataclass(frozen=True, repr=False)
class Identification(Shown):
    """What the logs say about the robot.

    Attributes:
        model: identified model with covariance and provenance of the fit.
        prior: the model the fit started from.
        estimates: by method: ``least squares``, ``instrumental variables``.
        method: the one the model was taken from.
        parameters, lumps, effects: quantities by name.
        observability: rank, conditioning and blind directions of the regression.
        hausman: p value of least squares against instruments; None without instruments.
        doubts: what is physically odd about the result, in words.
        invisible: what no log of this kind can show, in words.
        regression: filtered rows at the estimate.
        velocity: (N, 3) measured body velocities of its rows.
        track: times (K,) s and recursive estimates (K, P), paper Fig. 6.
        residual_nrmse: (4,) equation error by axis and in all.
        fit_run, test_run: free run on all fit logs and on all test logs.
        logs, tests: what was used, short logs joined; they state what was found of their recording.
        names: of all fit logs.
        recording: how the rows of every log came to be.
        refinement: result of the free-run refinement, where it was asked for.
        differs: test logs that are not of the robot of the fitted ones, by name.
        unexplained: what the model leaves of the fitted logs, by which its intervals are widened
            where that is likely; None where the motion is steady and a free run tells nothing.
        rolling: whether intervals hold what finite rollers do to a model without them.
        choice: how well methods predict what is kept out, where that chose; else None.
    """

    model: Model
    prior: Model
    estimates: dict[str, Estimate]
    method: str
    parameters: dict[str, Quantity]
    lumps: dict[str, Quantity]
    effects: dict[str, dict[str, Quantity]]
    observability: Observability
    hausman: float | None
    doubts: list[str]
    invisible: list[str]
    regression: Regression
    velocity: np.ndarray
    track: tuple[np.ndarray, np.ndarray]
    residual_nrmse: np.ndarray
    fit_run: FreeRun
    test_run: FreeRun | None
    logs: tuple[Log, ...]
    tests: tuple[Log, ...]
    names: tuple[str, ...]
    recording: tuple[Instrument, ...]
    refinement: OutputError | None
    differs: dict[str, Finding]
    unexplained: Unexplained | None
    rolling: bool
    choice: MethodChoice | None = None

    @property
    def test(self) -> Log | None:
        """The (first) test log."""
        return self.tests[0] if self.tests else None

    def headline(self) -> str:
        """See the base class."""
        judged = self.test_run or self.fit_run
        what = "on the test" if self.test_run else "on the fitted log"
        error = f"free-run error {100 * judged.nrmse:.3g} % {what}"
        return f"{listed_names(self.logs)} by {self.method}; {error}"

    def table(self) -> dict[str, list[Any]]:
        """See the base class."""
        effects = {f"{k}.{name}": q for k, own in self.effects.items() for name, q in own.items()}
        return quantity_columns(self.parameters | self.lumps | effects)

    def plot(self):
        """Measured and simulated velocities, of the test where there is one."""
        from ident.report.look import IDENTIFIED
        from ident.report.motion import velocities_figure

        run = self.test_run or self.fit_run
        return velocities_figure.on_canvas([("identified", IDENTIFIED, run)])

    def as_dict(self) -> dict[str, Any]:
        """Return what ``youbot identify --json`` writes."""
        x, y, yaw, total = (float(v) for v in self.residual_nrmse)
        fit = {
            "method": self.method,
            "equation": {"x": x, "y": y, "yaw": yaw, "nrmse": total},
            "free_run": _run_dict(self.fit_run),
            "test_free_run": _run_dict(self.test_run) if self.test_run else None,
            "hausman_p": self.hausman,
            "kept_out": None if self.choice is None else self.choice.errors,
            "widened": self.unexplained is not None and self.unexplained.likely,
            "widened_for_rollers": self.rolling,
        }
        return {
            "logs": list(self.names),
            "parameters": {k: q.as_dict() for k, q in self.parameters.items()},
            "lumps": {k: q.as_dict() for k, q in self.lumps.items()},
            "condition": self.observability.condition,
            "undetermined": list(self.observability.words),
            "invisible": self.invisible,
            "doubts": self.doubts,
            "recording": [one.as_dict() for one in self.recording],
            "fit": fit,
            "effects": {
                name: {k: q.as_dict() for k, q in values.items()}
                for name, values in self.effects.items()
            },
        }


@one_thread
def identify(
    logs: Log | Sequence[Log],
    model: str | Model = "nominal",
    add: dict[str, Any] | tuple[str, ...] = (),
    test: Log | Sequence[Log] | None = None,
    method: str = "auto",
    corner: float = CORNER,
    clusters: int = CLUSTERS,
    name: str = "identified",
) -> Identification:
    """Identify a robot from one or more logs.

    Args:
        logs: measured records of one robot.
        model: start: platform, wheel mass and, where the logs say nothing, values.
        add: effects to estimate beyond those of the model.
        test: records that are only used to report the free-run error.
        method: ``auto`` (instrumental variables where every log has a reference, else least
            squares; of voltages that or free run, whichever predicts better what is kept out),
            ``ls``, ``iv``, or ``free-run`` (output error, started from ``auto``).
        corner: corner of the filters, rad/s.
        clusters: stretches of time for the covariance.
        name: name of the identified model.

    Raises:
        ValueError: an unknown method, instruments asked for without a reference, or logs that show
            nothing.
    """
    given = as_list(logs)
    logs, tests = pooled(given), pooled(as_list(test))
    prior = without_instruments(load_model(model))
    effects = dict.fromkeys(add) if isinstance(add, tuple | list) else dict(add)
    prior = _with_added(prior, effects) if effects else prior
    prior = replace(prior, platform=logs[0].platform)
    instruments = _choose(method, logs)
    # A robot that answers late counts as a clock that is early, unless an effect stands for it.
    late = any(active.effect.late for active in prior.effects)
    records = find_recordings(logs, prior, signed=not late)
    tested = find_recordings(tests, prior, signed=not late) if tests else []
    logs, tests = [record.log for record in records], [record.log for record in tested]
    differs = disagreements(logs, tests, prior)
    tests, model = with_disagreements(tests, differs), prior
    linear = _linear(records, prior, name, corner, clusters, instruments, method == "iv")
    model, seen, regression = linear.model, linear.seen, linear.regression
    chosen, velocity = linear.method, linear.velocity
    refinement, factor = None, linear.estimates[chosen].quantile
    curved = any(not a.effect.parameter_of(n).linear for a in prior.effects for n in a.values)
    choice = None
    if method == "auto" and not curved and any(log.drive == "voltage" for log in logs):
        choice = _choice(records, prior, chosen, corner, clusters, instruments)
    free = curved if choice is None else choice.best == FREE_RUN
    if method == "free-run" or (method == "auto" and free):
        refinement = _refined(records, model)
        model, chosen = replace(without_instruments(refinement.model), name=name), FREE_RUN
        factor = float(stdtrit(max(refinement.windows - 1, 1), 0.975))
        regression, velocity = _rows(logs, model, corner)
    fit_run = free_run(logs, model)
    unexplained = Unexplained.of(logs, model, fit_run) if inertia_is_seen(logs, prior) else None
    if unexplained is not None and unexplained.likely:
        model = _widened(model, widening(seen, regression, logs, model, unexplained.share), seen)
    shift = rolling_shift(seen, logs, model)
    if shift is not None:
        model = _widened(model, np.outer(shift, shift), seen)
    parameters, lumped, extra = quantities(model, seen, factor, chosen)
    return Identification(
        model=annotated(model, parameters, chosen, given),
        prior=prior,
        estimates=linear.estimates,
        method=chosen,
        parameters=parameters,
        lumps=lumped,
        effects=extra,
        observability=linear.observability,
        hausman=linear.hausman,
        doubts=[*linear.bounded, *doubts(model, parameters)],
        invisible=invisible(logs),
        regression=regression,
        velocity=velocity,
        track=_track(regression, seen),
        residual_nrmse=equation_error(regression, model),
        fit_run=fit_run,
        test_run=free_run(tests, model) if tests else None,
        logs=tuple(logs),
        tests=tuple(tests),
        names=tuple(log.name for log in given),
        recording=tuple(one for record in (*records, *tested) for one in record.instruments),
        refinement=refinement,
        differs=differs,
        unexplained=unexplained,
        rolling=shift is not None,
        choice=choice,
    )


@dataclass(frozen=True, eq=False)
class _Linear:
    """What the regression of some logs says; see ``Identification``."""

    model: Model
    estimates: dict[str, Estimate]
    method: str
    seen: Seen
    bounded: list[str]
    observability: Observability
    regression: Regression
    velocity: np.ndarray
    hausman: float | None


def _linear(
    records: list[Recording],
    prior: Model,
    name: str,
    corner: float,
    clusters: int,
    instruments: bool,
    robust: bool = False,
) -> _Linear:
    """Estimate by regression; ``robust`` where only instruments will do.

    Raises:
        ValueError: the logs show nothing, or instruments are wanted and leave something unmoved.
    """
    logs, model = [record.log for record in records], prior
    for _ in range(RELINEARIZATIONS if prior.effects else 1):
        regression, velocity = _rows(logs, model, corner)
        start = _linear_values(prior, regression.names)
        observability = observe_regression(regression, model)
        if observability.rank == 0:
            names = ", ".join(log.name for log in logs)
            raise ValueError(f"no parameter leaves a trace in {names}; record a livelier motion")
        seen, loose, bounded = kept_possible(
            Seen.of(observability, regression, start, model), regression, prior
        )
        found = LinearEstimation(seen, model, corner, clusters, instruments).of(records, regression)
        if robust and len(found) < 2:
            raise ValueError(
                "the reference columns do not hold the motion that was driven and cannot "
                "serve as instruments; use ls"
            )
        estimates = {method: seen.restore(estimate) for method, estimate in found.items()}
        if loose is not seen:
            free = LinearEstimation(loose, model, corner, clusters, instruments)
            for method, estimate in free.of(records, regression).items():
                if method in estimates:
                    estimates[method] = _held(estimates[method], loose.restore(estimate))
        chosen = list(estimates)[-1]
        model = with_estimate(prior, estimates[chosen], name)
    hausman = durbin_wu_hausman(*found.values()) if len(found) == 2 else None
    return _Linear(model, estimates, chosen, seen, bounded, observability, regression, velocity,
                   hausman)  # fmt: skip


def _held(held: Estimate, free: Estimate) -> Estimate:
    """An estimate with a value at its bound: as unknown as without, give or take what that moved.

    Its own scatter holds for the case that the bound is the truth.
    """
    moved = held.values - free.values
    return replace(held, covariance=free.covariance + np.outer(moved, moved))


def _refined(records: list[Recording], model: Model, intervals: bool = True) -> OutputError:
    """Refine by free run from a linear estimate, which is what is known where logs say less."""
    free, start, ends = with_free_clocks(records, model)
    return refine(free, start, ends=ends, prior=model, intervals=intervals)


def _choice(
    records: list[Recording],
    prior: Model,
    linear: str,
    corner: float,
    clusters: int,
    instruments: bool,
) -> MethodChoice | None:
    """Which of regression and free run predicts better; None where a free run tells nothing."""
    if not inertia_is_seen([record.log for record in records], prior):
        return None

    def by_regression(train: list[Recording]) -> Model:
        return _linear(train, prior, prior.name, corner, clusters, instruments).model

    def by_free_run(train: list[Recording]) -> Model:
        return without_instruments(_refined(train, by_regression(train), False).model)

    return choose_method(records, {linear: by_regression, FREE_RUN: by_free_run})


def _with_added(model: Model, effects: dict[str, Any]) -> Model:
    """The model with effects; contrasts of which nothing was said start from equal wheels.

    Their common part is never estimated, so a typical size would stay in it.
    """
    model = model.with_effects(effects)
    values = list(model.values())
    for k, name in enumerate(model.names()[7:], start=7):
        identifier, flat = name.split(".")
        effect = next(a.effect for a in model.effects if a.identifier == identifier)
        if effects.get(identifier, 0.0) is None and effect.parameter_of(flat).contrast:
            values[k] = 0.0
    return model.with_values(values)


def with_estimate(model: Model, estimate: Estimate, name: str) -> Model:
    """Return the model with an estimate's values and covariance over ``model.names()``."""
    names = model.names()
    at = [names.index(parameter) for parameter in estimate.names]
    values, covariance = np.array(model.values()), np.zeros((len(names), len(names)))
    values[at] = estimate.values
    covariance[np.ix_(at, at)] = estimate.covariance
    return replace(model.with_values(values, name), covariance=covariance.tolist())


def _widened(model: Model, more: np.ndarray, seen: Seen) -> Model:
    """The model with more covariance (P, P) of the values of ``seen.names``."""
    at = [model.names().index(name) for name in seen.names]
    covariance = np.array(model.covariance)
    covariance[np.ix_(at, at)] += more
    return replace(model, covariance=covariance.tolist())


def _choose(method: str, logs: list[Log]) -> bool:
    if method not in ("auto", "ls", "iv", "free-run"):
        raise ValueError(f"method = {method!r}; choose auto, ls, iv or free-run")
    without = [log.name for log in logs if log.reference is None]
    if method == "iv" and without:
        raise ValueError(
            f"instrumental variables need the commanded motion; logs {without} have no reference "
            "columns (reference_vx, reference_vy, reference_yaw_rate); record them or use ls"
        )
    return method != "ls" and not without


def _linear_values(model: Model, names: tuple[str, ...]) -> np.ndarray:
    values = dict(zip(model.names(), model.values(), strict=True))
    return np.array([values[name] for name in names])


def _rows(logs: list[Log], model: Model, corner: float) -> tuple[Regression, np.ndarray]:
    """Regression of all logs and the velocities (N, 3) measured at its rows."""
    parts = [build_regression(log, model, corner) for log in logs]
    velocities = [
        log.velocity()[np.searchsorted(log.time, part.time)]
        for log, part in zip(logs, parts, strict=True)
    ]
    return Regression.join(parts), np.concatenate(velocities)


def _track(regression: Regression, seen: Seen) -> tuple[np.ndarray, np.ndarray]:
    reduced = seen.reduce(regression)
    spread = np.sqrt(np.mean(reduced.H**2, axis=(0, 1)))
    guess = GUESS / np.where(spread > 0, spread, 1.0)
    time, track = history(reduced, np.zeros(len(spread)), guess)
    return time, seen.start + track @ seen.basis.T


def equation_error(regression: Regression, model: Model) -> np.ndarray:
    """(4,) share of the drive's force that a model does not explain, by axis and in all."""
    error = regression.residual(_linear_values(model, regression.names))
    spread = regression.y - regression.y.mean(axis=0)
    by_axis = np.sqrt(np.mean(error**2, axis=0) / np.mean(spread**2, axis=0))
    return np.append(by_axis, np.sqrt(np.mean(error**2) / np.mean(spread**2)))


def _run_dict(run: FreeRun) -> dict[str, float]:
    vx, vy, yaw = (float(v) for v in run.rmse)
    return {"vx": vx, "vy": vy, "yaw_rate": yaw, "nrmse": run.nrmse}
