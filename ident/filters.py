"""First-order filters of sampled signals, exact for the way each signal lives between samples.

``F = a / (p + a)`` with p the derivative (paper eq. 8).  Velocities run straight from sample to
sample (first-order hold), torque commands are held (zero-order hold).  A zero-order hold on
velocities would bias the wheel inertia by 11 % at 100 Hz.  Sample times may vary.
"""

from __future__ import annotations

import numpy as np
from scipy.linalg.blas import dtbsv  # ty: ignore[missing-module-member]

# Steps whose lengths differ by less than this share one recursion; a larger spread is jitter.
UNIFORM = 1e-6


class FirstOrderFilter:
    """``a / (p + a)`` on one time grid; what depends on the grid alone is computed once.

    Args:
        time: (N,) s, strictly rising.
        corner: a, rad/s.
    """

    def __init__(self, time: np.ndarray, corner: float):
        step = np.diff(time)
        self.corner, self.decay = corner, np.exp(-corner * step)
        mean = -np.expm1(-corner * step) / (corner * step)
        self._before, self._after = mean - self.decay, 1.0 - mean
        if np.ptp(step) < UNIFORM * step.mean():
            # One number instead of an array: cheaper, and the recursion is then a plain filter.
            self.decay = float(self.decay.mean())
            self._before, self._after = float(self._before.mean()), float(self._after.mean())

    def hold(self, begin: np.ndarray, end: np.ndarray, start=0.0) -> np.ndarray:
        """Filter a signal that runs straight within each interval and may jump at the samples.

        Args:
            begin, end: (N-1, ...) values at the beginning and the end of each interval.
            start: filter state at the first sample.

        Returns:
            (N, ...) filtered samples.
        """
        drive = _scaled(begin, self._before) + _scaled(end, self._after)
        return recursion(drive, self.decay, start)

    def linear(self, u: np.ndarray, start=0.0) -> np.ndarray:
        """Filter a signal (N, ...) that runs straight from sample to sample (velocities)."""
        return self.hold(u[:-1], u[1:], start)

    def rate(self, u: np.ndarray) -> np.ndarray:
        """Filtered time derivative ``F u' = a (u - F u)`` of a signal that runs straight.

        Its state starts at zero, as that of ``linear`` does, so that equations in u and u' hold
        exactly from the first sample on.
        """
        return self.corner * (u - self.linear(u, start=u[0]))


def linear_hold(u: np.ndarray, time: np.ndarray, a: float, start: np.ndarray | float = 0.0):
    """Filter a signal (N, ...) that runs straight from sample to sample (velocities)."""
    return FirstOrderFilter(time, a).linear(u, start)


def delayed_hold(u: np.ndarray, time: np.ndarray, delay: float) -> np.ndarray:
    """Mean over each sample interval of a held signal that arrives ``delay`` seconds late.

    Returns:
        (N, ...) values which, held from sample to sample, carry the same impulse in every interval.
    """
    if delay == 0.0:
        return u
    step = np.diff(time)
    impulse = np.concatenate(
        [np.zeros((1, *u.shape[1:])), np.cumsum(_scaled(u[:-1], step), axis=0)]
    )
    late = time - delay
    index = np.clip(np.searchsorted(time, late, side="right") - 1, 0, len(time) - 2)
    inside = late - time[index]
    shifted = impulse[index] + _scaled(u[index], inside)
    mean = np.diff(shifted, axis=0) / step.reshape((-1,) + (1,) * (u.ndim - 1))
    return np.concatenate([mean, mean[-1:]])


def _scaled(u: np.ndarray, factor: np.ndarray | float) -> np.ndarray:
    if np.ndim(factor) == 0 or u.ndim == 1:
        return u * factor
    return u * factor.reshape((-1,) + (1,) * (u.ndim - 1))


def recursion(drive: np.ndarray, decay: np.ndarray | float, start=0.0) -> np.ndarray:
    """Run ``s[k+1] = decay[k] s[k] + drive[k]`` (N, ...) from ``s[0] = start``: (N + 1, ...)."""
    first = np.broadcast_to(np.asarray(start, float), drive.shape[1:])
    result = np.empty((len(drive) + 1, *drive.shape[1:]))
    result[0] = first
    if len(drive) == 0:
        return result
    if np.ndim(decay) == 0:
        result[1:] = drive
        result[1:2] += decay * first
        # Forward substitution in a matrix of two diagonals; scipy.signal takes a second to import.
        band = np.empty((2, len(drive)), order="F")
        band[0], band[1] = 1.0, -decay
        for column in result.reshape(len(result), -1).T:
            column[1:] = dtbsv(1, band, column[1:], lower=1, diag=1)
    else:
        _varying(drive, decay, result)
    return result


def _varying(drive: np.ndarray, decay: np.ndarray, result: np.ndarray) -> None:
    """Recursion with a decay of its own at every step, by blocks.

    Within a block the recursion is a weighted cumulative sum; blocks are short enough that the
    weights, products of decays, stay far from underflow.
    """
    logs = np.log(decay)
    longest = max(1, int(30.0 / max(-logs.min(), 1e-12)))
    shape = (-1,) + (1,) * (result.ndim - 1)
    for begin in range(0, len(drive), longest):
        end = min(begin + longest, len(drive))
        weight = np.exp(np.cumsum(logs[begin:end])).reshape(shape)
        total = np.cumsum(drive[begin:end] / weight, axis=0)
        result[begin + 1 : end + 1] = weight * (result[begin] + total)
