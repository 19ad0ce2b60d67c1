"""How logs came to be recorded: what a row stands for, and whose clock is late.

Hardly any robot holds its torque from row to row, yet a simulation has to hold something.  What
counts is the lead: the time by which the drive's rows act ahead of being held from their own time
on.  Held rows have none, sampled rows half a row, means over the time before a whole row; a late
clock or a filter adds to it.  The lead is estimated with the robot's parameters, by output error;
which of its causes it has is told by where it lies, since they do the same to a robot.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ident.drive_clock import leads
from ident.instruments import HOLD, OFFSET, SHIFT, lead_of, stating, with_instruments
from ident.log import Log
from ident.recording_words import CLOSE, SURE, Instrument, clock, declared
from ident.velocity_sensors import witnessed
from youbot_env.measurement import HOLDS, SAMPLED
from youbot_env.model import Model

# Share of what was known beforehand to which the error of a known clock has come down.
KNOWN = 0.25
# Least standard deviation of what is known of a lead beforehand, s.
LEAST_SPREAD = 0.01


@dataclass(frozen=True, eq=False)
class Recording:
    """A log with what was found of its recording.

    Attributes:
        original: the log as it was read.
        log: states hold and clock; laws and fits then see its robot.
        lead: time by which its rows act ahead of held ones, s.
        error: standard error of that; zero where it was declared.
        witnessed: what other instruments of the log say about those of its velocities.
    """

    original: Log
    log: Log
    lead: float
    error: float
    witnessed: tuple[Instrument, ...] = ()

    @property
    def instruments(self) -> tuple[Instrument, ...]:
        """The same for people and programs."""
        return (*clock(self.original, self.lead, self.error), *self.others)

    @property
    def others(self) -> tuple[Instrument, ...]:
        """What is known beyond hold and clock of the drive."""
        return (*declared(self.original), *self.witnessed)

    @property
    def known(self) -> bool:
        """Whether the clock is known well enough not to be taken for a late robot."""
        return self.error <= KNOWN * max(self.original.dt, LEAST_SPREAD)

    def moved_from(self, other: Recording) -> bool:
        """Whether the clock is known now and another than it was."""
        return self.known and abs(self.lead - other.lead) > CLOSE

    def moved(self) -> Log:
        """The log as it would be with a lead one standard error larger."""
        return stating(self.log, OFFSET, d=self.log.recording[OFFSET]["d"] + self.error)


def find_recordings(logs: list[Log], model: Model, signed: bool = True) -> list[Recording]:
    """Estimate what every log needs of the measurement model.

    Args:
        logs: records of one robot, with a drive input.
        model: start values of the robot, and effects that are known.
        signed: whether a robot that answers late is put down to the clock.  Where it is not, rows
            are taken to be sampled on the clock of the velocities there, and what is late is left
            to be explained.
    """
    if all(HOLD in log.recording and OFFSET in log.recording for log in logs):
        return [_recording(log, 0.0, 0.0, signed) for log in logs]
    told = [witnessed(log) for log in logs]
    seen = [log for log, _ in told]
    return [
        replace(_recording(log, *found, signed), original=original, witnessed=said)
        for original, log, (_, said), found in zip(
            logs, seen, told, leads(seen, model), strict=True
        )
    ]


def with_free_clocks(
    records: list[Recording], model: Model
) -> tuple[list[Log], Model, list[dict[str, tuple[float, float]]]]:
    """Logs whose clocks are to be fitted with the robot, from what was found of them.

    Returns:
        The logs; the model with the clock of the first; and for each log between which values its
        clock may move: where it was found, give or take its error.
    """
    logs, ends = [], []
    for record in records:
        stated, end = dict(record.log.recording), {}
        if record.error:
            found = stated.pop(OFFSET)["d"]
            half = max(CLOSE, SURE * record.error)
            end[SHIFT] = found - half, found + half
        logs.append(replace(record.log, recording=stated))
        ends.append(end)
    model = with_instruments(model, logs)
    first = records[0].log.recording
    return logs, model.with_effects({name: first[name] for name in (HOLD, OFFSET)}), ends


def _recording(log: Log, ahead: float, error: float, signed: bool) -> Recording:
    """What a fit to (means of) a log says of the log itself."""
    kind = log.recording.get(HOLD, {}).get("kind")
    hold = SAMPLED if kind is None else HOLDS[round(kind)]
    if OFFSET in log.recording:
        ahead, error = log.recording[OFFSET]["d"] + lead_of(hold, log.dt), 0.0
    else:
        # Known beforehand: rows act about half a row ahead, give or take a row, or as the hold that
        # was declared; unless they certainly do not.
        before = 0.5 * log.dt if kind is None else lead_of(hold, log.dt)
        spread = max(log.dt, LEAST_SPREAD)
        if abs(ahead - before) < spread + SURE * error:
            ahead = (ahead * spread**2 + before * error**2) / (spread**2 + error**2)
            error = error * spread / float(np.hypot(spread, error))
        earliest = 0.0 if kind is None else before
        if not signed:
            # Where the robot is late, or might as well be, rows count as what they usually are.
            late = earliest - ahead > max(CLOSE, SURE * error)
            ahead = before if late or error > 0.5 * spread else max(ahead, earliest)
            if late:  # whose fault that is nobody knows, nor then what a row stands for
                error = max(error, 0.5 * before)
    said = clock(log, ahead, error)
    hold = float(HOLDS.index(said[0].value))
    told = stating(stating(log, HOLD, kind=hold), OFFSET, d=float(said[1].value))
    return Recording(log, told, ahead, error)
