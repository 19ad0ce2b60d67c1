"""Signs and order of wheels and axes: the simplest fault that makes all channels agree.

When the simplest one is unique it is put right; when two are equally simple the log is refused and
both are named.

Seen from above, mecanum rollers form an X in one arrangement and an O in the other (each wheel's
roller angle negated).  Sideways motion is then opposite, and so is yaw on a platform that is longer
than wide, as if left and right were exchanged in all columns.  The size of the yaw tells: it acts
on l - h in place of l + h.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ident.doctor.correlation import correlate
from ident.doctor.record import Record
from ident.doctor.sign_faults import MIN_COSINE, Fault, Witnesses
from ident.doctor.smoothing import Smooth, smooth
from ident.doctor.turns import put_right
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
        gains = np.ma.masked_invalid(
            correlate(wheels, motion).gains(platform.jacobian_array)[:, YAW]
        )
        if gains.count():
            found.append(float(np.ma.median(gains)))
    return all(1 / NEAR < gain < NEAR for gain in found) if found else None


def check_signs(record: Record) -> None:
    """Put signs and order right where that is certain; refuse where it is not."""
    signals = smooth(record)
    if len(signals.rows) < 20:
        return
    witnesses = Witnesses(record, signals)
    if not witnesses.sources and not witnesses.silent:
        record.warn(
            "witness",
            "neither reference nor pose nor body velocity stands in the log",
            "header",
            "a sign common to all wheels, or left and right exchanged in all columns, cannot be "
            "noticed; record one of them",
        )
    for source, share in witnesses.silent.items():
        record.warn(
            "witness",
            f"{source} explains {max(share, 0):.0%} of what the wheels do",
            record.name(source),
            "not used to check the wheels; look at its axes, units and clock",
        )
    faults = witnesses.faults()
    wrong = not faults or any(fault.size != (0, 0) for fault in faults)
    if wrong and check_hand(record, signals, witnesses, faults):
        return
    if not faults:
        witnesses, faults = _one_liar(record, witnesses)
    if not faults:
        _unexplained(record, witnesses)
    elif all(f.of_source and f.source == "reference" for f in faults) and _alone(witnesses):
        _outvoted(record, faults, witnesses)
    elif len(faults) == 1:
        _repair(record, faults[0], witnesses)
    elif all(f.of_source and f.source == faults[0].source != "body_velocity" for f in faults):
        _outvoted(record, faults, witnesses)
    else:
        faults = sorted(faults, key=lambda fault: not (fault.of_source and fault.turn.rotates))
        words = [fault.words(record, witnesses.drive) for fault in faults[:6]]
        record.refuse(
            "signs",
            f"signs or order of columns are wrong, in one of {len(faults)} ways: "
            + "; or ".join(words),
            "header",
            "say which with --map NAME=COLUMN, a minus before COLUMN for the other sign, or add "
            "reference or pose columns that decide it (the youBot driver's own values have the "
            "other sign on the left wheels)",
        )


def _one_liar(record: Record, witnesses: Witnesses) -> tuple[Witnesses, list[Fault]]:
    """Leave out the one command or pose that contradicts everything else."""
    cases = []
    for source in witnesses.sources:
        fewer = witnesses.without(source)
        faults = fewer.faults() if fewer.sources else []
        if len(faults) == 1 and source != "body_velocity":
            cases.append((source, fewer, faults))
    least = min((faults[0].size for _, _, faults in cases), default=None)
    left_out = [case for case in cases if case[2][0].size == least]
    if len(left_out) != 1:
        return witnesses, []
    source, fewer, faults = left_out[0]
    record.warn(
        "signs",
        f"{source} contradicts all other channels",
        record.name(source),
        "left out; check its signs, order and frame (body X forward, Y left, yaw "
        "counter-clockwise)",
    )
    record.leave_out(source)
    return fewer, faults


def _alone(witnesses: Witnesses) -> bool:
    """Whether only one source of body motion speaks, so that none of its kind confirms wheels."""
    return len(witnesses.sources) == 1


def _outvoted(record: Record, faults: list[Fault], witnesses: Witnesses) -> None:
    """Leave out a command or pose that contradicts wheels which agree with each other."""
    source = faults[0].source
    words = " or ".join(fault.turn.words(source) for fault in faults[:3])
    drive = f" and {witnesses.drive}" if witnesses.drive and witnesses.wheels_agree() else ""
    record.warn(
        "signs",
        f"{source} contradicts wheel_velocity{drive}, which agree with each other: {words}",
        record.name(source),
        f"{source} left out; correct its columns, with --map NAME=COLUMN and a minus for the "
        "other sign. If it is right, all wheel columns are named after another front or side of "
        "the robot",
    )
    record.leave_out(source)


def _repair(record: Record, fault: Fault, witnesses: Witnesses) -> None:
    if fault.size == (0, 0):
        return
    drive, remedy, where = witnesses.drive, "put right", ""
    words, tell = f"signs or order: {fault.words(record, drive)}", record.fixed
    for channel, arrangement in (("wheel_velocity", fault.wheels), (drive, fault.drive)):
        if arrangement.changed and channel in record.channels:
            where = where or record.name(channel, arrangement.changed)
            record.set(channel, arrangement.undo(record.channels[channel]))
    source = fault.source
    if source:
        where = where or record.name(source)
        if source == "pose" and fault.turn.rotates:
            remedy = "the heading is put right"
        elif source == "pose":
            remedy = "all other channels agree; the pose is left out"
        if source == "pose" and not fault.turn.rotates:
            tell = record.warn if _alone(witnesses) else record.fixed
            record.leave_out("pose")
        else:
            put_right(record, source, fault.turn)
        if _alone(witnesses) and source in record.channels:
            # Seen from the wheels the frame is turned for certain; a mirror may be in either.
            tell = record.fixed if fault.turn.rotates else record.warn
            remedy += (
                "; wheels and drive input agree with each other. If the sensor is right, all wheel "
                "columns are named after another front of the robot"
            )
    tell("turned_frame" if source else "signs", words, where, remedy)


def _unexplained(record: Record, witnesses: Witnesses) -> None:
    """No simple fault explains the disagreement: name the columns that disagree most."""
    for kind, channel in (("wheels", "wheel_velocity"), ("drive", witnesses.drive)):
        for source in witnesses.sources:
            table = witnesses.table(source, kind)
            if table is None:
                continue
            most = np.nan_to_num(np.diag(table.most()), nan=1.0)
            bad = np.flatnonzero(most < MIN_COSINE)
            if not len(bad):
                continue
            agreement = np.diag(table.cosines)[bad].min()
            tell = record.refuse if most.min() < 0 else record.warn
            tell(
                "signs",
                f"{channel} does not follow the {source} (agreement {agreement:.2f}, 1 is "
                "perfect), whatever signs and order",
                record.name(channel, bad),
                "check signs, order and units of these columns, and of the " + source,
            )
