"""Noise of the observation, a function of the step and of numbers drawn once an episode.

A hash of both makes it: each step's noise can be computed by itself, for one robot or for many at
once, and a vector environment sees in each copy what a single one with that seed sees.
"""

from __future__ import annotations

import math

import numpy as np

from youbot_env.backend import NUMPY, Ops
from youbot_env.platform import Platform
from youbot_env.simulation import Sensors

BLOCK = 64
KEYS = 2  # numbers that an episode draws for its noise


def noise_scale(sensors: Sensors, platform: Platform) -> np.ndarray:
    """Standard deviations of (ahead, left, yaw, V_X, V_Y, Omega), (6,).

    Body velocities are least squares over the wheels, so their covariance is that of the wheel
    speeds times ``(J'J)^-1``.
    """
    jacobian = platform.jacobian_array
    velocity = sensors.wheel_velocity * np.sqrt(np.diag(np.linalg.inv(jacobian.T @ jacobian)))
    return np.array([sensors.position, sensors.position, sensors.yaw, *velocity])


def noise_keys(numbers, ops: Ops) -> tuple:
    """Keys of the noise of an episode, uint32, from ``KEYS`` numbers drawn in [0, 1)."""
    return tuple(ops.bits(number * 2.0**32) for number in numbers)


def noise_block(scale: np.ndarray, keys: tuple, begin: int) -> np.ndarray:
    """Noise of ``BLOCK`` steps of one episode from step ``begin`` on, (BLOCK, 6)."""
    steps = np.arange(begin, begin + BLOCK, dtype=np.uint32)
    keys = tuple(np.array([key], np.uint32) for key in keys)
    return np.stack(noise(scale.tolist(), keys, steps, NUMPY), axis=1)


def noise(scale, keys: tuple, step, ops: Ops) -> tuple:
    """Normal noise of one step, as many components as ``scale`` has standard deviations.

    Args:
        scale: standard deviations, an even number.
        keys: of the episode, two components, uint32.
        step: number of the step, uint32.
        ops: elementary functions.
    """
    place = _mixed(_mixed(keys[0] + step * 0x9E3779B9) ^ keys[1])
    drawn = [_mixed(place + (k + 1) * 0x85EBCA6B % 2**32) for k in range(len(scale))]
    # 23 bits and a half: in (0, 1), and exact in single precision.
    shares = [ops.coarse(ops.real(bits >> 9)) * 2.0**-23 + 2.0**-24 for bits in drawn]
    values = []
    for k in range(0, len(scale), 2):  # Box and Muller, two at a time
        length = ops.sqrt(-2.0 * ops.log(shares[k]))
        c, s = ops.cos_sin(2.0 * math.pi * shares[k + 1])
        values += [scale[k] * length * c, scale[k + 1] * length * s]
    return tuple(values)


def _mixed(bits):
    """A hash of 32 bits in which every bit of the argument changes half of the result's.

    Constants: C. Wellons, "Prospecting for hash functions" (2018), and its later search.
    """
    bits = (bits ^ (bits >> 16)) * 0x21F0AAAD
    bits = (bits ^ (bits >> 15)) * 0xD35A2D97
    return bits ^ (bits >> 15)
