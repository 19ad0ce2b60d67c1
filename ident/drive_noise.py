"""Noise of the drive's record that lasts: where wheels press against each other it stands alone.

More wheels than freedoms leave combinations of torques that move nothing.  A robot that rolls
ideally feels none of them, so what its record holds of them, and no function of the motion
explains, is noise of the record: of the same size as in the torques that move the robot, where no
residual could tell it from physics.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import null_space
from scipy.optimize import nnls

from ident.contradiction import wheels_agree
from ident.filters import recursion
from ident.log import Log
from ident.noise import torque_noise

# Lags at which the noise is compared with itself, s; white noise has nothing at any of them.
LAGS = (0.02, 0.03, 0.04, 0.06, 0.08, 0.12, 0.16, 0.24, 0.32, 0.48, 0.64, 0.96)
# Correlation times that are tried, s.
TIMES = np.geomspace(0.02, 0.5, 17)
# What the motion leaves in such torques is smooth over these times, s, or lasts: integrators of the
# loops drift, limits of the torque are met for a while.
SMOOTH = (1.0, np.inf)
# Speed over which a dry force changes its sign, in rms wheel speeds.
DRY = 0.05
# Of eleven simulated records without lasting noise the largest variance that seemed to last was
# 0.06 of the white one, made by loops that answer to the noise of the wheel speeds.
SMALLEST = 0.15
# Drawings of noise; each serves twice, with either sign, so that all but the bias cancels.
PAIRS = 2


@dataclass(frozen=True)
class LastingNoise:
    """First-order noise of every wheel's torque.

    Attributes:
        size: standard deviation, N m.
        time: correlation time, s.
    """

    size: float
    time: float

    def __str__(self) -> str:
        return f"{self.size:.2g} N m over {self.time:.2g} s"

    def draw(self, steps: np.ndarray, wheels: int, rng: np.random.Generator) -> np.ndarray:
        """(n, W L) torques, N m, in W windows of steps (W, L), s."""
        windows, length = steps.shape
        keep = np.exp(-float(np.median(steps)) / self.time)
        white = rng.normal(size=(wheels * windows, length))
        white[:, 1:] *= np.sqrt(1.0 - keep**2)
        return self.size * recursion(white.T, keep)[1:].T.reshape(wheels, -1)


NO_NOISE = LastingNoise(0.0, 1.0)


def lasting_noise(log: Log) -> LastingNoise:
    """Estimate it; none where no combination of torques is free of the motion, or wheels slip.

    With real rollers, slip or unequal radii such torques do move something, and are no noise.
    """
    # Every floor and every refinement of a diagnosis asks for it.
    return log.memo.of(("lasting noise",), lambda: _lasting_noise(log))


def _lasting_noise(log: Log) -> LastingNoise:
    """The same, worked out."""
    free = null_space(log.platform.jacobian_array.T)
    if free.shape[1] == 0 or not wheels_agree(log, whole=True):
        return NO_NOISE
    left = _unexplained(log, log.command @ free)
    steps = [max(1, round(lag / log.dt)) for lag in LAGS]
    shared = np.array([_product(log, left, step) for step in steps])
    lags = np.array(steps) * log.dt
    motion = np.exp(-0.5 * (lags[:, None] / SMOOTH) ** 2)
    fits = [nnls(np.column_stack([np.exp(-lags / time), motion]), shared) for time in TIMES]
    best = int(np.argmin([misfit for _, misfit in fits]))
    parts = fits[best][0]
    white = max(_product(log, left, 0) - parts.sum(), 0.0)
    if parts[0] < SMALLEST * white:
        return NO_NOISE
    return LastingNoise(float(np.sqrt(parts[0])), float(TIMES[best]))


def _unexplained(log: Log, torque: np.ndarray) -> np.ndarray:
    """Torques (N, k) less what functions of the motion and of the moving torques explain."""
    speed = log.velocity() @ log.platform.jacobian_array.T
    dry = np.tanh(speed / max(DRY * float(speed.std()), 1e-9))
    jacobian = log.platform.jacobian_array
    moving = log.command @ jacobian @ np.linalg.pinv(jacobian)
    columns = np.column_stack([np.ones(len(speed)), speed, dry, np.abs(speed) * speed, moving])
    return torque - columns @ np.linalg.lstsq(columns, torque)[0]


def _product(log: Log, values: np.ndarray, step: int) -> float:
    """Mean product of values (N, k) with themselves ``step`` rows later."""
    pairs = [values[a : b - step] * values[a + step : b] for a, b in log.spans]
    return float(np.concatenate(pairs).mean())


def noisier(logs: list[Log], pairs: int = PAIRS) -> Iterator[list[Log]]:
    """Logs with noise as theirs added to the torques, in pairs with either sign; none without.

    Noise that lasts shakes a light robot more than a heavy one, so a simulation that is shaken
    prefers the heavy one, and a clock that makes up for it: by 25 to 30 ms where 0.03 N m lasted
    0.15 s, of which this tells half.
    """
    spreads, lasts = [torque_noise(log) for log in logs], [lasting_noise(log) for log in logs]
    if not any(np.any(spread) for spread in spreads) and not any(one.size for one in lasts):
        return
    rng = np.random.default_rng(0)
    for _ in range(pairs):
        noise = [s * rng.normal(size=log.command.shape) for log, s in zip(logs, spreads,
                 strict=True)]  # fmt: skip
        for k, (log, one) in enumerate(zip(logs, lasts, strict=True)):
            if one.size:
                steps = np.full((1, len(log.time)), log.dt)
                noise[k] = noise[k] + one.draw(steps, log.command.shape[1], rng).T
        for sign in (1.0, -1.0):
            yield [_with_noise(log, sign * n) for log, n in zip(logs, noise, strict=True)]


def _with_noise(log: Log, noise: np.ndarray) -> Log:
    return log if log.drive != "torque" else replace(log, wheel_torque=log.wheel_torque + noise)
