"""What is hidden in a robot: which parameters of an effect make its size, which its shape.

A drawn effect is a pattern of parameters at amount one, scaled as a whole, and a shape that stays
fixed.  Library effects and those of this room are drawn by the same rule.
"""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from ident.benchmark.conditions import FIT_SECONDS
from ident.benchmark.laws import LAWS
from ident.benchmark.outside import OUTSIDE
from youbot_env.effects import Effect, Parameter, get_effect
from youbot_env.model import ActiveEffect, Model
from youbot_env.platform import Platform

# Effects of the library that a record of wheels, torques and pose can show.  Roller ripple and slip
# belong to the plant with real rollers; errors of base and roller angle show against the pose only.
EFFECTS = (
    "wheel_coulomb_friction", "stribeck_friction", "wheel_friction_asymmetry",
    "load_dependent_friction", "roller_coulomb_friction", "rolling_resistance",
    "yaw_scrub_friction", "quadratic_drag", "floor_slope", "cable_tether", "torque_gain",
    "torque_offset", "torque_dead_zone", "torque_saturation", "actuator_delay", "actuator_lag",
    "battery_sag", "friction_warmup", "payload_change", "torque_ripple", "wheel_radius_error",
)  # fmt: skip
# Parameters in which a law is not linear and that still say how much of it there is.
AMOUNTS = {
    ("actuator_delay", "d"), ("actuator_lag", "T"), ("torque_dead_zone", "threshold"),
    ("torque_saturation", "limit"), ("wheel_radius_error", "e"), ("torque_hysteresis", "b"),
}  # fmt: skip
# Of these less is more: a lower limit clips more.
INVERSE = ("torque_saturation",)
# Ends beyond which no robot of this kind goes, tighter than what is physically possible: at 30 ms
# the wheel loops begin to oscillate, the youBot carries 20 kg, and no wheel is 3 mm too large.
PLAUSIBLE = {
    ("actuator_delay", "d"): (0.0, 0.03),
    ("actuator_lag", "T"): (0.001, 0.1),
    ("payload_change", "dm"): (-20.0, 20.0),
    ("wheel_radius_error", "e"): (-0.05, 0.05),
}
SLOW_DRIVE = ("actuator_delay", "actuator_lag")


@dataclass(frozen=True)
class Hidden:
    """One drawn effect.

    Attributes:
        effect: the law.
        pattern: parameters at amount one, by flat name.
        shape: parameters that keep their values.
        inverse: whether the pattern is divided by the amount.
    """

    effect: Effect
    pattern: dict[str, float]
    shape: dict[str, float]
    inverse: bool = False

    def values(self, amount: float) -> dict[str, float]:
        """Parameters at an amount, inside their bounds."""
        factor = 1.0 / amount if self.inverse else amount
        scaled = {name: self._clipped(name, factor * v) for name, v in self.pattern.items()}
        return {name: float(v) for name, v in (scaled | self.shape).items()}

    def largest(self) -> float:
        """Largest amount at which no bound is met."""
        ends = []
        for name, value in self.pattern.items():
            low, high = self._bounds(name)
            if self.inverse and low > 0:
                ends.append(value / low)
            elif not self.inverse and value:
                ends.append((high if value > 0 else low) / value)
        return min(ends, default=math.inf)

    def _bounds(self, name: str) -> tuple[float, float]:
        parameter = self.effect.parameter_of(name)
        return PLAUSIBLE.get((self.effect.identifier, parameter.name), parameter.bounds)

    def _clipped(self, name: str, value: float) -> float:
        low, high = self._bounds(name)
        return min(max(value, low), high)


def hide(robot: Model, hidden: list[tuple[Hidden, float]]) -> Model:
    """Return the robot with drawn effects of some amounts in it; none need be registered."""
    active = tuple(
        ActiveEffect(h.effect, h.effect.complete(h.values(amount), robot.platform))
        for h, amount in hidden
    )
    return replace(robot, effects=active)


def named(identifier: str) -> Effect:
    """Effect of that identifier: the library's, or one of this room."""
    own = {effect.identifier: effect for effect in (*OUTSIDE, *LAWS)}
    return own[identifier]() if identifier in own else get_effect(identifier)


def kin(hidden: tuple[str, ...]) -> tuple[str, ...]:
    """Effects of the library that diagnosis must not know for hidden ones to lie outside it."""
    kinds = {effect.identifier: effect.kin for effect in OUTSIDE}
    return sum((kinds.get(identifier, ()) for identifier in hidden), ())


