"""Free-run refinement: the parameters whose simulation from the drive input alone fits best.

Output error over windows (multiple shooting with measured starts) by Gauss-Newton steps of the
linearised simulation.  Noise of the velocities does not bias it, what noise of the torques does is
taken back at the end, and nonlinear parameters (delays, limits, Stribeck speeds) are estimated with
the others.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ident.drive_noise import PAIRS, noisier
from ident.instruments import adapted, stated
from ident.kept import kept
from ident.log import Log
from ident.noise import DOUBTED
from ident.parameter_space import FreeValues
from ident.prior import Pull
from ident.residuals import ScaledFit
from ident.scopes import Scopes
from ident.sensitivity import Linearised
from youbot_env.model import Model
from youbot_env.parameters import Parameters

# A step must lower the sum of squares by this share to be worth another.
TOLERANCE = 1e-6
# Levenberg and Marquardt, in columns of unit length: tried one after the other until one helps.
DAMPING = (0.0, 1e-3, 1e-2, 0.1, 1.0, 10.0)
# Bias that is taken back, in standard errors.
LARGEST_BIAS = 4.0


@dataclass(frozen=True)
class OutputError:
    """Result of a refinement.

    Attributes:
        models: the model with refined values, for each log; they share those of the robot.
        covariance: (Z, Z) of all values as ``scopes`` lays them out, from the scatter between
            windows and what is not known of the wheel angles; None where it was not asked for.
        scopes: which values the logs share.
        windows: number of windows.
        cost: half the sum of squared scaled errors, before and after.
        converged: whether further steps would not have helped.
        simulations: each log simulated with the refined model.
    """

    models: tuple[Model, ...]
    covariance: np.ndarray | None
    scopes: Scopes
    windows: int
    cost: tuple[float, float]
    converged: bool
    simulations: tuple[Linearised, ...]

    @property
    def model(self) -> Model:
        """The model of the first log."""
        return self.models[0]


def refine(
    logs: list[Log],
    model: Model | list[Model],
    free: tuple[str, ...] | None = None,
    window: float | None = None,
    iterations: int = 30,
    keep: list[np.ndarray] | None = None,
    weights: list[np.ndarray] | None = None,
    tolerance: float = TOLERANCE,
    intervals: bool = True,
    ends: list[dict[str, tuple[float, float]]] | None = None,
    smooth: bool = False,
    draws: int = PAIRS,
    prior: Model | None = None,
) -> OutputError:
    """Refine a model by output error.

    Args:
        logs: measured records.
        model: start values; of several the best are taken.  What a log states about its own
            recording is taken as given for it.
        free: names (of ``model.names()``) to estimate; when None all in which laws are smooth.
        window: length of the windows, s; chosen from each log's duration when None.
        iterations: most Gauss-Newton steps.
        keep: (W,) for each log, the windows that are fitted; all when None.
        weights: (m,) for each log, of its outputs; ``output_weights`` when None.
        tolerance: share of the sum of squares that a step must remove to be worth another.
        intervals: whether the covariance is wanted, and what noise of the torques does to the
            values taken back, which takes a while.
        ends: for each log, lowest and highest values by name, within those of the model.
        draws: pairs of records with more noise, by which what noise does to the values is told.
        prior: model whose seven parameters are what is known before any log; directions of which
            these logs say less stay near it, see ``ident.prior``.
        smooth: whether errors are averaged over neighbouring samples, see ``scaled_fit.smoothed``.

    Returns:
        The refined model with its covariance.  Contrast parameters keep their mean.
    """
    starts = [model] if isinstance(model, Model) else model
    rest = (window, iterations, keep, weights, tolerance, intervals, ends, smooth, draws, prior)
    return kept(
        "refinement",
        (logs, starts, free and sorted(free), *rest),  # names in any order are one question
        lambda: _refine(logs, starts, free, *rest),
        _packed,
        lambda known: _unpacked(known, logs, starts[0], window),
    )


@np.errstate(all="ignore")  # guesses that run away are told by their cost
def _refine(
    logs: list[Log],
    starts: list[Model],
    free: tuple[str, ...] | None,
    window: float | None,
    iterations: int,
    keep: list[np.ndarray] | None,
    weights: list[np.ndarray] | None,
    tolerance: float,
    intervals: bool,
    ends: list[dict[str, tuple[float, float]]] | None,
    smooth: bool,
    draws: int,
    prior: Model | None,
) -> OutputError:
    """As ``refine``, without looking for an answer that was kept."""
    model, scopes = starts[0], Scopes.of(starts[0], len(logs))
    fixed = [set(stated(model, log)) for log in logs]
    free_values = FreeValues.of(model, free, scopes, fixed, ends)

    def at(values, logs: list[Log] = logs) -> ScaledFit:
        models = scopes.split(values, model)
        return ScaledFit.at(logs, models, window, keep, weights, smooth)

    fits = [
        at(free_values.within(scopes.join([adapted(start, log) for log in logs])))
        for start in starts
    ]
    now = min(fits, key=lambda fit: fit.cost)
    pull = Pull.of(now, prior)

    def cost(fit: ScaledFit) -> float:
        return fit.cost if pull is None else fit.cost + pull.cost(fit.values)

    def stepped(fit: ScaledFit, damping: float) -> tuple[np.ndarray, float]:
        moving = free_values.moving
        return fit.step(free_values, damping, pull and pull.rows(fit.values, moving))

    first, converged, gentlest = now.cost, False, 0
    for _ in range(iterations):
        values, better = now.values, None
        for level in range(gentlest, len(DAMPING)):
            step, promised = stepped(now, DAMPING[level])
            if promised < tolerance * cost(now):
                break  # dampening promises even less
            trial = at(free_values.moved(values, step))
            if cost(trial) < cost(now):
                better, gentlest = trial, max(level - 1, 0)  # much gentler would fail again
                break
        if better is None or cost(now) - cost(better) < tolerance * cost(now):
            now, converged = better or now, True
            break
        now = better
    models, covariance = now.models, None
    if intervals:
        covariance, values = now.covariance(free_values), now.values
        if pull is not None:
            covariance = pull.covariance(now, free_values, covariance)
        steps = [stepped(at(values, noisy), 0.0)[0] for noisy in noisier(logs, draws)]
        if steps:
            whole = np.mean(steps, axis=0)
            bias = _credible(whole, np.sqrt(np.diag(covariance)))
            now = at(free_values.within(values - bias))
            doubt = whole - (1.0 - DOUBTED) * bias
            covariance = covariance + np.outer(doubt, doubt)
        models = tuple(
            replace(one, covariance=covariance[np.ix_(places, places)].tolist())
            for one, places in zip(now.models, scopes.index, strict=True)
        )
    clusters = int(now.groups[-1]) + 1
    costs = first, now.cost
    return OutputError(models, covariance, scopes, clusters, costs, converged, now.simulations)


def _packed(found: OutputError) -> dict[str, Any]:
    """A result in types that JSON has: parameters as they are, since theta would round them."""
    values = [
        {
            "parameters": list(model.parameters.as_dict().values()),
            "effects": [active.values for active in model.effects],
        }
        for model in found.models
    ]
    covariance = None if found.covariance is None else found.covariance.tolist()
    return {
        "values": values,
        "covariance": covariance,
        "windows": found.windows,
        "cost": found.cost,
        "converged": found.converged,
    }


@np.errstate(all="ignore")
def _unpacked(
    known: dict[str, Any], logs: list[Log], model: Model, window: float | None
) -> OutputError:
    """The result again, its logs simulated anew."""
    scopes = Scopes.of(model, len(logs))
    models = tuple(
        replace(
            model,
            parameters=Parameters(*one["parameters"]),
            effects=tuple(
                replace(active, values=values)
                for active, values in zip(model.effects, one["effects"], strict=True)
            ),
        )
        for one in known["values"]
    )
    simulations = tuple(
        Linearised.of(log, one, window) for log, one in zip(logs, models, strict=True)
    )
    covariance = known["covariance"]
    if covariance is not None:
        covariance = np.array(covariance)
        models = tuple(
            replace(one, covariance=covariance[np.ix_(places, places)].tolist())
            for one, places in zip(models, scopes.index, strict=True)
        )
    cost, converged = tuple(known["cost"]), known["converged"]
    return OutputError(models, covariance, scopes, known["windows"], cost, converged, simulations)


def _credible(bias: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """The bias (Z,), shortened where it exceeds what one linear step can tell."""
    known = errors > 0
    largest = float(np.max(np.abs(bias[known]) / errors[known], initial=0.0))
    return bias * min(1.0, LARGEST_BIAS / max(largest, 1e-12))
