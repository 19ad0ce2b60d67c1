"""The shape of rollers: bodies of revolution whose common envelope is the cylinder of the wheel."""

from __future__ import annotations

import math

from youbot_env.platform import Platform
from youbot_env.roller_rates import rate_moments, rate_ratio

# A wheel gets six rollers, or more where six would taper to less than this share of r.
LEAST_TAPER = 0.5
# Ellipsoids a roller.  One leaves gaps of 0.28 mm in the youBot's cylinder, three 0.03 mm: with
# fewer the wheels hop from roller to roller, more cost time and change nothing measurable.
ELLIPSOIDS = 3


def roller_count(platform: Platform) -> int:
    """Rollers that each wheel carries: six on the youBot."""
    count = 6
    while 1.0 / rate_ratio(platform, math.pi / count) < LEAST_TAPER:
        count += 1
    return count


def mean_square_rate_ratio(platform: Platform) -> float:
    """Mean over time of the squared ratio of the rollers' rates to those of ideal ones."""
    return rate_moments(platform, math.pi / roller_count(platform))[1]


def roller_ellipsoids(platform: Platform, roller_angle: float) -> list[tuple[float, float]]:
    """Semi-axes (across, along the roller's axis), m, of coaxial ellipsoids of revolution.

    A wheel turned by q from the middle of its lowest roller rests on an ellipsoid at the depth

        h(q) = (R - r) cos q + sqrt(a^2 + K sin^2 q),    K = (b^2 - a^2) cos^2(delta)

    below its axle.  With K = (R - r) (R / cos p - (R - r)) and a^2 = R^2 - K - R (R - r) cos p it
    touches h = R at q = +-p and is nowhere deeper: no roller stands out of the cylinder.  At p = 0
    this is a = r and b^2 = r^2 + (R - r) r / cos^2(delta), the curvature of the true shape there.

    Args:
        platform: radii and number of rollers.
        roller_angle: delta, rad, between the roller's axis and the direction of rolling.
    """
    radius, depth = platform.wheel_radius, platform.wheel_radius - platform.roller_radius
    edge = math.cos(math.pi / roller_count(platform))
    axes = []
    for k in range(ELLIPSOIDS):
        cosine = 1.0 - (1.0 - edge) * (k + 0.5) / ELLIPSOIDS
        stretch = depth * (radius / cosine - depth)
        across = math.sqrt(radius**2 - stretch - radius * depth * cosine)
        axes.append((across, math.sqrt(across**2 + stretch / math.cos(roller_angle) ** 2)))
    return axes
