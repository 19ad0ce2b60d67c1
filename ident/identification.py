"""From measured logs to an identified model: the one call behind ``scripts/identify.py``."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from ident.observability import Observability, observe_regression

from ident.estimators import (
    CLUSTERS,
    Estimate,
    durbin_wu_hausman,
    instrumental_variables,
    least_squares,
    reference_motion,
)
from ident.free_run import FreeRun, free_run
from ident.log import Log
from ident.output_error import OutputError, refine
from ident.physical import decode, doubts, invisible, lump_weights
from ident.recursive import history
from ident.regression import CORNER, Regression, build_regression
from youbot_env.model import Model
from youbot_env.model_file import load_model
from youbot_env.parameters import UNITS

# Standard deviations of the recursive estimator's first guess, in sizes of the nominal values: wide
# enough that the guess is forgotten within the first seconds.
GUESS = 1e4
RELINEARIZATIONS = 3


@dataclass(frozen=True)
class Quantity:
    """A number with its uncertainty.

    Attributes:
        value, unit: as printed.
        se: standard error; ci95: 95 % interval; None where the log says nothing.
        source: estimator that gave it.
    """

    value: float
    unit: str
    se: float | None
    ci95: tuple[float, float] | None
    source: str

    def as_dict(self) -> dict[str, Any]:
        """Return what JSON shows."""
        interval = list(self.ci95) if self.ci95 else None
        return {"value": self.value, "unit": self.unit, "se": self.se, "ci95": interval}


@dataclass(frozen=True)
class Identification:
    """What the logs say about the robot.

    Attributes:
        model: identified model with covariance and provenance of the fit.
        prior: the model the fit started from.
        estimates: by method: ``least squares``, ``instrumental variables``, ``recursive``.
        method: the one the model was taken from.
        parameters, lumps, effects: quantities by name.
        observability: rank, conditioning and blind directions of the regression.
        hausman: p value of least squares against instruments; None without instruments.
        doubts: what is physically odd about the result, in words.
        invisible: what no log of this kind can show, in words.
        regression: filtered rows at the estimate.
        track: times (K,) s and recursive estimates (K, P), paper Fig. 6.
        residual_nrmse: (4,) equation error by axis and in all.
        fit_run, test_run: free run on the (first) fit log and on the test log.
        logs, test: what was used.
        refinement: result of the free-run refinement, where it was asked for.
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
    track: tuple[np.ndarray, np.ndarray]
    residual_nrmse: np.ndarray
    fit_run: FreeRun
    test_run: FreeRun | None
    logs: tuple[Log, ...]
    test: Log | None
    refinement: OutputError | None

    def as_dict(self) -> dict[str, Any]:
        """Return what ``identify.py --json`` writes."""
        x, y, yaw, total = (float(v) for v in self.residual_nrmse)
        fit = {
            "method": self.method,
            "equation": {"x": x, "y": y, "yaw": yaw, "nrmse": total},
            "free_run": _run_dict(self.fit_run),
            "test_free_run": _run_dict(self.test_run) if self.test_run else None,
            "hausman_p": self.hausman,
        }
        return {
            "logs": [log.name for log in self.logs],
            "parameters": {k: q.as_dict() for k, q in self.parameters.items()},
            "lumps": {k: q.as_dict() for k, q in self.lumps.items()},
            "condition": self.observability.condition,
            "undetermined": list(self.observability.words),
            "invisible": self.invisible,
            "doubts": self.doubts,
            "fit": fit,
            "effects": {
                name: {k: q.as_dict() for k, q in values.items()}
                for name, values in self.effects.items()
            },
        }


