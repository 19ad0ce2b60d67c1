"""One simulated robot whose wheels carry real rollers: contacts and slip are physics here."""

from __future__ import annotations

import math
import warnings
from dataclasses import replace

import mujoco
import numpy as np

from youbot_env.arguments import check_kind, check_number
from youbot_env.backend import FLOAT
from youbot_env.model import Model
from youbot_env.plant import BoundModel, ModelStructure
from youbot_env.rollers.bodies import Bodies
from youbot_env.simulation.analytic import LONGEST, SHORTEST


class Camera:
    """A camera that follows the robot from behind and above.

    Args:
        model: compiled model.
        width, height: size of the pictures, px.
        reach: size of the robot, m; sets the distance.

    Raises:
        RuntimeError: MuJoCo finds no way to draw off screen.
    """

    def __init__(self, model: mujoco.MjModel, width: int, height: int, reach: float):
        self.size, self._model = (width, height), model
        try:
            self._renderer = mujoco.Renderer(model, height, width)
        except ValueError:
            raise  # a picture larger than 1920 x 1080
        except Exception as error:  # every OpenGL backend raises its own
            raise RuntimeError(
                f"MuJoCo cannot draw off screen ({error}); without a display set the environment "
                "variable MUJOCO_GL=egl (or osmesa, in software) before Python starts, and "
                "install that library (Debian, Ubuntu: libegl1 or libosmesa6)"
            ) from error
        self._view = mujoco.MjvCamera()
        self._view.distance, self._view.elevation, self._view.azimuth = 4 * reach, -30.0, 30.0

    def picture(self, data: mujoco.MjData, pose: np.ndarray) -> np.ndarray:
        """Draw the state with the robot at pose (x, y, yaw) in the middle: (height, width, 3)."""
        # Positions only: solving for forces here would change the start of the next solution.
        mujoco.mj_kinematics(self._model, data)
        mujoco.mj_camlight(self._model, data)
        self._view.lookat[:2] = pose[:2]
        self._renderer.update_scene(data, camera=self._view)
        return self._renderer.render()


# Laws that replace the rolling of ideal wheels; here wheels roll by themselves.
INEXPRESSIBLE = ("kinematics", "slip")
# Laws that stand for what rollers and contacts do here by themselves.
PHYSICS = ("roller_ripple", "wheel_slip")
FLOOR_FRICTION, MOST_FRICTION = 0.8, 10.0


