"""Values of a model for several records: the robot's are shared, every record has its own others.

All of them together make one flat vector: the values of the first record in the order of
``Model.names()``, then the own values of the second record, of the third, and so on.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from youbot_env.model import Model


@dataclass(frozen=True, eq=False)
class Scopes:
    """Where the values of each record stand in the flat vector.

    Attributes:
        names: (P,) of a model's values.
        own: (P,) whether a value belongs to the record.
        index: (L, P) place of each value of each record.
    """

    names: tuple[str, ...]
    own: np.ndarray
    index: np.ndarray

    @classmethod
    def of(cls, model: Model, count: int) -> Scopes:
        """Lay out a model's values for ``count`` records."""
        own = np.array([parameter_scope(model, name) == "record" for name in model.names()])
        size, each = len(own), int(own.sum())
        index = np.tile(np.arange(size), (count, 1))
        for k in range(1, count):
            index[k, own] = size + (k - 1) * each + np.arange(each)
        return cls(model.names(), own, index)

    @property
    def size(self) -> int:
        """Length of the flat vector."""
        return int(self.index.max()) + 1

    def join(self, models: list[Model] | tuple[Model, ...]) -> np.ndarray:
        """(Z,) flat vector of models that share the robot's values."""
        values = np.empty(self.size)
        for places, model in zip(self.index[::-1], models[::-1], strict=True):
            values[places] = model.values()
        return values

    def split(self, values: np.ndarray, model: Model) -> tuple[Model, ...]:
        """The model of each record, of a flat vector (Z,)."""
        return tuple(model.with_values(values[places]) for places in self.index)

    def spread(self, per_value: np.ndarray, record: int) -> np.ndarray:
        """(Z, ...) rows of a model's values (P, ...) at their places for one record."""
        spread = np.zeros((self.size, *per_value.shape[1:]), per_value.dtype)
        spread[self.index[record]] = per_value
        return spread


def parameter_scope(model: Model, name: str) -> str:
    """``robot`` or ``record``, of a value by its flat name."""
    identifier, _, flat = name.rpartition(".")
    if not identifier:
        return "robot"
    active = next(a for a in model.effects if a.identifier == identifier)
    return active.effect.parameter_of(flat).scope
