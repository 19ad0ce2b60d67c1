"""Free-run refinement: the parameters whose simulation from the drive input alone fits best.

Output error over windows (multiple shooting with measured starts) by Gauss-Newton steps of the
linearised simulation.  Noise of the velocities does not bias it, what noise of the torques does is
taken back at the end, and nonlinear parameters (delays, limits, Stribeck speeds) are estimated with
the others.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from scipy.linalg import null_space

from ident.angle_drift import drifted
from ident.input_noise import noisier
from ident.jackknife import left_one_out
from ident.log import Log
from ident.sensitivity import Linearised
from youbot_env.dynamics import Theta
from youbot_env.effects import get_effect
from youbot_env.model import Model
from youbot_env.parameters import UNITS, typical

# Theta may move within these factors of what is ordinary; first moments within this one.
FACTORS = (0.02, 50.0)
FIRST_MOMENT = 2.0
# Start of every window that is left out: there the noise of its first sample still shows, s.
SETTLE = 0.5
# Directions weaker than this share of the strongest, in equally long columns, are left alone.
WEAK = 1e-6
# A step must lower the sum of squares by this share to be worth another.
TOLERANCE = 1e-6
# Levenberg and Marquardt, in columns of unit length: tried one after the other until one helps.
DAMPING = (0.0, 1e-3, 1e-2, 0.1, 1.0, 10.0)
# Speeds and times in which a law is not linear change by at most this factor in one step.
NEARBY = 2.0
# A simulation that runs away counts as this many spreads.
LIMIT = 1e3
# Bias that is taken back, in standard errors.
LARGEST_BIAS = 4.0
# Draws of the drift of the wheel angles.
DRIFTS = 8


@dataclass(frozen=True)
class OutputError:
    """Result of a refinement.

    Attributes:
        model: the model with refined values.
        covariance: (P, P) of ``model.names()``, from the scatter between windows and what is not
            known of the wheel angles; None where it was not asked for.
        windows: number of windows.
        cost: half the sum of squared scaled errors, before and after.
        converged: whether further steps would not have helped.
        simulations: each log simulated with the refined model.
    """

    model: Model
    covariance: np.ndarray | None
    windows: int
    cost: tuple[float, float]
    converged: bool
    simulations: tuple[Linearised, ...]


@np.errstate(all="ignore")  # guesses that run away are told by their cost
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
) -> OutputError:
    """Refine a model by output error.

    Args:
        logs: measured records.
        model: start values; of several the best are taken.
        free: names (of ``model.names()``) to estimate; when None all in which laws are smooth.
        window: length of the windows, s; chosen from each log's duration when None.
        iterations: most Gauss-Newton steps.
        keep: (W,) for each log, the windows that are fitted; all when None.
        weights: (m,) for each log, of its outputs; ``output_weights`` when None.
        tolerance: share of the sum of squares that a step must remove to be worth another.
        intervals: whether the covariance is wanted, and what noise of the torques does to the
            values taken back, which takes a while.

    Returns:
        The refined model with its covariance.  Contrast parameters keep their mean.
    """
    starts = [model] if isinstance(model, Model) else model
    model = starts[0]
    directions, (low, high) = free_directions(model, free), value_bounds(model)

    def at(values, logs: list[Log] = logs) -> _Fit:
        return _Fit.at(logs, model.with_values(np.clip(values, low, high)), window, keep, weights)

    now = min((at(start.values()) for start in starts), key=lambda fit: fit.cost)
    first, converged, gentlest, curved = now.cost, False, 0, _curved(model)
    for _ in range(iterations):
        values, better = np.array(now.model.values()), None
        for level in range(gentlest, len(DAMPING)):
            step, promised = now.step(values, directions, low, high, DAMPING[level])
            if promised < tolerance * now.cost:
                break  # dampening promises even less
            trial = at(np.where(curved, np.clip(values + step, *_nearby(values)), values + step))
            if trial.cost < now.cost:
                better, gentlest = trial, max(level - 1, 0)  # much gentler would fail again
                break
        if better is None or now.cost - better.cost < tolerance * now.cost:
            now, converged = better or now, True
            break
        now = better
    refined, covariance = now.model, None
    if intervals:
        covariance = now.covariance(directions)
        values, errors = np.array(refined.values()), np.sqrt(np.diag(covariance))
        shifts = [at(values, noisy).step(values, directions, low, high, 0.0)[0]
                  for noisy in noisier(logs)]  # fmt: skip
        now = at(values - _credible(np.mean(shifts, axis=0), errors)) if shifts else now
        refined = replace(now.model, covariance=covariance.tolist())
    clusters = int(now.groups[-1]) + 1
    return OutputError(refined, covariance, clusters, (first, now.cost), converged, now.simulations)


def _curved(model: Model) -> np.ndarray:
    """(P,) whether a law bends so much in a value that a step of it must stay near."""
    found = [False] * len(Theta._fields)
    for active in model.effects:
        parameters = [active.effect.parameter_of(name) for name in active.values]
        found += [not p.linear and p.bounds[0] > 0 for p in parameters]
    return np.array(found)


def _nearby(values: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    return values / NEARBY, values * NEARBY


def _credible(bias: np.ndarray, errors: np.ndarray) -> np.ndarray:
    """The bias (P,), shortened where it exceeds what one linear step can tell."""
    known = errors > 0
    largest = float(np.max(np.abs(bias[known]) / errors[known], initial=0.0))
    return bias * min(1.0, LARGEST_BIAS / max(largest, 1e-12))


@dataclass(frozen=True, eq=False)
class _Fit:
    """Scaled errors of all logs at one set of values."""

    model: Model
    simulations: tuple[Linearised, ...]
    error: np.ndarray
    groups: np.ndarray
    keep: tuple[np.ndarray, ...]
    weights: tuple[np.ndarray, ...]

    @classmethod
    def at(
        cls, logs: list[Log], model: Model, window: float | None, keep=None, weights=None
    ) -> _Fit:
        weights = tuple(weights or map(output_weights, logs))
        simulations = tuple(Linearised.of(log, model, window) for log in logs)
        keep = tuple(keep or [np.ones(sim.shape[0], bool) for sim in simulations])
        parts, groups, count = [], [], 0
        for sim, kept, weight in zip(simulations, keep, weights, strict=True):
            error = scaled_error(sim, weight)[kept]
            parts.append(error.ravel())
            groups.append(count + np.repeat(np.arange(len(error)), error[0].size))
            count += len(error)
        return cls(model, simulations, np.concatenate(parts), np.concatenate(groups), keep,
                   weights)  # fmt: skip

    @property
    def cost(self) -> float:
        return 0.5 * float(self.error @ self.error)

    @cached_property
    def _made(self) -> dict[tuple, np.ndarray]:
        return {}

    def _columns_of(self, chosen: tuple) -> np.ndarray:
        if chosen not in self._made:
            self._made[chosen] = self.columns(np.array(chosen))
        return self._made[chosen]

    def columns(self, chosen: np.ndarray) -> np.ndarray:
        parts = []
        for sim, kept, weight in zip(self.simulations, self.keep, self.weights, strict=True):
            columns = settled(sim, sim.value_columns(chosen) * weight[:, None])[kept]
            parts.append(np.nan_to_num(columns.reshape(-1, columns.shape[-1])))
        return np.concatenate(parts)

    def step(self, values, directions, low, high, damping: float) -> tuple[np.ndarray, float]:
        """Damped Gauss-Newton step (P,), and how much lower it promises the cost to be.

        Values at a bound do not push against it.
        """
        moving = np.any(directions != 0, axis=1)
        columns, held = self._columns_of(tuple(moving)), np.zeros(len(values), bool)
        for _ in range(3):
            basis = directions[:, ~np.any(directions[held] != 0, axis=0)]
            step = basis @ _least_squares(columns @ basis[moving], self.error, damping)
            out = ((values <= low) & (step < 0)) | ((values >= high) & (step > 0))
            if not np.any(out & ~held):
                break
            held |= out
        left = self.error - columns @ step[moving]
        return step, self.cost - 0.5 * float(left @ left)

    def covariance(self, basis: np.ndarray) -> np.ndarray:
        """(P, P) from the scatter between windows and the drift of wheel angles."""
        moving = np.any(basis != 0, axis=1)
        columns = self._columns_of(tuple(moving)) @ basis[moving]
        found = left_one_out(columns, self.error, self.groups, basis)
        # What every robot has is no answer, and its own sizes hardly depend on the drift.
        if any(a.effect.needs_wheel_angle and not a.effect.background for a in self.model.effects):
            scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
            drifts = np.linalg.lstsq(columns / scale, self.drifts(), rcond=WEAK)[0]
            drifts = basis / scale @ drifts
            found = found + drifts @ drifts.T / DRIFTS
        return found

    def drifts(self) -> np.ndarray:
        """(N, DRIFTS) changes of the errors when the wheel angles are as wrong as they may be."""
        rng, changes = np.random.default_rng(0), []
        for _ in range(DRIFTS):
            other = [drifted(sim, rng) for sim in self.simulations]
            error = [
                scaled_error(sim, weight)[kept].ravel()
                for sim, weight, kept in zip(other, self.weights, self.keep, strict=True)
            ]
            changes.append(np.concatenate(error) - self.error)
        return np.stack(changes, axis=1)


def free_directions(model: Model, free: tuple[str, ...] | None = None) -> np.ndarray:
    """(P, K) directions in which values may move: contrasts keep their mean.

    Args:
        model: gives names and effects.
        free: names that may move; when None all but those in which a law has no derivative.
    """
    names = model.names()
    if free is None:
        fixed = [
            f"{a.identifier}.{name}"
            for a in model.effects
            for name in a.values
            if not a.effect.parameter_of(name).smooth
        ]
        free = tuple(name for name in names if name not in fixed)
    unit = np.eye(len(names))
    directions = [unit[:, [k]] for k, name in enumerate(names) if name in free]
    for active in model.effects:
        for parameter in active.effect.parameters:
            members = [
                k
                for k, name in enumerate(names)
                if name in free
                and name.startswith(f"{active.identifier}.{parameter.name}_")
                and parameter.contrast
            ]
            if len(members) > 1:
                kept = [d for d in directions if not np.any(d[members])]
                directions = [*kept, unit[:, members] @ null_space(np.ones((1, len(members))))]
    return np.concatenate(directions, axis=1) if directions else np.zeros((len(names), 0))


def scaled_error(sim: Linearised, weights: np.ndarray) -> np.ndarray:
    """(W, l, m) settled free-run errors, weighted."""
    error = settled(sim, sim.residual * weights)
    return np.clip(np.nan_to_num(error, nan=LIMIT), -LIMIT, LIMIT)


def settled(sim: Linearised, values: np.ndarray) -> np.ndarray:
    """Samples (W, l, ...) of each window after its start has settled."""
    length = values.shape[1]
    return values[:, min(round(SETTLE / sim.log.dt), length // 3) :]


def output_weights(log: Log) -> np.ndarray:
    """(m,) reciprocal spreads of the outputs; wheels share one, they are one kind of sensor."""
    if log.body_velocity is None:
        spread = np.full(log.wheel_velocity.shape[1], log.wheel_velocity.std())
    else:
        spread = log.body_velocity.std(axis=0)
    return 1.0 / np.maximum(spread, 1e-6)


def _least_squares(columns: np.ndarray, error: np.ndarray, damping: float) -> np.ndarray:
    scale = np.linalg.norm(columns, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    columns = columns / scale
    if damping:
        width = columns.shape[1]
        columns = np.concatenate([columns, np.sqrt(damping) * np.eye(width)])
        error = np.concatenate([error, np.zeros(width)])
    return np.linalg.lstsq(columns, error, rcond=WEAK)[0] / scale


def value_bounds(
    model: Model, factors: tuple[float, float] | None = None
) -> tuple[np.ndarray, np.ndarray]:
    """Lowest and highest values (P,) that an estimate may take.

    Args:
        model: gives names and effects, and by its mass what is ordinary for the robot.
        factors: of the model's own values, the least and the most; when None ``FACTORS`` of
            ordinary ones, widened so that a start that is far off binds nothing.
    """
    start, ordinary = np.array(model.values(), float), typical(model.values()[0], model.platform)
    low, high = np.empty_like(start), np.empty_like(start)
    for k, name in enumerate(model.names()):
        identifier, _, flat = name.rpartition(".")
        if identifier:
            low[k], high[k] = get_effect(identifier).parameter_of(flat).bounds
        elif name in UNITS:
            size = max(abs(start[k]), 1e-6)
            low[k], high[k] = np.multiply(factors or FACTORS, size)
            if factors is None:
                low[k] = min(size, FACTORS[0] * ordinary[k])
                high[k] = max(high[k], FACTORS[1] * ordinary[k])
        else:
            low[k], high[k] = FIRST_MOMENT * ordinary[k] * np.array([-1.0, 1.0])
    return low, high
