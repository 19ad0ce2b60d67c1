"""Frozen records: a noisy sensor that shows the same digits over many rows is no longer read.

Noise makes an exact repetition rare and a long one impossible, so no motion is needed to see it.
A record without noise may well repeat itself, at rest or in steady motion: there only a jump of the
wheel speeds at the end, which no moving mass makes, tells that it was frozen.
"""

from __future__ import annotations

import numpy as np

from ident.doctor.finding import Finding
from ident.doctor.record import Record, runs

CHANNELS = ("wheel_velocity", "wheel_torque")
FEWEST = 5  # rows with the same digits in all channels of the wheels
FEWEST_ALONE = 8  # in one channel: shorter ones may be how the log began, or a filter that fills
LONGER = 3.0  # times the length of the longest ordinary repetitions (95 % are shorter)
RARE = 0.05  # share of rows that repeat ordinarily in a channel that shows its noise
NOISY = 0.3  # share of steps that go back: 2/3 for white noise, 0 for a smooth signal
TRAVELLED = 0.05  # m or rad, by which the pose moves while wheels stand: no noise, no creeping
JUMP = 5.0  # times the largest of ordinary steps (99 % are smaller)
MOST = 0.5  # of a log that may be cut out
SOME = 0.2  # of the rows that may be written again; more are a sensor slower than the log


def check_frozen(record: Record) -> None:
    """Cut out stretches in which noisy channels repeat themselves."""
    present = [c for c in CHANNELS if c in record.channels]
    if not present or len(record.time) < 100:
        return
    told: list[Finding] = []
    same, joined = {}, np.ones(len(record.time), bool)
    for channel in present:
        values = record.channels[channel]
        same[channel] = np.zeros(values.shape, bool)
        same[channel][1:] = (values[1:] == values[:-1]) & ~record.breaks[1:, None]
        joined &= same[channel].all(axis=1)
    cut = _frozen(record, joined, present, together=True, fewest=FEWEST)
    _repeated(record, joined & ~_beside(cut), present, same)
    told += _told(record, cut, "all wheel channels", record.name(present[0]))
    if len(present) > 1:
        for channel in present:
            alike = same[channel].all(axis=1) & ~_beside(cut)
            found = _frozen(record, alike, [channel], together=True)
            told += _told(record, found, f"all columns of {channel}", record.name(channel))
            cut |= found
    for channel in present:
        for column in range(same[channel].shape[1]):
            alike = same[channel][:, column] & ~_beside(cut)
            found = _frozen(record, alike, [channel], together=False, column=column)
            told += _told(record, found, "the values", record.name(channel, [column]))
            cut |= found
    if cut.mean() > MOST:
        record.refuse(
            "frozen_rows", f"frozen in {cut.mean():.0%} of the log", "file", "record again"
        )
    elif cut.any():
        record.findings += told
        record.drop(cut, split=True)


def _repeated(
    record: Record, joined: np.ndarray, present: list[str], same: dict[str, np.ndarray]
) -> None:
    """Replace single rows that repeat the row before in all noisy channels at once."""
    noisy = [
        _noisy(record.channels[c][:, k], joined) for c in present for k in range(same[c].shape[1])
    ]
    count = int(joined.sum())
    if np.mean(noisy) < MOST or not 0 < count < SOME * len(joined):
        return
    stretches = [(b, e) for b, e in runs(joined) if e < len(joined) and not record.breaks[e]]
    for begin, end in stretches:
        around = [begin - 1, end]
        for channel in present:
            values = record.channels[channel]
            for column in range(values.shape[1]):
                values[begin:end, column] = np.interp(
                    record.time[begin:end], record.time[around], values[around, column]
                )
    record.derived.clear()
    if stretches:
        record.fixed(
            "frozen_rows",
            f"{count} rows ({count / len(joined):.1%}) repeat the one before in all wheels: "
            "written again without a new reading",
            f"{record.name(present[0])}, {record.unit_of_place} {record.lines[stretches[0][0]]} "
            "first",
            "replaced by a line between their neighbours",
        )


