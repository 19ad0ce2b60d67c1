"""What the robot may do during a calibration motion."""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass

import numpy as np

from ident.motion_columns import motion_columns
from youbot_env.model import Model
from youbot_env.references import Motion


@dataclass(frozen=True)
class Limits:
    """Largest values that a motion may ask for.

    The acceleration of 1 m/s^2 is a tenth of gravity: the wheels do not slip on any common floor.

    Attributes:
        speed: of the centre, m/s.
        yaw_rate: rad/s.
        acceleration: of the centre, m/s^2.
        yaw_acceleration: rad/s^2.
        torque: of each wheel, N m; below the 4 N m at which the wheel loops clip.
    """

    speed: float = 0.3
    yaw_rate: float = 1.0
    acceleration: float = 1.0
    yaw_acceleration: float = 2.5
    torque: float = 3.0

    def __post_init__(self) -> None:
        for name, value in asdict(self).items():
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"limit {name} = {value}; give a positive number")

    def evaluate(self, motion: Motion, model: Model) -> tuple[np.ndarray, np.ndarray]:
        """Columns of the regression and how much of the limits a motion uses.

        Returns:
            ``(columns (..., 3, 7), use (..., 4 + n))`` with the squared shares of speed, yaw rate,
            acceleration, yaw acceleration and of the torques that the model needs for the motion.
        """
        columns = motion_columns(motion, model)
        lever, theta = model.platform.lever, np.array(model.values()[:7])
        wrench = columns @ theta / np.array([lever, lever, 1.0])
        torque = wrench @ np.linalg.pinv(model.platform.jacobian_array)
        (vx, vy, om), (ax, ay, al) = motion.rate, motion.acceleration
        parts = (
            (vx**2 + vy**2) / self.speed**2,
            om**2 / self.yaw_rate**2,
            (ax**2 + ay**2) / self.acceleration**2,
            al**2 / self.yaw_acceleration**2,
        )
        shape = torque.shape[:-1]
        use = [np.broadcast_to(part, shape) for part in parts]
        return columns, np.concatenate(
            [np.stack(use, axis=-1), (torque / self.torque) ** 2], axis=-1
        )

    def shares(self, use: np.ndarray) -> dict[str, float]:
        """Largest share of each limit in ``use`` (N, 4 + n)."""
        peak = np.sqrt(use.max(axis=0))
        return dict(zip(asdict(self), [*peak[:4].tolist(), float(peak[4:].max())], strict=True))
