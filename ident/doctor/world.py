"""Velocities in the axes of the world instead of those of the robot.

Motion capture and simulators publish twists in world axes.  As long as the robot hardly turns they
pass for those of the body; the wheels show the difference, or else the pose.
"""

from __future__ import annotations

import numpy as np

from ident.doctor.odometry import wheel_twist
from ident.doctor.record import Record
from ident.doctor.smoothing import smooth

EXPLAINED = 0.95  # share of the planar motion that wheels or pose explain in world axes
LESS = 0.25  # of what they leave unexplained in body axes, what is left in world axes
TURNS = 0.05  # rad rms, by which the robot must turn to tell


def check_world(record: Record) -> None:
    """Turn velocities from world axes into those of the robot, where the wheels show it."""
    if len(smooth(record).rows) < 100:
        return
    witness = next((w for w in ("wheel_velocity", "pose") if w in record.channels), "")
    for source in ("body_velocity", "reference"):
        if witness and source in record.channels:
            _source(record, source, witness)


def _source(record: Record, source: str, witness: str) -> None:
    signals, rows = smooth(record).signals, smooth(record).rows
    shown = signals[source][:, :2]
    rolled = signals[witness]
    if witness == "wheel_velocity":
        rolled = wheel_twist(rolled, record.platform)
    rolled = rolled[:, :2]
    heading = _heading(record)
    if np.std(heading[rows]) < TURNS or not np.any(shown):
        return
    left_body = _left(shown, rolled)[0]
    left_world, M = _left(shown, _turned(rolled, heading[rows]))
    if left_world > min(1 - EXPLAINED, LESS * left_body):
        return
    start = float(np.arctan2(M[1, 0] - M[0, 1], M[0, 0] + M[1, 1]))
    values = record.channels[source].copy()
    values[:, :2] = _turned(values[:, :2], -(heading + start))
    record.set(source, values)
    words = "the wheels explain" if witness == "wheel_velocity" else "the pose explains"
    record.fixed(
        "world_frame",
        f"{source} is in the axes of the world: {words} {1 - left_world:.1%} of it "
        f"there and {1 - left_body:.1%} in those of the robot",
        record.name(source, [0, 1]),
        "turned into the axes of the robot",
    )


def _heading(record: Record) -> np.ndarray:
    """(N,) rad, by the pose, else by the turning of the wheels, from zero."""
    pose = record.get("pose")
    if pose is not None:
        return np.unwrap(pose[:, 2])
    turning = wheel_twist(record.channels["wheel_velocity"], record.platform)[:, 2]
    steps = np.diff(record.time, prepend=record.time[0])
    return np.cumsum(turning * steps)


def _turned(vectors: np.ndarray, angle: np.ndarray) -> np.ndarray:
    """(N, 2) vectors turned counter-clockwise by (N,) angles."""
    c, s = np.cos(angle), np.sin(angle)
    return np.column_stack(
        [c * vectors[:, 0] - s * vectors[:, 1], s * vectors[:, 0] + c * vectors[:, 1]]
    )


def _left(shown: np.ndarray, rolled: np.ndarray) -> tuple[float, np.ndarray]:
    """Share of the motion that a linear map leaves unexplained, and the (2, 2) map."""
    M = np.linalg.lstsq(rolled, shown, rcond=None)[0].T
    return float(np.mean((shown - rolled @ M.T) ** 2) / np.mean(shown**2)), M
