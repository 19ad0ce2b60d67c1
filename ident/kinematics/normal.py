"""Normal equations of the kinematic values: pose against odometry, and wheels against each other.

Everything is kept by clusters, stretches of time whose residuals are independent of each other.
"""

from __future__ import annotations

import numpy as np

from ident.estimators import CLUSTERS
from ident.kinematics.wheels import rolling
from ident.kinematics.windows import MOUNT, Windows
from ident.pooling import MANY_RUNS
from youbot_env.platform import Platform

# What could plausibly be: radii and base 5 %, roller angle 3 degrees; offsets 0.2 m and 12
# degrees; delay 0.1 s.
PLAUSIBLE, PLAUSIBLE_MOUNT = 0.05, (0.2, 0.2, 0.2, 0.1)
ROUNDING = 1e-9  # a record without noise still has it: m, rad, rad/s


class Normal:
    """Sums of squares and products at given values, by G clusters.

    Args:
        windows: the log.
        platform: nominal wheel table.
        values: (p,) kinematic values, then the mount.

    Attributes:
        rolling: kinematics at the values.
        noise: rms of what is left: position m, yaw rad, contradiction of the wheels rad/s.
    """

    def __init__(self, windows: Windows, platform: Platform, values: np.ndarray):
        count = len(platform.wheels)
        self.wheels, self.radius = count, platform.wheel_radius
        self.rolling = rolling(platform, values[: count + 2])
        residual, design, nuisance = windows.residual(self.rolling.odometry, values[count + 2 :])
        fresh = windows.fresh[..., None]
        left = _project(residual[..., None], nuisance, fresh * np.ones(3))[..., 0] * fresh
        squares = np.sum(left**2, axis=(0, 1)) / fresh.sum()
        place, yaw = np.sqrt(squares[:2].mean()), np.sqrt(squares[2])
        speed = windows.speed(0.0)
        contrary = speed @ self.rolling.contradiction.T
        slip = np.sqrt(np.mean(np.sum(contrary**2, axis=2)) / max(count - 3, 1))
        self.noise = (float(place), float(yaw), float(slip))

        weight = fresh / (np.array([place, place, yaw]) + ROUNDING) ** 2
        design = _project(design, nuisance, weight)
        groups = _independent(windows)
        self._pose = _by_group(_gram(design, design * weight[..., None]), groups)
        self._score = _by_group(np.einsum("wkab,wka->wb", design, residual * weight), groups)
        self._speed = None
        if count > 3:
            self._speed = _by_group(_gram(speed, speed) / (slip + ROUNDING) ** 2, groups)

    def sums(self, scale: np.ndarray, free: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Information (G, p, p) and scores (G, p) of all values in scaled units.

        Args:
            scale: (p,) units.
            free: append the 3 n entries of J, in units of 5 % of 1 / R.
        """
        count, mount, slopes = self.wheels, len(MOUNT), self.rolling
        kinematic = count + 2
        size, unit = kinematic + mount, scale
        if free:
            unit = np.append(scale, np.full(3 * count, PLAUSIBLE / self.radius))
        chain = np.zeros((3 * count + mount, len(unit)))
        chain[: 3 * count, :kinematic] = slopes.odometry_slope
        chain[3 * count :, kinematic:size] = np.eye(mount)
        parts = np.zeros((len(unit), count, count))
        parts[:kinematic] = slopes.contradiction_slope.T.reshape(-1, count, count)
        if free:
            chain[: 3 * count, size:] = slopes.odometry_free
            parts[size:] = slopes.contradiction_free.T.reshape(-1, count, count)
        information = chain.T @ self._pose @ chain
        score = self._score @ chain
        if self._speed is not None:
            # Each sample says P phi' = 0; the slope by a value is (dP/dp) phi'.
            seen = np.einsum("pai,gij->gpaj", parts, self._speed)
            information = information + np.einsum("gpaj,qaj->gpq", seen, parts)
            score = score - np.einsum("gpaj,aj->gp", seen, slopes.contradiction)
        return information * unit[:, None] * unit, score * unit


def _independent(windows: Windows) -> list[np.ndarray]:
    """Windows of each cluster: stretches of time, of many logs each one."""
    number = np.arange(len(windows.run))
    runs, begin = np.unique(windows.run, return_index=True)
    if len(runs) >= MANY_RUNS:
        return np.split(number, begin[1:])
    return np.array_split(number, min(CLUSTERS, len(number)))


def _gram(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Products of columns within each window, (W, ..., p) and (W, ..., q) to (W, p, q)."""
    tall, other = (part.reshape(len(part), -1, part.shape[-1]) for part in (left, right))
    return tall.transpose(0, 2, 1) @ other


def _by_group(values: np.ndarray, groups: list[np.ndarray]) -> np.ndarray:
    return np.array([values[group].sum(axis=0) for group in groups])


def _project(columns: np.ndarray, nuisance: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Take the heading at the start of each window out of columns (W, K, 3, m)."""
    weighted = weight * nuisance
    size = np.einsum("wka,wka->w", weighted, nuisance)
    share = np.einsum("wka,wkam->wm", weighted, columns) / size[:, None]
    return columns - nuisance[..., None] * share[:, None, None, :]
