"""Frames that are turned against the wheels by a constant angle, such as a mocap's or a sensor's.

A quarter turn shows as exchanged axes; what stands in between passes for slip, unequal scales or a
tilted floor.  Against the wheels the angle is certain, so it is taken out.
"""

from __future__ import annotations

import numpy as np

from ident.doctor.odometry import Kinematic, pose_against, velocity_against, wheel_twist
from ident.doctor.record import Record
from ident.doctor.smoothing import BODY_SOURCES
from ident.doctor.turns import put_right, turn_by

# rad: smaller angles are left, diagnosis and calibration estimate them with everything else.
TURNED = 0.12
CLEAR = 6.0  # standard errors
STRETCHED = 0.15  # of the scale: more of anything but rotation and scale is slip, no turned frame


def check_heading(record: Record) -> None:
    """Turn pose and body velocities into the axes of the wheels; leave out such a command."""
    if "wheel_velocity" not in record.channels or len(record.time) < 100:
        return
    for source in BODY_SOURCES:
        kinematic = against_wheels(record, source)
        if kinematic is None or not _turned(kinematic):
            continue
        angle = kinematic.angle
        what = (
            f"{source} is turned by {np.rad2deg(angle.value):.1f} +- "
            f"{np.rad2deg(1.96 * angle.se):.1f} deg against the axes of the wheels"
        )
        where = record.name(source)
        if source == "reference":
            record.warn("turned_frame", what, where, "left out; give it in the axes of the robot")
            record.leave_out(source)
        else:
            put_right(record, source, turn_by(angle.value))
            record.fixed("turned_frame", what, where, "a constant angle, taken out")


def _turned(kinematic: Kinematic) -> bool:
    """Whether the source sees the motion of the wheels in a turned frame, and nothing else."""
    angle, M = kinematic.angle, kinematic.matrix
    if kinematic.yaw.known and kinematic.yaw.value < 0:
        return False
    if not angle.known or abs(angle.value) < TURNED or not angle.differs(0.0, CLEAR):
        return False
    c, s = np.cos(angle.value), np.sin(angle.value)
    rotation = np.array([[c, -s], [s, c]])
    size = 0.5 * np.sum(M * rotation)
    return bool(size > 0 and np.abs(M / size - rotation).max() < STRETCHED)


def against_wheels(record: Record, source: str) -> Kinematic | None:
    """Scales and mount of one source against the wheels; None where it says nothing."""
    values = record.get(source)
    if values is None or not np.any(values):
        return None
    starts = (0, *(np.flatnonzero(record.breaks[1:]) + 1).tolist())
    compare = pose_against if source == "pose" else velocity_against
    rolled = wheel_twist(record.channels["wheel_velocity"], record.platform)
    return compare(record.time, values, rolled, starts, record.platform.reach)
