"""How far odometry runs away from the pose: per metre and per turn."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

import numpy as np

from ident.kinematics.windows import Windows, cut_windows, integrate, rotate
from ident.log import Log

# Windows are long enough for a drift to show beside the noise of the pose.
WINDOW = 10.0
# Poses are averaged over this time at either end, s, odometry taken out.
AVERAGE = 0.5


@dataclass(frozen=True)
class Drift:
    """Error of odometry started at the measured pose, at the end of windows and of the log.

    Attributes:
        position_per_metre: sum of the windows' position errors over the way driven in them.
        heading_per_turn: sum of the windows' heading errors, rad, over the turns made in them,
            either way round; None where the robot did not make a tenth of a turn.
        windows: how many there were.
        position, heading: error at the end of the longest contiguous piece, m and rad.
        way, turns: way driven and turns made in that piece, m and turns.
    """

    position_per_metre: float
    heading_per_turn: float | None
    windows: int
    position: float
    heading: float
    way: float
    turns: float

    def as_dict(self) -> dict[str, float | int | None]:
        """Return what JSON shows."""
        return asdict(self)


def measure_drift(log: Log, odometry: np.ndarray, mount: np.ndarray) -> Drift:
    """Follow a log by its wheels alone.

    Args:
        log: with wheel speeds and pose.
        odometry: (3, n) matrix W of ``v = W phi'``.
        mount: where the pose sensor sits and how late it is; the same for every W that is compared.

    Raises:
        ValueError: the log is too short.
    """
    whole = cut_windows(log, None)
    length = min(WINDOW, float(whole.time[0, -1] - whole.time[0, 0]))
    position, heading, way, turns = _follow(cut_windows(log, length), odometry, mount)
    last = [float(part[0]) for part in _follow(whole, odometry, mount)]
    if way.sum() <= 0.0:
        raise ValueError(f"log {log.name!r}: the wheels do not move")
    return Drift(
        float(position.sum() / way.sum()),
        float(heading.sum() / turns.sum()) if turns.sum() > 0.1 else None,
        len(way),
        *last,
    )


def _follow(windows: Windows, odometry: np.ndarray, mount: np.ndarray) -> tuple:
    """Position and heading errors at the end, way and turns of each window, (W,) each."""
    step, speed = np.diff(windows.time, axis=1), windows.speed(mount[3])
    moved = integrate(step, speed, odometry, slopes=False)
    few = max(1, min(round(AVERAGE / float(np.median(step))), windows.time.shape[1] // 4))
    first, last = slice(None, few), slice(-few, None)
    ahead = windows.pose[..., 2] - moved.yaw
    start = ahead[:, first].mean(axis=1)
    there = moved.place + rotate(moved.yaw) @ mount[:2]
    there = np.einsum("wab,wkb->wka", rotate(start - mount[2]), there)
    gap = windows.pose[..., :2] - there
    gap = gap[:, last].mean(axis=1) - gap[:, first].mean(axis=1)
    rate = 0.5 * np.abs(moved.velocity[:, 1:] + moved.velocity[:, :-1])
    way = np.sum(np.hypot(rate[..., 0], rate[..., 1]) * step, axis=1)
    turns = np.sum(rate[..., 2] * step, axis=1) / (2 * math.pi)
    return np.hypot(*gap.T), np.abs(ahead[:, last].mean(axis=1) - start), way, turns
