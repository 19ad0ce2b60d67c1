"""The windows of the free run in which a model goes most astray, as motions that can be played."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.integrate import cumulative_trapezoid

from ident.free_run import FreeRun
from ident.log import Log
from youbot_env.backend import NUMPY
from youbot_env.stepping import pose_rate

WORST = 5
# Fewer windows than this give no interval.
LEAST_WINDOWS = 4


@dataclass(frozen=True)
class Stretch:
    """One window of a free run.

    Attributes:
        window: its number.
        start, end: s from the start of the log.
        log: name of the record it lies in.
        nrmse: free-run error within it, as a share of the signals' rms over the whole log.
        share_of_error: of the squared error of all windows.
        rmse: (3,) m/s, m/s, rad/s.
    """

    window: int
    start: float
    end: float
    nrmse: float
    share_of_error: float
    rmse: np.ndarray
    log: str

    def as_dict(self) -> dict[str, Any]:
        """Return what JSON shows."""
        vx, vy, yaw = (float(v) for v in self.rmse)
        return {
            "log": self.log,
            "start": self.start,
            "end": self.end,
            "nrmse": self.nrmse,
            "share_of_error": self.share_of_error,
            "free_run": {"vx": vx, "vy": vy, "yaw_rate": yaw},
        }


def window_errors(run: FreeRun) -> np.ndarray:
    """(W,) squared error of each window, in units of the signals' variance; its mean is nrmse^2."""
    spread = run.measured.std(axis=0)
    moving = spread > 1e-9
    scaled = ((run.simulated - run.measured)[:, moving] / spread[moving]) ** 2
    count = np.bincount(run.window)
    return np.bincount(run.window, scaled.mean(axis=1)) / count


def worst_stretches(log: Log, run: FreeRun, count: int = WORST) -> tuple[Stretch, ...]:
    """The windows with most error, worst first: ``count``, but no more than half of them."""
    squared = window_errors(run)
    found = []
    for number in np.argsort(-squared)[: min(count, (len(squared) + 1) // 2)]:
        rows = run.window == number
        time = run.time[rows] - log.time[0]
        error = run.simulated[rows] - run.measured[rows]
        found.append(
            Stretch(
                int(number),
                float(time[0]),
                float(time[-1]),
                float(np.sqrt(squared[number])),
                float(squared[number] / squared.sum()),
                np.sqrt(np.mean(error**2, axis=0)),
                log.run_name(int(log.run_of(run.time[rows][0]))),
            )
        )
    return tuple(found)


def track(time: np.ndarray, velocity: np.ndarray, start=(0.0, 0.0, 0.0)) -> np.ndarray:
    """Poses (N, 3), m, m, rad, of a body that leaves ``start`` with body velocities (N, 3)."""
    yaw = start[2] + cumulative_trapezoid(velocity[:, 2], time, initial=0.0)
    rate = pose_rate(tuple(velocity.T), yaw, NUMPY)
    along = cumulative_trapezoid(np.stack(rate[:2], axis=1), time, axis=0, initial=0.0)
    return np.column_stack([along + start[:2], yaw])


def start_pose(log: Log, time: float) -> tuple[float, float, float]:
    """Measured pose at a time of the log's own clock; the origin where none was measured."""
    if log.pose is None:
        return 0.0, 0.0, 0.0
    return tuple(float(v) for v in log.pose[np.searchsorted(log.time, time)])
