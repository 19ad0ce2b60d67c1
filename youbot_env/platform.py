"""The wheel table of an omnidirectional platform and the kinematics that follow from it.

Frames: body X forward, Y left, yaw counter-clockwise.  Units: SI, angles in rad.
Source: Adamov & Kobrin (2018), eq. (3), written for wheels of any heading and roller angle.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from functools import cached_property, reduce
from typing import Any, NamedTuple

from youbot_env.backend import FLOAT, Ops, weighted_sum


@dataclass(frozen=True)
class Wheel:
    """One wheel of the table.

    Attributes:
        name: corner or place, ends the column names of a log (``wheel_velocity_<name>``).
        x, y: wheel centre in the body frame, m.
        roller_angle: angle of the roller axis from the rolling direction, rad (0 for an omni
            wheel, -45 or +45 degrees for a mecanum wheel).
        heading: direction in which the wheel rolls, rad from body X (0 on a mecanum platform).
    """

    name: str
    x: float
    y: float
    roller_angle: float
    heading: float = 0.0


class Geometry(NamedTuple):
    """Jacobians in components: each entry is a number, an array or a symbol.

    Attributes:
        jacobian: n rows of three, wheel speeds ``phi' = J v`` with v = (V_X, V_Y, Omega).
        roller_jacobian: n rows of three, roller rates ``gamma' = G v``.
        wheel_metric: upper triangle (xx, xy, xo, yy, yo, oo) of ``J' J``.
        roller_metric: the same of ``G' G``.
    """

    jacobian: tuple
    roller_jacobian: tuple
    wheel_metric: tuple
    roller_metric: tuple

    @classmethod
    def from_rows(cls, jacobian: tuple, roller_jacobian: tuple) -> Geometry:
        """Build the geometry, with its metrics, from the rows of J and G."""
        return cls(jacobian, roller_jacobian, _metric(jacobian), _metric(roller_jacobian))

    def wheel_velocity(self, v: tuple) -> tuple:
        """Wheel speeds ``J v``, rad/s, for body velocities v = (V_X, V_Y, Omega)."""
        return tuple(weighted_sum(row, v) for row in self.jacobian)

    def roller_velocity(self, v: tuple) -> tuple:
        """Roller rates ``G v``, rad/s."""
        return tuple(weighted_sum(row, v) for row in self.roller_jacobian)

    def wrench(self, torque: tuple) -> tuple:
        """Generalized forces ``J' M`` (F_X N, F_Y N, M_O N m) of shaft torques M, N m."""
        return tuple(weighted_sum(column, torque) for column in zip(*self.jacobian, strict=True))

    def roller_wrench(self, torque: tuple) -> tuple:
        """Generalized forces ``G' tau`` of torques in the roller bearings, N m."""
        return tuple(
            weighted_sum(column, torque) for column in zip(*self.roller_jacobian, strict=True)
        )


