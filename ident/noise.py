"""Noise of the measured signals: how large it is, and what it does to a fit by simulation.

A simulation is driven by the measured torques, so their noise shakes it where the robot was not
shaken.  Laws that are not linear (a dead zone, friction near standstill, a spring) answer to that
with a mean of their own, and a fit of the simulation mistakes it for parameters.  The bias grows
with the variance of the noise: as much noise once more shifts the estimates by as much again, which
tells what to take back (simulation extrapolation, Cook and Stefanski 1994).

Laws that read the wheel angle get the integral of the measured speeds.  Its error is a random walk
that lasts over all windows, so no scatter between windows shows it.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from ident.dead_reckoning import wheel_speeds
from ident.instruments import FILTER
from ident.log import Log

if TYPE_CHECKING:  # which simulates what this module knows the noise of
    from ident.sensitivity import Linearised

# White noise becomes this much larger in second differences: 1 + 4 + 1.
AMPLIFIED = 6.0
# Median of |x| of a normal variable in standard deviations.
MEDIAN = 0.6745


def second_differences(log: Log, signal: np.ndarray) -> np.ndarray:
    """(N', k) second differences of a signal (N, k) inside the contiguous pieces of a log."""
    return np.concatenate([np.diff(signal[a:b], 2, axis=0) for a, b in log.spans])


def spread(values: np.ndarray) -> np.ndarray:
    """(...) standard deviations of normal values (N, ...), robust against steps."""
    return np.median(np.abs(values), axis=0) / MEDIAN


def white_variance(log: Log, signal: np.ndarray) -> np.ndarray:
    """(k,) variances of the white part of a signal (N, k)."""
    return spread(second_differences(log, signal)) ** 2 / AMPLIFIED


# Share of what noise does to an estimate that is not known once it is taken back.
DOUBTED = 0.5


def speed_variance(log: Log) -> np.ndarray:
    """(n,) variances of the noise of the wheel speeds, (rad/s)^2.

    A filter that the log states has passed the noise too, of which second differences then show
    less: ``6 - 8 a + 2 a^2`` variances with ``a = exp(-dt / T)``.
    """
    if log.speed_noise is not None:
        return log.speed_noise**2
    variance = white_variance(log, log.wheel_velocity)
    lag = log.recording.get(FILTER, {}).get("T", 0.0)
    if lag <= 0.0:
        return variance
    keep = np.exp(-log.dt / lag)
    return variance * AMPLIFIED / (6.0 - 8.0 * keep + 2.0 * keep**2)


# What is beyond so many spreads is a step and no noise.
STEP = 4.0


def noisier_speeds(log: Log) -> Iterator[Log]:
    """A log with as much noise as its own in its speeds, and what wheel loops make of it, twice.

    Where a row of the drive shows an instant, the torque that answers an error of the encoders was
    not felt as long as the row lasts, but is there in the same row as that error.
    """
    shown = "wheel_velocity" if log.body_velocity is None else "body_velocity"
    speed, rng = getattr(log, shown), np.random.default_rng(0)
    noise = np.sqrt(white_variance(log, speed)) * rng.normal(size=speed.shape)
    drive = {}
    if log.drive == "torque" and shown == "wheel_velocity":
        gain, _ = _loops(log)
        before = np.concatenate([np.zeros((1, noise.shape[1])), noise[:-1]])
        drive["wheel_torque"] = gain[:, 0] * noise + gain[:, 1] * before
    for sign in (1.0, -1.0):
        changes = {shown: noise} | drive
        yield replace(log, **{k: getattr(log, k) + sign * n for k, n in changes.items()})


def torque_noise(log: Log) -> np.ndarray:
    """(n,) standard deviations of the noise of the measured torques, N m.

    Fast changes that do not follow from the measured wheel speeds: what the wheel loops make of the
    noise of their encoders is a torque that the robot felt, where rows are held.  Voltages are
    known as commanded.
    """
    if log.drive != "torque":
        return np.zeros(log.command.shape[1])
    if log.drive_noise is not None:
        return log.drive_noise
    return _loops(log)[1]


def _loops(log: Log) -> tuple[np.ndarray, np.ndarray]:
    """What wheel loops make of noise: gains (n, 2) on the speeds of a row and the one before.

    And (n,) spreads of the white part of torques that is no linear function of the speeds.
    """
    torque = second_differences(log, log.command)
    speed = second_differences(log, wheel_speeds(log))
    found = [
        _answer(torque[1:, k], np.stack([speed[1:, k], speed[:-1, k]], axis=1))
        for k in range(torque.shape[1])
    ]
    return np.array([gain for gain, _ in found]), np.array([left for _, left in found])


def _answer(torque: np.ndarray, speeds: np.ndarray) -> tuple[np.ndarray, float]:
    usual = np.all([np.abs(x) <= STEP * spread(x) for x in (torque, *speeds.T)], axis=0)
    if not np.all(spread(speeds)):  # speeds without noise, or in steps coarser than it
        return np.zeros(2), float(spread(torque) / np.sqrt(AMPLIFIED))
    if np.count_nonzero(usual) < 2 * speeds.shape[1]:
        return np.zeros(2), 0.0
    gain = np.linalg.lstsq(speeds[usual], torque[usual])[0]
    return gain, float(spread(torque - speeds @ gain) / np.sqrt(AMPLIFIED))


def drifted(sim: Linearised, rng: np.random.Generator) -> Linearised:
    """The log simulated once more, with wheel angles as wrong as integrated noise makes them."""
    if not len(sim.windows.angles):
        return sim
    log, speed = sim.log, wheel_speeds(sim.log)
    noise = np.sqrt(white_variance(log, speed)) * rng.normal(size=speed.shape)
    walk = np.cumsum(noise * np.gradient(log.time)[:, None], axis=0)
    rows = (sim.windows.index - 1).ravel()
    windows = replace(sim.windows, angles=sim.windows.angles + walk[rows].T)
    after = windows.simulate(sim.model.values())
    return replace(sim, windows=windows, states=np.concatenate([sim.states[:, :1], after], axis=1))
