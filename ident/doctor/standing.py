"""What other channels say of a wheel that stands: a wheel may stand by command.

A diagonal of a mecanum platform, a wheel of an omni platform that is driven along its axle, stand
still all the time while the others turn.  Only what says that it should have moved makes it stuck.
"""

from __future__ import annotations

import numpy as np

from ident.doctor.record import Record
from ident.doctor.smoothing import WINDOW

STILL = 0.1  # of the rms of the busiest wheel by the same witness: less is no motion
LEVEL = 0.3  # of that rms, by which a steady speed may differ from what is shown


class Standing:
    """Speeds of wheels by everything but their own sensors."""

    def __init__(self, record: Record):
        self.speed = record.get("wheel_velocity")
        self.J = record.platform.jacobian_array
        self.witnesses = [motion @ self.J.T for motion in witnessed(record)]
        self.left = np.linalg.svd(self.J)[0][:, 3:]

    def excused(self, channel: str, column: int, begin: int, end: int, value: float) -> bool:
        """Whether a column may well have stood at a value in rows ``[begin, end)``."""
        if channel != "wheel_velocity":  # a wheel at rest may need no torque
            if self.speed is None:
                return False
            size = float(np.sqrt(np.mean(self.speed**2, axis=0)).max())
            return _rms(self.speed[begin:end, column]) < STILL * size
        known = [(shown[:, column], shown) for shown in self.witnesses]
        if self.left.shape[1] == 1:
            known.append((self._rolled(column), self.speed))
        if not known:
            return value == 0
        return any(_stands(own[begin:end], value, _busiest(shown)) for own, shown in known)

    def _rolled(self, column: int) -> np.ndarray:
        """(N,) speed of a wheel by the others, where four wheels roll together."""
        left = self.left[:, 0].copy()
        own, left[column] = left[column], 0.0
        return -self.speed @ left / own


def witnessed(record: Record) -> list[np.ndarray]:
    """(N, 3) body velocities by command, sensor and pose; units do not matter."""
    found = [record.channels[c] for c in ("reference", "body_velocity") if c in record.channels]
    pose = record.get("pose")
    if pose is not None:
        rows = np.arange(len(pose))
        half = max(1, round(WINDOW / record.dt))
        a, b = np.maximum(rows - half, 0), np.minimum(rows + half, len(pose) - 1)
        change = (pose[b] - pose[a]) / (record.time[b] - record.time[a])[:, None]
        c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
        found.append(
            np.column_stack(
                [c * change[:, 0] + s * change[:, 1], c * change[:, 1] - s * change[:, 0],
                 change[:, 2]]
            )
        )  # fmt: skip
    return [motion for motion in found if np.any(motion)]


def _stands(own: np.ndarray, value: float, size: float) -> bool:
    """Whether a witness says that a wheel stood, or turned steadily as it shows."""
    if value == 0:
        return _rms(own) < STILL * size
    return float(np.std(own)) < STILL * size and abs(float(np.mean(own)) - value) < LEVEL * size


def _busiest(speeds: np.ndarray) -> float:
    return float(np.sqrt(np.mean(speeds**2, axis=0)).max())


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))
