"""Unit and sign of torques, from the mass and the inertia they appear to move."""

from __future__ import annotations

import numpy as np

from ident.doctor.correlation import explained
from ident.doctor.record import Record
from ident.doctor.smoothing import smooth
from youbot_env import dynamics
from youbot_env.dynamics import Theta
from youbot_env.model_file import load_model

UNITS = {"N cm": 100.0, "mN m": 1000.0, "kgf cm": 10.197}  # values per N m
LIGHTEST, HEAVIEST = 2.0, 30.0  # apparent mass of a platform, in masses of its wheels
NARROWEST, WIDEST = 0.2, 2.0  # radius of gyration, in distances of the wheels from the centre
# Beyond these limits it is told; a robot half as heavy, lighter than its wheels, or three times as
# heavy is refused.  The band is 15 times wide: it shows that a unit is wrong, never which is right.
LIGHTER, HEAVIER = 2.0, 3.0
DOUBTED = 3.0  # times the data sheet's, or less than that part of it
# Masses and inertia that differ from the data sheet's by one and the same factor.  On 70 logs of 30
# robots, loaded and on slippery floors, they never do by more than 1.5.
COMMON, ALIKE = 1.8, 1.3
YAW = 2
CERTAIN = 10.0  # estimate over its standard error
BRAKING = -0.5  # mean power of a wheel over the product of the rms of torque and speed
BUSY = 0.1  # rms of a wheel over that of the busiest, below which it says nothing
NOTHING = Theta(0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0)
# What is asked for on each axis, and its unit.
NAMES, KILOGRAMS = ("m0", "m0", "I0"), ("kg", "kg", "kg m^2")
ONES = [NOTHING._replace(**{name: 1.0}) for name in NAMES]


def check_effort(record: Record) -> None:
    """Refuse torques that brake a moving robot or would move an impossible mass."""
    torque, wheels = record.get("wheel_torque"), record.get("wheel_velocity")
    if torque is None or (wheels is not None and not _drives(record, torque, wheels)):
        return
    low, high = (n * len(record.platform.wheels) * record.platform.wheel_mass
                 for n in (LIGHTEST, HEAVIEST))  # fmt: skip
    near, far = (n * record.platform.reach for n in (NARROWEST, WIDEST))
    limits = {"kg": (low, high), "kg m^2": (low * near**2, high * far**2)}
    sheet, inertias = _data_sheet(record), _inertias(record)
    for axis, (found, unit) in inertias.items():
        lowest, highest = limits[unit]
        if not lowest < found < highest:
            _impossible(record, found, unit, lowest, highest)
            return
        ratio = found / sheet[axis] if sheet else 1.0
        if not 1 / DOUBTED < ratio < DOUBTED:
            record.warn(
                "mass",
                f"these torques would move {found:.3g} {unit}, {ratio:.2g} times the data sheet's "
                f"{sheet[axis]:.3g} {unit} (wheels turning with it)",
                record.name("wheel_torque"),
                "check the unit of torques, kt and gear, and what the robot carries",
            )
            return
    ratios = np.array([found / sheet[axis] for axis, (found, _) in inertias.items() if sheet])
    if YAW not in inertias or len(ratios) < 2 or ratios.max() > ALIKE * ratios.min():
        return
    mean = float(np.exp(np.mean(np.log(ratios))))
    if not 1 / COMMON < mean < COMMON:
        record.warn(
            "mass",
            f"masses and inertia that these torques would move are alike {mean:.2f} times those of "
            "the data sheet",
            record.name("wheel_torque"),
            "that is what a wrong unit, kt or gear does; a load would not change both alike",
        )


def _data_sheet(record: Record) -> list[float]:
    """Apparent masses forward and sideways, kg, and inertia, kg m^2; empty where none is known."""
    nominal, geometry = load_model("nominal"), record.platform.geometry
    if nominal.platform.geometry != geometry:
        return []
    theta = nominal.parameters.theta(nominal.platform)._replace(max=0.0, may=0.0)
    whole, one = (
        [
            dynamics.momentum(geometry, each, tuple(np.eye(3)[axis]))[axis]
            for axis, each in enumerate(thetas)
        ]
        for thetas in ([theta] * 3, ONES)
    )
    return [float(w / o) for w, o in zip(whole, one, strict=True)]


