"""Rollers of the other hand: a platform whose rollers form an O where its table says X.

Seen from above, mecanum rollers form an X in one arrangement and an O in the other (each wheel's
roller angle negated).  Sideways motion is then opposite, and so is yaw on a platform that is longer
than wide, as if left and right were exchanged in all columns.  The size of the yaw tells: it acts
on l - h in place of l + h.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ident.doctor.evidence import hear
from ident.doctor.record import Record
from ident.doctor.smoothing import Smooth
from ident.doctor.witnesses import Fault, Witnesses
from youbot_env.platform import Platform

NEAR = 1.5  # factor within which the yaw of wheels and witness is that of the table
YAW = 2


def check_hand(record: Record, signals: Smooth, witnesses: Witnesses, faults: list[Fault]) -> bool:
    """Refuse a log whose wheels and witnesses agree on a table with the other roller angles.

    Args:
        record: the log.
        signals: its smoothed channels.
        witnesses: what they testify with the table as it is.
        faults: the simplest faults in signs and order that would explain them.

    Returns:
        Whether it was refused or accepted, so that no column is touched.
    """
    other = other_hand(record.platform)
    if other is None or not witnesses.sources:
        return False
    there = Witnesses(replace(record, platform=other, findings=[]), signals)
    if not there.sources or any(fault.size != (0, 0) for fault in there.faults()):
        return False
    right = Fault(witnesses.all[0], witnesses.all[0])
    fits = _fits(signals, there, right, other)
    rivals = [_fits(signals, witnesses, fault, record.platform) for fault in faults]
    certain = fits is True and not any(rival is not False for rival in rivals)
    columns = bool(faults) and not any(fault.of_source for fault in faults)
    undecided = fits is not False and columns and True not in rivals
    if not (certain or undecided):
        return False
    what = (
        "the rollers have the other hand than in the wheel table (an O in place of an X, or the "
        "reverse): with each roller angle negated wheels and "
        f"{' and '.join(there.sources)} agree as they stand"
    )
    if not certain:
        words = "; or ".join(fault.words(record, witnesses.drive) for fault in faults[:2])
        what += f"; or columns are exchanged: {words}"
    record.refuse(
        "roller_hand",
        what,
        "wheel table",
        "give the robot's own table with --platform FILE, roller_angle_deg with the other sign on "
        "every wheel (docs/add_a_platform.md)"
        + ("" if certain else ", or name the columns with --map NAME=COLUMN"),
    )
    return True


def other_hand(platform: Platform) -> Platform | None:
    """The platform with all roller angles negated; None where that is none or the same."""
    wheels = tuple(replace(wheel, roller_angle=-wheel.roller_angle) for wheel in platform.wheels)
    try:
        other = replace(platform, wheels=wheels)
    except ValueError:  # a square platform cannot turn then
        return None
    return None if np.allclose(other.jacobian_array, platform.jacobian_array) else other


def _fits(signals: Smooth, witnesses: Witnesses, fault: Fault, platform: Platform) -> bool | None:
    """Whether a fault gives the yaw of a measured witness its size; None where nothing says so."""
    if witnesses.wheels is None:
        return None
    wheels, found = fault.wheels.undo(witnesses.wheels), []
    for source in witnesses.sources:
        if source == "reference":
            continue  # a command is turned into wheel speeds by the robot's own table
        motion = signals.signals[source]
        if fault.source == source:
            motion = fault.turn.undo(motion)
        gains = np.ma.masked_invalid(hear(wheels, motion).gains(platform.jacobian_array)[:, YAW])
        if gains.count():
            found.append(float(np.ma.median(gains)))
    return all(1 / NEAR < gain < NEAR for gain in found) if found else None
