"""Many short logs as one record: a data set whose pieces nobody knows the order of.

A lab has hundreds of runs of some seconds each.  One by one they decide nothing, and numbers of
their own for floor, load, battery and clock would outnumber what they show.  Joined they are one
record with as many contiguous pieces: these numbers are one for all, the cost grows with the
samples, and whole runs can be kept out of a fit.
"""

from __future__ import annotations

import hashlib
from collections.abc import Sequence
from dataclasses import replace
from os import PathLike

import numpy as np

from ident.log import CHANNELS, Log
from youbot_env.arguments import check_kind, several

# Logs of at least this length, s, are records of their own, unless there are more than so many:
# parameters of every record would make the cost grow with the square of their number.
OWN, MOST = 20.0, 4
# Sample times of one record differ by at most this share.
ALIKE = 0.2
# Time between two runs, s, which nobody knows: longer than any gap that is bridged.
APART = 10.0
# From so many runs on these, not their windows, are what is independent: a run of one speed in one
# direction is wrong by the same in all of its windows.
MANY_RUNS = 20


def as_list(logs: Log | str | PathLike | Sequence[Log | str | PathLike] | None) -> list[Log]:
    """Logs as a list: none, one or several; what is not a log is the file of one.

    Of files that are very long the liveliest stretches are read, see ``ident.excerpt``.

    Raises:
        TypeError: neither logs nor files.
        ValueError, OSError: a file that cannot be read as a log.
    """
    if logs is None:
        return []
    return [_read(one) for one in several(logs, Log, str, PathLike)]


def _read(log: Log | str | PathLike) -> Log:
    if isinstance(log, Log):
        return log
    check_kind("log", log, (str, PathLike), "a Log, or the file of one")
    from ident.excerpt import load_excerpt  # which needs what needs this module

    return load_excerpt(log)


def pooled(logs: Sequence[Log]) -> list[Log]:
    """Logs in which short ones of one kind are joined; the order is that of the first of each.

    Of one kind are logs with the same drive, channels and statements about their recording, and
    nearly the same sample time.
    """
    if len(logs) < 2 or (len(logs) <= MOST and all(log.duration >= OWN for log in logs)):
        return list(logs)
    many, groups = len(logs) > MOST, []
    for log in logs:
        alone = log.duration >= OWN and not many
        group = next((g for g in groups if not alone and _alike(g[0], log)), None)
        if group is None:
            groups.append([log])
        else:
            group.append(log)
    return [joined(group) for group in groups]


def as_one(logs: Sequence[Log]) -> Log:
    """All logs as one.

    Raises:
        ValueError: they are not of one kind.
    """
    for log in logs[1:]:
        if not _alike(logs[0], log):
            raise ValueError(
                f"logs {logs[0].name!r} ({1 / logs[0].dt:.3g} Hz) and {log.name!r} "
                f"({1 / log.dt:.3g} Hz) differ in rate, channels, drive or stated recording; "
                "compare each by itself"
            )
    return joined(logs)


def _alike(one: Log, other: Log) -> bool:
    shown = [[getattr(log, c) is not None for c in CHANNELS] for log in (one, other)]
    return (
        one.platform == other.platform
        and shown[0] == shown[1]
        and one.recording == other.recording
        and abs(one.dt - other.dt) <= ALIKE * min(one.dt, other.dt)
    )


def joined(logs: Sequence[Log]) -> Log:
    """One log of which every log is a piece, with time running on from one to the next.

    Its name is that of the first with the number of the others; findings say whose they are.
    """
    if len(logs) == 1:
        return logs[0]
    times, starts, runs, begin, rows = [], [], [], 0.0, 0
    for log in logs:
        times.append(log.time - log.time[0] + begin)
        starts += [start + rows for start in log.starts]
        runs.append((log.name, begin))
        begin = float(times[-1][-1]) + APART
        rows += len(log.time)
    values = {
        channel: np.concatenate([getattr(log, channel) for log in logs])
        for channel in CHANNELS
        if getattr(logs[0], channel) is not None and channel != "wheel_angle"
    }
    findings = tuple(
        replace(finding, where=f"{log.name}, {finding.where}")
        for log in logs
        for finding in log.findings
    )
    digest = hashlib.sha256("".join(log.digest for log in logs).encode()).hexdigest()
    first = logs[0]
    return replace(
        first,
        **values,
        time=np.concatenate(times),
        wheel_angle=None,
        starts=tuple(starts),
        runs=tuple(runs),
        name=f"{first.name} and {len(logs) - 1} more",
        findings=findings,
        accepted=tuple(dict.fromkeys(name for log in logs for name in log.accepted)),
        digest=digest,
        source=f"{first.source} and {len(logs) - 1} more",
    )