def _impossible(record: Record, found: float, unit: str, low: float, high: float) -> None:
    """Tell or refuse torques that would move ``found``, and say what they would in other units."""
    where = record.name("wheel_torque")
    what = f"these torques would move {found:.3g} {unit}"
    if low / LIGHTER < found < high * HEAVIER:
        record.warn("mass", what, where, "check the units of torques, kt and gear")
        return
    fits = [
        f"{found / factor:.3g} {unit} in {name}"
        for name, factor in UNITS.items()
        if low < found / factor < high
    ]
    record.refuse(
        "mass",
        f"{what}; this platform has {low:.3g} to {high:.3g} {unit}"
        + (f" (it would be {', '.join(fits)})" if fits else ""),
        where,
        "check the units of torques and wheel speeds, kt and gear, and the time; give a unit in "
        f"brackets, --map wheel_torque_{record.platform.wheel_names[0]}='NAME [mN m]' or NAME "
        "[rpm]; of per cent or per mille of a rated torque make N m first",
    )


def _drives(record: Record, torque: np.ndarray, wheels: np.ndarray) -> bool:
    """Refuse torques that brake all the time; tell whether they drive."""
    # Wheel loops may press the wheels against each other, which moves and brakes nothing.
    inner = np.linalg.svd(record.platform.jacobian_array)[0][:, 3:]
    torque = torque - np.mean(torque, axis=0) @ inner @ inner.T
    power = np.mean(torque * wheels, axis=0)
    strength, speed = (np.sqrt(np.mean(values**2, axis=0)) for values in (torque, wheels))
    busy = (strength > BUSY * strength.max()) & (speed > BUSY * speed.max())
    braking = np.flatnonzero(busy & (power < BRAKING * strength * speed))
    if not len(braking) and power.sum() >= BRAKING / 2 * np.sum(strength * speed):
        return True
    record.refuse(
        "braking",
        f"torque against speed all the time: {power.min():.3g} W on average",
        record.name("wheel_torque", braking if len(braking) else None),
        "torque or speed has the other sign: say which with a minus before the column, "
        "--map NAME=-COLUMN",
    )
    return False


def _inertias(record: Record) -> dict[int, tuple[float, str]]:
    """Apparent masses and inertia, by axis, where the motion shows them clearly.

    Each axis is fitted alone: inertia, friction in proportion to its speed, and a constant.
    """
    signals = smooth(record)
    if len(signals.rows) < 100:
        return {}
    v, rate = signals.signals.get("wheel_velocity"), signals.rates.get("wheel_velocity")
    if v is not None:
        inverse = np.linalg.pinv(record.platform.jacobian_array).T
        v, rate = v @ inverse, rate @ inverse
    else:
        v, rate = signals.signals["body_velocity"], signals.rates["body_velocity"]
    geometry, body, rate = record.platform.geometry, tuple(v.T), tuple(rate.T)
    wrench = geometry.wrench(tuple(signals.signals["wheel_torque"].T))
    # Windows overlap: no more of them are independent than there are seconds.
    seconds = max(1.0, len(signals.rows) * record.dt * max(1, np.diff(signals.rows).min()))
    size = np.std(v, axis=0) * [1.0, 1.0, record.platform.lever]
    found = {}
    for axis, (one, unit) in enumerate(zip(ONES, KILOGRAMS, strict=True)):
        inertia = dynamics.momentum(geometry, one, rate)[axis]
        inertia = inertia + dynamics.centripetal(one, body)[axis]
        columns = np.stack([inertia, body[axis]], axis=1)
        columns = columns - columns.mean(axis=0)
        force = wrench[axis] - np.mean(wrench[axis])
        if size[axis] < 0.1 * size.max() or explained(force[:, None], columns)[0] < 0.5:
            continue
        values = np.linalg.lstsq(columns, force, rcond=None)[0]
        spread = np.std(force - columns @ values)
        error = spread * np.sqrt(np.linalg.inv(columns.T @ columns)[0, 0] * len(force) / seconds)
        if values[0] > CERTAIN * error:
            found[axis] = (float(values[0]), unit)
    return found
