"""Sensors that stand still while the robot moves, and signals at their limits."""

from __future__ import annotations

import numpy as np

from ident.doctor.record import Record, runs
from ident.doctor.resolution import resolution
from ident.doctor.standing import Standing

DEAD = 1e-4  # of what its fellows reach at times: a channel that changes by less says nothing
OFTEN = 90.0  # percentile of their sizes; spikes are still there, and one must not make others dead
LONG = 0.3  # s without any change
ACTIVE = 0.1  # share of its rms by which the others move meanwhile
MOST_STUCK = 0.2  # fraction of a log that may be cut out
SATURATED = 0.01  # fraction of samples at the limit that is told
HELD = 0.5  # fraction of repeated values that is told
PILED = 3.0  # times as many at the limit as one coarse step inside: more than a crest of a motion
JUMP = 0.005  # of the rms, between repeated values
CHANGES = 1.0  # steps of a coarse record by which the others say that it should have changed, rms


def check_stuck(record: Record) -> None:
    """Cut out stretches in which one sensor stands still alone; refuse dead ones."""
    cut = np.zeros(len(record.time), bool)
    for channel in ("wheel_velocity", "wheel_torque"):
        values = record.get(channel)
        if values is None:
            continue
        rms = float(np.sqrt(np.mean(values**2, axis=0)).max())
        standing = Standing(record)
        for column in range(values.shape[1] if rms > 0 else 0):
            stuck = _column(record, channel, column, rms, standing)
            if stuck.mean() > MOST_STUCK:
                what = f"stands still or saturated in {stuck.mean():.0%} of the log"
                where = record.name(channel, [column])
                if not record.refuse("stuck_sensor", what, where, "repair the sensor"):
                    continue
            cut |= stuck
    if cut.any():
        record.drop(cut, split=True)


def _column(
    record: Record, channel: str, column: int, rms: float, standing: Standing
) -> np.ndarray:
    """Examine one column; return the samples to cut out."""
    values = record.channels[channel]
    own, stuck = np.ascontiguousarray(values[:, column]), np.zeros(len(values), bool)
    limits = {float(own.min()), float(own.max())}
    least = DEAD * float(np.percentile(np.abs(values), OFTEN, axis=0).max())
    if np.ptp(own) <= least:
        changing = np.any(np.ptp(values, axis=0) > least)
        if changing and not standing.excused(channel, column, 0, len(own), float(own[0])):
            what = f"always {own[0]:.6g} while the others change"
            record.refuse("stuck_sensor", what, record.name(channel, [column]), "repair the sensor")
        return stuck
    same, step = np.concatenate([[False], own[1:] == own[:-1]]), resolution(own)
    if channel != "wheel_velocity":
        _limits(record, channel, column, limits, step)
    _held(record, channel, column, same, step)
    others = [k for k in range(values.shape[1]) if k != column]
    shortest = max(10, LONG / record.dt)
    for begin, end in runs(same):
        if end - begin < shortest:
            continue
        alone = np.std(values[begin - 1 : end, others], axis=0).max() > ACTIVE * rms
        # Coarse steps repeat as long as the signal stays within one of them.
        if step and np.std(_expected(record, channel, column)[begin:end]) < CHANGES * step:
            continue
        # A command at its limit is no broken sensor; a speed that cannot rise is one.
        if not alone or (channel != "wheel_velocity" and float(own[begin]) in limits):
            continue
        limited = own[begin] != 0 and float(own[begin]) in limits
        if limited or not standing.excused(channel, column, begin - 1, end, float(own[begin])):
            stuck[begin - 1 : end] = True
    if stuck.any():
        begin, end = max(runs(stuck), key=lambda run: run[1] - run[0])
        seconds = record.time[end - 1] - record.time[begin]
        limit = "its limit " if float(own[begin]) in limits else ""
        record.fixed(
            "stuck_sensor",
            f"stands at {limit}{own[begin]:.6g} for {seconds:.3g} s while the others change "
            f"({len(runs(stuck))} such stretches)",
            record.place(begin, channel, column),
            "cut out; the log is split there",
        )
    return stuck


def _expected(record: Record, channel: str, column: int) -> np.ndarray:
    """(N,) the best linear guess of a column from all other wheel columns."""
    others = [np.delete(record.channels[channel], column, axis=1), np.ones((len(record.time), 1))]
    others += [
        record.channels[c]
        for c in ("wheel_velocity", "wheel_torque")
        if c != channel and c in record.channels
    ]
    columns = np.hstack(others)
    own = record.channels[channel][:, column]
    return columns @ np.linalg.lstsq(columns, own, rcond=None)[0]


def _limits(record: Record, channel: str, column: int, limits: set[float], step: float) -> None:
    """Tell when a signal spends its time exactly at its largest or smallest value."""
    own = record.channels[channel][:, column]
    if step:  # the outermost of coarse steps holds fewer values than the next one inside
        inward = {min(limits): step, max(limits): -step}
        near = {x: np.mean(np.abs(own - x - d) < step / 2) for x, d in inward.items()}
        limits = {x for x in limits if np.mean(own == x) > PILED * near[x]}
    for limit in sorted(limits):
        there = own == limit
        if limit == 0 or there.mean() < SATURATED or max(e - b for b, e in runs(there)) < 3:
            continue
        record.warn(
            "saturation",
            f"{there.mean():.1%} of the samples are exactly {limit:.6g}: saturated",
            record.name(channel, [column]),
            "drive more gently, or widen the range of the sensor",
        )


def _held(record: Record, channel: str, column: int, same: np.ndarray, step: float) -> None:
    """Tell when most values repeat the one before: the sensor is slower than the log."""
    if same.mean() < HELD / 2:
        return
    own = record.channels[channel][:, column]
    rms = np.sqrt(np.mean(own**2))
    moving = np.abs(own) > 0.2 * rms
    jumps = np.abs(np.diff(own, prepend=own[0]))[moving & ~same]
    repeated = float(np.mean(same[moving])) if moving.any() else 0.0
    # A steady motion without noise repeats values too, but it does not jump in between.
    least = max(JUMP * rms, 1.5 * step)
    if repeated > HELD and len(jumps) and np.median(jumps) > least:
        record.warn(
            "slow_sensor",
            f"{repeated:.0%} of the values repeat the one before: the sensor is slower than the "
            "log",
            record.name(channel, [column]),
            f"log it at its own rate, about {(1 - repeated) / record.dt:.3g} Hz",
        )
