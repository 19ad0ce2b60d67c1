"""Free-run errors of logs at one set of values, steps that lower them, and how sure those are."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ident.covariance import left_one_out
from ident.log import Log
from ident.noise import drifted
from ident.parameter_space import FreeValues
from ident.pooling import MANY_RUNS
from ident.scopes import Scopes
from ident.sensitivity import Linearised
from youbot_env.model import Model

# Start of every window that is left out: there the noise of its first sample still shows, s.
SETTLE = 0.5
# Directions weaker than this share of the strongest, in equally long columns, are left alone.
WEAK = 1e-6
# A simulation that runs away counts as this many spreads.
LIMIT = 1e3
# Draws of the drift of the wheel angles.
DRIFTS = 8
# Errors of windows that are far shorter than the robot remembers go together for this time, s.
REMEMBERED = 1.0


@dataclass(frozen=True, eq=False)
class ScaledFit:
    """Scaled errors of all logs at one set of values.

    Attributes:
        values: (Z,) as ``scopes`` lays them out.
        scopes: which values each log shares with the others.
        simulations: each log simulated with its model.
        error: (N,) settled free-run errors of the windows that are fitted, weighted.
        groups: (N,) number of the window of each, or of the run where there are many.
        keep: (W,) for each log, the windows that are fitted.
        weights: (m,) for each log, of its outputs.
        smooth: whether errors and columns are averaged, see ``smoothed``.
    """

    values: np.ndarray
    scopes: Scopes
    simulations: tuple[Linearised, ...]
    error: np.ndarray
    groups: np.ndarray
    keep: tuple[np.ndarray, ...]
    weights: tuple[np.ndarray, ...]
    smooth: bool = False

    @classmethod
    def at(
        cls, logs: list[Log], models, window: float | None, keep=None, weights=None, smooth=False
    ) -> ScaledFit:
        """Simulate logs, each with its model; arguments as ``output_error.refine`` has them."""
        weights = tuple(weights or map(output_weights, logs))
        simulations = tuple(
            Linearised.of(log, model, window) for log, model in zip(logs, models, strict=True)
        )
        keep = tuple(keep or [np.ones(sim.shape[0], bool) for sim in simulations])
        parts, groups, count = [], [], 0
        for sim, kept, weight in zip(simulations, keep, weights, strict=True):
            error = smoothed(scaled_error(sim, weight), smooth)[kept]
            parts.append(error.ravel())
            number = independent(sim.log, sim.begin[kept])
            groups.append(count + np.repeat(number, error[0].size))
            count += int(number[-1]) + 1
        scopes = Scopes.of(models[0], len(logs))
        return cls(scopes.join(models), scopes, simulations, np.concatenate(parts),
                   np.concatenate(groups), keep, weights, smooth)  # fmt: skip

    @property
    def models(self) -> tuple[Model, ...]:
        """The model of each log."""
        return tuple(sim.model for sim in self.simulations)

    @property
    def cost(self) -> float:
        """Half the sum of squares."""
        return 0.5 * float(self.error @ self.error)

    def columns(self, free: FreeValues) -> np.ndarray:
        """(N, M) derivatives of what is simulated by the values that move."""
        key = tuple(free.moving)
        if key not in self._made:
            parts = []
            for number, (sim, kept, weight) in enumerate(
                zip(self.simulations, self.keep, self.weights, strict=True)
            ):
                places = self.scopes.index[number]
                mine = free.moving[places]
                columns = settled(sim, sim.value_columns(mine) * weight[:, None])[kept]
                columns = smoothed(columns, self.smooth)
                part = np.zeros((columns[..., 0].size, len(free.moving)))
                part[:, places[mine]] = np.nan_to_num(columns.reshape(len(part), -1))
                parts.append(part[:, free.moving])
            self._made[key] = np.concatenate(parts)
        return self._made[key]

    @cached_property
    def _made(self) -> dict[tuple, np.ndarray]:
        return {}

    def step(
        self, free: FreeValues, damping: float, beside: tuple[np.ndarray, np.ndarray] | None = None
    ) -> tuple[np.ndarray, float]:
        """Damped Gauss-Newton step (Z,), and how much lower it promises the cost to be.

        Values at a bound do not push against it.

        Args:
            free: what may move.
            damping: of Levenberg and Marquardt, in columns of unit length.
            beside: columns (K, M) and errors (K,) of further rows, which the cost counts too.
        """
        values, moving, columns, error = self.values, free.moving, self.columns(free), self.error
        if beside is not None:
            columns = np.concatenate([columns, beside[0]])
            error = np.concatenate([error, beside[1]])
        held = np.zeros(len(values), bool)
        for _ in range(3):
            basis = free.directions[:, ~np.any(free.directions[held] != 0, axis=0)]
            step = basis @ _least_squares(columns @ basis[moving], error, damping)
            out = ((values <= free.low) & (step < 0)) | ((values >= free.high) & (step > 0))
            if not np.any(out & ~held):
                break
            held |= out
        left = error - columns @ step[moving]
        return step, 0.5 * float(error @ error - left @ left)

    def covariance(self, free: FreeValues) -> np.ndarray:
        """(Z, Z) from the scatter between windows and the drift of wheel angles."""
        basis = free.directions
        columns = self.columns(free) @ basis[free.moving]
        found = left_one_out(columns, self.error, self.groups, basis)
        # What every robot has is no answer, and its own sizes hardly depend on the drift.
        effects = [active.effect for active in self.models[0].effects]
        if any(effect.needs_wheel_angle and not effect.background for effect in effects):
            scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
            drifts = np.linalg.lstsq(columns / scale, self._drifts(), rcond=WEAK)[0]
            drifts = basis / scale @ drifts
            found = found + drifts @ drifts.T / DRIFTS
        return found

    def _drifts(self) -> np.ndarray:
        """(N, DRIFTS) changes of the errors when the wheel angles are as wrong as they may be."""
        rng, changes = np.random.default_rng(0), []
        for _ in range(DRIFTS):
            other = [drifted(sim, rng) for sim in self.simulations]
            error = [
                smoothed(scaled_error(sim, weight), self.smooth)[kept].ravel()
                for sim, weight, kept in zip(other, self.weights, self.keep, strict=True)
            ]
            changes.append(np.concatenate(error) - self.error)
        return np.stack(changes, axis=1)


def independent(log: Log, begin: np.ndarray) -> np.ndarray:
    """(W,) number of the group of windows, independent of the others, that each belongs to.

    Args:
        log: the record.
        begin: (W,) time at which each begins, s, ascending.
    """
    number = np.unique(log.run_of(begin), return_inverse=True)[1]
    if number[-1] + 1 >= MANY_RUNS:
        return number
    if log.window is None:
        return np.arange(len(begin))
    return np.unique((begin - begin[0]) // REMEMBERED, return_inverse=True)[1]


def smoothed(rows: np.ndarray, wanted: bool = True) -> np.ndarray:
    """Rows (W, l, ...) averaged with weights 1, 2, 1 over neighbouring samples, if that is wanted.

    Means of the drive over intervals that begin between two of its rows hold less of the rows'
    noise than others.  A fit of the clock prefers them for that; up to half of the rate of the
    rows, which is what is left here, there is no such difference.
    """
    if not wanted:
        return rows
    return 0.25 * (rows[:, :-2] + 2 * rows[:, 1:-1] + rows[:, 2:])


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
    if not columns.shape[1]:
        return np.zeros(0)
    scale = np.linalg.norm(columns, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    # Inner products of tall columns take a tenth of the time of their decomposition, and a step
    # that is repeated until it no longer helps needs no more digits than they keep.
    inner = columns.T @ columns / np.outer(scale, scale) + damping * np.eye(columns.shape[1])
    strength, turn = np.linalg.eigh(inner)
    strong = strength > WEAK**2 * strength[-1]
    turn = turn[:, strong]
    return turn @ ((turn.T @ (columns.T @ error / scale)) / strength[strong]) / scale
