"""Which method of estimation predicts better: asked of what is kept out of the fit, in turn.

Regression minimises what the equations leave and a free run what a simulation does.  Where a model
is right they agree.  Where much is missing, as on robots that only state their voltage, either may
be far better, and the fit itself does not tell which.
"""

from __future__ import annotations

import itertools
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from ident.free_run import free_run
from ident.log import Log
from ident.pooling import joined
from ident.recording import Recording
from youbot_env.model import Model

# Parts that are kept out in turn: whole runs, or blocks of time where there are fewer runs.
PARTS = 4
# Of a real log least squares left 51.0 % of what was kept out and a free run 50.4 %; on other logs
# the first was better then.  A gain of less than this share chooses nothing.
CLEAR = 0.05


@dataclass(frozen=True)
class MethodChoice:
    """How well methods predict what they were not fitted to.

    Attributes:
        errors: free-run error over all that was kept out, as a share of the motion's rms, by
            method, the usual one first; infinite where a simulation runs away or nothing fits.
        parts: what was kept out in turn, in words.
    """

    errors: dict[str, float]
    parts: str

    @property
    def best(self) -> str:
        """The method with the least error; the usual one where none is clearly better."""
        usual, least = next(iter(self.errors)), min(self.errors, key=self.errors.get)
        return least if self.errors[least] < (1.0 - CLEAR) * self.errors[usual] else usual

    def __str__(self) -> str:
        shown = (
            f"{name} {100 * error:.3g} %" if np.isfinite(error) else f"{name} without bound"
            for name, error in self.errors.items()
        )
        return f"{self.best}, free-run error on {self.parts} kept out in turn: {', '.join(shown)}"


def choose_method(
    records: Sequence[Recording], methods: dict[str, Callable[[list[Recording]], Model]]
) -> MethodChoice:
    """Fit all but a part by every method, simulate that part, and so on with the others.

    Args:
        records: logs with their recording.
        methods: by name, what makes a model of records; a ``ValueError`` of it counts as a model
            that predicts nothing.
    """
    units, kind = _units([record.log for record in records])
    spread = np.concatenate([record.log.velocity() for record in records]).std(axis=0)
    squares, count = dict.fromkeys(methods, 0.0), 0
    for number in range(PARTS):
        kept = [[log for k, log in mine if k % PARTS != number] for mine in units]
        out = [log for mine in units for k, log in mine if k % PARTS == number]
        train = [
            replace(record, log=joined(logs), error=0.0)
            for record, logs in zip(records, kept, strict=True)
            if logs
        ]
        for name, fitted in methods.items():
            try:
                model = fitted(train)
                runs = [free_run(log, model) for log in out]
            except ValueError:
                squares[name] = np.inf
                continue
            for run in runs:
                share = float(np.mean((run.rmse / spread) ** 2))
                squares[name] += len(run.time) * (share if np.isfinite(share) else np.inf)
        count += sum(len(log.time) for log in out)
    errors = {name: float(np.sqrt(total / max(count, 1))) for name, total in squares.items()}
    return MethodChoice(errors, f"{PARTS} {kind}")


def _units(logs: list[Log]) -> tuple[list[list[tuple[int, Log]]], str]:
    """Parts of every log that stay whole, numbered through all of them, and what they are."""
    ends = [[*(begin for _, begin in log.runs), np.inf] if log.runs else [-np.inf, np.inf]
            for log in logs]  # fmt: skip
    kind = "groups of whole runs"
    if sum(len(end) - 1 for end in ends) < PARTS:
        kind = "blocks of time"
        ends = [list(np.linspace(log.time[0], log.time[-1] + log.dt, PARTS + 1)) for log in logs]
    units, number = [], 0
    for log, end in zip(logs, ends, strict=True):
        mine = []
        for begin, until in itertools.pairwise(end):
            mine.append((number, log.part(begin, until)))
            number += 1
        units.append(mine)
    return units, kind
