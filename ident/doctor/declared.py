"""Units that a file or a mapping declares: ``rpm``, ``in/s``, ``rpm motor``, ``ticks of 2048``."""

from __future__ import annotations

import re

import numpy as np

from youbot_env.platform import Platform

DEGREE, TURN, INCH, FOOT = np.pi / 180, 2 * np.pi, 0.0254, 0.3048
LENGTHS = {"m": 1.0, "mm": 1e-3, "cm": 1e-2, "in": INCH, "inch": INCH, "inches": INCH, "ft": FOOT}
ANGLES = {
    "rad": 1.0, "radians": 1.0, "deg": DEGREE, "degree": DEGREE, "degrees": DEGREE, "°": DEGREE,
    "rev": TURN, "turn": TURN, "turns": TURN,
}  # fmt: skip
TIMES = {
    "s": 1.0, "sec": 1.0, "secs": 1.0, "seconds": 1.0, "ms": 1e-3, "msec": 1e-3, "us": 1e-6,
    "µs": 1e-6, "usec": 1e-6, "ns": 1e-9, "nsec": 1e-9, "nsecs": 1e-9, "nanosec": 1e-9,
}  # fmt: skip
# Kind of quantity and factor to SI by unit.
UNITS: dict[str, tuple[str, float]] = {
    **{unit: ("length", factor) for unit, factor in LENGTHS.items()},
    **{f"{unit}/s": ("speed", factor) for unit, factor in LENGTHS.items()},
    **{unit: ("angle", factor) for unit, factor in ANGLES.items()},
    **{f"{unit}/s": ("rate", factor) for unit, factor in ANGLES.items()},
    **{unit: ("time", factor) for unit, factor in TIMES.items()},
    "rpm": ("rate", TURN / 60), "rps": ("rate", TURN), "dps": ("rate", DEGREE),
    "rev/min": ("rate", TURN / 60), "1/min": ("rate", TURN / 60),
    "N m": ("torque", 1.0), "Nm": ("torque", 1.0), "N*m": ("torque", 1.0), "N.m": ("torque", 1.0),
    "N cm": ("torque", 1e-2), "Ncm": ("torque", 1e-2),
    "mN m": ("torque", 1e-3), "mNm": ("torque", 1e-3),
    "A": ("current", 1.0), "mA": ("current", 1e-3),
    "V": ("voltage", 1.0), "mV": ("voltage", 1e-3),
    "%": ("share", 1e-2), "percent": ("share", 1e-2), "-": ("share", 1.0), "1": ("share", 1.0),
    "ticks": ("count", 1.0), "counts": ("count", 1.0), "inc": ("count", 1.0),
    "ticks/s": ("count rate", 1.0), "counts/s": ("count rate", 1.0),
}  # fmt: skip
# Kinds that a channel may be declared in.
KINDS = {
    "time": ("time",),
    "wheel_velocity": ("rate", "speed", "count rate"),
    "wheel_position": ("angle", "length", "count"),
    "wheel_torque": ("torque",),
    "wheel_current": ("current",),
    "wheel_voltage": ("voltage",),
    "wheel_duty": ("share",),
    "battery_voltage": ("voltage",),
    "x": ("length",), "y": ("length",), "yaw": ("angle",),
    "body_velocity_x": ("speed",), "body_velocity_y": ("speed",), "yaw_rate": ("rate",),
    "reference_vx": ("speed",), "reference_vy": ("speed",), "reference_yaw_rate": ("rate",),
}  # fmt: skip
SHAPE = re.compile(r"^(?P<unit>.+?)(\s+of\s+(?P<count>[\d.]+))?(?P<motor>\s+(of the )?motor)?$")
KNOWN = "rad/s, rpm, deg/s, m, mm, in, rad, deg, s, ms, ns, N m, A, mA, V, %, ticks of N, ... motor"


class UnitError(ValueError):
    """A unit that cannot be used; the message says why and what to do."""


def known_unit(text: str) -> bool:
    """Tell whether a text is a unit."""
    match = SHAPE.match(text.strip())
    return bool(match) and _plain(match["unit"]) is not None


def factor_of(text: str, name: str, platform: Platform, gear: float | None) -> float:
    """Factor from a declared unit to SI at the wheel.

    Args:
        text: the unit, with ``of N`` for ticks a turn and ``motor`` for what is before the gear.
        name: log name of the column.
        platform: its wheel radius turns speeds at the rim into rad/s.
        gear: motor turns per wheel turn, or None.

    Returns:
        The factor; 1 for ticks of which nobody says how many make a turn.

    Raises:
        UnitError: an unknown unit, one of another quantity, or a motor without its gear.
    """
    match = SHAPE.match(text.strip())
    found = _plain(match["unit"]) if match else None
    if found is None:
        raise UnitError(f"unit {text!r} is unknown; known are {KNOWN}")
    kind, factor = found
    stem = name.rpartition("_")[0]
    channel = name if name in KINDS else next((c for c in KINDS if stem.startswith(c)), name)
    if kind not in KINDS.get(channel, (kind,)):
        raise UnitError(f"{name} cannot be in {text!r}, the unit of a {kind}")
    if kind in ("speed", "length") and channel.startswith("wheel"):
        factor /= platform.wheel_radius
    if kind.startswith("count"):
        if not match["count"]:
            return 1.0
        factor *= TURN / float(match["count"])
    if match["motor"]:
        if gear is None:
            raise UnitError(f"unit {text!r} needs the gear; give --gear TURNS")
        factor = factor * gear if kind == "torque" else factor / gear
    return factor


def _plain(text: str) -> tuple[str, float] | None:
    """Kind and factor of a unit; capital letters do not matter where they say nothing."""
    text = text.strip()
    small = {unit.lower(): unit for unit in reversed(UNITS)}
    return UNITS.get(text) or UNITS.get(small.get(text.lower(), ""))
