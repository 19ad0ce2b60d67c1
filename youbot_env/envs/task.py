"""The tracking task in components: what is observed, what is rewarded, when it has failed.

Used on floats by the single environments and on arrays by the vector environment.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from gymnasium import spaces

from youbot_env.backend import Ops
from youbot_env.platform import Platform
from youbot_env.references import rotate_to_body

LEVELS = ("torque", "velocity")
# Errors at which the reward has fallen to one half.
POSITION_SCALE, YAW_SCALE = 0.1, 0.2
EFFORT_SHARE = 0.1
# Beyond these the robot has lost its reference and the episode ends.
LOST_DISTANCE, LOST_YAW = 1.0, math.pi / 2
# Limits of what an argument can make large or small.  An environment with a preview of 500 takes
# 3 s to make; forces beyond these let positions overflow in one period, and rewards become NaN.
SHORTEST = 1e-5  # s, of a control period
LARGEST = {
    "preview": 500, "preview_stride": 10_000, "dt": 1.0, "torque_limit": 1e4, "speed_limit": 100.0,
    "yaw_rate_limit": 1000.0,
}  # fmt: skip
# Bounds of the observation; the driver's own limits are 0.8 m/s and 1.6 rad/s.
SPEED_BOUND, YAW_RATE_BOUND = 4.0, 12.0


@dataclass(frozen=True)
class TrackingTask:
    """Follow a reference pose.

    Attributes:
        platform: gives the number of wheels.
        action_level: ``torque`` (one action a wheel) or ``velocity`` (V_X, V_Y, Omega for the
            wheel-speed loops on board).
        dt: control period, s.
        preview: number of future reference twists in the observation.
        preview_stride: control periods between two of them.
        torque_limit: torque of action 1, N m.
        speed_limit, yaw_rate_limit: body velocities of action 1 on the kinematic level.
    """

    platform: Platform
    action_level: str = "torque"
    dt: float = 0.01
    preview: int = 5
    preview_stride: int = 10
    torque_limit: float = 4.0
    speed_limit: float = 0.8
    yaw_rate_limit: float = 1.6

    def __post_init__(self) -> None:
        if self.action_level not in LEVELS:
            raise ValueError(f"action_level = {self.action_level!r}; choose one of {LEVELS}")
        for name, low in (("preview", 0), ("preview_stride", 1)):
            value, high = getattr(self, name), LARGEST[name]
            whole = isinstance(value, int) and not isinstance(value, bool)
            if not whole or not low <= value <= high:
                raise ValueError(f"{name} = {value!r}; give a whole number from {low} to {high}")
        if isinstance(self.dt, int | float) and 0 < self.dt < SHORTEST:
            raise ValueError(f"dt = {self.dt!r}; give at least {SHORTEST:g} s")
        for name in ("dt", "torque_limit", "speed_limit", "yaw_rate_limit"):
            value, high = getattr(self, name), LARGEST[name]
            number = isinstance(value, int | float) and not isinstance(value, bool)
            if not number or not 0 < value <= high:
                raise ValueError(f"{name} = {value!r}; give a positive number of at most {high:g}")

    @property
    def action_space(self) -> spaces.Box:
        """Normalised actions in [-1, 1]."""
        size = len(self.platform.wheels) if self.action_level == "torque" else 3
        return spaces.Box(-1.0, 1.0, (size,), np.float32)

    @property
    def observation_space(self) -> spaces.Box:
        """Bounds of ``observe``; what exceeds them is clipped."""
        high = [1.5, 1.5, math.pi, SPEED_BOUND, SPEED_BOUND, YAW_RATE_BOUND, 1.0, 1.0]
        high += [SPEED_BOUND, SPEED_BOUND, YAW_RATE_BOUND] * (self.preview + 1)
        bound = np.array(high, np.float32)
        return spaces.Box(-bound, bound, dtype=np.float32)

    @property
    def preview_length(self) -> int:
        """Control periods from now to the last previewed instant."""
        return self.preview * self.preview_stride

    @property
    def preview_times(self) -> list[float]:
        """Times from now of the twists in the observation, s."""
        return [k * self.preview_stride * self.dt for k in range(self.preview + 1)]

    def error(self, pose: tuple, heading: tuple, wanted: tuple, ops: Ops) -> tuple:
        """Pose error (ahead, left, yaw) of the reference seen from the robot, m, m, rad.

        ``heading`` is (cos yaw, sin yaw); the yaw error is wrapped into [-pi, pi).
        """
        gap = tuple(ops.coarse(w - p) for w, p in zip(wanted, pose, strict=True))
        turns = ops.floor(gap[2] * (0.5 / math.pi) + 0.5)
        return rotate_to_body((gap[0], gap[1], gap[2] - (2 * math.pi) * turns), heading)

    def observe(self, error: tuple, velocity: tuple, heading: tuple, twists) -> list:
        """Return the observation, see ``TrackingEnv``; ``twists`` are now and the previews."""
        flat = [*error, *velocity, *heading]
        for twist in twists:
            flat.extend(twist)
        return flat

    def judge(self, error: tuple, action: tuple, ops: Ops) -> tuple:
        """Return ``(reward, lost)``; the reward lies in [0, 1]."""
        squared = error[0] * error[0] + error[1] * error[1]
        miss = squared * (1 / POSITION_SCALE**2) + error[2] * error[2] * (1 / YAW_SCALE**2)
        effort = sum(a * a for a in action) * (EFFORT_SHARE / len(action))
        distance = ops.maximum(
            squared * (1 / LOST_DISTANCE**2), error[2] * error[2] * (1 / LOST_YAW**2)
        )
        return (1.0 - effort) / (1.0 + miss), distance > 1.0
