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

from ident.doctor.odometry import body_against, pose_against_wheels
from ident.drive_clock import leads
from ident.instruments import FILTER, HOLD, OFFSET, SHIFT, lead_of, stating, with_instruments
from ident.log import Log
from ident.recording_words import CLOSE, SURE, WIDE, Instrument, clock, declared, plain
from youbot_env.effects import get_effect
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


# Wheel speeds that come later than the pose by this much, s, and by so many standard errors, are
# late: simulated robots with rollers and creep stay below a third of it.
LATE, CERTAIN = 2e-3, 4.0
# Angles, rad, places, m, and biases, rad/s, of a body-velocity sensor that are worth a word.
NOTICED = {"angle": 5e-3, "px": 5e-3, "py": 5e-3, "b": 1e-3}


def witnessed(log: Log) -> tuple[Log, tuple[Instrument, ...]]:
    """The log with what its pose says about the lateness of its wheel speeds stated.

    A pose shows what has happened and is never early: against it speeds can only be too late.
    Where the pose is late itself nothing is said.
    """
    if log.body_velocity is not None:
        return _body_sensor(log)
    shown = log.pose is not None and log.wheel_velocity is not None
    if not shown or FILTER in log.recording:
        return log, ()
    seen = pose_against_wheels(log)
    if seen is None or not seen.shift.known or seen.shift.se > LATE:
        return log, ()
    late, half = -seen.shift.value, WIDE * seen.shift.se
    if late < -LATE:
        return log, ()
    if late < max(LATE, CERTAIN * seen.shift.se):
        return stating(log, FILTER, T=0.0), ()
    words = (
        f"wheel speeds come {1e3 * late:.3g} ms +- {1e3 * half:.2g} ms later than the pose: a "
        "filter with that time constant, or means over twice that time"
    )
    said = Instrument(
        FILTER, "T", late, "s", (late - half, late + half), "estimated", log.name, words
    )
    return stating(log, FILTER, T=late), (said,)


def _body_sensor(log: Log) -> tuple[Log, tuple[Instrument, ...]]:
    """The log with mounting and bias of its body-velocity sensor, as its wheels or pose show them.

    Kinematics show them whatever forces act; what they leave open diagnosis looks for.
    """
    # Rollers and slip stand between the wheels and the motion, nothing between it and a pose.
    source = "wheels" if log.pose is None else "pose"
    if source == "wheels" and log.wheel_velocity is None:
        return log, ()
    seen = body_against(log, source)
    if seen is None:
        return log, ()
    # Of the wheels against the sensor, and of the sensor against the pose, signs are opposite.
    sign = -1.0 if source == "wheels" else 1.0
    values = {
        ("sensor_mounting", "angle"): (seen.angle, sign),
        ("sensor_mounting", "px"): (seen.lever_x, -sign),
        ("sensor_mounting", "py"): (seen.lever_y, -sign),
        ("gyro_bias", "b"): (seen.bias, -sign),
    }
    told, declared_before = [], set(log.recording)
    for (name, flat), (estimate, turn) in values.items():
        effect = get_effect(name)
        if name in declared_before:
            continue
        least = NOTICED[flat]
        if not estimate.known or abs(estimate.value) < max(least, CERTAIN * estimate.se):
            continue
        stated = log.recording.get(name, {p.name: 0.0 for p in effect.parameters})
        log = stating(log, name, **{**stated, flat: turn * estimate.value})
        told.append(plain(log, effect, flat, turn * estimate.value, estimate.se))
    return log, tuple(told)
