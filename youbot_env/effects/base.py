"""What a physical effect is: one object that simulator, regression and controllers all use.

An effect acts on one link of the chain

    command -> drive -> wheel shaft -> roller -> body and floor -> kinematics -> sensors

and overrides the hook of that link.  Laws are written over components with the elementary
functions ``ops``, so the same law runs on floats, NumPy batches, CasADi symbols and JAX.  A file in
this folder that defines a subclass is found without an entry in any list.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from functools import cached_property
from types import SimpleNamespace
from typing import Any, ClassVar

from youbot_env.backend import Ops
from youbot_env.dynamics import Theta
from youbot_env.measurement import Dense, Rows
from youbot_env.platform import Geometry, Platform

GRAVITY = 9.81


@dataclass(frozen=True)
class Parameter:
    """One parameter of an effect.

    Attributes:
        name: short name; a wheel name is appended where the parameter is per wheel.
        unit: unit as printed.
        meaning: a few words.
        default: the typical size, from which tests and experiments start.
        bounds: what is physically possible.
        linear: whether the law is linear in it (its regression column is then the law at one).
        per_wheel: whether each wheel may have its own value; one number then means all wheels.
        contrast: whether only differences between wheels can be seen, the common part being a
            parameter of the robot itself or invisible; the typical size is then one wheel's.
        profile: sizes that a search tries where the law is not linear in the parameter, in units
            of ``profile_unit``.
        profile_unit: ``default`` (the typical size), ``command`` (rms of the drive input),
            ``peak`` (its largest value), ``duration`` (of the record) or ``reach`` (the farthest
            the robot comes from the origin along x or y).  ``order``: no profile but the orders of
            the wheel angle at which a record repeats.  ``roller_phase``: for each wheel what the
            wheels themselves tell of their rollers, where they do.
        crossed: whether its profile is tried with every value of the others' profiles.
        smooth: whether the law has a derivative in the parameter; where it has none the parameter
            stays at the best of its profile.
        scope: whose value it is: ``robot`` goes with the robot from log to log, ``record`` belongs
            to one log (its floor, its load, its instruments).
        choices: words for the whole numbers 0, 1, ... where the parameter is a choice.
    """

    name: str
    unit: str
    meaning: str
    default: float
    bounds: tuple[float, float]
    linear: bool = True
    per_wheel: bool = False
    contrast: bool = False
    profile: tuple[float, ...] = (0.25, 0.5, 1.0, 2.0, 4.0)
    profile_unit: str = "default"
    crossed: bool = False
    smooth: bool = True
    scope: str = "robot"
    choices: tuple[str, ...] = ()

    def shown(self, value: float) -> float | str:
        """The value as people read it: the word of a choice, else the number."""
        return self.choices[round(value)] if self.choices else value


class Signals:
    """Everything a law may depend on, in components, at one instant.

    Attributes:
        t: time, s.
        v: body velocities (V_X, V_Y, Omega), m/s, m/s, rad/s.
        pose: (x, y, yaw) in the world, m, m, rad.
        wheel_angle: n wheel angles, rad.
        command: n commanded (= logged) shaft torques, N m.
        torque: n shaft torques as far as the chain has come, N m: the command, then what the drive
            delivers, then what is left after each effect on the shaft.
        theta: parameters of the robot the effect sits on.
        state: states of the effect that is being asked, as many as its ``state_size``.
        wheel_velocity, roller_velocity: n wheel speeds J v and roller rates G v, rad/s, computed
            when first asked for.
    """

    def __init__(
        self,
        platform: Platform,
        geometry: Geometry,
        theta: Theta,
        t,
        v,
        pose,
        wheel_angle,
        command,
    ):
        self.platform, self.geometry, self.theta = platform, geometry, theta
        self.t, self.v, self.pose = t, v, pose
        self.wheel_angle, self.command, self.torque = wheel_angle, command, command
        self.state: tuple = ()

    @cached_property
    def wheel_velocity(self) -> tuple:
        """Wheel speeds, rad/s."""
        return self.geometry.wheel_velocity(self.v)

    @cached_property
    def roller_velocity(self) -> tuple:
        """Roller rates, rad/s."""
        return self.geometry.roller_velocity(self.v)


class Effect:
    """Base class of all effects; a subclass states what it is and overrides one hook or more.

    Class attributes:
        identifier: public name on the command line, in model files and in JSON.
        title, equation: for people; the equation in LaTeX.
        link: ``drive``, ``shaft``, ``roller``, ``body``, ``kinematics`` or ``sensor``; one of the
            link ``sensor`` belongs to the record and leaves the robot as it is.
        parameters: what it is measured by.
        regime: when it shows.
        confusables: identifiers of effects that look alike in most logs.
        contains: identifiers of effects that are special cases of this one.
        experiments: motions that tell them apart.
        only_beside: identifiers of effects; diagnosis looks for this one once it has one of them.
        order: place among the effects of the same link, small first.
        needs_pose, needs_wheel_angle, needs_time: signals beyond velocity that the law reads.
        background: whether every robot has some of it, so that it is explained before anything
            else is named.
        late: whether it makes the velocities answer late to the drive, which a clock may feign.
        candidate: whether diagnosis looks for it; hold and clock of the drive are found before.
        channel: what an effect of the link ``sensor`` changes, where a log may lack it.
        seen_by_wheels: whether wheel speeds alone show it; if not, only a measured pose does.
        torque_loss: whether a law of another link than ``drive`` loses a share of its torque.
    """

    identifier: ClassVar[str]
    title: ClassVar[str]
    equation: ClassVar[str]
    link: ClassVar[str]
    parameters: ClassVar[tuple[Parameter, ...]]
    regime: ClassVar[str] = ""
    confusables: ClassVar[tuple[str, ...]] = ()
    contains: ClassVar[tuple[str, ...]] = ()
    experiments: ClassVar[tuple[str, ...]] = ()
    only_beside: ClassVar[tuple[str, ...]] = ()
    order: ClassVar[int] = 0
    needs_pose: ClassVar[bool] = False
    needs_wheel_angle: ClassVar[bool] = False
    needs_time: ClassVar[bool] = False
    background: ClassVar[bool] = False
    late: ClassVar[bool] = False
    candidate: ClassVar[bool] = True
    channel: ClassVar[str] = ""
    seen_by_wheels: ClassVar[bool] = True
    torque_loss: ClassVar[bool] = False

    # Hooks.  ``p`` holds the parameters by name; a per-wheel parameter is always a tuple of n.

    def drive(self, p: Any, torque: tuple, s: Signals, ops: Ops) -> tuple:
        """Torques the drive delivers when ``torque`` is asked of it, n values, N m."""
        return torque

    def delay(self, p: Any):
        """Pure delay of the torque command, s."""
        return 0.0

    def shaft(self, p: Any, s: Signals, ops: Ops) -> tuple:
        """Torques added on the wheel shafts, n values, N m."""
        raise NotImplementedError

    def roller(self, p: Any, s: Signals, ops: Ops) -> tuple:
        """Torques added in the roller bearings, n values, N m."""
        raise NotImplementedError

    def body(self, p: Any, s: Signals, ops: Ops) -> tuple:
        """Wrench added on the body in the body frame, (N, N, N m)."""
        raise NotImplementedError

    def inertial(self, p: Any, s: Signals, ops: Ops) -> Theta:
        """Change of theta (a payload), to be added to the robot's; does not read velocities."""
        raise NotImplementedError

    def kinematics(self, p: Any, geometry: Geometry, s: Signals, ops: Ops) -> Geometry:
        """Jacobians in place of the ideal ones (radius errors, finite rollers).

        They belong to a configuration: velocities are not read.
        """
        raise NotImplementedError

    def slip(self, p: Any, s: Signals, ops: Ops) -> tuple:
        """Wheel speeds beyond J v, n values, rad/s."""
        raise NotImplementedError

    def record(self, p: Any, dense: Dense) -> None:
        """Change channels in place into what the instruments make of them (see ``measurement``)."""
        raise NotImplementedError

    def restore(self, p: Any, rows: Rows) -> Rows:
        """Undo ``record`` on the rows of a log as far as they tell."""
        raise NotImplementedError

    def state_size(self, platform: Platform) -> int:
        """Return how many states of its own the effect carries (torques of a lag, bristles)."""
        return 0

    def evolve(self, p: Any, torque: tuple, s: Signals, h, ops: Ops) -> tuple:
        """Return the effect's state h seconds after ``s.state``, inputs held, exactly if it can."""
        return s.state

    def time_constant(self, p: Any):
        """Fastest time constant of the effect's own state, s; the step is chosen below it."""
        return math.inf

    def plausible(self, values: dict[str, float]) -> bool:
        """Tell whether sizes within their bounds, by flat name, also make sense together."""
        return True

    # What follows is the same for every effect.

    @classmethod
    def scope(cls) -> str:
        """``record`` where every parameter belongs to one log, else ``robot``."""
        return "record" if all(p.scope == "record" for p in cls.parameters) else "robot"

    @classmethod
    def lessens_drive(cls) -> bool:
        """Whether the effect may take away what the drive exerts, not add a force of its own."""
        turned = cls.acts("kinematics") or cls.acts("slip")
        return cls.link == "drive" or turned or cls.torque_loss

    @classmethod
    def acts(cls, hook: str) -> bool:
        """Tell whether the effect overrides the hook of that name."""
        return getattr(cls, hook) is not getattr(Effect, hook)

    @classmethod
    def parameter_names(cls, platform: Platform, per_wheel: bool = False) -> tuple[str, ...]:
        """Flat parameter names; ``per_wheel`` splits those that may differ between wheels."""
        names = []
        for parameter in cls.parameters:
            if parameter.per_wheel and per_wheel:
                names += [f"{parameter.name}_{wheel}" for wheel in platform.wheel_names]
            else:
                names.append(parameter.name)
        return tuple(names)

    @classmethod
    def parameter_of(cls, flat_name: str) -> Parameter:
        """Return the parameter that a flat name (``fc`` or ``fc_fl``) belongs to.

        Raises:
            ValueError: the effect has no such parameter.
        """
        matches = [
            parameter
            for parameter in cls.parameters
            if flat_name == parameter.name or flat_name.startswith(f"{parameter.name}_")
        ]
        if not matches:
            raise ValueError(f"effect {cls.identifier} has no parameter {flat_name!r}")
        return max(matches, key=lambda parameter: len(parameter.name))

    @classmethod
    def arrange(cls, values: dict, platform: Platform) -> SimpleNamespace:
        """Turn flat values by name into what the laws read (tuples for per-wheel parameters)."""
        arranged = {}
        for parameter in cls.parameters:
            if not parameter.per_wheel:
                arranged[parameter.name] = values[parameter.name]
            elif parameter.name in values:
                arranged[parameter.name] = (values[parameter.name],) * len(platform.wheels)
            else:
                arranged[parameter.name] = tuple(
                    values[f"{parameter.name}_{wheel}"] for wheel in platform.wheel_names
                )
        return SimpleNamespace(**arranged)

    @classmethod
    def complete(cls, values: dict | float | None, platform: Platform) -> dict[str, float]:
        """Fill in defaults and check names, numbers and bounds.

        Args:
            values: parameters by flat name; one number stands for the first parameter.
            platform: gives the wheel names.

        Raises:
            ValueError: an unknown name, a value that is not a number, or one outside its bounds.
        """
        if values is None:
            values = {}
        if isinstance(values, int | float | str):
            values = {cls.parameters[0].name: values}
        if not isinstance(values, dict):
            raise ValueError(f"effect {cls.identifier}: {values!r} must be a number or a mapping")
        left, result = dict(values), {}
        for parameter in cls.parameters:
            split = [f"{parameter.name}_{wheel}" for wheel in platform.wheel_names]
            if parameter.per_wheel and any(name in left for name in split):
                rest = left.pop(parameter.name, 0.0)
                chosen = {name: left.pop(name, rest) for name in split}
            elif parameter.contrast and parameter.name not in left:
                chosen = dict.fromkeys(split, 0.0) | {split[0]: parameter.default}
            else:
                chosen = {parameter.name: left.pop(parameter.name, parameter.default)}
            for name, value in chosen.items():
                result[name] = _checked(cls.identifier, name, value, parameter)
        if left:
            known = cls.parameter_names(platform) + cls.parameter_names(platform, True)
            raise ValueError(
                f"effect {cls.identifier} has no parameter {sorted(left)}; "
                f"it has {sorted(set(known))}"
            )
        return result


def _checked(identifier: str, name: str, value, parameter: Parameter) -> float:
    low, high = parameter.bounds
    if isinstance(value, str) and value in parameter.choices:
        return float(parameter.choices.index(value))
    if isinstance(value, bool) or not isinstance(value, int | float):
        words = f"; choose {', '.join(parameter.choices)}" if parameter.choices else ""
        raise ValueError(f"effect {identifier}: {name} = {value!r} is not a number{words}")
    if not low <= value <= high:
        raise ValueError(
            f"effect {identifier}: {name} = {value} {parameter.unit} is outside "
            f"[{low}, {high}] {parameter.unit}"
        )
    if parameter.choices and value != round(value):
        raise ValueError(
            f"effect {identifier}: {name} = {value} is none of {', '.join(parameter.choices)}"
        )
    return float(value)
