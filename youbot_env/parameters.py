"""Physical parameters of a robot, their checks, and the two vectors that identification uses.

``Parameters`` are what a person reads (kg, kg m^2, m, N m s).  ``Theta`` are the seven numbers the
dynamics are linear in.  ``x`` is the vector of the paper (eq. 7), theta in other units.
"""

from __future__ import annotations

import math
from dataclasses import asdict, dataclass, fields
from typing import Any

from youbot_env.backend import FLOAT, Ops
from youbot_env.dynamics import Theta
from youbot_env.platform import Platform

UNITS = {
    "m0": "kg",
    "I0": "kg m^2",
    "I1": "kg m^2",
    "a_x": "m",
    "a_y": "m",
    "mu1": "N m s",
    "mu2": "N m s",
}
MEANING = {
    "m0": "total mass",
    "I0": "moment of inertia about the centre of the wheels",
    "I1": "spin inertia of one wheel, rotor included",
    "a_x": "centre of mass of the platform, forward",
    "a_y": "centre of mass of the platform, to the left",
    "mu1": "viscous friction of one wheel",
    "mu2": "viscous friction of one roller",
}


class ImpossibleParameters(ValueError):
    """Parameters that no robot can have."""


@dataclass(frozen=True)
class Parameters:
    """The physical parameters of a platform.

    Attributes:
        m0: total mass, kg.
        I0: moment of inertia about O, the centre of the wheels, kg m^2.
        I1: spin inertia of one wheel with its rotor seen at the wheel, kg m^2.
        a_x, a_y: centre of mass of the platform without wheels, body frame, m.
        mu1, mu2: viscous friction of one wheel and of one roller, N m s.
    """

    m0: float
    I0: float
    I1: float
    a_x: float
    a_y: float
    mu1: float
    mu2: float

    def theta(self, platform: Platform) -> Theta:
        """Return the seven parameters in which the dynamics are linear."""
        m = self.m0 - len(platform.wheels) * platform.wheel_mass
        return Theta(self.m0, self.I0, self.I1, m * self.a_x, m * self.a_y, self.mu1, self.mu2)

    @classmethod
    def from_theta(cls, theta: Theta, platform: Platform) -> Parameters:
        """Invert ``theta``, of components; nothing is checked, an estimate may be impossible."""
        m = theta.m0 - len(platform.wheels) * platform.wheel_mass
        if isinstance(m, float) and m == 0.0:
            m = math.nan  # without a body its centre of mass is nowhere
        return cls(theta.m0, theta.I0, theta.I1, theta.max / m, theta.may / m, *theta[5:])

    @classmethod
    def from_mapping(cls, values: dict, source: str = "parameters") -> Parameters:
        """Build from a mapping with exactly the seven names, each a finite number.

        Raises:
            ValueError: a name is missing, unknown, or its value is not a finite number.
        """
        names = [field.name for field in fields(cls)]
        missing, unknown = set(names) - set(values), set(values) - set(names)
        if missing or unknown:
            raise ValueError(
                f"{source}: missing {sorted(missing)}, unknown {sorted(unknown)}; "
                f"a robot has exactly the parameters {names}"
            )
        for name in names:
            value = values[name]
            if isinstance(value, bool) or not isinstance(value, int | float):
                raise ValueError(f"{source}: {name} = {value!r} is not a number; give its value")
            if not math.isfinite(value):
                raise ValueError(f"{source}: {name} = {value} is not finite")
        return cls(**{name: float(values[name]) for name in names})

    def as_dict(self) -> dict[str, float]:
        """Return the seven values by name."""
        return asdict(self)

    def rules(self, platform: Platform, ops: Ops) -> dict[str, Any]:
        """What possible parameters keep, by rule, as truth values or components of these.

        ``finite m0``, ``positive m0`` and so on; ``weight`` (more than the wheels alone),
        ``balance`` (the centre of mass is above the wheels' polygon) and ``inertia`` (more than
        the offset of the centre of mass alone gives).
        """
        kept: dict[str, Any] = {}
        for name in ("m0", "I0", "I1", "mu1", "mu2"):
            value = getattr(self, name)
            kept[f"finite {name}"] = ops.abs(value) < math.inf
            kept[f"positive {name}"] = value > 0 if name in ("m0", "I0") else value >= 0
        body = self.m0 - len(platform.wheels) * platform.wheel_mass
        own = body * (self.a_x * self.a_x + self.a_y * self.a_y)
        balance = platform.contains(self.a_x, self.a_y, ops)
        return kept | {"weight": body > 0, "balance": balance, "inertia": own < self.I0}

    def problems(self, platform: Platform) -> list[str]:
        """Say in words what makes these parameters impossible; empty when nothing does."""
        broken = [rule for rule, kept in self.rules(platform, FLOAT).items() if not kept]
        wheels = len(platform.wheels) * platform.wheel_mass
        own = (self.m0 - wheels) * (self.a_x**2 + self.a_y**2)
        words = {
            "weight": f"m0 = {self.m0:.6g} kg is not more than its {len(platform.wheels)} wheels "
            f"({wheels:.6g} kg)",
            "balance": f"centre of mass ({self.a_x:.4g}, {self.a_y:.4g}) m lies outside the "
            "wheels, the robot would tip over",
            "inertia": f"I0 = {self.I0:.6g} kg m^2 is below {own:.6g} kg m^2, what the offset of "
            "the centre of mass alone gives",
        }
        for name in ("m0", "I0", "I1", "mu1", "mu2"):
            value = getattr(self, name)
            words[f"finite {name}"] = f"{name} = {value} is not finite"
            if math.isfinite(value):
                words[f"positive {name}"] = f"{name} = {value:.6g} {UNITS[name]} must be positive"
        # Each of these follows from the one before it, or says nothing without it.
        chain = [rule for rule in ("weight", "balance", "inertia") if rule in broken][:1]
        if chain == ["inertia"] and not self.I0 > 0:
            chain = []
        single = [rule for rule in broken if " " in rule and rule in words]
        return [words[rule] for rule in (*single, *chain)]

    def check(self, platform: Platform) -> Parameters:
        """Return self when possible.

        Raises:
            ImpossibleParameters: names every value that no robot can have, and the remedy.
        """
        found = self.problems(platform)
        if found:
            raise ImpossibleParameters(
                "impossible parameters: " + "; ".join(found) + "; correct the model file or values"
            )
        return self


