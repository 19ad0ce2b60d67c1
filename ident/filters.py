"""First-order filters of sampled signals, exact for the way each signal lives between samples.

``F = a / (p + a)`` with p the derivative (paper eq. 8).  Velocities run straight from sample to
sample (first-order hold), torque commands are held (zero-order hold).  A zero-order hold on
velocities would bias the wheel inertia by 11 % at 100 Hz.  Sample times may vary.
"""

from __future__ import annotations

import numpy as np
from scipy.signal import lfilter

# Steps whose lengths differ by less than this share one recursion; a larger spread is jitter.
UNIFORM = 1e-6


def interval_hold(
    begin: np.ndarray, end: np.ndarray, time: np.ndarray, a: float, start: np.ndarray | float = 0.0
) -> np.ndarray:
    """Filter a signal that runs straight within each interval and may jump at the samples.

    Args:
        begin, end: (N-1, ...) values at the beginning and the end of each interval.
        time: (N,) s.
        a: corner of the filter, rad/s.
        start: filter state at the first sample.

    Returns:
        (N, ...) filtered samples.
    """
    step = np.diff(time)
    decay = np.exp(-a * step)
    mean = -np.expm1(-a * step) / (a * step)
    drive = _scaled(begin, mean - decay) + _scaled(end, 1.0 - mean)
    return _recursion(drive, decay, start)


def linear_hold(u: np.ndarray, time: np.ndarray, a: float, start: np.ndarray | float = 0.0):
    """Filter a signal (N, ...) that runs straight from sample to sample (velocities)."""
    return interval_hold(u[:-1], u[1:], time, a, start)


def zero_hold(u: np.ndarray, time: np.ndarray, a: float, start: np.ndarray | float = 0.0):
    """Filter a signal (N, ...) that keeps each sample's value until the next (torques)."""
    return interval_hold(u[:-1], u[:-1], time, a, start)


def linear_hold_rate(u: np.ndarray, time: np.ndarray, a: float) -> np.ndarray:
    """Filtered time derivative ``F u' = a (u - F u)`` of a signal that is linear between samples.

    Its state starts at zero, as that of ``linear_hold`` does, so that equations in u and u' hold
    exactly from the first sample on.
    """
    return a * (u - linear_hold(u, time, a, start=u[0]))


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


def _scaled(u: np.ndarray, factor: np.ndarray) -> np.ndarray:
    return u * factor.reshape((-1,) + (1,) * (u.ndim - 1))


def _recursion(drive: np.ndarray, decay: np.ndarray, start) -> np.ndarray:
    """Run ``s[k+1] = decay[k] s[k] + drive[k]`` from ``s[0] = start``."""
    first = np.broadcast_to(np.asarray(start, float), drive.shape[1:])
    result = np.empty((len(drive) + 1, *drive.shape[1:]))
    result[0] = first
    if np.ptp(decay) < UNIFORM * decay.mean():
        keep = float(decay.mean())
        result[1:] = lfilter([1.0], [1.0, -keep], drive, axis=0, zi=keep * first[None])[0]
        return result
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