@dataclass(frozen=True)
class Platform:
    """An omnidirectional platform: a table of at least three wheels, and their radii.

    Attributes:
        name: identifier used in model files.
        wheels: the table; its order is the order of torques, wheel speeds and log columns.
        wheel_radius: R, m.
        roller_radius: r, m, the largest radius of a roller.
        wheel_mass: m1, kg, one wheel with its rollers.

    Raises:
        ValueError: fewer than three wheels, repeated names, a radius or mass that is not positive,
            or wheels that leave a body motion free.
    """

    name: str
    wheels: tuple[Wheel, ...]
    wheel_radius: float
    roller_radius: float
    wheel_mass: float = 1.4

    def __post_init__(self) -> None:
        names = [wheel.name for wheel in self.wheels]
        if len(names) < 3:
            raise ValueError(f"platform {self.name!r} has {len(names)} wheels; it needs 3 or more")
        if len(set(names)) != len(names):
            raise ValueError(f"platform {self.name!r} repeats a wheel name in {names}; rename one")
        for label in ("wheel_radius", "roller_radius", "wheel_mass"):
            value = getattr(self, label)
            if not (math.isfinite(value) and value > 0):
                raise ValueError(f"platform {self.name!r}: {label} = {value} must be positive")
        if self.roller_radius >= self.wheel_radius:
            raise ValueError(
                f"platform {self.name!r}: roller_radius = {self.roller_radius} m must be smaller "
                f"than wheel_radius = {self.wheel_radius} m"
            )
        for wheel in self.wheels:
            if abs(wheel.roller_angle) >= math.radians(85):
                raise ValueError(
                    f"wheel {wheel.name!r}: roller_angle = {wheel.roller_angle} rad must stay "
                    "below 85 degrees; it is 45 degrees on a mecanum wheel and 0 on an omni wheel"
                )
        xx, xy, xo, yy, yo, oo = self.geometry.wheel_metric
        det = xx * (yy * oo - yo * yo) - xy * (xy * oo - yo * xo) + xo * (xy * yo - yy * xo)
        if not det > 1e-9 * xx * yy * oo:
            raise ValueError(
                f"platform {self.name!r}: its wheels leave a body motion free (rank of J below "
                "3); check positions, headings and roller angles"
            )

    @property
    def wheel_names(self) -> tuple[str, ...]:
        """Names of the wheels in table order."""
        return tuple(wheel.name for wheel in self.wheels)

    @cached_property
    def geometry(self) -> Geometry:
        """Jacobians J and G of this table (paper eq. 3), as plain numbers."""
        rows = [wheel_rows(wheel, self.wheel_radius, self.roller_radius) for wheel in self.wheels]
        return Geometry.from_rows(tuple(row[0] for row in rows), tuple(row[1] for row in rows))

    @cached_property
    def lever(self) -> float:
        """L, m: how far from the centre the wheels act on yaw; l + h on a mecanum platform."""
        metric = self.geometry.wheel_metric
        return math.sqrt(metric[5] / metric[0])

    def with_lever(self, lever: float) -> Platform:
        """The platform with its wheels moved outwards or inwards so that L is ``lever`` m."""
        if not (math.isfinite(lever) and lever > 0):
            raise ValueError(f"lever = {lever} m must be positive")
        k = lever / self.lever
        wheels = (replace(wheel, x=k * wheel.x, y=k * wheel.y) for wheel in self.wheels)
        return replace(self, wheels=tuple(wheels))

    @cached_property
    def reach(self) -> float:
        """Distance of the farthest wheel centre from O, m."""
        return max(math.hypot(wheel.x, wheel.y) for wheel in self.wheels)

    @cached_property
    def jacobian_array(self) -> Any:
        """J as an (n, 3) NumPy array."""
        import numpy as np

        return np.array(self.geometry.jacobian)

    @cached_property
    def outline(self) -> tuple[tuple[float, float], ...]:
        """Wheel centres (x, y), m, counter-clockwise."""
        count = len(self.wheels)
        x, y = (sum(getattr(w, axis) for w in self.wheels) / count for axis in ("x", "y"))
        around = sorted(self.wheels, key=lambda wheel: math.atan2(wheel.y - y, wheel.x - x))
        return tuple((wheel.x, wheel.y) for wheel in around)

    def contains(self, x, y, ops: Ops = FLOAT) -> Any:
        """Tell whether the point (x, y) m, of components, lies in the polygon of the wheels."""
        corners = self.outline
        edges = zip(corners, (*corners[1:], corners[0]), strict=True)
        left = [(bx - ax) * (y - ay) - (by - ay) * (x - ax) for (ax, ay), (bx, by) in edges]
        return reduce(ops.minimum, left) >= 0.0