class RollersPlant:
    """A robot with real rollers, driven by torque commands held for dt.

    Effects of the model act through the same laws as in the equations: those of the drive on the
    command, those of shafts and rollers on the joints, at the speeds these really have (of each
    wheel's rollers, on the lowest), those of the body at O.

    Args:
        model: platform, parameters and effects; in a simulation these are the true ones.
        dt: sample time, s; a whole number of physics steps.
        floor_friction: Coulomb coefficient between rollers and floor; if left, that of the model's
            ``wheel_slip``, else 0.8.
        timestep: physics step, s.  2 ms halves the time of computation and costs 1 % of the
            forward speed in rolling losses.

    ``roller_ripple`` and ``wheel_slip`` of a model are left out with a warning: here they are
    physics.

    Attributes:
        platform, dt, t: wheel table, sample time and time since reset, s.
        mj_model, mj_data: what MuJoCo simulates, for its viewer and for measurements of one's own.

    Raises:
        ImpossibleParameters: the model describes no possible robot.
        ValueError: an effect that bodies and contacts cannot express, inertias below those of the
            wheels, or a dt that is no multiple of the physics step.
    """

    def __init__(
        self,
        model: Model,
        dt: float = 0.01,
        floor_friction: float | None = None,
        timestep: float = 0.001,
    ):
        check_kind("model", model, Model, "a Model, as load_model returns it")
        model.check()
        check_number("timestep", timestep, SHORTEST, LONGEST)
        check_number("dt", dt, SHORTEST, LONGEST)
        if floor_friction is not None:
            check_number("floor_friction", floor_friction, 0.0, MOST_FRICTION)
        self._substeps = round(dt / timestep)
        if self._substeps < 1 or abs(self._substeps * timestep - dt) > 1e-9:
            raise ValueError(
                f"dt = {dt} s is not a whole number of physics steps of {timestep} s; "
                "change dt or timestep"
            )
        model, slippery = _without_physics(model)
        floor_friction = slippery if floor_friction is None else floor_friction
        if not floor_friction > 0:
            raise ValueError(f"floor_friction = {floor_friction} must be positive")
        self.model, self.platform, self.dt, self.t = model, model.platform, dt, 0.0
        self._timestep, self._floor_friction = timestep, floor_friction
        self._structure = ModelStructure.of(model, track_wheels=True)
        self._robot: BoundModel = self._structure.bind(model.values())
        for hook in INEXPRESSIBLE:
            for _, effect, _ in self._robot.acting(hook):
                raise ValueError(
                    f"effect {effect.identifier!r} replaces the {hook} of ideal wheels, but these "
                    "wheels roll and slip by themselves; leave it out, or use the analytic plant"
                )
        self._bodies = Bodies(self.platform, self._robot.theta, floor_friction, timestep)
        self.mj_model, self.mj_data = self._bodies.model, self._bodies.data
        self._camera: Camera | None = None
        self.reset()

    def sampled(self, dt: float) -> RollersPlant:
        """The same robot, at rest at the origin, with another sample time, s.

        Raises:
            ValueError: a dt that is no multiple of the physics step.
        """
        return RollersPlant(self.model, dt, self._floor_friction, self._timestep)

    def __getstate__(self) -> dict:
        """All but the camera, whose pictures live on the graphics card."""
        return self.__dict__ | {"_camera": None}

    def reset(self, pose=(0.0, 0.0, 0.0), velocity=(0.0, 0.0, 0.0), wheel_angle=0.0) -> None:
        """Place the robot on the floor, rolling, with relaxed effects.

        Args:
            pose: (x, y, yaw) of O, m, m, rad.
            velocity: (V_X, V_Y, Omega), m/s, m/s, rad/s.
            wheel_angle: angles from which the wheels start, rad, (n,) or one for all.  They decide
                which rollers touch the floor, and so where an open-loop motion ends.
        """
        rest = (0.0,) * len(self.platform.wheels)
        self.t, self._delivered = 0.0, rest
        self._internal = self._structure.rest().internal
        self._commands = [rest] * (math.floor(self._robot.delay() / self._timestep) + 2)
        self._bodies.adopt(self._robot.theta)
        self._bodies.place(pose, tuple(float(value) for value in velocity), wheel_angle)

    def step(self, command: np.ndarray) -> None:
        """Hold the shaft torques ``command`` (n,), N m, for dt.

        Raises:
            FloatingPointError: the simulation left the finite numbers.
        """
        wanted = tuple(float(value) for value in command)
        if self._robot.simple:
            self._delivered = wanted
            self.mj_data.qfrc_applied[self._bodies.wheels] = wanted
            mujoco.mj_step(self.mj_model, self.mj_data, self._substeps)
        else:
            for k in range(self._substeps):
                self._apply(wanted, self.t + k * self._timestep)
                mujoco.mj_step(self.mj_model, self.mj_data)
        self.t += self.dt
        if not np.isfinite(self.mj_data.qvel).all():
            raise FloatingPointError(
                f"the simulation diverged before t = {self.t:.3f} s at the command {wanted} N m; "
                f"use smaller torques or a timestep below {self._timestep} s"
            )
        self._bodies.pose()  # follows the heading, so that its turns are counted

    def motion(self) -> np.ndarray:
        """(x, y, yaw, V_X, V_Y, Omega) of O, see ``pose`` and ``velocity``."""
        return np.array([*self._bodies.pose(), *self._bodies.velocity()])

    @property
    def pose(self) -> np.ndarray:
        """(x, y, yaw) of O in the world, m, m, rad; yaw is not wrapped."""
        return np.array(self._bodies.pose())

    @property
    def velocity(self) -> np.ndarray:
        """(V_X, V_Y, Omega) of O in the body frame, m/s, m/s, rad/s."""
        return np.array(self._bodies.velocity())

    @property
    def wheel_angle(self) -> np.ndarray:
        """Wheel angles (n,), rad."""
        return self._bodies.wheel_angle()

    @property
    def wheel_velocity(self) -> np.ndarray:
        """Wheel speeds (n,), rad/s, as encoders see them."""
        return self._bodies.wheel_velocity()

    @property
    def delivered_torque(self) -> np.ndarray:
        """Torques (n,) that the drives put on the shafts in the last physics step, N m."""
        return np.array(self._delivered)

    def render(self, width: int = 640, height: int = 480) -> np.ndarray:
        """Picture of the robot, (height, width, 3) bytes, from a camera that follows it.

        Raises:
            RuntimeError: MuJoCo finds no way to draw off screen; says which setting helps.
            ValueError: a picture larger than 1920 x 1080.
        """
        if self._camera is None or self._camera.size != (width, height):
            self._camera = Camera(self.mj_model, width, height, self.platform.reach)
        return self._camera.picture(self.mj_data, self.pose)

    def _apply(self, wanted: tuple, t: float) -> None:
        """Set the forces of the next physics step; the states of the effects move along."""
        robot, bodies, force = self._robot, self._bodies, self.mj_data.qfrc_applied
        pose, v, angle = bodies.pose(), bodies.velocity(), tuple(bodies.wheel_angle().tolist())
        command = self._delayed(wanted) if robot.acting("delay") else wanted
        s = robot.signals(t, v, pose, angle, command, FLOAT)
        s.wheel_velocity = tuple(bodies.wheel_velocity().tolist())
        bodies.adopt(s.theta)
        torque, internal = robot.deliver(s, self._internal, self._timestep, FLOAT)
        self._delivered, self._internal = torque, internal
        for index, effect, p in robot.acting("shaft"):
            s.state, s.torque = internal[index], torque
            added = effect.shaft(p, s, FLOAT)
            torque = tuple([m + a for m, a in zip(torque, added, strict=True)])
        force[:] = 0.0
        force[bodies.wheels] = torque
        if robot.acting("roller"):
            # Laws speak of ideal rollers; rate and torque go over to real ones at equal power.
            lowest, ratio = bodies.lowest_rollers()
            s.roller_velocity = tuple((self.mj_data.qvel[lowest] / ratio).tolist())
            for index, effect, p in robot.acting("roller"):
                s.state = internal[index]
                force[lowest] += effect.roller(p, s, FLOAT) / ratio
        c, n = math.cos(pose[2]), math.sin(pose[2])
        for index, effect, p in robot.acting("body"):
            s.state = internal[index]
            fx, fy, moment = effect.body(p, s, FLOAT)
            force[0] += c * fx - n * fy
            force[1] += n * fx + c * fy
            force[5] += moment

    def _delayed(self, wanted: tuple) -> tuple:
        """Command that arrives now: its mean over the next physics step."""
        self._commands = [wanted, *self._commands[:-1]]
        steps = self._robot.delay() / self._timestep
        whole = math.floor(steps)
        part = steps - whole
        pairs = zip(self._commands[whole], self._commands[whole + 1], strict=True)
        return tuple([(1 - part) * new + part * old for new, old in pairs])


def _without_physics(model: Model) -> tuple[Model, float]:
    """The model less what real rollers do by themselves, and the friction of its floor."""
    active = {one.identifier: one.values for one in model.effects}
    left_out = [name for name in PHYSICS if name in active]
    if left_out:
        warnings.warn(
            f"model {model.name!r}: {' and '.join(left_out)} left out on real rollers, which do "
            "that by themselves",
            stacklevel=3,
        )
    kept = tuple(one for one in model.effects if one.identifier not in PHYSICS)
    friction = active.get("wheel_slip", {}).get("f", FLOOR_FRICTION)
    return replace(model, effects=kept), float(friction)
