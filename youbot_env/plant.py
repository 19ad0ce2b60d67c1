"""The chain from commanded torques to motion, with effects on its links.

Static structure (which effects there are) and values (numbers, arrays or symbols) are apart: a
``ModelStructure`` is fixed when a function is built, the values are arguments of it.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, NamedTuple

from youbot_env import dynamics
from youbot_env.backend import Ops
from youbot_env.dynamics import Inertia, Theta
from youbot_env.effects.base import Effect, Signals
from youbot_env.model import Model
from youbot_env.platform import Geometry, Platform


class State(NamedTuple):
    """State of the plant, in components.

    Attributes:
        pose: (x, y, yaw), m, m, rad, world frame.
        velocity: (V_X, V_Y, Omega), m/s, m/s, rad/s, body frame.
        wheel_angle: n angles, rad; empty where nobody needs them.
        internal: one tuple of states for each effect.
    """

    pose: tuple
    velocity: tuple
    wheel_angle: tuple
    internal: tuple


@dataclass(frozen=True)
class ModelStructure:
    """Which platform and which effects, and the flat names of the values they take.

    Attributes:
        platform: wheel table.
        effects: effects in order of the chain.
        effect_names: for each effect the flat names of its parameters.
        track_wheels: whether wheel angles are part of the state.
    """

    platform: Platform
    effects: tuple[Effect, ...] = ()
    effect_names: tuple[tuple[str, ...], ...] = ()
    track_wheels: bool = False

    @classmethod
    def of(cls, model: Model, track_wheels: bool = False) -> ModelStructure:
        """Return the structure of a model; wheel angles are tracked where an effect reads them."""
        effects = tuple(active.effect for active in model.effects)
        track = track_wheels or any(effect.needs_wheel_angle for effect in effects)
        names = tuple(tuple(active.values) for active in model.effects)
        return cls(model.platform, effects, names, track)

    @property
    def key(self) -> tuple:
        """What two structures must share for one compiled function to serve both."""
        identities = tuple(type(effect) for effect in self.effects)
        return self.platform, identities, self.effect_names, self.track_wheels

    @property
    def value_count(self) -> int:
        """Number of values: seven of theta and those of the effects."""
        return len(Theta._fields) + sum(map(len, self.effect_names))

    @property
    def state_size(self) -> int:
        """Number of components of the flat state."""
        return len(self.flatten(self.rest()))

    def rest(self, pose: tuple = (0.0, 0.0, 0.0), velocity: tuple = (0.0, 0.0, 0.0)) -> State:
        """Return the state with relaxed effects at a pose and a velocity."""
        wheels = (0.0,) * len(self.platform.wheels) if self.track_wheels else ()
        internal = tuple((0.0,) * effect.state_size(self.platform) for effect in self.effects)
        return State(tuple(pose), tuple(velocity), wheels, internal)

    def flatten(self, state: State) -> tuple:
        """Return the state as one flat tuple of components."""
        return (*state.pose, *state.velocity, *state.wheel_angle, *sum(state.internal, ()))

    def unflatten(self, flat) -> State:
        """Invert ``flatten``."""
        flat = tuple(flat)
        wheels = len(self.platform.wheels) if self.track_wheels else 0
        return State(flat[:3], flat[3:6], flat[6 : 6 + wheels], self.parted(flat[6 + wheels :]))

    def parted(self, flat) -> tuple:
        """States of the effects, from one sequence of all of them to one tuple for each effect."""
        flat, internal, at = tuple(flat), [], 0
        for effect in self.effects:
            size = effect.state_size(self.platform)
            internal.append(flat[at : at + size])
            at += size
        return tuple(internal)

    @property
    def bristled(self) -> bool:
        """Whether a law beyond the drive has a memory: forces then need the effects' states."""
        return any(e.state_size(self.platform) and not e.acts("drive") for e in self.effects)

    def bind(self, values) -> BoundModel:
        """Give the structure its values, in the order of ``Model.names()``."""
        values = tuple(values)
        theta, at, bound = Theta(*values[:7]), 7, []
        for index, (effect, names) in enumerate(zip(self.effects, self.effect_names, strict=True)):
            chosen = dict(zip(names, values[at : at + len(names)], strict=True))
            bound.append((index, effect, effect.arrange(chosen, self.platform)))
            at += len(names)
        return BoundModel(self.platform, theta, bound, values)


