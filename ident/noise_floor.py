"""How small the free-run error of a log could be: what its sensors' noise alone leaves."""

from __future__ import annotations

import numpy as np

from ident.contradiction import rolling_variance
from ident.scaled_fit import settled
from ident.sensitivity import Linearised
from ident.white_noise import white_variance


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
    own = white_variance(log, shown)
    known = log.drive_noise
    drive = white_variance(log, log.command) if known is None else known**2
    rng = np.random.default_rng(0)
    torque = np.sqrt(drive)[:, None] * rng.normal(size=(len(drive), sim.time.size))
    wrench = log.platform.jacobian_array.T @ torque
    followed = settled(sim, sim.force_columns([wrench])[..., 0])
    total = own + np.mean(followed**2, axis=(0, 1))
    return float(np.mean(total * weights**2)), total


def velocity_floor(sim: Linearised, spread: np.ndarray) -> tuple[float, float]:
    """Free-run errors of body velocities that are no fault of a model, as shares of ``spread``.

    Args:
        sim: a log simulated with it.
        spread: (3,) rms of the motion, m/s, m/s, rad/s.

    Returns:
        What the noise of the sensors leaves, and what real rollers and slip may leave besides.
    """
    log, found = sim.log, []
    for variance in (noise_floor(sim, np.ones(sim.residual.shape[-1]))[1], rolling_variance(log)):
        if log.body_velocity is None:
            variance = np.linalg.pinv(log.platform.jacobian_array) ** 2 @ variance
        found.append(float(np.sqrt(np.mean(variance / spread**2))))
    return found[0], found[1]
