"""Wheel kinematics as a function of what may be wrong with it: radii, base, roller angle.

The Jacobian is that of the plant with the effects ``roller_angle_error``, ``wheel_radius_error``
and ``base_geometry_error``; CasADi differentiates it.  Nothing of the kinematics is written here.
"""

from __future__ import annotations

import math
from functools import lru_cache
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from ident.signals import body_velocity
from youbot_env.backend import NUMPY, Ops, casadi_ops
from youbot_env.dynamics import Theta
from youbot_env.effects import get_effect
from youbot_env.effects.roller_ripple import PITCH
from youbot_env.plant import ModelStructure
from youbot_env.platform import Geometry, Platform

RADIUS, BASE, ROLLER = "wheel_radius_error", "base_geometry_error", "roller_angle_error"
RIPPLE = "roller_ripple"
# Roller phases over which averages are taken; more change nothing in the fifth digit.
PHASES = 24


class Rolling(NamedTuple):
    """Kinematics of n wheels at one set of p values, with derivatives.

    Attributes:
        odometry: (3, n) W, body velocities ``v = W phi'`` by least squares.
        contradiction: (n, n) P, the part ``P phi'`` of the wheel speeds that no motion explains.
        odometry_slope: (3 n, p) derivatives of W, its entries by rows.
        contradiction_slope: (n n, p) derivatives of P.
        odometry_free, contradiction_free: the same with respect to the 3 n entries of J by rows.
    """

    odometry: np.ndarray
    contradiction: np.ndarray
    odometry_slope: np.ndarray
    contradiction_slope: np.ndarray
    odometry_free: np.ndarray
    contradiction_free: np.ndarray


def parameter_names(platform: Platform) -> tuple[str, ...]:
    """Names of the values: a radius for each wheel, the base, the roller angle."""
    return (*(f"radius_{wheel}" for wheel in platform.wheel_names), "base", "roller_angle")


def steeper(platform: Platform) -> np.ndarray:
    """(n,) sign of the change of each roller angle when all rollers lie steeper."""
    return np.array([math.copysign(1.0, wheel.roller_angle) for wheel in platform.wheels])


def effect_values(platform: Platform, values) -> dict[str, dict[str, Any]]:
    """Parameters of the effects by identifier and flat name.

    Args:
        platform: nominal wheel table.
        values: numbers or symbols in the order of ``parameter_names``: relative errors of the radii
            and of the base, rad by which all rollers lie steeper.
    """
    names, count = platform.wheel_names, len(platform.wheels)
    signs = steeper(platform).tolist()
    return {
        ROLLER: {f"e_{w}": s * values[count + 1] for w, s in zip(names, signs, strict=True)},
        RADIUS: {f"e_{w}": values[k] for k, w in enumerate(names)},
        BASE: {"e": values[count]},
    }


def rolling(platform: Platform, values: np.ndarray) -> Rolling:
    """Evaluate the kinematics on ideal rollers and their exact derivatives.

    Args:
        platform: nominal wheel table.
        values: (n + 2) in the order of ``parameter_names``; zero is nominal.
    """
    parts = [part.full() for part in _rolling_function(platform)(values)]
    count, size = len(platform.wheels), len(values)
    odometry, contradiction, slope, other = parts
    return Rolling(
        odometry.reshape(3, count),
        contradiction.reshape(count, count),
        slope[:, :size],
        other[:, :size],
        slope[:, size:],
        other[:, size:],
    )


def mean_odometry(platform: Platform, values: np.ndarray, size: float = 1.0) -> tuple:
    """W averaged over the roller phases, which wheels pass at equal steps of their angle.

    Args:
        platform: nominal wheel table.
        values: (n + 2) in the order of ``parameter_names``.
        size: of the effect ``roller_ripple``; 0 gives W of ideal rollers.

    Returns:
        ``(W (3, n), derivatives of its entries by rows with respect to the values (3 n, n + 2))``.

    Raises:
        ValueError: the rollers are too thin for six of them to make a wheel.
    """
    get_effect(RIPPLE).complete({"size": size}, platform)
    mean, slope = (part.full() for part in _mean_function(platform)(values, size))
    return mean.reshape(3, -1), slope