class BoundModel:
    """A structure with values: evaluates delivered torques, accelerations and wheel speeds."""

    def __init__(
        self,
        platform: Platform,
        theta: Theta,
        bound: list[tuple[int, Effect, Any]],
        values: tuple,
    ):
        self.platform, self.theta, self.geometry = platform, theta, platform.geometry
        self.effects, self.values = bound, values
        self._hooks = {
            hook: sorted(
                (entry for entry in bound if entry[1].acts(hook)), key=lambda e: e[1].order
            )
            for hook in ("drive", "delay", "shaft", "roller", "body", "inertial", "kinematics",
                         "slip", "restore")
        }  # fmt: skip
        # Instruments leave the robot as it is.
        self.simple = all(effect.link == "sensor" for _, effect, _ in bound)
        self.reads_pose = any(effect.needs_pose for _, effect, _ in bound)
        self.reads_wheel_angle = any(effect.needs_wheel_angle for _, effect, _ in bound)
        self._constant = not (self._hooks["inertial"] or self._hooks["kinematics"])
        self.inertia: Inertia | None = (
            dynamics.prepare(self.geometry, theta) if self._constant else None
        )

    def acting(self, hook: str) -> list[tuple[int, Effect, Any]]:
        """Effects that override a hook, in chain order: (index, effect, its parameters)."""
        return self._hooks[hook]

    def delay(self):
        """Total pure delay of the torque command, s."""
        return sum(effect.delay(p) for _, effect, p in self._hooks["delay"])

    def signals(
        self, t, v, pose, wheel_angle, command, ops: Ops, geometry: Geometry | None = None
    ) -> Signals:
        """Collect what the laws read, with Jacobians and theta as the effects change them.

        ``geometry`` gives the changed Jacobians where they are known already.
        """
        known = geometry or self.geometry
        s = Signals(self.platform, known, self.theta, t, v, pose, wheel_angle, command)
        for _, effect, p in [] if geometry else self._hooks["kinematics"]:
            s.geometry = effect.kinematics(p, s.geometry, s, ops)
        change = self.theta_change(s, ops)
        if change is not None:
            s.theta = Theta(*_sum(s.theta, change))
        return s

    def theta_change(self, s: Signals, ops: Ops) -> tuple | None:
        """What effects (a payload) add to theta; None where no effect does."""
        total = None
        for _, effect, p in self._hooks["inertial"]:
            change = effect.inertial(p, s, ops)
            total = tuple(change) if total is None else _sum(total, change)
        return total

    def deliver(self, s: Signals, internal: tuple, h, ops: Ops) -> tuple[tuple, tuple]:
        """Pass the command through the drive.

        Args:
            s: signals at the start of the step.
            internal: states of all effects at that instant.
            h: time since then, s; inputs are held.
            ops: elementary functions.

        Returns:
            ``(torques on the shafts, states of all effects after h)``.
        """
        torque, states = s.command, list(internal)
        for index, effect, p in self._hooks["drive"]:
            s.state = states[index]
            s.state = states[index] = effect.evolve(p, torque, s, h, ops)
            torque = effect.drive(p, torque, s, ops)
        for index, effect, p in self.effects:
            if states[index] and not effect.acts("drive"):
                s.state = states[index]
                states[index] = effect.evolve(p, torque, s, h, ops)
        return torque, tuple(states)

    def wrench(self, torque: tuple, s: Signals, internal: tuple, ops: Ops) -> tuple:
        """Generalized forces on the body: shaft torques, rollers and floor together."""
        s.torque = torque
        for index, effect, p in self._hooks["shaft"]:
            s.state, s.torque = internal[index], torque
            torque = _sum(torque, effect.shaft(p, s, ops))
        total = s.geometry.wrench(torque)
        for index, effect, p in self._hooks["roller"]:
            s.state = internal[index]
            total = _sum(total, s.geometry.roller_wrench(effect.roller(p, s, ops)))
        for index, effect, p in self._hooks["body"]:
            s.state = internal[index]
            total = _sum(total, effect.body(p, s, ops))
        return total

    def inertia_at(self, s: Signals) -> Inertia:
        """What forward dynamics needs of the configuration; no velocity enters it."""
        return self.inertia or dynamics.prepare(s.geometry, s.theta)

    def acceleration(self, wrench: tuple, s: Signals, inertia: Inertia | None = None) -> tuple:
        """Forward dynamics under generalized forces; ``inertia`` where it is known already."""
        return dynamics.acceleration(inertia or self.inertia_at(s), s.v, wrench)

    def wheel_velocity(self, s: Signals, ops: Ops, internal: tuple | None = None) -> tuple:
        """Wheel speeds that an encoder sees, rad/s: J v and slip.

        Slip depends on the torque that reaches the floor; give ``internal`` where ``wrench`` has
        not been evaluated on these signals before.
        """
        speed = s.wheel_velocity
        if self._hooks["slip"] and internal is not None:
            self.wrench(self.deliver(s, internal, 0.0, ops)[0], s, internal, ops)
        for _, effect, p in self._hooks["slip"]:
            speed = _sum(speed, effect.slip(p, s, ops))
        return speed


def _sum(a: tuple, b: tuple) -> tuple:
    return tuple(x + y for x, y in zip(a, b, strict=True))
