"""Signed orders of wheels: which column holds which wheel, and with which sign."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from ident.doctor.evidence import CERTAIN, Likeness

MOST_WHEELS = 4  # beyond that only single swaps are considered, not all orders


@dataclass(frozen=True)
class Arrangement:
    """Column i of a log holds ``signs[i]`` times the signal of wheel ``order[i]``."""

    order: tuple[int, ...]
    signs: tuple[int, ...]

    @property
    def changed(self) -> tuple[int, ...]:
        """Columns that hold another wheel or the other sign."""
        return tuple(
            i for i, (k, s) in enumerate(zip(self.order, self.signs, strict=True))
            if k != i or s < 0
        )  # fmt: skip

    def undo(self, values: np.ndarray) -> np.ndarray:
        """Put columns into the order and signs of the platform."""
        result = np.empty_like(values)
        result[:, list(self.order)] = values * np.array(self.signs)
        return result

    def undo_vector(self, vector: np.ndarray) -> np.ndarray:
        """Do the same for one value a column."""
        return self.undo(vector[None])[0]

    def words(self, names: tuple[str, ...]) -> str:
        """Say it for people: ``fl has the other sign``, ``fl and fr are exchanged``."""
        parts, moved = [], [i for i, k in enumerate(self.order) if k != i]
        flipped = [names[i] for i in range(len(names)) if i not in moved and self.signs[i] < 0]
        if len(flipped) == len(names):
            parts.append("all wheels have the other sign")
        elif flipped:
            verb = "has" if len(flipped) == 1 else "have"
            parts.append(f"{', '.join(flipped)} {verb} the other sign")
        if len(moved) == 2 and all(self.signs[i] > 0 for i in moved):
            parts.append(f"{names[moved[0]]} and {names[moved[1]]} are exchanged")
        elif moved:
            listed = [
                f"{names[i]} holds {'-' if self.signs[i] < 0 else ''}{names[self.order[i]]}"
                for i in moved
            ]
            parts.append(", ".join(listed))
        return "; ".join(parts) or "as they should be"


def arrangements(count: int) -> list[Arrangement]:
    """All arrangements of ``count`` wheels, those that change least first."""
    if count <= MOST_WHEELS:
        orders = list(itertools.permutations(range(count)))
    else:
        orders = [tuple(range(count))]
        for i, k in itertools.combinations(range(count), 2):
            order = list(range(count))
            order[i], order[k] = k, i
            orders.append(tuple(order))
    found = [Arrangement(o, s) for o in orders for s in itertools.product((1, -1), repeat=count)]
    return sorted(found, key=lambda arrangement: len(arrangement.changed))


def fitting(candidates: list[Arrangement], table: Likeness, least: float) -> np.ndarray:
    """Tell for each candidate whether every column may resemble its wheel; NaN says nothing.

    Args:
        candidates: arrangements of n wheels.
        table: columns against wheels.
        least: cosine that counts as resemblance.
    """
    orders = np.array([candidate.order for candidate in candidates])
    signs = np.array([candidate.signs for candidate in candidates])
    columns = np.arange(orders.shape[1])
    found = signs * table.cosines[columns, orders] + CERTAIN * table.errors[columns, orders]
    return ~np.any(found <= least, axis=1)


def likeness(arrangement: Arrangement, table: Likeness) -> float:
    """The least resemblance of a column to its wheel; NaN says nothing.

    Args:
        arrangement: of n wheels.
        table: columns against wheels.
    """
    cosines = table.cosines
    found = np.array(arrangement.signs) * cosines[np.arange(len(cosines)), list(arrangement.order)]
    return float(np.min(found, where=np.isfinite(found), initial=1.0))
