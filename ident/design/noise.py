"""How well a motion determines the parameters, from the noise of the sensors alone.

Torque noise n_M and wheel-speed noise n_w leave in the regression of paper eq. (9) the residual

    e = F [S J' n_M - S (M d/dt + D) J^+ n_w],   S = diag(L, L, 1),

whose spectrum Phi is known.  The motion is smooth and the instruments, made from the commanded
motion, carry no noise: the estimator is ``W^-1 sum H'z`` and its covariance

    W^-1 [sum_f H_f* Phi(f) H_f] W^-1,   W = sum H'H,

a sum over the frequencies of the filtered columns.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.regression import CORNER
from youbot_env import dynamics
from youbot_env.model import Model
from youbot_env.simulation import Sensors

# Rate of the logs, Hz.
RATE = 100.0


@dataclass(frozen=True)
class Information:
    """Second moments of the filtered columns of motions, means over a sample.

    Attributes:
        gramian: (..., 7, 7) mean of H'H.
        meat: (..., 7, 7) mean covariance of H'e.
    """

    gramian: np.ndarray
    meat: np.ndarray

    def covariance(self, samples: float) -> np.ndarray:
        """(..., 7, 7) expected covariance of theta from so many samples."""
        inverse = np.linalg.inv(self.gramian)
        return inverse @ self.meat @ inverse / samples

    @classmethod
    def mean(cls, parts: list[Information], weights: list[float]) -> Information:
        """Information of parts one after the other, weights summing to one."""
        pairs = list(zip(parts, weights, strict=True))
        return cls(sum(w * p.gramian for p, w in pairs), sum(w * p.meat for p, w in pairs))


@dataclass(frozen=True)
class NoiseModel:
    """Spectrum of the regression's residual.

    Attributes:
        mass, damping, jacobian, scale: (3, 3) M and D, (n, 3) J, (3, 3) S.
        torque, velocity: variances of a sample of the wheels' torques and speeds.
        corner: of the regression's filters, rad/s.
    """

    mass: np.ndarray
    damping: np.ndarray
    jacobian: np.ndarray
    scale: np.ndarray
    torque: float
    velocity: float
    corner: float = CORNER

    @classmethod
    def of(cls, model: Model, sensors: Sensors | None = None) -> NoiseModel:
        """Noise of the sensors as a robot with these parameters turns it into forces."""
        sensors, platform = sensors or Sensors(), model.platform
        theta, lever = model.parameters.theta(platform), platform.lever
        return cls(
            _square(dynamics.mass_matrix(platform.geometry, theta)),
            _square(dynamics.damping_matrix(platform.geometry, theta)),
            platform.jacobian_array,
            np.diag([lever, lever, 1.0]),
            # A resolution q adds the variance q^2 / 12 of a uniform error.
            sensors.wheel_torque**2 + sensors.wheel_torque_step**2 / 12,
            sensors.wheel_velocity**2 + sensors.wheel_velocity_step**2 / 12,
        )

    def spectrum(self, frequency: np.ndarray) -> np.ndarray:
        """(K, 3, 3) spectrum of the unfiltered residual at angular frequencies (K,), per sample."""
        S, J = self.scale, self.jacobian
        torque = S @ J.T @ J @ S
        response = S @ (1j * frequency[:, None, None] * self.mass + self.damping)
        speed = response @ np.linalg.inv(J.T @ J) @ response.conj().swapaxes(-1, -2)
        return self.torque * torque + self.velocity * speed

    def information(self, columns: np.ndarray, dt: float) -> Information:
        """Information in columns (..., N, 3, 7) sampled every dt s over whole periods."""
        count = columns.shape[-3]
        H = np.fft.rfft(columns, axis=-3) / count
        frequency = 2 * np.pi * np.fft.rfftfreq(count, dt)
        # Every frequency but zero (and the last of an even count) stands for two.
        weight = np.full(len(frequency), 2.0)
        weight[0] = 1.0
        weight[count // 2 + 1 - (count % 2 == 0) :] = 1.0
        gain = 1.0 / (1.0 + (frequency / self.corner) ** 2)
        once, twice = (weight * gain**power for power in (1, 2))
        left = H.conj().swapaxes(-1, -2)
        gramian = np.sum(once[:, None, None] * (left @ H).real, axis=-3)
        meat = np.sum(twice[:, None, None] * (left @ (self.spectrum(frequency) @ H)).real, axis=-3)
        return Information(gramian, meat)


def _square(upper: tuple) -> np.ndarray:
    xx, xy, xo, yy, yo, oo = upper
    return np.array([[xx, xy, xo], [xy, yy, yo], [xo, yo, oo]], float)
