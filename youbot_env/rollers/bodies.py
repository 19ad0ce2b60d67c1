"""The bodies of a robot with real rollers: placing them on the floor and reading their motion."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from youbot_env.backend import NUMPY
from youbot_env.dynamics import Theta
from youbot_env.platform import Platform
from youbot_env.rollers.mjcf import build, set_theta
from youbot_env.rollers.shape import rate_ratio, roller_count

SETTLING = 0.3  # s, in which the robot comes to rest on the floor


class Bodies:
    """A compiled robot and its state.

    Args:
        platform: wheel table and radii.
        theta: the seven parameters of the robot.
        floor_friction: Coulomb coefficient between rollers and floor.
        timestep: physics step, s.

    Attributes:
        model, data: what MuJoCo simulates.
        wheels: places of the n wheel speeds in ``qvel`` and in generalized forces.
        yaw: heading at the last reading, rad, not wrapped.
    """

    def __init__(self, platform: Platform, theta: Theta, floor_friction: float, timestep: float):
        self._platform, self._theta = platform, theta
        self.model, self._layout = build(platform, theta, floor_friction, timestep)
        self.data = mujoco.MjData(self.model)
        self.yaw = 0.0
        self.wheels: list[int] = self._layout.wheel_velocity.tolist()
        self._angles = self._layout.wheel_position.tolist()
        self._rollers = self._layout.roller_velocity.tolist()
        self._pitch = 2 * math.pi / roller_count(platform)
        phases = np.linspace(-self._pitch / 2, self._pitch / 2, 241)
        self._ratios = phases, rate_ratio(platform, phases, NUMPY)
        self._rest = self._settle()

    def place(self, pose, v: tuple, wheel_angle) -> None:
        """Put the robot on the floor at a pose, all wheels and rollers rolling with v."""
        data, geometry = self.data, self._platform.geometry
        x, y, self.yaw = (float(value) for value in pose)
        mujoco.mj_resetData(self.model, data)
        data.qpos[:] = self._rest
        data.qpos[:2] = x, y
        turn = np.array([math.cos(self.yaw / 2), 0.0, 0.0, math.sin(self.yaw / 2)])
        mujoco.mju_mulQuat(data.qpos[3:7], turn, self._rest[3:7])
        data.qpos[self._angles] = wheel_angle
        c, s = math.cos(self.yaw), math.sin(self.yaw)
        data.qvel[:2] = c * v[0] - s * v[1], s * v[0] + c * v[1]
        data.qvel[5] = v[2]
        data.qvel[self.wheels] = geometry.wheel_velocity(v)
        lowest, ratio = self.lowest_rollers()
        data.qvel[lowest] = geometry.roller_velocity(v) * ratio

    def pose(self) -> tuple[float, float, float]:
        """(x, y, yaw) of O in the world, m, m, rad; yaw is not wrapped."""
        px, py, _, w, x, y, z = self.data.qpos[:7].tolist()
        yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        self.yaw = yaw + 2 * math.pi * round((self.yaw - yaw) / (2 * math.pi))
        return px, py, self.yaw

    def velocity(self) -> tuple[float, float, float]:
        """(V_X, V_Y, Omega) of O in the body frame, m/s, m/s, rad/s."""
        _, _, yaw = self.pose()
        vx, vy, _, _, _, omega = self.data.qvel[:6].tolist()
        c, s = math.cos(yaw), math.sin(yaw)
        return c * vx + s * vy, c * vy - s * vx, omega

    def wheel_angle(self) -> np.ndarray:
        """Wheel angles (n,), rad."""
        return self.data.qpos[self._angles]

    def wheel_velocity(self) -> np.ndarray:
        """Wheel speeds (n,), rad/s."""
        return self.data.qvel[self.wheels]

    def lowest_rollers(self) -> tuple[list[int], np.ndarray]:
        """Each wheel's lowest roller: its place in ``qvel``, and how much faster than ideal."""
        lowest, phases = [], []
        for rollers, angle in zip(self._rollers, self.wheel_angle().tolist(), strict=True):
            nearest = round(angle / self._pitch)
            # A wheel that rolls forward brings down the roller before the present one.
            lowest.append(rollers[-nearest % len(rollers)])
            phases.append(angle - nearest * self._pitch)
        return lowest, np.interp(phases, *self._ratios)

    def adopt(self, theta: Theta) -> None:
        """Change masses and frictions where theta differs from the present one."""
        if theta != self._theta:
            set_theta(self.model, self._layout, self._platform, theta)
            self._theta = theta

    def _settle(self) -> np.ndarray:
        """Positions of a robot that stands still at the origin, sunk into the floor.

        It first sinks into its mounts, unevenly; their springs are then preloaded by as much, so
        that it stands level: wheels that lean would roll off to one side.
        """
        model, data, steps = self.model, self.data, round(SETTLING / self.model.opt.timestep)
        mounts = model.jnt_qposadr[self._layout.mount]
        mujoco.mj_step(model, data, steps)
        model.qpos_spring[mounts] = -data.qpos[mounts]
        mujoco.mj_resetData(model, data)
        mujoco.mj_step(model, data, steps)
        rest = model.qpos0.copy()
        rest[2:7], rest[mounts] = data.qpos[2:7], data.qpos[mounts]
        return rest
