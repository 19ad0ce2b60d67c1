"""What the robot's driver and a motion-capture system report: resolution and noise."""

from __future__ import annotations

from dataclasses import dataclass, fields

import numpy as np

from youbot_env.arguments import check_number

MOST = 1e6  # of any noise or resolution


@dataclass(frozen=True)
class Sensors:
    """Standard deviations (normal noise) and resolutions of the measured channels.

    Attributes:
        wheel_velocity: noise of the wheel speeds, rad/s.
        wheel_velocity_step: their resolution (one motor rpm), rad/s.
        wheel_torque: noise of the torques, N m.
        wheel_torque_step: their resolution (one milliampere), N m.
        position, yaw: noise of motion capture, m and rad.
        velocity, yaw_rate: noise of a sensor of the body velocity, m/s and rad/s.
    """

    wheel_velocity: float = 0.02
    wheel_velocity_step: float = 4.053e-3
    wheel_torque: float = 0.03
    wheel_torque_step: float = 8.6557e-4
    position: float = 1e-3
    yaw: float = 2e-3
    velocity: float = 5e-3
    yaw_rate: float = 5e-3

    def __post_init__(self) -> None:
        for field in fields(self):
            check_number(field.name, getattr(self, field.name), 0.0, MOST)

    def read_wheel_velocity(self, value: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Wheel speeds as the driver reports them, rad/s."""
        return _read(value, self.wheel_velocity, self.wheel_velocity_step, rng)

    def read_wheel_torque(self, value: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Shaft torques as the driver reports them, N m."""
        return _read(value, self.wheel_torque, self.wheel_torque_step, rng)

    def read_pose(self, pose: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Pose (..., 3) as motion capture reports it, m, m, rad."""
        return pose + rng.normal(size=np.shape(pose)) * (self.position, self.position, self.yaw)

    def read_body_velocity(self, value: np.ndarray, rng: np.random.Generator) -> np.ndarray:
        """Body velocity (..., 3) as a sensor of its own reports it, m/s, m/s, rad/s."""
        noise = self.velocity, self.velocity, self.yaw_rate
        return value + rng.normal(size=np.shape(value)) * noise


IDEAL = Sensors(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)


def _read(value, noise: float, step: float, rng: np.random.Generator) -> np.ndarray:
    noisy = value + noise * rng.normal(size=np.shape(value))
    return np.round(noisy / step) * step if step else noisy
