"""Free-run refinement: the parameters whose simulation from the drive input alone fits best.

Output error over windows (multiple shooting with measured starts), exact derivatives from CasADi.
Noise in the regressors does not bias it, and nonlinear parameters (delays, limits, Stribeck speeds)
are estimated with the others.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import lru_cache

import casadi as ca
import numpy as np
from scipy.optimize import least_squares

from ident.free_run import WINDOW, Windows, cut_windows
from ident.log import Log
from youbot_env.effects import get_effect
from youbot_env.model import Model
from youbot_env.parameters import UNITS

# Theta may move within these factors of its start; first moments within this many kg m.
FACTORS = (0.02, 50.0)
FIRST_MOMENT = 20.0
# A simulation that runs away counts as this many spreads, so that the optimiser can turn back.
LIMIT = 1e3


@dataclass(frozen=True)
class OutputError:
    """Result of a refinement.

    Attributes:
        model: the model with refined values.
        covariance: (P, P) of ``model.names()``, from the scatter between windows.
        windows: number of windows.
        cost: half the sum of squared scaled errors, before and after.
        converged: whether the optimiser met its tolerance.
    """

    model: Model
    covariance: np.ndarray
    windows: int
    cost: tuple[float, float]
    converged: bool


def refine(
    logs: list[Log],
    model: Model,
    free: tuple[str, ...] | None = None,
    window: float = WINDOW,
    iterations: int = 30,
) -> OutputError:
    """Refine a model by output error.

    Args:
        logs: measured records.
        model: start values.
        free: names (of ``model.names()``) to estimate; all when None.
        window: length of the windows, s.
        iterations: most Gauss-Newton steps.

    Returns:
        The refined model with its covariance.
    """
    names, start = model.names(), np.array(model.values(), float)
    chosen = np.array([free is None or name in free for name in names])
    low, high = _bounds(model, start)
    problems = [_Problem(log, model, window, high) for log in logs]
    weight = 1.0 / np.mean([problem.spread for problem in problems], axis=0)
    scale = np.where(start != 0, np.abs(start), 1.0)
    values = start.copy()

    def residual(x: np.ndarray) -> np.ndarray:
        values[chosen] = x
        return np.concatenate([p.error(values, weight) for p in problems])

    def jacobian(x: np.ndarray) -> np.ndarray:
        values[chosen] = x
        return np.concatenate([p.derivative(values, weight)[:, chosen] for p in problems])

    first = residual(start[chosen])
    result = least_squares(
        residual,
        np.clip(start[chosen], low[chosen], high[chosen]),
        jacobian,
        bounds=(low[chosen], high[chosen]),
        x_scale=scale[chosen],
        max_nfev=iterations,
        xtol=1e-8,
        ftol=1e-8,
    )
    values[chosen] = result.x
    covariance = np.zeros((len(names), len(names)))
    groups = np.concatenate(
        [p.groups + sum(q.count for q in problems[:k]) for k, p in enumerate(problems)]
    )
    covariance[np.ix_(chosen, chosen)] = _cluster_covariance(result.jac, result.fun, groups)
    refined = replace(model.with_values(values), covariance=covariance.tolist())
    cost = (0.5 * float(first @ first), float(result.cost))
    return OutputError(refined, covariance, int(groups[-1]) + 1, cost, result.status > 0)


class _Problem:
    """One log: simulated windows, their errors and derivatives."""

    def __init__(self, log: Log, model: Model, window: float, high: np.ndarray):
        # Commands far enough back for the longest delay that the bounds allow.
        widest = model.with_values(np.where(_is_delay(model), high, model.values()))
        self.windows: Windows = cut_windows(log, widest, window)
        velocity = log.velocity()
        self.measured = velocity[self.windows.index.ravel()]
        self.spread = np.maximum(velocity.std(axis=0), 1e-6)
        self.count, length = self.windows.index.shape
        self.groups = np.repeat(np.arange(self.count), 3 * length)

    def error(self, values: np.ndarray, weight: np.ndarray) -> np.ndarray:
        simulated = self.windows.simulate(values)[:, :, 3:6].reshape(-1, 3)
        error = np.nan_to_num((simulated - self.measured) * weight, nan=LIMIT)
        return np.clip(error, -LIMIT, LIMIT).ravel()

    def derivative(self, values: np.ndarray, weight: np.ndarray) -> np.ndarray:
        w = self.windows
        function = _velocity_jacobian(w.function, len(values))
        flat = np.asarray(function(w.start, w.commands, values, w.clock, w.step))
        shaped = flat.reshape(-1, 3, len(values)) * weight[None, :, None]
        return np.nan_to_num(shaped.reshape(-1, len(values)))


@lru_cache(maxsize=16)
def _velocity_jacobian(windows: ca.Function, count: int) -> ca.Function:
    inputs = [ca.MX.sym(name, *windows.size_in(k)) for k, name in enumerate(windows.name_in())]
    velocity = ca.vec(windows(*inputs)[3:6, :])
    return ca.Function("velocity_jacobian", inputs, [ca.jacobian(velocity, inputs[2])])


def _is_delay(model: Model) -> np.ndarray:
    delays = {a.identifier for a in model.effects if a.effect.acts("delay")}
    return np.array([name.split(".")[0] in delays for name in model.names()])


def _bounds(model: Model, start: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    low, high = np.empty_like(start), np.empty_like(start)
    for k, name in enumerate(model.names()):
        identifier, _, flat = name.rpartition(".")
        if identifier:
            low[k], high[k] = get_effect(identifier).parameter_of(flat).bounds
        elif name in UNITS:
            size = max(abs(start[k]), 1e-6)
            low[k], high[k] = FACTORS[0] * size, FACTORS[1] * size
        else:
            low[k], high[k] = -FIRST_MOMENT, FIRST_MOMENT
    delay = _is_delay(model)
    # A history of commands as long as the widest bound would cost much; twice the start is ample.
    high[delay] = np.minimum(high[delay], np.maximum(2.0 * start[delay], 0.06))
    return low, high


def _cluster_covariance(jacobian: np.ndarray, error: np.ndarray, groups: np.ndarray) -> np.ndarray:
    count = int(groups[-1]) + 1
    scale = np.sqrt(np.sum(jacobian**2, axis=0))
    scale = np.where(scale > 0, scale, 1.0)
    scaled = jacobian / scale
    scores = np.zeros((count, jacobian.shape[1]))
    np.add.at(scores, groups, scaled * error[:, None])
    bread = np.linalg.pinv(scaled.T @ scaled, rcond=1e-10)
    meat = scores.T @ scores * count / max(count - 1, 1)
    return bread @ meat @ bread / np.outer(scale, scale)
