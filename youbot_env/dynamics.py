"""The equations of motion, once: evaluated on floats, NumPy batches, CasADi symbols and JAX.

Everything goes in and out by components (structure of arrays).  The equations are linear in

    theta = (m0, I0, I1, m a_x, m a_y, mu1, mu2)

so the regression of identification is this same code at unit values of theta.
Source: Adamov & Kobrin (2018), eq. (4), (5), for any wheel table:

    d/dt (M v) |body + h(v) = J' M_shaft + ...,   M = M_body + I1 J'J,   h = centripetal + D v,
    D = mu1 J'J + mu2 G'G.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from youbot_env.backend import is_zero, weighted_sum
from youbot_env.platform import Geometry


class Theta(NamedTuple):
    """The seven parameters in which the dynamics are linear.

    Attributes:
        m0: total mass, kg.
        I0: moment of inertia of the whole robot about O, kg m^2.
        I1: spin inertia of one wheel with its rotor seen at the wheel, kg m^2.
        max, may: first moments m a_x, m a_y of the mass about O, kg m.
        mu1: viscous friction of one wheel, N m s.
        mu2: viscous friction of one roller, N m s.
    """

    m0: Any
    I0: Any
    I1: Any
    max: Any
    may: Any
    mu1: Any
    mu2: Any


def mass_matrix(geometry: Geometry, theta: Theta) -> tuple:
    """Upper triangle (xx, xy, xo, yy, yo, oo) of the mass matrix, kg, kg m, kg m^2."""
    body = (theta.m0, 0.0, -theta.may, theta.m0, theta.max, theta.I0)
    return tuple(_add(theta.I1, w, b) for w, b in zip(geometry.wheel_metric, body, strict=True))


def damping_matrix(geometry: Geometry, theta: Theta) -> tuple:
    """Upper triangle of the viscous friction matrix ``mu1 J'J + mu2 G'G``."""
    pairs = zip(geometry.wheel_metric, geometry.roller_metric, strict=True)
    return tuple(weighted_sum((w, g), (theta.mu1, theta.mu2)) for w, g in pairs)


def momentum(geometry: Geometry, theta: Theta, v: tuple) -> tuple:
    """Generalized momentum ``M v`` for v = (V_X, V_Y, Omega)."""
    return symmetric_product(mass_matrix(geometry, theta), v)


def centripetal(theta: Theta, v: tuple) -> tuple:
    """Forces quadratic in v that belong on the left side of eq. (4), N, N, N m.

    They carry m0 and not m0 + 4 I1/R^2: wheel speeds are J v with constant J, so the spin of the
    wheels adds no such term.
    """
    vx, vy, om = v
    px = weighted_sum((theta.m0, -theta.may), (vx, om))
    py = weighted_sum((theta.m0, theta.max), (vy, om))
    return -om * py, om * px, vx * py - vy * px


def friction(geometry: Geometry, theta: Theta, v: tuple) -> tuple:
    """Viscous friction ``D v`` on the left side of eq. (4), N, N, N m."""
    return symmetric_product(damping_matrix(geometry, theta), v)


def symmetric_product(upper: tuple, v: tuple) -> tuple:
    """Multiply a symmetric 3x3 matrix, given by its upper triangle, by v."""
    xx, xy, xo, yy, yo, oo = upper
    return (
        weighted_sum((xx, xy, xo), v),
        weighted_sum((xy, yy, yo), v),
        weighted_sum((xo, yo, oo), v),
    )


class Factors(NamedTuple):
    """A symmetric 3x3 matrix as ``L diag(1/r) L'`` with unit lower triangular L."""

    l21: Any
    l31: Any
    l32: Any
    reciprocals: tuple


def factorize(upper: tuple) -> Factors:
    """Factorize a symmetric positive definite 3x3 matrix given by its upper triangle."""
    xx, xy, xo, yy, yo, oo = upper
    l21, l31 = xy / xx, xo / xx
    second = yy - l21 * xy
    l32 = (yo - l31 * xy) / second
    third = oo - l31 * xo - l32 * l32 * second
    return Factors(l21, l31, l32, (1.0 / xx, 1.0 / second, 1.0 / third))


def solve(factors: Factors, right: tuple) -> tuple:
    """Solve ``A z = right`` for the matrix of the factors."""
    l21, l31, l32, (r1, r2, r3) = factors
    y1, y2, y3 = right
    coupled = not is_zero(l21)
    if coupled:
        y2 = y2 - l21 * y1
    z3 = r3 * (y3 - l31 * y1 - l32 * y2)
    z2 = r2 * y2 - l32 * z3
    z1 = r1 * y1 - l31 * z3
    return (z1 - l21 * z2 if coupled else z1), z2, z3


class Inertia(NamedTuple):
    """What the forward dynamics need and what does not change while the robot moves."""

    theta: Theta
    mass: Factors
    damping: tuple


def prepare(geometry: Geometry, theta: Theta) -> Inertia:
    """Factorize the mass matrix and collect the damping once for many evaluations."""
    mass = factorize(mass_matrix(geometry, theta))
    return Inertia(theta, mass, damping_matrix(geometry, theta))


def acceleration(inertia: Inertia, v: tuple, wrench: tuple) -> tuple:
    """Forward dynamics: (V_X', V_Y', Omega') under the generalized forces ``wrench``."""
    quadratic = centripetal(inertia.theta, v)
    viscous = symmetric_product(inertia.damping, v)
    net = tuple(w - c - d for w, c, d in zip(wrench, quadratic, viscous, strict=True))
    return solve(inertia.mass, net)


def kinetic_energy(geometry: Geometry, theta: Theta, v: tuple):
    """Kinetic energy ``v' M v / 2``, J."""
    return weighted_sum(v, momentum(geometry, theta, v)) / 2


def _add(scale, weight, body):
    if is_zero(weight):
        return body
    return scale * weight + body