def _beside(rows: np.ndarray) -> np.ndarray:
    """(N,) rows that are flagged or follow one that is."""
    return rows | np.concatenate([[False], rows[:-1]])


def _told(record: Record, rows: np.ndarray, what: str, where: str) -> list[Finding]:
    stretches = runs(rows)
    if not stretches:
        return []
    begin, end = max(stretches, key=lambda run: run[1] - run[0])
    seconds = record.time[end - 1] - record.time[begin]
    what = (
        f"{what} repeat the same digits for {seconds:.3g} s ({len(stretches)} such stretches, "
        f"{rows.mean():.1%} of the rows): frozen"
    )
    where = f"{where}, {record.unit_of_place} {record.lines[begin]}"
    return [Finding("fixed", what, where, "cut out; the log is split there", "frozen_rows")]


def _frozen(
    record: Record,
    same: np.ndarray,
    channels: list[str],
    together: bool,
    column: int = 0,
    fewest: int = FEWEST_ALONE,
) -> np.ndarray:
    """(N,) rows of the repetitions that are no measurement.

    Args:
        record: the log.
        same: (N,) rows that repeat the row before.
        channels: whose columns repeat.
        together: all columns of the channels; else ``column`` of the only one.
        column: the one that repeats.
        fewest: rows that count.
    """
    frozen = np.zeros(len(same), bool)
    repeats = runs(same)
    if not repeats:
        return frozen
    # How long one reading stands ordinarily, most readings for one row.
    lengths = np.array([end - begin + 1 for begin, end in repeats])
    single = int(len(same) - same.sum()) - len(repeats)
    ordinary = np.percentile(np.concatenate([lengths, np.ones(max(single, 0))]), 95)
    least = max(fewest, LONGER * ordinary)
    long = [(b - 1, e) for (b, e), n in zip(repeats, lengths, strict=True) if n >= least]
    if not long:
        return frozen
    inside = np.zeros(len(same), bool)
    for begin, end in long:
        inside[begin:end] = True
    columns = [
        record.channels[c][:, k]
        for c in channels
        for k in (range(record.channels[c].shape[1]) if together else [column])
    ]
    noisy = any(_noisy(values, inside) for values in columns)
    speeds = columns if channels[0] == "wheel_velocity" else []
    for begin, end in long:
        shown = [values[begin] for values in columns]
        if not together and (shown[0] == 0 or shown[0] in (columns[0].min(), columns[0].max())):
            continue  # a dead zone or a limit, which are looked at elsewhere
        jumps = together and any(_jumps(values, inside, end) for values in speeds)
        # Zeros all over are a robot that stands, unless its pose goes on.
        travels = bool(together and speeds) and _travels(record, begin, end)
        if travels or (any(shown) and (jumps or noisy)):
            frozen[begin:end] = True
    return frozen


def _noisy(values: np.ndarray, inside: np.ndarray) -> bool:
    """Whether a column shows its noise, so that it repeats by chance only."""
    step = np.diff(values)[~(inside[1:] | inside[:-1])]
    if len(step) < 20 or np.mean(step == 0) > RARE:
        return False
    return bool(np.mean(step[1:] * step[:-1] < 0) > NOISY)


def _jumps(values: np.ndarray, inside: np.ndarray, end: int) -> bool:
    """Whether a speed jumps where the repetition ends."""
    if end >= len(values):
        return False
    step = np.abs(np.diff(values))
    ordinary = step[~(inside[1:] | inside[:-1])]
    ordinary = ordinary[ordinary > 0]
    return len(ordinary) > 20 and step[end - 1] > JUMP * np.percentile(ordinary, 99)


def _travels(record: Record, begin: int, end: int) -> bool:
    """Whether the pose moves on while all wheels show zero."""
    pose = record.get("pose")
    if pose is None or np.any(record.channels["wheel_velocity"][begin]):
        return False
    return bool(np.abs(pose[end - 1] - pose[begin]).max() > TRAVELLED)
