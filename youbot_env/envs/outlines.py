"""Shapes of the top view as plain arrays: the robot seen from above, laps and dashes of paths."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from scipy.spatial import ConvexHull

from youbot_env.platform import Platform, Wheel

OMNI_BELOW = math.radians(20)  # rollers lie along the rim below this angle, in two rows
OMNI_WIDTH, MECANUM_WIDTH = 0.45, 0.72  # half width over radius, as wheels on the market have it
ROLLERS_IN_VIEW = 4
# Arrow head behind the front edge, in wheel radii.
NOSE = ((-0.4, 0.0), (-1.9, 1.1), (-1.9, -1.1))
MOST_POINTS = 20_000


@dataclass(frozen=True)
class RobotOutline:
    """A platform seen from above, in the body frame (X forward, Y left), m.

    Attributes:
        body: rounded footprint, (K, 2).
        nose: arrow head near the front edge, (3, 2).
        wheels: one outline (K, 2) a wheel.
        rollers: one stack of roller axes (S, 2, 2) a wheel, as the upper rollers lie.
        reach: radius of a circle about O that holds everything.
    """

    body: np.ndarray
    nose: np.ndarray
    wheels: tuple[np.ndarray, ...]
    rollers: tuple[np.ndarray, ...]
    reach: float

    @classmethod
    def of(cls, platform: Platform) -> RobotOutline:
        """Derive the shapes from the wheel table and the wheel radius."""
        radius = platform.wheel_radius
        wheels, rollers, corners = [], [], []
        for wheel in platform.wheels:
            omni = abs(wheel.roller_angle) < OMNI_BELOW
            half = radius * np.array([1.0, OMNI_WIDTH if omni else MECANUM_WIDTH])
            wheels.append(_on_body(wheel, rounded(_rectangle(half - 0.2 * radius), 0.2 * radius)))
            rollers.append(_on_body(wheel, upper_rollers(wheel.roller_angle, *(0.88 * half))))
            # The body ends a quarter of a wheel radius outside the wheels, with round corners.
            corners.append(_on_body(wheel, _rectangle(half - 0.5 * radius)))
        body = rounded(np.concatenate(corners), 0.75 * radius)
        nose = np.array([body[:, 0].max(), 0.0]) + radius * np.array(NOSE)
        reach = float(np.hypot(*body.T).max())
        return cls(body, nose, tuple(wheels), tuple(rollers), reach)


def upper_rollers(roller_angle: float, half_length: float, half_width: float) -> np.ndarray:
    """Axes of the rollers on top of a wheel that rolls along x, (S, 2, 2) m.

    The wheel table describes the roller on the floor, whose axis points along
    (cos delta, sin delta): only along it can the floor hold the wheel.  Half a turn about the
    wheel axis brings a roller to the top and mirrors it, to (cos delta, -sin delta).

    Args:
        roller_angle: delta of the wheel table, rad.
        half_length, half_width: the rectangle that the axes stay in, m.
    """
    if abs(roller_angle) < OMNI_BELOW:
        pitch = half_length
        rows = [
            (x, y) for y, shift in ((-0.5, 0.0), (0.5, 0.5)) for x in (shift - 1, shift, shift + 1)
        ]
        centres = np.array([(x * pitch, y * half_width) for x, y in rows])
        reach = 0.34 * pitch
    else:
        along = np.linspace(-1.0, 1.0, ROLLERS_IN_VIEW) * half_length
        centres = np.stack([along, np.zeros_like(along)], axis=-1)
        reach = half_width / abs(math.sin(roller_angle))
    axis = reach * np.array([math.cos(roller_angle), -math.sin(roller_angle)])
    # Keep the part of each axis c + t axis, |t| <= 1, that lies within the length of the wheel.
    t = (np.array([-half_length, half_length]) - centres[:, :1]) / axis[0]
    t = np.sort(t, axis=1).clip(-1.0, 1.0)
    return (centres[:, None] + t[..., None] * axis)[t[:, 1] - t[:, 0] > 0.3]


def on_floor(points: np.ndarray, pose: np.ndarray) -> np.ndarray:
    """Map body points (..., 2) m to the floor for a pose (x, y, yaw)."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    return points @ np.array([(c, s), (-s, c)]) + pose[:2]


def rounded(points: np.ndarray, radius: float) -> np.ndarray:
    """Return the convex hull of circles about points, counter-clockwise, (K, 2) m."""
    angle = np.arange(0.0, 2 * math.pi, math.pi / 24)
    circle = radius * np.stack([np.cos(angle), np.sin(angle)], axis=-1)
    cloud = (points[:, None] + circle).reshape(-1, 2)
    return cloud[ConvexHull(cloud).vertices]


def evenly(path: np.ndarray, step: float) -> np.ndarray:
    """Return points on a path (N, 2) at equal arc lengths ``step``, from its start to its end.

    The step is widened where more than ``MOST_POINTS`` would be needed.
    """
    if len(path) < 2:
        return path[:0]
    length = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    at = np.append(np.arange(0.0, length[-1], max(step, length[-1] / MOST_POINTS)), length[-1])
    return np.stack([np.interp(at, length, column) for column in path.T], axis=-1)


def first_lap(path: np.ndarray) -> np.ndarray:
    """Cut an evenly spaced path (N, 2) that repeats itself to its first lap.

    Dashes of several laps over one another would merge to a solid line.
    """
    if len(path) < 3:
        return path
    step = np.hypot(*(path[1] - path[0]))
    away = np.hypot(*(path - path[0]).T)
    left = np.argmax(away > 5 * step)
    for lap in np.flatnonzero((away < step) & (np.arange(len(path)) > left)) if left else ():
        if np.hypot(*(path[lap:] - path[: len(path) - lap]).T).max() < 2 * step:
            return path[: lap + 1]
    return path


def dashes(path: np.ndarray, on: int, off: int) -> np.ndarray:
    """Cut an evenly spaced path (N, 2) into dashes (D, on + 1, 2) with gaps of ``off`` steps."""
    starts = np.arange(0, len(path) - on, on + off)
    return path[starts[:, None] + np.arange(on + 1)]


def _on_body(wheel: Wheel, points: np.ndarray) -> np.ndarray:
    """Place points of a wheel that rolls along x on the body."""
    return on_floor(points, np.array([wheel.x, wheel.y, wheel.heading]))


def _rectangle(half: np.ndarray) -> np.ndarray:
    return np.array([(1, 1), (-1, 1), (-1, -1), (1, -1)]) * half