def wheel_rows(
    wheel: Wheel, wheel_radius, roller_radius, offset=0.0, phase=0.0, ops: Ops = FLOAT
) -> tuple[tuple, tuple]:
    """Rows of J and G for one wheel (paper eq. 3), with the roller on the floor at any phase.

    Args:
        wheel: the wheel.
        wheel_radius, roller_radius: R and r, m.
        offset: added to the roller angle, rad; a component.
        phase: q, how far the wheel has turned since the middle of that roller touched the floor,
            rad; a component.  Zero is the ideal wheel of the paper.
        ops: elementary functions of the components.

    Returns:
        ``(J_i, G_i)``, three entries each.  With u and w the speeds of the wheel centre along and
        across its heading: ``R phi' = u + tan(delta) w`` and ``gamma' = -w / (r cos(delta))``.
        At phase q the contact lies ``(R - r) tan(q) tan(delta)`` left of the wheel centre, the
        factor of w in the first is ``tan(delta) / cos(q)``, and r in the second becomes
        ``R cos(q) - (R - r)``.
    """
    c, s = _exact(math.cos(wheel.heading)), _exact(math.sin(wheel.heading))
    delta, lean = wheel.roller_angle + offset, ops.cos(phase)
    tangent, cosine = _exact(ops.tan(delta)), ops.cos(delta)
    shift = (wheel_radius - roller_radius) * ops.tan(phase) * tangent
    along = (c, s, wheel.x * s - wheel.y * c - shift)
    across = (-s, c, wheel.x * c + wheel.y * s)
    slant, arm = tangent / lean, (roller_radius - wheel_radius * (1.0 - lean)) * cosine
    rolling = tuple((a + slant * b) / wheel_radius for a, b in zip(along, across, strict=True))
    roller = tuple(-b / arm + 0.0 for b in across)
    return rolling, roller


def _exact(value):
    """Return the nearest of -1, 0 and 1 where rounding alone keeps a number from it.

    tan(45 deg) is 0.9999999999999999 in floating point; left so, friction of the youBot would
    not be exactly diagonal.  Arrays and symbols pass through.
    """
    if not isinstance(value, float):
        return value
    nearest = float(round(value))
    return nearest if abs(value - nearest) < 1e-12 else value


def _metric(rows: tuple) -> tuple:
    columns = list(zip(*rows, strict=True))
    pairs = ((0, 0), (0, 1), (0, 2), (1, 1), (1, 2), (2, 2))
    products = [weighted_sum(columns[i], columns[j]) for i, j in pairs]
    if all(isinstance(value, float) for value in products):
        scale = max(abs(value) for value in products)
        products = [0.0 if abs(value) < 1e-12 * scale else value for value in products]
    return tuple(products)


def mecanum(
    name: str,
    half_track: float,
    half_base: float,
    wheel_radius: float,
    roller_radius: float,
    wheel_mass: float,
) -> Platform:
    """Four mecanum wheels with rollers in X arrangement seen from above.

    Args:
        name: identifier.
        half_track: l, half the distance between left and right wheels, m.
        half_base: h, half the distance between front and rear wheels, m.
        wheel_radius, roller_radius: R and r, m.
        wheel_mass: m1, kg.
    """
    quarter = math.pi / 4
    table = (
        Wheel("fl", +half_base, +half_track, -quarter),
        Wheel("fr", +half_base, -half_track, +quarter),
        Wheel("rl", -half_base, +half_track, +quarter),
        Wheel("rr", -half_base, -half_track, -quarter),
    )
    return Platform(name, table, wheel_radius, roller_radius, wheel_mass)


def youbot() -> Platform:
    """The KUKA youBot base with the dimensions of Adamov & Kobrin (2018)."""
    return mecanum("youbot", 0.15, 0.2355, 0.0475, 0.014, 1.4)


def omni3(reach: float = 0.2, wheel_radius: float = 0.05, roller_radius: float = 0.008) -> Platform:
    """Three omni wheels at 60, 180 and 300 degrees on a circle of radius ``reach``, m."""
    wheels = []
    for name, place in (("left", 60.0), ("rear", 180.0), ("right", 300.0)):
        angle = math.radians(place)
        wheels.append(
            Wheel(name, reach * math.cos(angle), reach * math.sin(angle), 0.0, angle + math.pi / 2)
        )
    return Platform("omni3", tuple(wheels), wheel_radius, roller_radius, 0.4)


PLATFORMS = {"youbot": youbot, "omni3": omni3}
