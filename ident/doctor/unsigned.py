"""Currents without a sign: the magnitude alone is logged, as many motor boards do."""

from __future__ import annotations

import numpy as np

from ident.doctor.record import Record

# Of the largest: a set speed below it is 0 but for rounding.
STANDS = 1e-3
# Share of its moving rows in which a wheel turns backwards, so that a signed current would show it.
BACKWARDS = 0.2
# Least share of values in the middle half of the range: magnitudes pass it on their way to zero.  A
# signed current read as unsigned leaves it empty, for it jumps from nothing to the range's end.  On
# 72 real runs with magnitudes the share is 0.48 or more.
MIDDLE = 0.02


def check_unsigned(record: Record) -> None:
    """Give magnitudes of currents the sign of the set speed, else that of the motion."""
    current = record.get("wheel_current")
    if current is None or np.any(current < 0) or not np.any(current > 0):
        return
    if np.mean(np.abs(current / np.percentile(current, 99) - 0.5) < 0.25) < MIDDLE:
        return
    command, speed = record.get("reference"), record.get("wheel_velocity")
    set_speed = None if command is None else command @ record.platform.jacobian_array.T
    if set_speed is None and speed is None:
        return
    signs, told = np.zeros(current.shape), []
    for values, words in ((set_speed, "the set speed"), (speed, "the wheel's speed")):
        if values is None or not np.nan_to_num(values).any():
            continue
        least = STANDS * np.nanmax(np.abs(values)) if values is set_speed else 0.0
        sure = np.abs(values) > least
        signs = np.where(signs == 0, np.where(sure, np.sign(values), 0.0), signs)
        told.append(words)
    moving = signs != 0
    back = (signs < 0).sum(axis=0) > BACKWARDS * np.maximum(moving.sum(axis=0), 1)
    if not back.any():
        return
    record.set("wheel_current", signs * current)
    turning = record.name("wheel_current", np.flatnonzero(back))
    record.fixed(
        "signs",
        f"currents are never negative while wheels turn backwards ({turning}): magnitudes alone",
        record.name("wheel_current"),
        f"given the sign of {', else of '.join(told)}, and 0 where the wheel stands; that is wrong "
        "while a motor brakes",
    )
