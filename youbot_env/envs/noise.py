"""Noise of the observation, drawn in blocks from the generator of the episode.

Blocks keep the draws of a vector environment cheap while each copy keeps a generator of its own,
so that it sees the same noise as a single environment with that seed.
"""

from __future__ import annotations

import numpy as np

from youbot_env.platform import Platform
from youbot_env.simulation import Sensors

BLOCK = 64


def noise_scale(sensors: Sensors, platform: Platform) -> np.ndarray:
    """Standard deviations of (ahead, left, yaw, V_X, V_Y, Omega), (6,).

    Body velocities are least squares over the wheels, so their covariance is that of the wheel
    speeds times ``(J'J)^-1``.
    """
    jacobian = platform.jacobian_array
    velocity = sensors.wheel_velocity * np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    return np.array([sensors.position, sensors.position, sensors.yaw, *velocity])


def noise_block(scale: np.ndarray, rng: np.random.Generator) -> np.ndarray:
    """The next ``BLOCK`` noise samples of one episode, (BLOCK, 6)."""
    return rng.normal(size=(BLOCK, 6)) * scale
