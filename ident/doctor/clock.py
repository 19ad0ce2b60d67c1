"""Time stamps: unit, order, repetition, gaps, jitter."""

from __future__ import annotations

import numpy as np

from ident.doctor.record import Record

FASTEST, SLOWEST = 5e-4, 0.5  # s, what a sample time of a wheel log can be
UNITS = {"ms": 1e-3, "us": 1e-6, "ns": 1e-9}
UNCLEAR, AN_HOUR = 2.0, 3600.0  # s
GAP = 4.5  # median sample times: more is a gap
FEW = 0.01  # fraction of time stamps that may be wrong


def check_clock(record: Record) -> None:
    """Bring time to seconds, strictly rising; split the log at gaps."""
    missing = ~np.isfinite(record.time)
    if missing.any():
        where = record.place(int(np.flatnonzero(missing)[0]), None)
        what = f"{int(missing.sum())} rows have no time"
        if missing.sum() > FEW * len(missing) and record.refuse(
            "clock", what, where, "record again"
        ):
            return
        record.drop(missing, split=False)
        record.fixed("clock", what, where, "rows left out")
    if len(record.time) < 2:
        record.refuse(
            "clock", f"{len(record.time)} samples", "file", "record at least 2 s", final=True
        )
        return
    _unit(record)
    _order(record)
    if any(finding.severity == "error" for finding in record.findings):
        return
    _gaps(record)


def _unit(record: Record) -> None:
    steps = np.abs(np.diff(record.time))
    steps = steps[steps > 0]
    if not len(steps):
        record.refuse(
            "clock",
            "time stands still",
            record.place(1),
            "record the time of each sample, s",
            final=True,
        )
        return
    step = float(np.median(steps))
    if FASTEST <= step <= SLOWEST:
        return
    fits = [unit for unit, scale in UNITS.items() if FASTEST <= step * scale <= SLOWEST]
    # Steps of 1 could be a slow log in s as well as a fast one in ms; a long one is in ms.
    unclear = step < UNCLEAR and step * len(record.time) < AN_HOUR
    if step < FASTEST or not fits or unclear:
        record.refuse(
            "clock",
            f"the median time step is {step:.6g}; as seconds that is {1 / step:.6g} samples a "
            "second",
            "column time",
            f"give time in s with steps of {FASTEST} to {SLOWEST} s, or its unit: time [ms]",
        )
        return
    record.time = (record.time - record.time[0]) * UNITS[fits[0]]
    record.fixed(
        "clock", f"the median time step is {step:.6g}: {fits[0]}", "column time", "turned into s"
    )


def _order(record: Record) -> None:
    steps = np.diff(record.time)
    repeated, back = steps == 0, steps < 0
    if back.any():
        row = int(np.flatnonzero(back)[0]) + 1
        where = f"{record.place(row)}, column time"
        what = f"time runs back from {record.time[row - 1]:.9g} to {record.time[row]:.9g} s"
        what += f" ({int(back.sum())} times)"
        order = np.argsort(record.time, kind="stable")
        sorted_steps = np.diff(record.time[order])
        typical = np.median(sorted_steps)
        if np.all((sorted_steps > 0.3 * typical) & (sorted_steps < 1.7 * typical)):
            record.reorder(order)
            record.fixed("clock", what, where, "rows are out of order; sorted by time")
            return
        outside = _outside(record.time)
        if outside.sum() <= max(1, FEW * len(steps)):
            record.drop(outside, split=False)
            record.fixed(
                "clock", what, where, f"{int(outside.sum())} rows with wrong times left out"
            )
            repeated = np.diff(record.time) == 0
        elif record.refuse("clock", what, where, "split the file there, or repair the time stamps"):
            return
        else:
            record.drop(outside, split=True)
            repeated = np.diff(record.time) == 0
    if repeated.any():
        row = int(np.flatnonzero(repeated)[0]) + 1
        what = f"time {record.time[row]:.9g} s stands there again ({int(repeated.sum())} times)"
        where = f"{record.place(row)}, column time"
        if repeated.mean() > 0.1 and record.refuse(
            "clock", what, where, "record time with more digits, or one row per time"
        ):
            return
        record.drop(np.concatenate([[False], repeated]), split=False)
        record.fixed("clock", what, where, "repeated rows left out")


def _outside(time: np.ndarray) -> np.ndarray:
    """Fewest samples without which time rises: all but a longest rising subsequence."""
    from bisect import bisect_left

    tails, owners, before = [], [], np.full(len(time), -1)
    for row, value in enumerate(time.tolist()):
        at = bisect_left(tails, value)
        before[row] = owners[at - 1] if at else -1
        if at == len(tails):
            tails.append(value)
            owners.append(row)
        else:
            tails[at], owners[at] = value, row
    outside, row = np.ones(len(time), bool), owners[-1]
    while row >= 0:
        outside[row] = False
        row = before[row]
    return outside


def _gaps(record: Record) -> None:
    steps = np.diff(record.time)
    typical = record.dt
    gaps = np.flatnonzero(steps > GAP * typical)
    told = [row for row in gaps if not record.breaks[row + 1]]
    record.breaks[gaps + 1] = True
    if told:
        longest = max(told, key=lambda row: steps[row])
        record.fixed(
            "clock",
            f"{len(told)} gaps in time, the longest {steps[longest]:.4g} s",
            f"{record.place(longest + 1)}, column time",
            "the log is split there",
        )
    inside = steps[steps <= GAP * typical]
    spread = float(np.std(inside)) / typical
    if spread > 0.25:
        record.warn(
            "clock",
            f"time steps vary by {spread:.0%} of {typical:.4g} s (rms)",
            "column time",
            "used as they are; record at a steady rate where you can",
        )
