"""Every effect of the library tried on top of a model: its size, and what it would improve.

An effect is fitted with the base parameters, its nonlinear parameters profiled over a grid; the
error that is left is measured on a record that was not used for the fit.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ident.estimators import Estimate, instrumental_variables, least_squares, reference_motion
from ident.free_run import free_run
from ident.log import Log
from ident.regression import Regression, build_regression
from youbot_env.effects import Parameter, effect_names, get_effect
from youbot_env.model import Model

# Sizes of a nonlinear parameter that are tried, in units of its typical size.
PROFILE = (0.25, 0.5, 0.75, 1.0, 1.5)
# Below this drop of the held-out equation error the costly free run is not worth its time.
SCREEN = 0.03
# Stretches of the held-out record whose losses are compared.
STRETCHES = 24


@dataclass(frozen=True)
class Loss:
    """Errors of one model on one record, as shares of the signals' rms, and where they arose.

    Attributes:
        equation, free_run: normalised errors of forces and of simulated velocities.
        stretches: (2, K) mean squared normalised errors of equation and free run by stretch.
    """

    equation: float
    free_run: float
    stretches: np.ndarray

    @property
    def total(self) -> float:
        """Geometric mean of both errors."""
        return float(np.sqrt(self.equation * self.free_run))


@dataclass(frozen=True)
class Candidate:
    """One effect fitted on top of a model.

    Attributes:
        identifier: the effect.
        model: base and effect with fitted values.
        sizes: values of the effect's parameters by flat name.
        errors: standard errors of those that enter linearly.
        clusters: stretches behind the standard errors.
        fit_error: equation error on the fit record.
        loss: errors on the held-out record.
    """

    identifier: str
    model: Model
    sizes: dict[str, float]
    errors: dict[str, float]
    clusters: int
    fit_error: float
    loss: Loss

    @property
    def count(self) -> int:
        """Number of parameters."""
        return len(self.sizes)


def fit_base(log: Log, model: Model) -> Model:
    """Fit what enters linearly; nonlinear parameters keep their values."""
    return fit_linear(log, model, passes=2)[0]


def fit_linear(log: Log, model: Model, passes: int = 1) -> tuple[Model, Estimate, Regression]:
    """Fit theta and the linear parameters of all effects of a model.

    Instruments are used where the log has a reference and no effect reads the torque: a column
    made of torque would need a simulated one.

    Args:
        log: measured record.
        model: start; nonlinear parameters keep their values.
        passes: more than one lets laws settle that depend on the robot's own parameters.
    """
    for _ in range(passes):
        regression = build_regression(log, model)
        known = dict(zip(model.names(), model.values(), strict=True))
        prior = np.array([known[name] for name in regression.names])
        plain = log.reference is None or any(a.effect.acts("drive") for a in model.effects)
        if plain or any(a.effect.acts("delay") for a in model.effects):
            estimate = least_squares(regression, prior)
        else:
            instruments = build_regression(log, model, transform=reference_motion).H
            estimate = instrumental_variables(regression, instruments, prior)
        known |= dict(zip(estimate.names, estimate.values.tolist(), strict=True))
        model = model.with_values([known[name] for name in model.names()])
    return model, estimate, regression


def equation_error(regression: Regression, model: Model) -> tuple[float, np.ndarray]:
    """Normalised equation error, and squared normalised residuals (N,) by row."""
    known = dict(zip(model.names(), model.values(), strict=True))
    residual = regression.residual(np.array([known[name] for name in regression.names]))
    squared = np.mean((residual / regression.y.std(axis=0)) ** 2, axis=1)
    return float(np.sqrt(squared.mean())), squared


def measure_loss(log: Log, model: Model, worth: float = np.inf) -> Loss | None:
    """Errors of a model on a record it was not fitted to; None where the equations leave more."""
    equation, squared = equation_error(build_regression(log, model), model)
    if equation > worth:
        return None
    run = free_run(log, model)
    spread = np.maximum(run.measured.std(axis=0), 1e-9)
    free = np.mean(((run.simulated - run.measured) / spread) ** 2, axis=1)
    stretches = np.array([_by_stretch(squared), _by_stretch(free)])
    return Loss(equation, run.nrmse, stretches)


def fit_candidates(
    fit: Log,
    held_out: Log,
    base: Model,
    before: Loss,
    progress: Callable[[int], None] | None = None,
) -> list[Candidate]:
    """Fit every effect that the model does not have yet; return those that help the equations."""
    present = {active.identifier for active in base.effects}
    worth = (1.0 - SCREEN) * before.equation
    found = []
    for number, identifier in enumerate(effect_names()):
        if identifier not in present:
            candidate = fit_candidate(fit, held_out, base, identifier, worth)
            if candidate is not None:
                found.append(candidate)
        if progress is not None:
            progress(number + 1)
    return found


def fit_candidate(
    fit: Log, held_out: Log, base: Model, identifier: str, worth: float = np.inf
) -> Candidate | None:
    """Fit one effect; None where it cannot be evaluated here or leaves more than ``worth``."""
    effect, best = get_effect(identifier), None
    for values in _profile(effect, base, fit):
        try:
            model, estimate, regression = fit_linear(fit, base.with_effects({identifier: values}))
            error = equation_error(regression, model)[0]
        except (ValueError, np.linalg.LinAlgError):
            continue
        if np.isfinite(error) and (best is None or error < best[0]):
            best = (error, model, estimate)
    if best is None:
        return None
    # Once more at the values found: some laws (a slope) depend on the mass beside them.
    model, estimate, regression = fit_linear(fit, best[1])
    error = equation_error(regression, model)[0]
    sizes = dict(model.effects[-1].values)
    deviations = dict(zip(estimate.names, estimate.standard_errors.tolist(), strict=True))
    errors = {
        name: deviations[f"{identifier}.{name}"]
        for name in sizes
        if f"{identifier}.{name}" in deviations
    }
    loss = measure_loss(held_out, _within_bounds(model), worth)
    if loss is None:
        return None
    return Candidate(identifier, model, sizes, errors, estimate.clusters, error, loss)


def _profile(effect, base: Model, log: Log):
    """Start values: linear parameters at zero, at most one nonlinear parameter over its grid."""
    platform = base.platform
    values = effect.complete(None, platform)
    curved = [name for name in values if not effect.parameter_of(name).linear]
    for name in values:
        parameter = effect.parameter_of(name)
        if parameter.linear:
            values[name] = min(max(0.0, parameter.bounds[0]), parameter.bounds[1])
    if not curved:
        yield values
        return
    shared = {effect.parameter_of(name).name for name in curved}
    for name in curved if len(shared) == len(curved) else [curved[0]]:
        parameter = effect.parameter_of(name)
        for size in _grid(parameter, log):
            yield values | {name: size}


def _grid(parameter: Parameter, log: Log) -> list[float]:
    low, high = parameter.bounds
    if parameter.name == "t0":
        return (log.duration * np.linspace(0.15, 0.85, 6)).tolist()
    sizes = [parameter.default * factor for factor in PROFILE]
    if low < 0 < high:
        sizes += [-size for size in sizes]
    return [size for size in sizes if low <= size <= high]


def _within_bounds(model: Model) -> Model:
    """Simulate with sizes that are possible; an estimate may lie a little outside."""
    values = list(model.values())
    for at, name in enumerate(model.names()):
        identifier, _, flat = name.rpartition(".")
        if identifier:
            low, high = get_effect(identifier).parameter_of(flat).bounds
            values[at] = min(max(values[at], low), high)
    return model.with_values(values)


def _by_stretch(squared: np.ndarray) -> np.ndarray:
    return np.array([part.mean() for part in np.array_split(squared, STRETCHES)])
