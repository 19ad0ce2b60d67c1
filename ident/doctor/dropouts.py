"""Failed reads: single rows or bursts in which a channel shows one and the same wrong number.

A driver whose read fails writes 0 (or -1, or 999).  What gives it away is that a signal of the
wheels jumps there and back, far from its neighbours, to exactly the same number again and again.
A robot that stands shows zeros as well, but comes to them and leaves them gradually.
"""

from __future__ import annotations

import numpy as np

from ident.doctor.cells import MOST_MISSING
from ident.doctor.record import Record, runs
from ident.doctor.resolution import resolution
from ident.doctor.spikes import MOST, WIDEST

CHANNELS = ("wheel_velocity", "wheel_torque", "wheel_voltage")
LONGEST = 1.0  # s: a longer stretch at one number is a sensor that stands still
# A straight line over g seconds misses (w g)^2 / 8 of a motion of w rad/s: 4 % at 5 rad/s over
# 0.11 s, which in a twentieth of the rows is no 0.2 % of anything.
BRIDGED = 0.11  # s between the good rows on either side that may be interpolated
FEWEST = 3  # jumps to a number and back that show that it is no measurement
FAR = 3.0  # times the largest of ordinary steps (99 % are smaller) that both jumps exceed
TOGETHER = 0.5  # of the wheels that jump, where all show 0 in the same row
SHARED = 0.5  # of the failed reads of others, from which a column fails with them
MOST_VALUES = 20  # numbers that stand in a column most often: only these are looked at


def check_dropouts(record: Record) -> None:
    """Replace short failed reads of wheel channels, cut out longer ones."""
    if len(record.time) < 20:
        return
    pieces, cut = np.cumsum(record.breaks), np.zeros(len(record.time), bool)
    for channel in CHANNELS:
        if channel not in record.channels:
            continue
        values = record.channels[channel].copy()
        told: dict[tuple, list[int]] = {}
        for value, column, failed in _together(values, pieces, record.dt):
            told.setdefault((value, failed.tobytes()), []).append(column)
        for (value, packed), columns in told.items():
            failed = np.frombuffer(packed, bool)
            cut |= _mend(record, channel, columns, value, failed, values, pieces)
        if told:
            record.set(channel, values)
    if cut.any():
        record.drop(cut, split=True)


def _together(values: np.ndarray, pieces: np.ndarray, dt: float):
    """Failed reads of all columns of a channel: (value, column, (N,) rows) each.

    What one column shows to be a failed read is one of the others too, where they show the same.
    """
    found = {
        (value, column): failed
        for column in range(values.shape[1])
        for value, failed in _failed(values[:, column], pieces, dt)
    }
    for value in {value for value, _ in found}:
        union = np.any([rows for (v, _), rows in found.items() if v == value], axis=0)
        for column in range(values.shape[1]):
            shared = union & (values[:, column] == value)
            own = found.get((value, column), np.zeros(len(shared), bool))
            if (value, column) in found or shared.mean() > SHARED * union.mean():
                found[value, column] = own | shared
    if not any(value == 0 for value, _ in found):
        failed = _all_zero(values, pieces, dt)
        found |= {(0.0, column): failed for column in range(values.shape[1]) if failed.any()}
    return [(value, column, failed) for (value, column), failed in _by_column(found)]


def _all_zero(values: np.ndarray, pieces: np.ndarray, dt: float) -> np.ndarray:
    """(N,) rows in which all wheels jump to exactly 0 together, and back: once is enough."""
    failed = np.zeros(len(values), bool)
    steps = np.abs(np.diff(values, axis=0))
    ordinary = FAR * np.percentile(steps, 99, axis=0)
    longest = max(1, round(LONGEST / dt))
    for begin, end in runs(np.all(values == 0, axis=1)):
        heights = [_jump(own, pieces, begin, end) for own in values.T]
        jumped = np.sum(heights > np.maximum(ordinary, 0))
        if end - begin <= longest and ordinary.all() and jumped >= TOGETHER * values.shape[1]:
            failed[begin:end] = True
    return failed


def _by_column(found: dict) -> list:
    """Items of ``{(value, column): rows}`` in the order of the columns."""
    return sorted(found.items(), key=lambda item: (item[0][1], item[0][0]))