def x_scale(platform: Platform) -> Theta:
    """Factors from theta to the vector x of paper eq. (7): ``x = x_scale * theta``.

    For the youBot (L^2, 1, 4L^2/R^2, L, L, 4L^2/R^2, 8h^2/r^2).  Where rollers stand still while
    the robot turns (omni wheels on a circle) the last is that of driving sideways on the lever.
    """
    lever, geometry = platform.lever, platform.geometry
    wheel = geometry.wheel_metric[5]
    roller = geometry.roller_metric[5] or lever**2 * geometry.roller_metric[3]
    return Theta(lever**2, 1.0, wheel, lever, lever, wheel, roller)


def to_x(theta: Theta, platform: Platform) -> tuple[float, ...]:
    """Vector x of paper eq. (7), kg m^2 and N m s."""
    return tuple(s * t for s, t in zip(x_scale(platform), theta, strict=True))


def from_x(x, platform: Platform) -> Theta:
    """Invert ``to_x``."""
    return Theta(*(float(v) / s for s, v in zip(x_scale(platform), x, strict=True)))


def typical(mass: float, platform: Platform) -> Theta:
    """Values of an ordinary robot of some mass, kg, to an order of magnitude.

    Those at which all entries of the vector x are alike: platform and wheels carry as much inertia,
    frictions stop the robot within a second, the centre of mass is as far off as the lever.
    """
    scale = x_scale(platform)
    return Theta(*(scale.m0 * mass / factor for factor in scale))


def lumps(x) -> dict[str, float]:
    """Combinations of x that one motion block determines well, kg m^2 and N m s.

    x1 + x3 is the inertia against translation, x2 + x3 against turning; x6 and x7 are the
    frictions of wheels and rollers.
    """
    return {"x1+x3": x[0] + x[2], "x2+x3": x[1] + x[2], "x6": x[5], "x7": x[6]}
