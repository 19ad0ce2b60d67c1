"""Counters that overflow: speeds that wrap round, signed currents that were read as unsigned.

An integer of k bits that grows past its largest value goes on at its smallest.  The record then
jumps by one and the same number there and back, between two ends at which nothing else jumps, and
runs on smoothly once that number is added.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ident.doctor.correlation import explained
from ident.doctor.record import Record
from ident.doctor.standing import witnessed

CHANNELS = ("wheel_velocity", "wheel_current", "wheel_torque", "wheel_duty", "wheel_voltage")
FEWEST = 2  # jumps in a channel: there and back
JUMP = 0.6  # of the range of the channel, that each jump spans
SMOOTH = 0.5  # of the jumps, below which all other steps stay, before and after they are taken out
VALUES = 5  # numbers seen beyond the jumps: fewer are a code for something else
PRECISE = 2e-3  # of the jump, standard error to which it must be known to be taken out
UNSIGNED = 0.01  # of the jump, by which values of an unsigned number may lie below zero
FOLLOWS = 0.5  # share of the channel that another witness of the motion explains without jumps
LEFT = 0.5  # of what contradicts the others with the jumps, what does so without them


@dataclass(frozen=True)
class Wrap:
    """Jumps of a channel.

    Attributes:
        period: size of the jumps.
        error: its standard error.
        count: number of jumps.
        row, column: the first one.
        values: (N, n) channel without them.
        unsigned: whether negative values became large ones.
    """

    period: float
    error: float
    count: int
    row: int
    column: int
    values: np.ndarray
    unsigned: bool


def check_overflow(record: Record) -> None:
    """Take out jumps of speeds that wrapped round; refuse signed numbers read as unsigned."""
    for channel in CHANNELS:
        values = record.get(channel)
        found = None if values is None or len(values) < 20 else _find(record, channel)
        if found is None:
            continue
        where = record.place(found.row, channel, found.column)
        what = f"{found.count} jumps by one and the same {found.period:.5g}, there and back: "
        if found.unsigned:
            record.refuse(
                "overflow",
                f"{what}a signed number was read as an unsigned one (two's complement)",
                where,
                f"subtract {found.period:.5g} from values above {found.period / 2:.5g}, or read "
                "the register as a signed integer",
            )
        elif found.error < PRECISE * found.period:
            record.set(channel, found.values)
            what += "an integer wrapped round (overflow)"
            record.fixed("overflow", what, where, "the jumps were taken out")
        else:
            record.refuse(
                "overflow",
                f"{what}an integer wrapped round (overflow)",
                where,
                "read the register with more bits, or drive more slowly",
            )


def _find(record: Record, channel: str) -> Wrap | None:
    """Jumps of all columns of a channel, else those of single ones, which others confirm."""
    values = record.channels[channel]
    found = find_wrap(values, record.breaks)
    if found is not None and _moves(record, channel, found):
        return found
    mended, single = values.copy(), []
    for column in range(values.shape[1]):
        one = find_wrap(values[:, [column]], record.breaks)
        if one is None:
            continue
        tried = values.copy()
        tried[:, column] = one.values[:, 0]
        one = replace(one, column=column, values=tried)
        if _moves(record, channel, one, [column]):
            mended[:, column] = tried[:, column]
            single.append(one)
    if not single:
        return None
    count = sum(one.count for one in single)
    error = max(one.error for one in single)
    return replace(single[0], count=count, error=error, values=mended)


def find_wrap(values: np.ndarray, breaks: np.ndarray) -> Wrap | None:
    """Find jumps by one number that are no motion.

    Args:
        values: (N, n) columns of one counter.
        breaks: (N,) rows that do not follow from the row before.
    """
    step = np.diff(values, axis=0)
    step[breaks[1:]] = 0.0
    span = float(np.ptp(values, axis=0).max())
    jumps = np.abs(step) > JUMP * span
    if not span or jumps.sum() < FEWEST:
        return None
    rest = np.where(jumps, 0.0, step)
    if np.abs(rest).max() > SMOOTH * np.abs(step[jumps]).min():
        return None
    # What a column would have done meanwhile is what it did right before and after.
    around = np.zeros_like(rest)
    around[1:-1] = 0.5 * (rest[:-2] + rest[2:])
    sizes = np.abs(step - around)[jumps]
    period = max(float(np.mean(sizes)), span)
    error = float(np.std(sizes)) / np.sqrt(len(sizes))
    unwrapped = values - period * np.concatenate(
        [np.zeros((1, values.shape[1])), np.cumsum(np.where(jumps, np.sign(step), 0.0), axis=0)]
    )
    unsigned = bool(values.min() > -UNSIGNED * period)
    centre = 0.0 if unsigned else float(values.max() + values.min()) / 2
    unwrapped -= period * np.round((np.median(unwrapped, axis=0) - centre) / period)
    beyond = values[np.abs(unwrapped - values) > period / 2]
    if len(np.unique(beyond)) < VALUES or np.abs(np.diff(unwrapped, axis=0)).max() > SMOOTH * span:
        return None
    row, column = np.argwhere(jumps)[0]
    return Wrap(period, error, int(jumps.sum()), int(row) + 1, int(column), unwrapped, unsigned)


def _moves(record: Record, channel: str, found: Wrap, columns: list[int] | None = None) -> bool:
    """Whether the channel fits another witness of the motion better without the jumps.

    A drive that is switched, or wheels that start between two rows, jump as well.
    """
    values = record.channels[channel]
    motions = witnessed(record)
    if channel != "wheel_velocity" and "wheel_velocity" in record.channels:
        motions.append(record.channels["wheel_velocity"])
    for motion in motions:
        regressors = np.hstack([motion, np.gradient(motion, record.time, axis=0)])
        now, then = (
            float(np.median(explained(v if columns is None else v[:, columns], regressors)))
            for v in (values, found.values)
        )
        if then > FOLLOWS and 1 - then < LEFT * (1 - now):
            return True
    if channel != "wheel_velocity":
        return False
    left = np.linalg.svd(record.platform.jacobian_array)[0][:, 3:]
    now, then = (float(np.sum((v @ left) ** 2)) for v in (values, found.values))
    return then < LEFT * now