def _failed(own: np.ndarray, pieces: np.ndarray, dt: float) -> list[tuple[float, np.ndarray]]:
    """Numbers that stand for failed reads in a column, and the (N,) rows of each.

    Args:
        own: (N,) one channel of one wheel.
        pieces: (N,) number of the contiguous piece of each row.
        dt: sample time, s.
    """
    numbers, counts = np.unique(own, return_counts=True)
    often = np.argsort(counts)[::-1][:MOST_VALUES]
    often = often[counts[often] >= FEWEST]
    steps, grain = np.abs(np.diff(own)), resolution(own)
    found, longest = [], max(1, round(LONGEST / dt))
    for k in often:
        value, there = float(numbers[k]), own == numbers[k]
        ordinary = steps[~(there[1:] | there[:-1]) & (steps > 0)]
        if len(ordinary) < 10:
            continue
        limit = max(FAR * float(np.percentile(ordinary, 99)), 2 * grain)
        stretches = [(b, e) for b, e in runs(there) if e - b <= longest]
        jumped = [(b, e) for b, e in stretches if _jump(own, pieces, b, e) > limit]
        if len(jumped) < FEWEST:
            continue
        # Once a number is known for a failed read it is one near zero as well, unless it also
        # occurs as a measurement: in coarse steps, or where the robot stands.
        width = max(e - b for b, e in jumped)
        outside = value in (numbers[0], numbers[-1])
        if outside and width <= WIDEST and there.mean() <= MOST:
            continue  # a few spikes, which are mended alike
        inner = [(b, e) for b, e in stretches if b > 0 and e < len(own) and e - b <= width]
        near = [stretch for stretch in inner if stretch not in set(jumped)]
        far_rows, near_rows = (sum(e - b for b, e in group) for group in (jumped, near))
        if near_rows <= far_rows and counts[k] > FEWEST * np.median(counts):
            jumped += near
        failed = np.zeros(len(own), bool)
        for begin, end in jumped:
            failed[begin:end] = True
        found.append((value, failed))
    return found


def _jump(own: np.ndarray, pieces: np.ndarray, begin: int, end: int) -> float:
    """Height of the jump to a stretch and back: the smaller flank, 0 if it is a crossing."""
    flanks = [
        float(own[row] - own[begin])
        for row in (begin - 1, end)
        if 0 <= row < len(own) and pieces[row] == pieces[begin]
    ]
    if len(flanks) < 2 or flanks[0] * flanks[1] <= 0:
        return 0.0
    return min(abs(flank) for flank in flanks)


def _mend(
    record: Record,
    channel: str,
    columns: list[int],
    value: float,
    failed: np.ndarray,
    values: np.ndarray,
    pieces: np.ndarray,
) -> np.ndarray:
    """Interpolate the short stretches of some columns in place; return the (N,) rows to cut out."""
    cut, stretches = np.zeros(len(failed), bool), runs(failed)
    count, width = int(failed.sum()), max(end - begin for begin, end in stretches)
    where = record.name(channel, columns)
    where = f"{where}, {record.unit_of_place} {record.lines[stretches[0][0]]} first"
    what = (
        f"{count} rows ({count / len(failed):.1%}) are exactly {value:.6g} between neighbours far "
        f"from it ({len(stretches)} times, {width} in a row at most): failed reads"
    )
    if count > MOST_MISSING * len(failed):
        record.refuse("failed_reads", what, where, "record again; log only values that were read")
        return cut
    bridged = 0
    for begin, end in stretches:
        inside = begin > 0 and end < len(failed) and pieces[begin - 1] == pieces[end]
        if inside and record.time[end] - record.time[begin - 1] <= BRIDGED:
            around = [begin - 1, end]
            for column in columns:
                values[begin:end, column] = np.interp(
                    record.time[begin:end], record.time[around], values[around, column]
                )
            bridged += 1
        else:
            cut[begin:end] = True
    done = [f"{bridged} stretches replaced by a line between their neighbours"] if bridged else []
    done += ["longer ones cut out; the log is split there"] if cut.any() else []
    record.fixed("failed_reads", what, where, ", ".join(done))
    return cut
