"""Poses that jump: a camera that loses the marker, a map that is matched anew.

The robot goes on, the pose does so elsewhere.  Before and after it is right, so the log is split.
"""

from __future__ import annotations

import numpy as np

from ident.doctor.record import Record

FAR = 5.0  # times the largest of ordinary steps (99 % are smaller)
LEAST = np.array([0.02, 0.02])  # m, rad: smaller ones do no harm
MOST = 0.01  # of the rows: more are noise of the pose
LISTED = 3


def check_jumps(record: Record) -> None:
    """Split the log where the pose jumps and stays there."""
    pose = record.get("pose")
    if pose is None or len(pose) < 20:
        return
    turned = (np.diff(pose[:, 2]) + np.pi) % (2 * np.pi) - np.pi
    steps = np.column_stack([np.hypot(*np.diff(pose[:, :2], axis=0).T), np.abs(turned)])
    steps[record.breaks[1:]] = 0.0
    limit = np.array([_limit(own, least) for own, least in zip(steps.T, LEAST, strict=True)])
    jumps = np.any(steps > limit, axis=1)
    if not jumps.any() or jumps.mean() > MOST:
        return
    rows = np.flatnonzero(jumps) + 1
    largest = steps[rows - 1].max(axis=0)
    more = f" (and {len(rows) - LISTED} more)" if len(rows) > LISTED else ""
    record.breaks[rows] = True
    record.derived.clear()
    record.fixed(
        "pose_jumps",
        f"the pose jumps {len(rows)} times, by up to {largest[0]:.3g} m and "
        f"{np.rad2deg(largest[1]):.3g} deg from one row to the next",
        ", ".join(record.place(int(row)) for row in rows[:LISTED]) + more,
        "the log is split there",
    )


def _limit(steps: np.ndarray, least: float) -> float:
    """Step beyond which a pose has jumped: far above what motion and slow sensors make."""
    moving = steps[steps > 0]
    return max(FAR * float(np.percentile(moving, 99)), least) if len(moving) else np.inf
