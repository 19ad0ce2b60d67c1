"""One simulated robot whose wheels carry real rollers: contacts and slip are physics here."""

from __future__ import annotations

import math

import mujoco
import numpy as np

from youbot_env.backend import FLOAT, NUMPY
from youbot_env.dynamics import Theta
from youbot_env.effects.base import Signals
from youbot_env.model import Model
from youbot_env.plant import Robot, Structure
from youbot_env.rollers.camera import Camera
from youbot_env.rollers.mjcf import build, set_theta
from youbot_env.rollers.shape import rate_ratio, roller_count

# Laws that replace the rolling of ideal wheels; here wheels roll by themselves.
INEXPRESSIBLE = ("kinematics", "slip")
SETTLING = 0.3  # s, in which the robot comes to rest on the floor


class RollersPlant:
    """A robot with real rollers, driven by torque commands held for dt.

    Effects of the model act through the same laws as in the equations: those of the drive on the
    command, those of shafts and rollers on the joints, at the speeds these really have (of each
    wheel's rollers, on the lowest), those of the body at O.

    Args:
        model: platform, parameters and effects; in a simulation these are the true ones.
        dt: sample time, s; a whole number of physics steps.
        floor_friction: Coulomb coefficient between rollers and floor.
        timestep: physics step, s.  At 1 ms a tenth of real time is spent; 2 ms halves that and
            costs 1 % of the forward speed in rolling losses.

    Attributes:
        platform, dt, t: wheel table, sample time and time since reset, s.

    Raises:
        ImpossibleParameters: the model describes no possible robot.
        ValueError: an effect that bodies and contacts cannot express, inertias below those of the
            wheels, or a dt that is no multiple of the physics step.
    """

    def __init__(
        self,
        model: Model,
        dt: float = 0.01,
        floor_friction: float = 0.8,
        timestep: float = 0.001,
    ):
        model.check()
        self._substeps = round(dt / timestep)
        if self._substeps < 1 or abs(self._substeps * timestep - dt) > 1e-9:
            raise ValueError(
                f"dt = {dt} s is not a whole number of physics steps of {timestep} s; "
                "change dt or timestep"
            )
        if not floor_friction > 0:
            raise ValueError(f"floor_friction = {floor_friction} must be positive")
        self.model, self.platform, self.dt, self.t = model, model.platform, dt, 0.0
        self._structure = Structure.of(model, track_wheels=True)
        self._robot: Robot = self._structure.bind(model.values())
        for hook in INEXPRESSIBLE:
            for _, effect, _ in self._robot.acting(hook):
                raise ValueError(
                    f"effect {effect.identifier!r} replaces the {hook} of ideal wheels, but these "
                    "wheels roll and slip by themselves; leave it out, or use the analytic plant"
                )
        self._pitch = 2 * math.pi / roller_count(self.platform)
        self._theta = self._robot.theta
        self._mj, self._layout = build(self.platform, self._theta, floor_friction, timestep)
        self._data = mujoco.MjData(self._mj)
        self._camera: Camera | None = None
        self._rest = self._settle()
        self.reset()

    def reset(self, pose=(0.0, 0.0, 0.0), velocity=(0.0, 0.0, 0.0), wheel_angle=0.0) -> None:
        """Place the robot on the floor, rolling, with relaxed effects.

        Args:
            pose: (x, y, yaw) of O, m, m, rad.
            velocity: (V_X, V_Y, Omega), m/s, m/s, rad/s.
            wheel_angle: angles from which the wheels start, rad, (n,) or one for all.  They decide
                which rollers touch the floor, and so where an open-loop motion ends.
        """
        mujoco.mj_resetData(self._mj, self._data)
        self.t, self._yaw = 0.0, float(pose[2])
        self._internal = self._structure.rest().internal
        self._delivered = np.zeros(len(self.platform.wheels))
        history = math.floor(self._robot.delay() / self._mj.opt.timestep) + 2
        self._commands = [(0.0,) * len(self.platform.wheels)] * history
        self._adopt(self._robot.theta)
        self._place(pose, tuple(float(value) for value in velocity), wheel_angle)

    def step(self, command: np.ndarray) -> None:
        """Hold the shaft torques ``command`` (n,), N m, for dt.

        Raises:
            FloatingPointError: the simulation left the finite numbers.
        """
        wanted = tuple(float(value) for value in command)
        if self._robot.simple:
            self._delivered[:] = wanted
            self._data.qfrc_applied[self._layout.wheel_velocity] = wanted
            mujoco.mj_step(self._mj, self._data, self._substeps)
        else:
            for k in range(self._substeps):
                self._apply(wanted, self.t + k * self._mj.opt.timestep)
                mujoco.mj_step(self._mj, self._data)
        self.t += self.dt
        if not np.isfinite(self._data.qvel).all():
            raise FloatingPointError(
                f"the simulation diverged before t = {self.t:.3f} s at the command {wanted} N m; "
                f"use smaller torques or a timestep below {self._mj.opt.timestep} s"
            )
        self._yaw = self._unwrapped_yaw()

    @property
    def pose(self) -> np.ndarray:
        """(x, y, yaw) of O in the world, m, m, rad; yaw is not wrapped."""
        return np.array([*self._data.qpos[:2], self._yaw])

    @property
    def velocity(self) -> np.ndarray:
        """(V_X, V_Y, Omega) of O in the body frame, m/s, m/s, rad/s."""
        return np.array(self._body_velocity(self._yaw))

    @property
    def wheel_angle(self) -> np.ndarray:
        """Wheel angles (n,), rad."""
        return self._data.qpos[self._layout.wheel_position]

    @property
    def wheel_velocity(self) -> np.ndarray:
        """Wheel speeds (n,), rad/s, as encoders see them."""
        return self._data.qvel[self._layout.wheel_velocity]

    @property
    def delivered_torque(self) -> np.ndarray:
        """Torques (n,) that the drives put on the shafts in the last physics step, N m."""
        return self._delivered.copy()

    def render(self, width: int = 640, height: int = 480) -> np.ndarray:
        """Picture of the robot, (height, width, 3) bytes, from a camera that follows it.

        Raises:
            RuntimeError: MuJoCo finds no way to draw off screen; says which setting helps.
        """
        if self._camera is None or self._camera.size != (width, height):
            self._camera = Camera(self._mj, width, height, self.platform.reach)
        return self._camera.picture(self._data, self.pose)

    def _settle(self) -> np.ndarray:
        """Positions of a robot that stands still at the origin, sunk into the floor.

        It first sinks into its mounts, unevenly; their springs are then preloaded by as much, so
        that it stands level: wheels that lean would roll off to one side.
        """
        model, data, steps = self._mj, self._data, round(SETTLING / self._mj.opt.timestep)
        mounts = model.jnt_qposadr[self._layout.mount]
        mujoco.mj_step(model, data, steps)
        model.qpos_spring[mounts] = -data.qpos[mounts]
        mujoco.mj_resetData(model, data)
        mujoco.mj_step(model, data, steps)
        rest = model.qpos0.copy()
        rest[2:7], rest[mounts] = data.qpos[2:7], data.qpos[mounts]
        return rest

    def _place(self, pose, v: tuple, wheel_angle) -> None:
        data, layout, geometry = self._data, self._layout, self.platform.geometry
        c, s = math.cos(self._yaw), math.sin(self._yaw)
        data.qpos[:] = self._rest
        data.qpos[:2] = pose[:2]
        turn = np.array([math.cos(self._yaw / 2), 0.0, 0.0, math.sin(self._yaw / 2)])
        mujoco.mju_mulQuat(data.qpos[3:7], turn, self._rest[3:7])
        data.qpos[layout.wheel_position] = wheel_angle
        data.qvel[:2] = c * v[0] - s * v[1], s * v[0] + c * v[1]
        data.qvel[5] = v[2]
        data.qvel[layout.wheel_velocity] = geometry.wheel_velocity(v)
        lowest, phase = self._lowest_rollers()
        data.qvel[lowest] = geometry.roller_velocity(v) * rate_ratio(self.platform, phase, NUMPY)

    def _body_velocity(self, yaw: float) -> tuple[float, float, float]:
        vx, vy, _, _, _, omega = self._data.qvel[:6].tolist()
        c, s = math.cos(yaw), math.sin(yaw)
        return c * vx + s * vy, c * vy - s * vx, omega

    def _unwrapped_yaw(self) -> float:
        w, x, y, z = self._data.qpos[3:7].tolist()
        yaw = math.atan2(2 * (w * z + x * y), 1 - 2 * (y * y + z * z))
        return yaw + 2 * math.pi * round((self._yaw - yaw) / (2 * math.pi))

    def _lowest_rollers(self) -> tuple[np.ndarray, np.ndarray]:
        """Indices in ``qvel`` of each wheel's lowest roller, and the phases of the wheels, rad."""
        rollers = self._layout.roller_velocity
        turned = self.wheel_angle / self._pitch
        nearest = np.rint(turned)
        # Roller k + 1 comes down after roller k when a wheel turns backward.
        chosen = (-nearest).astype(int) % rollers.shape[1]
        return rollers[np.arange(len(chosen)), chosen], self._pitch * (turned - nearest)

    def _signals(self, command: tuple, t: float) -> Signals:
        """What the laws read, taken from the bodies."""
        yaw = self._unwrapped_yaw()
        pose, v = (*self._data.qpos[:2].tolist(), yaw), self._body_velocity(yaw)
        s = self._robot.signals(t, v, pose, tuple(self.wheel_angle.tolist()), command, FLOAT)
        s.wheel_velocity = tuple(self.wheel_velocity.tolist())
        return s

    def _apply(self, wanted: tuple, t: float) -> None:
        """Set the forces of the next physics step; the states of the effects move along."""
        robot, layout, force = self._robot, self._layout, self._data.qfrc_applied
        s = self._signals(self._delayed(wanted), t)
        self._adopt(s.theta)
        torque, internal = robot.deliver(s, self._internal, self._mj.opt.timestep, FLOAT)
        self._delivered[:], self._internal = torque, internal
        force[:] = 0.0
        for index, effect, p in robot.acting("shaft"):
            s.state, s.torque = internal[index], torque
            torque = tuple(map(sum, zip(torque, effect.shaft(p, s, FLOAT), strict=True)))
        force[layout.wheel_velocity] = torque
        if robot.acting("roller"):
            # Laws speak of ideal rollers; rate and torque go over to real ones at equal power.
            lowest, phase = self._lowest_rollers()
            ratio = rate_ratio(self.platform, phase, NUMPY)
            s.roller_velocity = tuple((self._data.qvel[lowest] / ratio).tolist())
            for index, effect, p in robot.acting("roller"):
                s.state = internal[index]
                force[lowest] += effect.roller(p, s, FLOAT) / ratio
        c, n = math.cos(s.pose[2]), math.sin(s.pose[2])
        for index, effect, p in robot.acting("body"):
            s.state = internal[index]
            fx, fy, moment = effect.body(p, s, FLOAT)
            force[:2] += c * fx - n * fy, n * fx + c * fy
            force[5] += moment

    def _delayed(self, wanted: tuple) -> tuple:
        """Command that arrives now: its mean over the next physics step."""
        self._commands = [wanted, *self._commands[:-1]]
        steps = self._robot.delay() / self._mj.opt.timestep
        whole = math.floor(steps)
        part = steps - whole
        pairs = zip(self._commands[whole], self._commands[whole + 1], strict=True)
        return tuple((1 - part) * new + part * old for new, old in pairs)

    def _adopt(self, theta: Theta) -> None:
        """Change masses and frictions where an effect has changed the robot."""
        if theta != self._theta:
            set_theta(self._mj, self._layout, self.platform, theta)
            self._theta = theta
