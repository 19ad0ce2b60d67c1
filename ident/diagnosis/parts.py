"""What windows of the logs are for: fitting, choosing between rivals, or the last word."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ident.free_run import cut_windows
from ident.log import Log
from ident.scaled_fit import output_weights, settled
from ident.sensitivity import Linearised, window_length
from youbot_env.model import Model

FIT, SELECT, VERIFY = 0, 1, 2
# Of a second log this share, from its start, helps to choose; the rest is kept for the end.
CHOOSING = 0.6
# A second log with fewer windows than this is all kept for the end.
FEWEST = 8
# Where there is no second log, every so many windows of the first are kept for the end.
KEPT = 5


@dataclass(frozen=True, eq=False)
class Part:
    """A log and what each of its windows is for.

    Attributes:
        log: the record.
        role: (W,) FIT, SELECT or VERIFY.
        weights: (m,) of the outputs.
        ends: lowest and highest values, by flat name, of what may move of its recording.
    """

    log: Log
    role: np.ndarray
    weights: np.ndarray
    ends: dict[str, tuple[float, float]] = field(default_factory=dict)

    def windows(self, role: int) -> np.ndarray:
        """(W,) whether each window has a role."""
        return self.role == role


def divide(logs: list[Log], test: Log | None, model: Model) -> list[Part]:
    """Give every window its role.

    Args:
        logs: records to fit.
        test: record of the same robot in another motion; its last part is untouched until the end.
        model: any model of the platform.
    """
    parts = []
    for log in logs:
        role = np.full(_count(log, model), FIT)
        if test is None:
            role[KEPT - 1 :: KEPT] = VERIFY
        parts.append(Part(log, role, output_weights(log)))
    if test is not None:
        count = _count(test, model)
        role = np.full(count, VERIFY)
        if count >= FEWEST:
            role[: round(CHOOSING * count)] = SELECT
        parts.append(Part(test, role, output_weights(test)))
    return parts


def _count(log: Log, model: Model) -> int:
    return len(cut_windows(log, model, window_length(log)).index)


def weigh(parts: list[Part], simulations: tuple[Linearised, ...]) -> list[Part]:
    """Weigh body velocities by how well the base model explains each of them.

    Axes that no model of this kind explains would hide what happens on the others.  Wheels are one
    kind of sensor and keep their common weight.
    """
    if any(part.log.body_velocity is None for part in parts):
        return parts
    fitted = [settled(s, s.residual)[p.windows(FIT)] for p, s in zip(parts, simulations,
              strict=True)]  # fmt: skip
    squared = np.concatenate([np.nan_to_num(e).reshape(-1, e.shape[-1]) for e in fitted]) ** 2
    weights = 1.0 / np.sqrt(np.maximum(squared.mean(axis=0), 1e-12))
    return [replace(part, weights=weights) for part in parts]
