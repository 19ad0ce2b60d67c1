"""The lever l + h of a wheel table against how fast the robot is seen to turn."""

from __future__ import annotations

import math

from ident.doctor.heading import against_wheels
from ident.doctor.odometry import Estimate
from ident.doctor.record import Record
from ident.doctor.scales import ALONE
from ident.doctor.smoothing import BODY_SOURCES

# Relative distance from the table that is told: turning on real rollers is 4 % short.
OFF = 0.075
CLEAR = 1.96  # standard errors
WIDEST = 2.5  # times the table's lever: beyond that columns or wheels are wrong, no lever
PRECISE = 0.03  # relative standard error beyond which the lever is not known


def check_lever(record: Record) -> None:
    """Tell the lever by which the wheels would turn the robot as pose or gyro show.

    Yaw by the wheels is a sum of their rim speeds over the lever, forward motion one over nothing:
    the ratio of both scales is free of the wheel radius.
    """
    if "wheel_velocity" not in record.channels or len(record.time) < 100:
        return
    for source in BODY_SOURCES:
        seen = against_wheels(record, source) if source != "reference" else None
        if seen is None or not seen.yaw.known:
            continue
        forward = seen.forward
        if not forward.known or forward.se > PRECISE * abs(forward.value):
            forward = Estimate(1.0, 0.0)  # the wheel radius of the table
        ratio = forward.value / seen.yaw.value
        spread = abs(ratio) * math.hypot(seen.yaw.se / seen.yaw.value, forward.se / forward.value)
        if not WIDEST > ratio > 1 / WIDEST or spread > PRECISE * ratio:
            continue
        if abs(ratio - 1) > max(OFF, CLEAR * spread):
            lever, table = ratio * record.platform.lever, record.platform.lever
            record.warn(
                "lever",
                f"{source} turns as with a lever l + h of {lever:.3f} +- "
                f"{CLEAR * spread * table:.3f} m, the wheel table has {table:.3f} m: "
                f"yaw is {1 / ratio:.2f} times what the wheels say",
                record.name(source, [2]),
                f"compare with the drawing: where it agrees give --lever {lever:.3g}; slip in "
                "turning looks like a longer lever, and a pose computed from the wheels shows the "
                "lever that it was computed with",
                geometry=abs(ratio - 1) > ALONE,
            )
        return