def draw_hidden(identifier: str, rng: np.random.Generator, platform: Platform) -> Hidden:
    """Draw pattern and shape of an effect.

    Where wheels may differ, half of the draws put the effect on all of them and half on one; where
    only differences between wheels can be seen, it sits on one, with either sign.
    """
    effect = named(identifier)
    if identifier in DRAWS:
        pattern, shape = DRAWS[identifier](rng)
        return Hidden(effect, pattern, shape)
    one = rng.choice(platform.wheel_names) if rng.uniform() < 0.5 else None
    any_one, sign = rng.choice(platform.wheel_names), rng.choice((-1.0, 1.0))
    pattern, shape = {}, {}
    for parameter in effect.parameters:
        value, name = parameter.default, parameter.name
        if parameter.contrast:
            pattern |= {f"{name}_{any_one}": sign * value}
        elif parameter.linear or (identifier, name) in AMOUNTS:
            pattern |= {f"{name}_{one}" if parameter.per_wheel and one else name: value}
        else:
            shape[name] = _shape(parameter, rng)
    return Hidden(effect, pattern, shape, identifier in INVERSE)


def _shape(parameter: Parameter, rng: np.random.Generator) -> float:
    """A value within a factor of two of the typical one, or any phase where that is zero."""
    low, high = parameter.bounds
    if parameter.default == 0.0:
        return float(rng.uniform(-math.pi, math.pi))
    return min(max(parameter.default * 2.0 ** rng.uniform(-1.0, 1.0), low), high)


# Effects whose parameters belong together: functions of the generator that return pattern and
# shape.


def _stribeck(rng):
    ratio, speed = rng.uniform(1.3, 2.0), rng.uniform(0.3, 1.0)
    one = rng.choice(("fl", "fr", "rl", "rr")) if rng.uniform() < 0.5 else None
    tail = f"_{one}" if one else ""
    return {f"fc{tail}": 0.2, f"fs{tail}": 0.2 * ratio}, {"ws": speed}


def _peak(rng):
    ratio, speed = rng.uniform(1.3, 2.0), rng.uniform(0.3, 1.0)
    return {"fc": 0.2, "fs": 0.2 * ratio}, {"ws": speed}


def _lugre(rng):
    pattern, shape = _peak(rng)
    return pattern, shape | {"bend": 0.02 * 2.0 ** rng.uniform(-1.0, 1.0)}


def _width(rng):
    return {"fc": 0.2}, {"width": float(np.exp(rng.uniform(np.log(0.03), np.log(0.4))))}


def _slope(rng):
    direction = rng.uniform(-math.pi, math.pi)
    return {"sx": 0.01 * math.cos(direction), "sy": 0.01 * math.sin(direction)}, {}


def _cable(rng):
    direction, pull = rng.uniform(-math.pi, math.pi), rng.uniform(0.0, 4.0)
    return {"k": 5.0, "fx": pull * math.cos(direction), "fy": pull * math.sin(direction)}, {}


def _payload(rng):
    x, y, mass = rng.uniform(-0.15, 0.15), rng.uniform(-0.1, 0.1), 5.0
    pattern = {"dm": mass, "dI": mass * (0.02 + x * x + y * y), "dpx": mass * x, "dpy": mass * y}
    return pattern, {"t0": FIT_SECONDS * rng.uniform(0.3, 0.7)}


def _ripple(rng):
    """Order 6 in half of the draws, else anything from 2 to 12; each wheel has its own phase."""
    order = 6.0 if rng.uniform() < 0.5 else float(rng.uniform(2.0, 12.0))
    wheels = ("fl", "fr", "rl", "rr") if rng.uniform() < 0.5 else (rng.choice(("fl", "rr")),)
    pattern = {}
    for wheel in wheels:
        phase = rng.uniform(-math.pi, math.pi)
        pattern |= {f"a_{wheel}": 0.15 * math.cos(phase), f"b_{wheel}": 0.15 * math.sin(phase)}
    return pattern, {"k": order}


def _swing(rng):
    direction, phase = rng.uniform(-math.pi, math.pi, 2)
    pattern = {"fx": 4.0 * math.cos(direction), "fy": 4.0 * math.sin(direction)}
    return pattern, {"w": float(rng.uniform(2.0, 9.0)), "p": float(phase)}


DRAWS: dict[str, Callable] = {
    "stribeck_friction": _stribeck,
    "floor_slope": _slope,
    "cable_tether": _cable,
    "payload_change": _payload,
    "torque_ripple": _ripple,
    "lorentzian_peak": _peak,
    "exponential_peak": _peak,
    "lugre_friction": _lugre,
    "other_width_coulomb": _width,
    "swinging_load": _swing,
}
