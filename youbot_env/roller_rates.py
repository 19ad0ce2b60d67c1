"""How fast real rollers turn beside ideal ones of radius r."""

from __future__ import annotations

from functools import lru_cache

import numpy as np

from youbot_env.backend import FLOAT, NUMPY, Ops
from youbot_env.platform import Platform, Wheel, wheel_rows

LOOKS = 2001


def rate_ratio(platform: Platform, phase, ops: Ops = FLOAT):
    """How many times faster than an ideal roller of radius r a real one turns.

    Rollers grow thinner towards their ends, which touch the floor at other phases of the wheel.

    Args:
        platform: wheel table and radii.
        phase: how far the wheel has turned since the middle of the roller touched the floor, rad.
        ops: elementary functions of ``phase``.
    """
    wheel = Wheel("any", 0.0, 0.0, 0.0)
    radii = platform.wheel_radius, platform.roller_radius
    ideal, real = wheel_rows(wheel, *radii), wheel_rows(wheel, *radii, phase=phase, ops=ops)
    return real[1][1] / ideal[1][1]


@lru_cache(maxsize=16)
def rate_moments(platform: Platform, edge: float) -> tuple[float, float]:
    """Mean and mean square over time of that ratio, in a steady motion across turning wheels.

    A wheel then turns in proportion to ``1 / cos(phase)``, so a phase lasts ``cos(phase)``.

    Args:
        platform: wheel table and radii.
        edge: largest phase, rad, half of a roller's pitch.
    """
    phase = np.linspace(-edge, edge, LOOKS)
    ratio, lasts = rate_ratio(platform, phase, NUMPY), np.cos(phase)
    mean, square = (float(np.average(power, weights=lasts)) for power in (ratio, ratio**2))
    return mean, square
