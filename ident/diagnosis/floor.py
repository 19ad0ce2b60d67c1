"""How small the free-run error of a log could be: what its sensors' noise alone leaves."""

from __future__ import annotations

import numpy as np
from scipy.linalg import null_space

from ident.log import Log
from ident.output_error import settled
from ident.sensitivity import Linearised

# White noise becomes this much larger in second differences: 1 + 4 + 1.
AMPLIFIED = 6.0
# Median of |x| of a normal variable in standard deviations.
MEDIAN = 0.6745
# Mean squared contradiction of the wheels, in units of their noise, from which they disagree.
CONTRADICTION = 2.0


def noise_floor(sim: Linearised, weights: np.ndarray) -> tuple[float, np.ndarray]:
    """Mean squared free-run error from the noise of outputs and drive input.

    Both are read off second differences, which motion does not reach.  The drive's carries what
    the wheel loops make of the wheels' noise, which the robot really feels: the floor is rather
    too high than too low.

    Returns:
        Weighted as ``scaled_error`` is; and (m,) variances in the units of the outputs.
    """
    log = sim.log
    shown = log.wheel_velocity if log.body_velocity is None else log.body_velocity
    own = np.array([_white(log.pieces(), shown, k) for k in range(shown.shape[1])])
    drive = np.array([_white(log.pieces(), log.command, k) for k in range(log.command.shape[1])])
    rng = np.random.default_rng(0)
    torque = np.sqrt(drive)[:, None] * rng.normal(size=(len(drive), sim.time.size))
    wrench = log.platform.jacobian_array.T @ torque
    followed = settled(sim, sim.force_columns([wrench])[..., 0])
    total = own + np.mean(followed**2, axis=(0, 1))
    return float(np.mean(total * weights**2)), total


def wheels_agree(log: Log) -> bool:
    """Tell whether the wheels contradict each other by no more than their noise.

    More wheels than freedoms are bound by ideal rolling.  Where they keep to it, rollers and slip
    cannot be what a model leaves unexplained; where they do not, or cannot show it, they may be.
    Wheels of other radii than assumed contradict each other in proportion to the motion, which
    rollers do not; that part is left out.
    """
    if log.wheel_velocity is None:
        return False
    jacobian = log.platform.jacobian_array
    free = null_space(jacobian.T)
    if free.shape[1] == 0:
        return False
    noise = [_white(log.pieces(), log.wheel_velocity, k) for k in range(len(free))]
    expected = float(np.mean(np.array(noise) @ free**2))
    contradiction = log.wheel_velocity @ free
    motion = log.wheel_velocity @ np.linalg.pinv(jacobian).T
    contradiction -= motion @ np.linalg.lstsq(motion, contradiction)[0]
    return float(np.mean(contradiction**2)) < CONTRADICTION * expected


def _white(pieces: list, signal: np.ndarray, column: int) -> float:
    """Variance of the white part of a signal, robust against steps."""
    differences, start = [], 0
    for piece in pieces:
        count = len(piece.time)
        differences.append(np.diff(signal[start : start + count, column], 2))
        start += count
    joined = np.concatenate(differences)
    return float((np.median(np.abs(joined)) / MEDIAN) ** 2 / AMPLIFIED)
