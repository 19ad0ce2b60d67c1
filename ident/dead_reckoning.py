"""Pose and wheel angles integrated from measured speeds, through a whole log.

What a law reads that no instrument shows is integrated from what they do show.  It goes on through
short gaps, where speeds are taken to run straight; beyond a long one nobody knows where the robot
or its wheels have got to.
"""

from __future__ import annotations

import numpy as np

from ident.log import Log
from youbot_env.backend import NUMPY
from youbot_env.stepping import pose_rate

# Longest gap that is bridged, s: a robot of this size turns on for about as long as it is left
# alone, so its heading is known to some hundredths of a radian at the other end.
LONGEST_GAP = 0.5
# Turned in a longer gap at most, rad, by a robot that stands before and behind it; means over so
# many samples tell whether it does.
TURNED, SAMPLES = 0.03, 8


def bridged(log: Log) -> bool:
    """Tell whether what is integrated holds through the whole log.

    It does through gaps that are short, through those in which the robot stands, and where it was
    integrated before the log was cut; not from one run to the next.
    """
    if log.held:
        return True
    if len(log.runs) > 1:
        return False
    yaw_rate = log.velocity()[:, 2]
    for start in log.starts[1:]:
        gap = log.time[start] - log.time[start - 1]
        before, after = yaw_rate[max(0, start - SAMPLES) : start], yaw_rate[start : start + SAMPLES]
        if gap > LONGEST_GAP and gap * max(abs(before.mean()), abs(after.mean())) > TURNED:
            return False
    return True


def dead_reckoning(log: Log) -> np.ndarray:
    """(N, 3) pose from the measured velocities, m, m, rad; zero at the first sample."""
    v = tuple(log.velocity().T)
    yaw = integral(log.time, v[2])
    rate = pose_rate(v, yaw, NUMPY)
    return np.stack([integral(log.time, rate[0]), integral(log.time, rate[1]), yaw], axis=1)


def wheel_speeds(log: Log) -> np.ndarray:
    """(N, n) measured wheel speeds, rad/s, or those of the measured body velocities."""
    if log.wheel_velocity is None:
        return log.velocity() @ log.platform.jacobian_array.T
    return log.wheel_velocity


def wheel_angles(log: Log) -> np.ndarray:
    """(N, n) wheel angles integrated from their speeds, rad, zero at the start of the record."""
    if log.wheel_angle is not None:
        return log.wheel_angle
    return np.stack([integral(log.time, column) for column in wheel_speeds(log).T], axis=1)


def integral(time: np.ndarray, rate: np.ndarray) -> np.ndarray:
    """(N,) integral of a rate (N,) that runs straight between samples, zero at the first."""
    areas = 0.5 * (rate[1:] + rate[:-1]) * np.diff(time)
    return np.concatenate([[0.0], np.cumsum(areas)])
