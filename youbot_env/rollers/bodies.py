"""The bodies of a robot with real rollers: placing them on the floor and reading their motion.

A wheel table becomes a tree: floor, platform on a free joint at O, wheels on stiff mounts, rollers
on the wheels.  Masses and frictions are written into the compiled model by ``set_theta``.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import mujoco
import numpy as np

from youbot_env.backend import NUMPY
from youbot_env.dynamics import Theta
from youbot_env.effects.base import GRAVITY
from youbot_env.platform import Platform, Wheel
from youbot_env.rollers.shape import (
    mean_square_rate_ratio,
    rate_ratio,
    roller_count,
    roller_ellipsoids,
)

# The rollers' share of the wheel's mass.  The equations know no inertia of rollers; at this share
# it adds 0.5 % to the youBot's sideways inertia.
ROLLERS_SHARE = 0.24
# Wheels are mounted a little elastically, as on any frame: the mounts give way by this much, m,
# under the robot and are critically damped.  On a rigid frame wheels leave the floor in turn, for
# their rollers differ from the cylinder by hundredths of a millimetre, and spin.
MOUNT_SAG = 5e-4
# The floor is as stiff as a step of 1 ms resolves; it gives way by a few micrometres.  Softer
# contacts roll with a dry friction that no parameter asks for: (0.004 s, 0.9) with 0.5 N, this
# one with 0.1 N.
SOLREF = (0.002, 1.0)
SOLIMP = (0.98, 0.98, 1e-4, 0.5, 2.0)
# Friction is this much stiffer than the normal contact; sets how little rolling rollers creep.
IMPEDANCE_RATIO = 10.0

ORANGE, DARK, BLACK = (0.95, 0.45, 0.1, 1.0), (0.3, 0.3, 0.33, 1.0), (0.1, 0.1, 0.12, 1.0)


class Layout(NamedTuple):
    """Where things are in the state of the compiled model.

    Attributes:
        body: index of the platform's body.
        mount, wheel: (n,) joint indices.
        wheel_position: (n,) indices of wheel angles in ``qpos``.
        wheel_velocity: (n,) indices of wheel speeds in ``qvel``.
        roller_velocity: (n, rollers) indices of roller rates in ``qvel``.
    """

    body: int
    mount: np.ndarray
    wheel: np.ndarray
    wheel_position: np.ndarray
    wheel_velocity: np.ndarray
    roller_velocity: np.ndarray


def build(
    platform: Platform, theta: Theta, floor_friction: float, timestep: float
) -> tuple[mujoco.MjModel, Layout]:
    """Compile the model of a robot.

    Args:
        platform: wheel table and radii.
        theta: the seven parameters of the robot.
        floor_friction: Coulomb coefficient between rollers and floor.
        timestep: step of the integration, s.

    Raises:
        ValueError: an inertia below what wheels of this mass have by themselves.
    """
    spec = mujoco.MjSpec()
    spec.modelname = platform.name
    _set_options(spec.option, timestep)
    contact = {"friction": (floor_friction, 0, 0), "condim": 3, "solref": SOLREF, "solimp": SOLIMP}
    _add_floor(spec, contact)
    body = spec.worldbody.add_body(name="platform", pos=(0, 0, platform.wheel_radius))
    body.add_freejoint(name="platform")
    body.add_light(pos=(0, 0, 4), dir=(0, 0, -1), mode=mujoco.mjtCamLight.mjCAMLIGHT_TRACK)
    # Off the origin, because a compiled model has no place for the offset of a centre of mass that
    # was at zero; ``set_theta`` puts it where it is.
    _set_inertial(body, 1.0, (0.01, 0.01, 0.0), (1.0, 1.0, 1.0))
    _add_shell(body, platform)
    for wheel in platform.wheels:
        _add_wheel(body, platform, wheel, contact)
    model = spec.compile()
    layout = _layout(model, platform)
    set_theta(model, layout, platform, theta)
    return model, layout


def set_theta(model: mujoco.MjModel, layout: Layout, platform: Platform, theta: Theta) -> None:
    """Give a compiled model the parameters of a robot.

    What wheels and rollers weigh by themselves is read from MuJoCo's own mass matrix; platform and
    rotors get the rest, so that the whole robot has exactly m0, I0 and I1.

    Raises:
        ValueError: I0 or I1 below what wheels of this mass have by themselves.
    """
    body, wheels = layout.body, layout.wheel_velocity
    mass = theta.m0 - len(platform.wheels) * platform.wheel_mass
    model.body_mass[body] = mass
    model.body_ipos[body] = theta.max / mass, theta.may / mass, 0.0
    model.body_inertia[body] = 1.0
    model.dof_armature[wheels] = 0.0
    own = _mass_matrix(model)
    yaw = theta.I0 - (own[5, 5] - 1.0)
    rotor = theta.I1 - own[wheels[0], wheels[0]]
    for name, total, rest in (("I0", theta.I0, yaw), ("I1", theta.I1, rotor)):
        if rest <= 0:
            raise ValueError(
                f"{name} = {total:.4g} kg m^2 leaves nothing beside the {total - rest:.4g} kg m^2 "
                f"that the masses have; raise {name} or lower the platform's wheel_mass, "
                f"now {platform.wheel_mass} kg"
            )
    # Only yaw matters to a robot on the floor; the other two are those of a flat body.
    model.body_inertia[body] = 0.6 * yaw, 0.6 * yaw, yaw
    model.dof_armature[wheels] = rotor
    model.dof_damping[wheels] = theta.mu1
    # mu2 belongs to ideal rollers; real ones turn faster near their ends, and at this coefficient
    # they lose the same power on average.
    model.dof_damping[layout.roller_velocity] = theta.mu2 / mean_square_rate_ratio(platform)
    load, rate = theta.m0 / len(platform.wheels), math.sqrt(GRAVITY / MOUNT_SAG)
    model.jnt_stiffness[layout.mount] = load * rate**2
    model.dof_damping[model.jnt_dofadr[layout.mount]] = 2 * load * rate
    mujoco.mj_setConst(model, mujoco.MjData(model))


def _set_options(option: mujoco.MjOption, timestep: float) -> None:
    option.timestep = timestep
    # Rollers are light and well damped: the contact forces must be solved together with the
    # implicit damping, or rolling rollers creep.  This integrator does so.
    option.integrator = mujoco.mjtIntegrator.mjINT_DISCRETE
    option.enableflags = int(mujoco.mjtEnableBit.mjENBL_DIAGEXACT)
    option.disableflags = int(mujoco.mjtDisableBit.mjDSBL_AUTORESET)
    # Few contacts on many joints: the dual solver needs the least time.
    option.solver = mujoco.mjtSolver.mjSOL_PGS
    option.jacobian = mujoco.mjtJacobian.mjJAC_SPARSE
    option.cone = mujoco.mjtCone.mjCONE_ELLIPTIC
    option.impratio = IMPEDANCE_RATIO


def _add_floor(spec: mujoco.MjSpec, contact: dict) -> None:
    spec.visual.global_.offwidth, spec.visual.global_.offheight = 1920, 1080
    spec.visual.headlight.ambient = spec.visual.headlight.diffuse = (0.4, 0.4, 0.4)
    spec.add_texture(
        name="tiles", type=mujoco.mjtTexture.mjTEXTURE_2D, width=256, height=256,
        builtin=mujoco.mjtBuiltin.mjBUILTIN_CHECKER,
        rgb1=(0.86, 0.87, 0.88), rgb2=(0.7, 0.72, 0.75),
    )  # fmt: skip
    textures = [""] * int(mujoco.mjtTextureRole.mjNTEXROLE)
    textures[int(mujoco.mjtTextureRole.mjTEXROLE_RGB)] = "tiles"
    spec.add_material(name="floor", textures=textures, texrepeat=(2, 2), texuniform=True)
    spec.worldbody.add_geom(
        name="floor", type=mujoco.mjtGeom.mjGEOM_PLANE, size=(0, 0, 1), material="floor",
        contype=0, conaffinity=1, **contact,
    )  # fmt: skip


def _add_shell(body: mujoco.MjsBody, platform: Platform) -> None:
    half = 0.8 * np.abs([(wheel.x, wheel.y) for wheel in platform.wheels]).max(axis=0)
    radius = platform.wheel_radius
    body.add_geom(
        name="shell", type=mujoco.mjtGeom.mjGEOM_BOX, size=(*half, 0.5 * radius),
        pos=(0, 0, 0.8 * radius), rgba=ORANGE, contype=0, conaffinity=0,
    )  # fmt: skip


def _add_wheel(body: mujoco.MjsBody, platform: Platform, wheel: Wheel, contact: dict) -> None:
    count, depth = roller_count(platform), platform.wheel_radius - platform.roller_radius
    mass = (1 - ROLLERS_SHARE) * platform.wheel_mass
    roller_mass = ROLLERS_SHARE * platform.wheel_mass / count
    spin = mass * depth**2 / 2
    hub = body.add_body(
        name=wheel.name, pos=(wheel.x, wheel.y, 0), quat=_turn((0, 0, 1), wheel.heading)
    )
    hub.add_joint(name=f"{wheel.name}_mount", type=mujoco.mjtJoint.mjJNT_SLIDE, axis=(0, 0, 1))
    hub.add_joint(name=wheel.name, type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0, 1, 0))
    _set_inertial(hub, mass, (0, 0, 0), (0.6 * spin, spin, 0.6 * spin))
    hub.add_geom(
        type=mujoco.mjtGeom.mjGEOM_CYLINDER, size=(0.6 * depth, 1.2 * platform.roller_radius, 0),
        quat=_turn((1, 0, 0), math.pi / 2), rgba=DARK, contype=0, conaffinity=0,
    )  # fmt: skip
    # Under the wheel a roller's axis makes the roller angle with the direction of rolling (this is
    # what eq. 3 says): it is that direction for an omni wheel.
    delta, spin = wheel.roller_angle, roller_mass * platform.roller_radius**2 / 2
    tilt = _turn((-math.sin(delta), math.cos(delta), 0), math.pi / 2)
    for k in range(count):
        angle = 2 * math.pi * k / count
        roller = hub.add_body(
            pos=(-depth * math.sin(angle), 0, -depth * math.cos(angle)),
            quat=_product(_turn((0, 1, 0), angle), tilt),
        )
        roller.add_joint(name=f"{wheel.name}_{k}", type=mujoco.mjtJoint.mjJNT_HINGE, axis=(0, 0, 1))
        _set_inertial(roller, roller_mass, (0, 0, 0), (3 * spin, 3 * spin, spin))
        for across, along in roller_ellipsoids(platform, delta):
            roller.add_geom(
                type=mujoco.mjtGeom.mjGEOM_ELLIPSOID, size=(across, across, along), rgba=BLACK,
                contype=1, conaffinity=0, **contact,
            )  # fmt: skip


def _set_inertial(body: mujoco.MjsBody, mass: float, centre: tuple, inertia: tuple) -> None:
    body.explicitinertial = True
    body.mass, body.ipos, body.inertia = mass, centre, inertia


def _layout(model: mujoco.MjModel, platform: Platform) -> Layout:
    names = platform.wheel_names
    wheels = np.array([model.joint(name).id for name in names])
    rollers = [
        [model.joint(f"{name}_{k}").id for k in range(roller_count(platform))] for name in names
    ]
    return Layout(
        body=model.body("platform").id,
        mount=np.array([model.joint(f"{name}_mount").id for name in names]),
        wheel=wheels,
        wheel_position=model.jnt_qposadr[wheels],
        wheel_velocity=model.jnt_dofadr[wheels],
        roller_velocity=model.jnt_dofadr[np.array(rollers)],
    )


def _mass_matrix(model: mujoco.MjModel) -> np.ndarray:
    data, full = mujoco.MjData(model), np.zeros((model.nv, model.nv))
    mujoco.mj_forward(model, data)
    mujoco.mj_fullM(model, data, full)
    return full


def _turn(axis: tuple, angle: float) -> np.ndarray:
    quaternion = np.zeros(4)
    mujoco.mju_axisAngle2Quat(quaternion, np.array(axis, float), angle)
    return quaternion


def _product(first: np.ndarray, second: np.ndarray) -> np.ndarray:
    quaternion = np.zeros(4)
    mujoco.mju_mulQuat(quaternion, first, second)
    return quaternion


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
