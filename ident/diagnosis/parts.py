"""What windows of the logs are for: fitting, choosing between rivals, or the last word."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ident.free_run import cut_windows
from ident.log import Log
from ident.scaled_fit import independent, output_weights, settled
from ident.sensitivity import Linearised, window_length
from youbot_env.model import Model

FIT, SELECT, VERIFY = 0, 1, 2
# Of a second log this share, from its start, helps to choose; the rest is kept for the end.
CHOOSING = 0.6
# A second log with fewer windows than this is all kept for the end.
FEWEST = 8
# Where there is no second log, every so many windows of the first are kept for the end; of so many
# runs or more, whole ones.
KEPT = 5


@dataclass(frozen=True, eq=False)
class Part:
    """A log and what each of its windows is for.

    Attributes:
        log: the record.
        role: (W,) FIT, SELECT or VERIFY.
        run: (W,) number of the run of the log that each window lies in.
        weights: (m,) of the outputs.
        ends: lowest and highest values, by flat name, of what may move of its recording.
    """

    log: Log
    role: np.ndarray
    run: np.ndarray
    weights: np.ndarray
    ends: dict[str, tuple[float, float]] = field(default_factory=dict)

    @property
    def fitted(self) -> int:
        """How many independent windows, or whole runs, are fitted."""
        run = self.run[self.role == FIT]
        return int(independent(run)[-1]) + 1 if len(run) else 0

    def windows(self, role: int) -> np.ndarray:
        """(W,) whether each window has a role."""
        return self.role == role


def divide(logs: list[Log], tests: list[Log], model: Model) -> list[Part]:
    """Give every window its role.

    Args:
        logs: records to fit.
        tests: records of the same robot in other motions; the last part of each is untouched until
            the end.
        model: any model of the platform.
    """
    parts = []
    for log in logs:
        index, run = _windows(log, model)
        role = np.full(len(run), FIT)
        if not tests:
            kept = run if run[-1] >= KEPT - 1 else np.arange(len(run))
            role[kept % KEPT == KEPT - 1] = VERIFY
        parts.append(Part(log, _undivided(role, index), run, output_weights(log)))
    for log in tests:
        index, run = _windows(log, model)
        role = np.full(len(run), VERIFY)
        if len(run) >= FEWEST:
            begins = log.time[index[:, 0]] < choosing_until(log)
            role[begins if log.runs else np.arange(len(run)) < round(CHOOSING * len(run))] = SELECT
        parts.append(Part(log, _undivided(role, index), run, output_weights(log)))
    return parts


def choosing_until(log: Log) -> float:
    """Time, s, at which the part of a second log for choosing ends, with a run if it can."""
    if log.runs:
        return log.runs[round(CHOOSING * len(log.runs))][1]
    return log.time[0] + CHOOSING * log.duration


def _windows(log: Log, model: Model) -> tuple[np.ndarray, np.ndarray]:
    """Rows (W, L) of the windows of a log, and the run (W,) that each lies in."""
    index = cut_windows(log, model, window_length(log)).index
    return index, log.run_of(log.time[index[:, 0]])


def _undivided(role: np.ndarray, index: np.ndarray) -> np.ndarray:
    """Roles in which a window that overlaps the one before it has the role of that one."""
    role = role.copy()
    for k in np.flatnonzero(index[1:, 0] <= index[:-1, -1]) + 1:
        role[k] = role[k - 1]
    return role


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
