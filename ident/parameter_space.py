"""Which values of a model an estimate may move, and how far."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.linalg import null_space

from ident.scopes import Scopes
from youbot_env.dynamics import Theta
from youbot_env.effects import get_effect
from youbot_env.model import Model
from youbot_env.parameters import UNITS, typical

# Theta may move within these factors of what is ordinary; first moments within this one.
FACTORS = (0.02, 50.0)
FIRST_MOMENT = 2.0
# Speeds and times in which a law is not linear change by at most this factor in one step.
NEARBY = 2.0


@dataclass(frozen=True, eq=False)
class FreeValues:
    """Values of a model, for one record or several, that are estimated.

    Attributes:
        directions: (Z, K) in which they move; contrasts keep their mean.
        low, high: (Z,) ends.
        curved: (Z,) whether a law bends so much in a value that a step of it must stay near.
    """

    directions: np.ndarray
    low: np.ndarray
    high: np.ndarray
    curved: np.ndarray

    @classmethod
    def of(
        cls,
        model: Model,
        free: tuple[str, ...] | None = None,
        scopes: Scopes | None = None,
        fixed: list[set[str]] | None = None,
        ends: list[dict[str, tuple[float, float]]] | None = None,
    ) -> FreeValues:
        """Look at a model.

        Args:
            model: gives names, effects and bounds.
            free: as ``free_directions`` takes it.
            scopes: lays out the values of several records; of one when None.
            fixed: names that stay as they are, for each record.
            ends: lowest and highest values by name, for each record, within those of the model.
        """
        scopes = scopes or Scopes.of(model, 1)
        fixed = fixed or [set()] * len(scopes.index)
        free = smooth_names(model) if free is None else free
        blocks = []
        for record, held in enumerate(fixed):
            mine = scopes.own if record else np.ones(len(scopes.own), bool)
            moving = tuple(n for n, m in zip(scopes.names, mine, strict=True)
                           if m and n in free and n not in held)  # fmt: skip
            blocks.append(scopes.spread(free_directions(model, moving), record))

        def laid_out(per_value: np.ndarray) -> np.ndarray:
            flat = np.empty(scopes.size, per_value.dtype)
            flat[scopes.index] = per_value
            return flat

        low, high = map(laid_out, value_bounds(model))
        for record, mine in enumerate(ends or []):
            for name, (lowest, highest) in mine.items():
                at = scopes.index[record, scopes.names.index(name)]
                low[at], high[at] = max(low[at], lowest), min(high[at], highest)
        return cls(np.concatenate(blocks, axis=1), low, high, laid_out(_curved(model)))

    @property
    def moving(self) -> np.ndarray:
        """(P,) whether each value moves at all."""
        return np.any(self.directions != 0, axis=1)

    def moved(self, values: np.ndarray, step: np.ndarray) -> np.ndarray:
        """Values (P,) after a step, shortened where it leads out of bounds or too far away."""
        near = np.clip(values + step, values / NEARBY, values * NEARBY)
        return self.within(np.where(self.curved, near, values + step))

    def within(self, values) -> np.ndarray:
        """Values (P,) inside their bounds."""
        return np.clip(values, self.low, self.high)


def free_directions(model: Model, free: tuple[str, ...] | None = None) -> np.ndarray:
    """(P, K) directions in which values may move: contrasts keep their mean.

    Args:
        model: gives names and effects.
        free: names that may move; when None all but those in which a law has no derivative.
    """
    names = model.names()
    free = smooth_names(model) if free is None else free
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


def smooth_names(model: Model) -> tuple[str, ...]:
    """Names of the values in which all laws have a derivative."""
    fixed = {
        f"{a.identifier}.{name}"
        for a in model.effects
        for name in a.values
        if not a.effect.parameter_of(name).smooth
    }
    return tuple(name for name in model.names() if name not in fixed)


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


def _curved(model: Model) -> np.ndarray:
    """(P,) whether a law bends so much in a value that a step of it must stay near."""
    found = [False] * len(Theta._fields)
    for active in model.effects:
        parameters = [active.effect.parameter_of(name) for name in active.values]
        found += [not p.linear and p.bounds[0] > 0 for p in parameters]
    return np.array(found)
