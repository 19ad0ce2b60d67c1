"""Unit and sign of torques, from the mass they appear to move."""

from __future__ import annotations

import numpy as np

from ident.doctor.evidence import explained
from ident.doctor.record import Record
from ident.doctor.smoothing import BODY_SOURCES, smooth
from youbot_env import dynamics
from youbot_env.dynamics import Theta

UNITS = {"N cm": 100.0, "mN m": 1000.0, "kgf cm": 10.197}  # values per N m
LIGHTEST, HEAVIEST = 2.0, 30.0  # apparent mass of a platform, in masses of its wheels
BRAKING = -0.5  # mean power of a wheel over the product of the rms of torque and speed
CERTAIN = 10.0  # estimate over its standard error


def check_effort(record: Record) -> None:
    """Refuse torques that brake a moving robot or would move an impossible mass."""
    torque, wheels = record.get("wheel_torque"), record.get("wheel_velocity")
    if torque is None:
        return
    if wheels is not None and not _power(record, torque, wheels):
        return
    mass, error = _mass(record)
    if not mass > CERTAIN * error:
        return
    unit_mass = len(record.platform.wheels) * record.platform.wheel_mass
    low, high = LIGHTEST * unit_mass, HEAVIEST * unit_mass
    if low < mass < high:
        return
    where, what = record.name("wheel_torque"), f"these torques would move {mass:.3g} kg"
    fits = [unit for unit, factor in UNITS.items() if low < mass / factor < high]
    if len(fits) == 1:
        record.set("wheel_torque", torque / UNITS[fits[0]])
        record.fixed(
            f"{what}: {fits[0]}", where, f"turned into N m ({mass / UNITS[fits[0]]:.3g} kg)"
        )
        return
    record.refuse(
        f"{what}; this platform has {low:.3g} to {high:.3g} kg",
        where,
        "check the units of torques and wheel speeds, kt and gear, and the time; give a unit in "
        "brackets, NAME [N cm] or NAME [rpm]",
    )


def _power(record: Record, torque: np.ndarray, wheels: np.ndarray) -> bool:
    """Refuse torques that brake all the time; tell whether they drive."""
    power = np.mean(torque * wheels, axis=0)
    strength, speed = (np.sqrt(np.mean(values**2, axis=0)) for values in (torque, wheels))
    share = power / (strength * speed + 1e-300)
    busy = (strength > 0.3 * strength.max()) & (speed > 0.3 * speed.max())
    braking = np.flatnonzero((share < BRAKING) & busy)
    if power.sum() > -0.1 * np.sqrt(np.mean(torque**2) * np.mean(wheels**2)) and not len(braking):
        return True
    columns = braking if len(braking) else None
    record.refuse(
        f"the torque brakes its wheel all the time: {power.min():.3g} W on average",
        record.name("wheel_torque", columns),
        "torque or speed has the other sign: say which with a minus before the column, "
        "--map NAME=-COLUMN",
    )
    return False


def _mass(record: Record) -> tuple[float, float]:
    """Apparent mass (with the spinning wheels) and its standard error, kg; (0, 1) if unknown."""
    signals = smooth(record)
    if len(signals.rows) < 100:
        return 0.0, 1.0
    inverse = np.linalg.pinv(record.platform.jacobian_array).T
    source = next((s for s in BODY_SOURCES[:2] if s in signals.signals), "wheel_velocity")
    v, rate = signals.signals.get(source), signals.rates.get(source)
    if v is None:
        return 0.0, 1.0
    if source == "wheel_velocity":
        v, rate = v @ inverse, rate @ inverse
    geometry, v, rate = record.platform.geometry, tuple(v.T), tuple(rate.T)
    nothing = Theta(0, 0, 0, 0, 0, 0, 0)
    heavy = nothing._replace(m0=1.0)
    inertia = dynamics.momentum(geometry, heavy, rate)
    turning = dynamics.centripetal(heavy, v)
    columns = [np.concatenate([inertia[k] + turning[k] for k in (0, 1)])]
    for name in ("mu1", "mu2"):
        brake = dynamics.friction(geometry, nothing._replace(**{name: 1.0}), v)
        columns.append(np.concatenate([brake[k] + 0 * v[k] for k in (0, 1)]))
    count = len(signals.rows)
    columns += [np.repeat([1.0, 0.0], count), np.repeat([0.0, 1.0], count)]
    wrench = geometry.wrench(tuple(signals.signals["wheel_torque"].T))
    force, regressors = np.concatenate(wrench[:2]), np.stack(columns, axis=1)
    if explained(force[:, None], regressors)[0] < 0.5:
        return 0.0, 1.0
    values, _, rank, _ = np.linalg.lstsq(regressors, force, rcond=1e-9)
    left = force - regressors @ values
    covariance = np.linalg.pinv(regressors.T @ regressors) * np.var(left)
    # Neighbouring windows overlap: fewer of them are independent than there are rows.
    independent = max(20.0, record.time[signals.rows[-1]] - record.time[signals.rows[0]])
    error = np.sqrt(covariance[0, 0] * max(1.0, 2 * count / independent))
    return (float(values[0]), float(error)) if rank == 5 else (0.0, 1.0)
