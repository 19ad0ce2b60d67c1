"""The kinematic controller: body velocities for the wheel-speed loops on board."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from controllers import base
from youbot_env.backend import NUMPY
from youbot_env.references import rotate_to_body


@dataclass(frozen=True, kw_only=True)
class Settings(base.Settings):
    """Settings of the kinematic controller.

    Attributes:
        position_gain: body velocity for a position error, 1/s.
        yaw_gain: yaw rate for a yaw error, 1/s.
    """

    position_gain: float = 4.0
    yaw_gain: float = 4.0

    def __post_init__(self) -> None:
        self.require_positive("position_gain", "yaw_gain")


class Kinematic(base.Controller):
    """Commands the velocity of the reference, turned into the robot's frame, plus feedback.

        V = R(yaw error) V_ref + k (position error),   Omega = Omega_ref + k (yaw error)

    The reference velocity is that in the middle of the coming control period.  Wheel speeds J v and
    their PI loops are on board (``youbot_env.simulation.WheelLoop``).  Nothing of the model but
    its platform is used.
    """

    name = "kinematic"
    action_level = "velocity"
    uses_model = False
    Settings = Settings
    settings: Settings

    def act(self, seen: np.ndarray, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See the base class."""
        settings, error = self.settings, seen[:, :3].T
        twist = seen[:, 8:11].T
        if settings.preview:
            twist = twist + (seen[:, 11:14].T - twist) * (0.5 / settings.preview_stride)
        # The turn from the frame of the reference into that of the robot is minus the yaw error.
        turned = rotate_to_body(tuple(twist), (NUMPY.cos(error[2]), -NUMPY.sin(error[2])))
        gains = (settings.position_gain, settings.position_gain, settings.yaw_gain)
        command = [v + k * e for v, k, e in zip(turned, gains, error, strict=True)]
        limits = (settings.speed_limit, settings.speed_limit, settings.yaw_rate_limit)
        return np.stack(command, axis=1) / limits, memory
