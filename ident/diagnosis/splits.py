"""What windows of the logs are for: fitting, choosing between rivals, or the last word."""

from __future__ import annotations

from dataclasses import dataclass, field, replace

import numpy as np

from ident.diagnosis.judge import INERTIAL
from ident.diagnosis.settings import SETTINGS
from ident.free_run import cut_windows
from ident.log import Log
from ident.noise_floor import noise_floor
from ident.parameter_space import smooth_names
from ident.residuals import independent, output_weights, settled
from ident.sensitivity import Linearised, window_length
from youbot_env.effects.base import Effect
from youbot_env.model import Model

FIT, SELECT, VERIFY = 0, 1, 2


@dataclass(frozen=True, eq=False)
class Part:
    """A log and what each of its windows is for.

    Attributes:
        log: the record.
        role: (W,) FIT, SELECT or VERIFY.
        begin: (W,) time at which each window begins, s.
        weights: (m,) of the outputs.
        ends: lowest and highest values, by flat name, of what may move of its recording.
        fixed: values of the model that are not fitted, by flat name, alike for all logs.
    """

    log: Log
    role: np.ndarray
    begin: np.ndarray
    weights: np.ndarray
    ends: dict[str, tuple[float, float]] = field(default_factory=dict)
    fixed: tuple[str, ...] = ()

    def free(self, model: Model) -> tuple[str, ...]:
        """Values of a model that are fitted."""
        return tuple(name for name in smooth_names(model) if name not in self.fixed)

    @property
    def fitted(self) -> int:
        """How many independent windows, or whole runs, are fitted."""
        begin = self.begin[self.role == FIT]
        return int(independent(self.log, begin)[-1]) + 1 if len(begin) else 0

    @property
    def run(self) -> np.ndarray:
        """(W,) number of the run of the log that each window lies in."""
        return self.log.run_of(self.begin)

    def windows(self, role: int) -> np.ndarray:
        """(W,) whether each window has a role."""
        return self.role == role


def judges(part: Part, effect: Effect) -> bool:
    """Tell whether a log may judge an effect: what happens once need not happen in another one."""
    once = effect.needs_time and effect.scope() == "record"
    return not once or bool(part.windows(FIT).any())


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
        index = _rows(log, model)
        run = log.run_of(log.time[index[:, 0]])
        role = np.full(len(run), FIT)
        if not tests:
            kept = _numbered(log, run, index) % SETTINGS.kept_every
            role[kept == SETTINGS.kept_every - 1] = VERIFY
        parts.append(_part(log, role, index))
    for log in tests:
        index = _rows(log, model)
        count = len(index)
        role = np.full(count, VERIFY)
        if count >= SETTINGS.fewest_windows:
            early = log.time[index[:, 0]] < choosing_until(log)
            role[early if log.runs else np.arange(count) < round(SETTINGS.choosing * count)] = (
                SELECT
            )
        parts.append(_part(log, role, index))
    return parts


def _numbered(log: Log, run: np.ndarray, index: np.ndarray) -> np.ndarray:
    """(W,) numbers of what is kept out of the fit as a whole: runs, stretches, or windows.

    Windows of a stretch of a long record are more alike than those of two; where it has few, and
    ends in a window that overlaps, that one counts with the one before, whose role it gets.
    """
    if run[-1] >= SETTINGS.kept_every - 1 or not log.cut:
        return run if run[-1] >= SETTINGS.kept_every - 1 else np.arange(len(run))
    piece = np.searchsorted(log.starts, index[:, 0], side="right")
    number = np.unique(piece, return_inverse=True)[1]
    if number[-1] >= SETTINGS.kept_every - 1:
        return number
    return np.cumsum(np.append(True, index[1:, 0] > index[:-1, -1])) - 1


def _part(log: Log, role: np.ndarray, index: np.ndarray) -> Part:
    fixed = () if log.window is None else INERTIAL
    begin = log.time[index[:, 0]]
    return Part(log, _undivided(role, index), begin, output_weights(log), fixed=fixed)


def choosing_until(log: Log) -> float:
    """Time, s, at which the part of a second log for choosing ends, with a run if it can."""
    if log.runs:
        return log.runs[round(SETTINGS.choosing * len(log.runs))][1]
    return log.time[0] + SETTINGS.choosing * log.duration


def _rows(log: Log, model: Model) -> np.ndarray:
    """(W, L) rows of the windows of a log."""
    return cut_windows(log, model, window_length(log)).index


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
    weights = 1.0 / np.sqrt(_by_axis(parts, simulations, FIT))
    return [replace(part, weights=weights) for part in parts]


def by_axis(parts: list[Part], simulations: tuple[Linearised, ...]) -> list[Part]:
    """Weigh body velocities so that each axis counts by the share of its error that is no noise.

    An effect that halves the error of one axis gains alike then, however much of the other errors
    nothing explains: to first order it is judged by the geometric mean over the axes.  Records to
    choose by move otherwise than fitted ones and have weights of their own.
    """
    if any(part.log.body_velocity is None for part in parts):
        return parts
    weights = {}
    for role in (FIT, SELECT):
        if any(part.windows(role).any() for part in parts):
            error = _by_axis(parts, simulations, role)
            floors = [sum(noise_floor(s)) for p, s in zip(parts, simulations, strict=True)
                      if p.windows(role).any()]  # fmt: skip
            beyond = np.maximum(1.0 - np.mean(floors, axis=0) / error, SETTINGS.least_axis_share)
            weights[role] = np.sqrt(beyond / error)
    return [
        replace(part, weights=weights[FIT if part.windows(FIT).any() else max(weights)])
        for part in parts
    ]


def _by_axis(parts: list[Part], simulations: tuple[Linearised, ...], role: int) -> np.ndarray:
    """(m,) mean squared error of each output in the windows of a role."""
    fitted = [settled(s, s.residual)[p.windows(role)] for p, s in zip(parts, simulations,
              strict=True)]  # fmt: skip
    squared = np.concatenate([np.nan_to_num(e).reshape(-1, e.shape[-1]) for e in fitted]) ** 2
    return np.maximum(squared.mean(axis=0), 1e-12)
