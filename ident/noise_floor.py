"""How small the free-run error of a log could be: what noise of sensors and drive leaves."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from ident.contradiction import rolling_variance
from ident.drive_noise import lasting_noise
from ident.noise import speed_variance, white_variance
from ident.residuals import settled
from ident.sensitivity import Linearised

# Draws of noise that lasts, which holds few independent values.
DRAWS = 4


class NoiseFloor(NamedTuple):
    """Mean squared free-run errors that noise leaves, in the squared units of the outputs.

    Attributes:
        white: (m,) from white noise of outputs and drive input.
        lasting: (m,) from noise of the drive input that lasts.
    """

    white: np.ndarray
    lasting: np.ndarray

    def of(self, weights: np.ndarray) -> float:
        """All of it, weighted as ``scaled_error`` is."""
        return float(np.mean((self.white + self.lasting) * weights**2))


def noise_floor(sim: Linearised) -> NoiseFloor:
    """Free-run errors from the noise of outputs and drive input.

    White noise is read off second differences, which motion does not reach; see ``drive_noise`` for
    what lasts.  The drive's carries what the wheel loops make of the wheels' noise, which the robot
    really feels: the floor is rather too high than too low.
    """
    log = sim.log
    if log.body_velocity is None:
        shown = speed_variance(log)
    else:
        shown = white_variance(log, log.body_velocity)
    known = log.drive_noise
    drive = white_variance(log, log.command) if known is None else known**2
    rng = np.random.default_rng(0)
    torque = np.sqrt(drive)[:, None] * rng.normal(size=(len(drive), sim.time.size))
    white = shown + _followed(sim, [torque])
    lasting = lasting_noise(log)
    if not lasting.size:
        return NoiseFloor(white, np.zeros_like(white))
    steps = sim.windows.step.reshape(sim.shape)
    drawn = [lasting.draw(steps, len(drive), rng) for _ in range(DRAWS)]
    return NoiseFloor(white, _followed(sim, drawn))


def _followed(sim: Linearised, torques: list[np.ndarray]) -> np.ndarray:
    """(m,) mean squared errors from torques (n, W L) of each draw."""
    jacobian = sim.log.platform.jacobian_array
    followed = settled(sim, sim.force_columns([jacobian.T @ torque for torque in torques]))
    return np.mean(followed**2, axis=(0, 1, 3))


def parameter_floor(sim: Linearised, covariance: np.ndarray) -> np.ndarray:
    """(m,) mean squared free-run errors that the uncertainty of a model's values leaves.

    Args:
        sim: a log simulated with the model.
        covariance: (P, P) of its values.
    """
    covariance = np.array(covariance)
    moving = np.diag(covariance) > 0
    if not moving.any():
        return np.zeros(sim.residual.shape[-1])
    columns = settled(sim, sim.value_columns(moving))
    spread = covariance[np.ix_(moving, moving)]
    return np.einsum("wlmi,ij,wlmj->m", columns, spread, columns) / columns[..., 0, 0].size


def velocity_floor(
    sim: Linearised, spread: np.ndarray, rippled: bool = False
) -> tuple[float, float, float, float]:
    """Free-run errors of body velocities that are no fault of a model, as shares of ``spread``.

    Args:
        sim: a log simulated with it.
        spread: (3,) rms of the motion, m/s, m/s, rad/s.
        rippled: see ``rolling_variance``.

    Returns:
        What white noise leaves, what noise of the drive that lasts leaves, what the uncertainty of
        the model's values leaves, and what real rollers may leave besides.
    """
    log, found = sim.log, []
    unsure = np.zeros(sim.residual.shape[-1])
    if sim.model.covariance is not None:
        unsure = parameter_floor(sim, sim.model.covariance)
    rolling = rolling_variance(log, rippled)
    for variance in (*noise_floor(sim), unsure, rolling):
        if log.body_velocity is None:
            variance = np.linalg.pinv(log.platform.jacobian_array) ** 2 @ variance
        found.append(float(np.sqrt(np.mean(variance / spread**2))))
    return tuple(found)