def ripple_geometry(platform: Platform, angle, size: float, phases) -> Geometry:
    """Jacobians of finite rollers at wheel angles, in components.

    Args:
        platform: wheel table.
        angle: n wheel angles, rad, components.
        size: of the effect ``roller_ripple``.
        phases: (n,) roller phases where the angles are zero, rad.

    Raises:
        ValueError: the rollers are too thin for six of them to make a wheel.
    """
    start = {f"phi0_{w}": float(q) for w, q in zip(platform.wheel_names, phases, strict=True)}
    effects = {RIPPLE: get_effect(RIPPLE).complete({"size": float(size), **start}, platform)}
    return _geometry(platform, effects, angle, NUMPY)


def middle_phases() -> np.ndarray:
    """(M,) roller phases, rad, over which averages are taken."""
    return (np.arange(PHASES) + 0.5) / PHASES * PITCH


def _geometry(platform: Platform, effects: dict[str, dict], angle, ops: Ops) -> Geometry:
    """Jacobians under effects at wheel angles, in components."""
    kinds = tuple(get_effect(name) for name in effects)
    structure = ModelStructure(platform, kinds, tuple(tuple(values) for values in effects.values()))
    flat = [value for values in effects.values() for value in values.values()]
    robot = structure.bind([*Theta(*[0.0] * 7), *flat])
    count, still = len(platform.wheels), (0.0, 0.0, 0.0)
    return robot.signals(0.0, still, still, tuple(angle), (0.0,) * count, ops).geometry


def _odometry(geometry: Geometry) -> ca.SX:
    """W in symbols: what each wheel's unit speed gives."""
    count = len(geometry.jacobian)
    columns = [body_velocity(geometry, tuple(unit)) for unit in np.eye(count).tolist()]
    return ca.horzcat(*(ca.vertcat(*column) for column in columns))


@lru_cache(maxsize=8)
def _rolling_function(platform: Platform) -> ca.Function:
    """``F(values) -> (W, P, slopes of W, slopes of P)``, slopes by the values and entries of J."""
    count = len(platform.wheels)
    values, free = ca.SX.sym("values", count + 2), ca.SX.sym("free", 3 * count)
    effects = effect_values(platform, ca.vertsplit(values))
    ideal = _geometry(platform, effects, (0.0,) * count, casadi_ops()).jacobian
    rows = tuple(
        tuple(entry + free[3 * i + j] for j, entry in enumerate(row)) for i, row in enumerate(ideal)
    )
    odometry = _odometry(Geometry.from_rows(rows, platform.geometry.roller_jacobian))
    jacobian = ca.vertcat(*(ca.horzcat(*row) for row in rows))
    # CasADi stores columns, NumPy rows: what is handed over is the transpose.
    outputs = [ca.vec(odometry.T), ca.vec((ca.SX.eye(count) - jacobian @ odometry).T)]
    slopes = [ca.jacobian(output, ca.vertcat(values, free)) for output in outputs]
    exact = ca.substitute([*outputs, *slopes], [free], [ca.SX.zeros(3 * count)])
    return ca.Function("rolling", [values], [ca.densify(part) for part in exact])


@lru_cache(maxsize=8)
def _mean_function(platform: Platform) -> ca.Function:
    """``F(values, size) -> (mean of W over the roller phases, its slopes by the values)``."""
    count = len(platform.wheels)
    values, size = ca.SX.sym("values", count + 2), ca.SX.sym("size")
    phase = ca.SX.sym("phase")
    effects = effect_values(platform, ca.vertsplit(values))
    effects[RIPPLE] = {"size": size, "phi0": 0.0}
    at_phase = ca.vec(_odometry(_geometry(platform, effects, (phase,) * count, casadi_ops())).T)
    one = ca.Function("one", [values, size, phase], [at_phase, ca.jacobian(at_phase, values)])
    all_phases = one.map(PHASES)
    v, s = ca.MX.sym("values", count + 2), ca.MX.sym("size")
    repeated = (ca.repmat(v, 1, PHASES), ca.repmat(s, 1, PHASES), middle_phases()[None])
    W, slopes = all_phases(*repeated)
    blocks = ca.horzsplit(slopes, count + 2)
    return ca.Function("mean", [v, s], [ca.sum2(W) / PHASES, sum(blocks) / PHASES])
