"""Poses that were computed from the wheel speeds: they confirm nothing.

What an independent sensor shows from row to row has its own noise.  A pose that was summed up from
the wheel speeds repeats theirs, which no sensor of the robot's motion can know.
"""

from __future__ import annotations

import numpy as np

from ident.doctor.odometry import SCALES, wheel_twist
from ident.doctor.record import Record

# Correlation of third differences, of which a smooth motion holds next to nothing.  On 24 logs with
# independent poses, real rollers among them, it is 0.04 at most; computed poses have 0.995.
COMPUTED = 0.5
FRESH = 0.9  # share of rows in which the pose changes, to be compared row by row
# Lag-one correlation of third differences: -0.75 of white noise, above 0 of a smooth motion, which
# two good sensors without noise show alike.
NOISE = -0.4
SAME = 0.02  # of a scale, within which a pose was computed with this wheel table


def check_wheel_odometry(record: Record) -> None:
    """Leave out a pose that repeats the noise of the wheel speeds."""
    pose, wheels = record.get("pose"), record.get("wheel_velocity")
    if pose is None or wheels is None or len(pose) < 100:
        return
    scales = _repeated(record, pose, wheel_twist(wheels, record.platform))
    if scales is None:
        return
    what = "the pose was computed from the wheel speeds: from row to row it repeats their noise"
    off = {
        name: scale
        for name, scale in zip(SCALES, scales, strict=True)
        if abs(scale - 1) > SAME and scale > 0
    }
    if off:
        listed = ", ".join(f"{name} {scale:.3f}" for name, scale in off.items())
        what += f", {listed} times as large"
    if set(off) == {"yaw"}:
        lever = record.platform.lever
        what += (
            f"; its author took a lever l + h of {lever / off['yaw']:.3g} m, the wheel table has "
            f"{lever:.3g} m"
        )
    used = "wheel_odometry" in record.accept
    remedy = "used as a pose" if used else "left out: it confirms neither wheels nor wheel table"
    if off:
        remedy += "; find out which of the two is right"
    record.warn(
        "wheel_odometry",
        what,
        record.name("pose"),
        f"{remedy}; record a pose of a sensor of its own (motion capture, lidar, camera)",
        geometry=bool(off),
    )
    if not used:
        record.leave_out("pose")


def _repeated(record: Record, pose: np.ndarray, twist: np.ndarray) -> np.ndarray | None:
    """(3,) scales of a pose that repeats the noise of (N, 3) body velocities; None if it does not.

    A pose may have been stepped with the speeds of the row before, of its own row, or of both.
    """
    step, yaw = np.diff(record.time), np.unwrap(pose[:, 2])
    change = np.diff(np.column_stack([pose[:, :2], yaw]), axis=0)
    if np.mean(np.any(change != 0, axis=1)) < FRESH:
        return None
    half = 0.5 * (yaw[1:] + yaw[:-1])
    c, s = np.cos(half), np.sin(half)
    shown = np.column_stack(
        [c * change[:, 0] + s * change[:, 1], c * change[:, 1] - s * change[:, 0], change[:, 2]]
    )
    unbroken = ~np.any([record.breaks[1 + k : len(record.time) - 3 + k] for k in range(4)], axis=0)
    fast = np.diff(shown / step[:, None], 3, axis=0)[unbroken]
    own = np.diff(twist, 3, axis=0)
    if np.any(np.mean(own[1:] * own[:-1], axis=0) > NOISE * np.mean(own**2, axis=0)):
        return None
    scales, best = np.full(3, np.nan), np.full(3, COMPUTED)
    for before, after in ((1.0, 0.0), (0.0, 1.0), (0.5, 0.5)):
        claimed = np.diff(before * twist[:-1] + after * twist[1:], 3, axis=0)[unbroken]
        together = np.sum(fast * claimed, axis=0)
        power = np.sum(claimed**2, axis=0)
        alike = together / np.sqrt(np.sum(fast**2, axis=0) * power)
        better = alike > best
        scales[better], best[better] = (together / power)[better], alike[better]
    return None if np.isnan(scales).any() else scales