def identify(
    logs: Log | list[Log],
    model: str | Model = "nominal",
    add: dict[str, Any] | tuple[str, ...] = (),
    test: Log | None = None,
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
        test: record that is only used to report the free-run error.
        method: ``auto`` (instrumental variables where every log has a reference, else least
            squares), ``ls``, ``iv``, or ``free-run`` (output error, started from ``auto``).
        corner: corner of the filters, rad/s.
        clusters: stretches of time for the covariance.
        name: name of the identified model.

    Raises:
        ValueError: an unknown method, or instruments asked for without a reference.
    """
    logs = [logs] if isinstance(logs, Log) else list(logs)
    prior = load_model(model)
    effects = dict.fromkeys(add) if isinstance(add, tuple | list) else dict(add)
    prior = prior.with_effects(effects) if effects else prior
    prior = replace(prior, platform=logs[0].platform)
    instruments = _choose(method, logs)
    model, estimates, regression = prior, {}, None
    for _ in range(RELINEARIZATIONS if prior.effects else 1):
        regression = Regression.join([build_regression(log, model, corner) for log in logs])
        start = _linear_values(prior, regression.names)
        estimates["least squares"] = least_squares(regression, start, clusters)
        chosen = "least squares"
        if instruments:
            rows = [build_regression(log, model, corner, reference_motion).H for log in logs]
            chosen = "instrumental variables"
            estimates[chosen] = instrumental_variables(
                regression, np.concatenate(rows), start, clusters
            )
        model = with_estimate(prior, estimates[chosen], name)
    refinement = None
    curved = any(not a.effect.parameter_of(n).linear for a in prior.effects for n in a.values)
    if method == "free-run" or (method == "auto" and curved):
        refinement = refine(logs, model)
        model, chosen = replace(refinement.model, name=name), "free run"
    track = _track(regression, prior)
    covariance = np.array(model.covariance)
    factor = estimates[next(iter(estimates))].quantile
    quantities, lumped, extra = _tables(model, covariance, factor, chosen)
    return Identification(
        model=_annotated(model, quantities, chosen, logs),
        prior=prior,
        estimates=estimates,
        method=chosen,
        parameters=quantities,
        lumps=lumped,
        effects=extra,
        observability=observe_regression(regression, model),
        hausman=durbin_wu_hausman(*estimates.values()) if len(estimates) == 2 else None,
        doubts=doubts(model, quantities),
        invisible=invisible(logs),
        regression=regression,
        track=track,
        residual_nrmse=_equation_error(regression, model),
        fit_run=free_run(logs[0], model),
        test_run=free_run(test, model) if test is not None else None,
        logs=tuple(logs),
        test=test,
        refinement=refinement,
    )


def with_estimate(model: Model, estimate: Estimate, name: str) -> Model:
    """Return the model with an estimate's values and covariance over ``model.names()``."""
    names = model.names()
    at = [names.index(parameter) for parameter in estimate.names]
    values, covariance = np.array(model.values()), np.zeros((len(names), len(names)))
    values[at] = estimate.values
    covariance[np.ix_(at, at)] = estimate.covariance
    return replace(model.with_values(values, name), covariance=covariance.tolist())


def _choose(method: str, logs: list[Log]) -> bool:
    if method not in ("auto", "ls", "iv", "free-run"):
        raise ValueError(f"method = {method!r}; choose auto, ls, iv or free-run")
    without = [log.name for log in logs if log.reference is None]
    if method == "iv" and without:
        raise ValueError(
            f"instrumental variables need the commanded motion; logs {without} have no reference "
            "columns (reference_vx, reference_vy, reference_yaw_rate); record them or use method 'ls'"
        )
    return method != "ls" and not without


def _linear_values(model: Model, names: tuple[str, ...]) -> np.ndarray:
    values = dict(zip(model.names(), model.values(), strict=True))
    return np.array([values[name] for name in names])


def _track(regression: Regression, prior: Model) -> tuple[np.ndarray, np.ndarray]:
    start = _linear_values(prior, regression.names)
    spread = np.sqrt(np.mean(regression.H**2, axis=(0, 1)))
    return history(regression, start, GUESS / np.where(spread > 0, spread, 1.0))


def _equation_error(regression: Regression, model: Model) -> np.ndarray:
    error = regression.residual(_linear_values(model, regression.names))
    spread = regression.y - regression.y.mean(axis=0)
    by_axis = np.sqrt(np.mean(error**2, axis=0) / np.mean(spread**2, axis=0))
    return np.append(by_axis, np.sqrt(np.mean(error**2) / np.mean(spread**2)))


def _tables(model: Model, covariance: np.ndarray, factor: float, source: str) -> tuple:
    parameters = {}
    for parameter, (value, gradient) in decode(model).items():
        se = float(np.sqrt(gradient @ covariance @ gradient))
        parameters[parameter] = _quantity(value, UNITS[parameter], se, factor, source)
    lumped = {}
    for lump, (weights, unit) in lump_weights(model).items():
        value = float(weights @ np.array(model.values()))
        se = float(np.sqrt(weights @ covariance @ weights))
        lumped[lump] = _quantity(value, unit, se, factor, source)
    extra: dict[str, dict[str, Quantity]] = {}
    names, values = model.names(), model.values()
    for at, name in enumerate(names[7:], start=7):
        identifier, flat = name.split(".")
        effect = next(a.effect for a in model.effects if a.identifier == identifier)
        se = float(np.sqrt(max(covariance[at, at], 0.0)))
        quantity = _quantity(values[at], effect.parameter_of(flat).unit, se, factor, source)
        extra.setdefault(identifier, {})[flat] = quantity
    return parameters, lumped, extra


def _quantity(value: float, unit: str, se: float, factor: float, source: str) -> Quantity:
    if not np.isfinite(se) or se == 0.0:
        return Quantity(float(value), unit, None, None, "kept from the prior model")
    return Quantity(
        float(value), unit, se, (float(value - factor * se), float(value + factor * se)), source
    )


def _annotated(
    model: Model, quantities: dict[str, Quantity], method: str, logs: list[Log]
) -> Model:
    used = " + ".join(log.name for log in logs)
    return replace(
        model,
        sources={name: f"{q.source}, {used}" for name, q in quantities.items()},
        standard_errors={name: q.se for name, q in quantities.items() if q.se is not None},
        provenance={
            "logs": [{"name": log.name, "sha256": log.digest} for log in logs],
            "method": method,
        },
    )


def _run_dict(run: FreeRun) -> dict[str, float]:
    vx, vy, yaw = (float(v) for v in run.rmse)
    return {"vx": vx, "vy": vy, "yaw_rate": yaw, "nrmse": run.nrmse}
