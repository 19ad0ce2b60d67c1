"""What of a long record is looked at: the stretches in which most happens, from all of its time.

A record is divided into equal spans; of each the stretch counts in which its channels change most,
and the livelier half of those is kept.  So rests go, and what changes over the hours stays.  Long
files are read that way without ever being held in memory; records in memory are cut that way where
a search would take too much.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from os import PathLike

import numpy as np

from ident.dead_reckoning import bridged, dead_reckoning, wheel_angles
from ident.diagnosis.settings import SETTINGS
from ident.doctor.finding import Finding
from ident.kinematics.ripple import with_phases_of
from ident.loaders.long_files import MOST_ROWS, SPANS, livelier, liveliness
from ident.log import CHANNELS, Log


def recorded(log: Log) -> float:
    """Time, s, that the samples of a log stand for; gaps do not count."""
    return len(log.time) * log.dt


def excerpt(log: Log, seconds: float) -> Log:
    """The liveliest stretches of a log, or the log itself where it holds no more than ``seconds``.

    Pose and wheel angles are integrated before it is cut, where the log tells none.
    """
    if recorded(log) <= seconds:
        return log
    known = log.held or bridged(log)
    if known:
        pose = dead_reckoning(log) if log.pose is None else log.pose
        log = replace(log, pose=pose, wheel_angle=wheel_angles(log))
    stretches = _stretches(log)
    signals = np.column_stack([log.velocity(), log.command])
    changes = np.array([signals[a:b].var(axis=0) for a, b in stretches])
    length = max(b - a for a, b in stretches) * log.dt
    spans = SPANS * max(1, int(seconds / length))
    middle = np.array([0.5 * (a + b) for a, b in stretches]) / len(log.time)
    span = np.minimum((middle * spans).astype(int), spans - 1)
    inside = [np.flatnonzero(span == number) for number in np.unique(span)]
    best = np.array([some[np.argmax(liveliness(changes[some]))] for some in inside])
    lengths = np.diff(np.array(stretches)[best], axis=1)[:, 0] * log.dt
    best = best[livelier(changes[best], lengths, seconds)]
    kept = _kept(log, [stretches[k] for k in best])
    what = f"{recorded(log):.0f} s are more than are looked at: {recorded(kept):.0f} s are used"
    remedy = f"{length:.3g} s each from all of the time, those in which most happens"
    finding = Finding("fixed", what, "file", remedy, "excerpt")
    return replace(kept, held=known, findings=(*log.findings, finding))


def load_excerpt(path: str | PathLike, *arguments, **options) -> Log:
    """``Log.load``, of a long file the liveliest stretches, as its findings say."""
    log = Log.load(path, *arguments, most_rows=MOST_ROWS, **options)
    return excerpt(log, SETTINGS.longest_seconds)


def excerpts(logs: Sequence[Log], tests: Sequence[Log]) -> tuple[list[Log], list[Log]]:
    """Logs to fit and logs to judge by, cut to ``most_seconds`` of diagnosis together.

    Short ones are kept whole; what they leave is shared by the others.
    """
    everything = [*logs, *tests]
    if sum(map(recorded, everything)) <= SETTINGS.most_seconds:
        return list(logs), list(tests)
    # Where encoders do not count angles they are found along all of a record.
    first = logs[0]
    aligned = [first, *(with_phases_of(first, log) for log in everything[1:])]
    left, kept = SETTINGS.most_seconds, {}
    for rank, k in enumerate(np.argsort([recorded(log) for log in aligned], kind="stable")):
        kept[int(k)] = excerpt(aligned[k], left / (len(aligned) - rank))
        left -= recorded(kept[int(k)])
    cut = [kept[k] for k in range(len(aligned))]
    return cut[: len(logs)], cut[len(logs) :]


def cut_told(before: Sequence[Log], after: Sequence[Log]) -> str:
    """Say of logs before and after a cut how much is used; empty where all of them is."""
    whole, used = (sum(map(recorded, logs)) for logs in (before, after))
    if used >= whole:
        return ""
    names = " + ".join(log.name for log in before)
    return f"; of the {whole:.0f} s of {names} the {used:.0f} s in which most happens were used"


def _stretches(log: Log) -> list[tuple[int, int]]:
    """First row of each stretch and the one after its last; a short piece is one of its own."""
    wanted, found = SETTINGS.excerpt_seconds / log.dt, []
    for start, stop in log.spans:
        edges = np.linspace(start, stop, max(1, int((stop - start) / wanted)) + 1).astype(int)
        found += list(zip(edges[:-1].tolist(), edges[1:].tolist(), strict=True))
    return found


def _kept(log: Log, chosen: list[tuple[int, int]]) -> Log:
    """Some stretches of a log, in order; those that follow each other stay together."""
    rows = np.concatenate([np.arange(a, b) for a, b in chosen])
    broken = np.zeros(len(log.time), bool)
    broken[list(log.starts)] = True
    follows = np.append(False, np.diff(rows) == 1) & ~broken[rows]
    values = {
        name: getattr(log, name)[rows]
        for name in ("time", *CHANNELS)
        if getattr(log, name) is not None
    }
    there = set(np.unique(log.run_of(values["time"])).tolist())
    runs = tuple(run for number, run in enumerate(log.runs) if number in there)
    return replace(log, **values, starts=tuple(np.flatnonzero(~follows).tolist()), runs=runs)
