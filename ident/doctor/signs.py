"""Signs and order of wheels and axes: the simplest fault that makes all channels agree.

When the simplest one is unique it is put right; when two are equally simple the log is refused and
both are named.
"""

from __future__ import annotations

import numpy as np

from ident.doctor.record import Record
from ident.doctor.smoothing import smooth
from ident.doctor.witnesses import ALIKE, Fault, Witnesses


def check_signs(record: Record) -> None:
    """Put signs and order right where that is certain; refuse where it is not."""
    signals = smooth(record)
    if len(signals.rows) < 20:
        return
    witnesses = Witnesses(record, signals)
    if not witnesses.sources and not witnesses.silent:
        record.warn(
            "neither reference nor pose nor body velocity stands in the log",
            "header",
            "a sign common to all wheels, or left and right exchanged in all columns, cannot be "
            "noticed; record one of them",
        )
    for source, share in witnesses.silent.items():
        record.warn(
            f"{source} explains {max(share, 0):.0%} of what the wheels do",
            record.name(source),
            "not used to check the wheels; look at its axes, units and clock",
        )
    faults = witnesses.faults()
    if not faults:
        witnesses, faults = _one_liar(record, witnesses)
    if not faults:
        _unexplained(record, witnesses)
    elif len(faults) == 1:
        _repair(record, faults[0], witnesses.drive)
    else:
        words = [fault.words(record, witnesses.drive) for fault in faults[:6]]
        record.refuse(
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
        f"{source} contradicts all other channels",
        record.name(source),
        "left out; check its signs, order and frame (body X forward, Y left, yaw "
        "counter-clockwise)",
    )
    record.leave_out(source)
    return fewer, faults


def _repair(record: Record, fault: Fault, drive: str) -> None:
    if fault.size == (0, 0):
        return
    words, remedy = fault.words(record, drive), "put right"
    where = ""
    for channel, arrangement in (("wheel_velocity", fault.wheels), (drive, fault.drive)):
        if arrangement.changed and channel in record.channels:
            where = where or record.name(channel, arrangement.changed)
            record.set(channel, arrangement.undo(record.channels[channel]))
    if fault.source:
        where = where or record.name(fault.source)
        if fault.source == "pose":
            record.leave_out("pose")
            remedy = "all other channels agree; the pose is left out"
        else:
            flipped = record.channels[fault.source] * np.array(fault.flip)
            record.set(fault.source, flipped)
    record.fixed(f"signs or order: {words}", where, remedy)


def _unexplained(record: Record, witnesses: Witnesses) -> None:
    """No simple fault explains the disagreement: name the columns that disagree most."""
    for kind, channel in (("wheels", "wheel_velocity"), ("drive", witnesses.drive)):
        for source in witnesses.sources:
            table = witnesses.cosines(source, kind)
            if table is None:
                continue
            agreement = np.nan_to_num(np.diag(table), nan=1.0)
            bad = np.flatnonzero(agreement < ALIKE)
            if not len(bad):
                continue
            tell = record.refuse if agreement.min() < 0 else record.warn
            tell(
                f"{channel} does not follow the {source} (agreement {agreement.min():.2f}, 1 is "
                "perfect), whatever signs and order",
                record.name(channel, bad),
                "check signs, order and units of these columns, and of the " + source,
            )
