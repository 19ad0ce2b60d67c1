"""The floor of the top view: grid, paths, reference and robot.

Frames: floor x to the right, y up, yaw counter-clockwise.
"""

from __future__ import annotations

import math
from dataclasses import dataclass
from types import ModuleType
from typing import Any

import numpy as np
from scipy.spatial import ConvexHull

from youbot_env.envs.camera import Camera, round_length
from youbot_env.envs.drawing import Brush, Colour, magnified
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


FLOOR, MINOR, GRID, AXIS = (255, 255, 255), (244, 245, 247), (228, 231, 235), (193, 199, 206)
BODY, EDGE, TYRE, ROLLER = (216, 228, 240), (45, 77, 110), (66, 76, 87), (160, 171, 183)
DRIVEN, REFERENCE, SATURATED = (40, 105, 176), (222, 132, 40), (200, 62, 54)
LINE = 2.0  # px, width of paths and outlines
FINE, QUICK = 4, 2  # magnifications for smooth edges; the quick one while the ground changes


class Scene:
    """The part of the floor that a camera sees.

    The ground (grid and both paths) is kept as a picture for as long as the camera rests; the
    driven path then grows on it, and a frame costs little more than the robot.

    Args:
        pygame: the module, loaded by the caller.
        platform: the wheel table; gives footprint, wheels and rollers.
        size: width and height of the view, px.
        fps: frames per second, 1/s.
        unit: factor on all line widths, 1 for a picture of ordinary size.
    """

    def __init__(
        self,
        pygame: ModuleType,
        platform: Platform,
        size: tuple[int, int],
        fps: float,
        unit: float,
    ) -> None:
        self.camera = Camera(*size, fps)
        self._pygame, self._unit = pygame, unit
        self._robot = RobotOutline.of(platform)
        self._roller_width = 0.8 * platform.roller_radius
        self._ground = pygame.Surface(size, 0, 32)
        self._view: tuple[float, ...] | None = None
        self._driven = self._planned = np.empty((0, 2))

    def draw(
        self,
        target: Any,
        pose: np.ndarray,
        reference_pose: np.ndarray,
        path: np.ndarray,
        reference_path: np.ndarray,
        saturated: np.ndarray,
    ) -> None:
        """Draw one frame on a surface of the size of the view; arguments as in ``TopView.draw``."""
        bodies = np.array([pose[:2], reference_pose[:2]])
        self.camera.follow(bodies, self._robot.reach, reference_path)
        self._update_ground(path, reference_path)
        target.blit(self._ground, (0, 0))
        margin = 4 * self._unit
        body = self._seen(self._robot.body, pose)
        with magnified(self._pygame, target, body, margin, FINE) as brush:
            self._draw_robot(brush, body, pose, saturated)
        body = self._seen(self._robot.body, reference_pose)
        with magnified(self._pygame, target, body, margin, FINE) as brush:
            self._draw_ghost(brush, body, reference_pose)

    def spacing(self) -> float:
        """Distance of the labelled grid lines, m."""
        return round_length(self.camera.span / 4)

    def ticks(self, axis: int, spacing: float) -> list[tuple[float, float]]:
        """Multiples of a spacing in view along x (0) or y (1): (coordinate m, position px)."""
        middle, half = self.camera.centre[axis], self.camera.extent[axis] / 2
        first, last = math.ceil((middle - half) / spacing), math.floor((middle + half) / spacing)
        values = np.arange(first, last + 1) * spacing
        pixels = self.camera.project(np.stack([values, values], axis=-1))[:, axis]
        return list(zip(values.tolist(), pixels.tolist(), strict=True))

    def _update_ground(self, path: np.ndarray, reference_path: np.ndarray) -> None:
        """Draw what is new on the ground, or all of it where the view or a path has changed."""
        same_plan = np.array_equal(reference_path, self._planned)
        factor = FINE if self.camera.resting and same_plan else QUICK
        view = (*self.camera.centre.tolist(), self.camera.span, factor)
        known = len(self._driven)
        if view == self._view and same_plan and np.array_equal(path[:known], self._driven):
            self._extend(path[max(known - 1, 0) :], path)
            return
        self._view, self._planned, self._driven = view, reference_path.copy(), path.copy()
        self._draw_grid()
        corners = np.array([(0.0, 0.0), self.camera.size])
        with magnified(self._pygame, self._ground, corners, 0.0, factor) as brush:
            lap = first_lap(evenly(reference_path, self._metres(5.0)))
            dashed = dashes(lap, on=2, off=1)
            self._draw_path(brush, dashed[:, :-1], dashed[:, 1:], REFERENCE)
            points = evenly(path, self._metres(4.0))
            self._draw_path(brush, points[:-1], points[1:], DRIVEN)

    def _extend(self, fresh: np.ndarray, path: np.ndarray) -> None:
        """Lengthen the driven path by its latest points, once they lead far enough."""
        if len(fresh) < 2 or np.ptp(fresh, axis=0).max() < self._metres(1.5):
            return
        self._driven = path.copy()
        around = self.camera.project(fresh)
        with magnified(self._pygame, self._ground, around, 2 * self._unit, FINE) as brush:
            self._draw_path(brush, fresh[:-1], fresh[1:], DRIVEN)

    def _draw_path(
        self, brush: Brush, starts: np.ndarray, ends: np.ndarray, colour: Colour
    ) -> None:
        """Draw the segments (..., 2) m of a path that lie near the view."""
        starts, ends = (self.camera.project(p).reshape(-1, 2) for p in (starts, ends))
        size = self.camera.size
        near = ((starts > -size) & (starts < 2 * size) & (ends > -size) & (ends < 2 * size)).all(1)
        brush.stroke(starts[near], ends[near], LINE * self._unit, colour)

    def _draw_grid(self) -> None:
        self._ground.fill(FLOOR)
        spacing = self.spacing()
        parts = 4 if f"{spacing:e}".startswith("2") else 5
        lines = [
            (axis, px, AXIS if value == 0 and step == spacing else colour)
            for step, colour in ((spacing / parts, MINOR), (spacing, GRID))
            for axis in (0, 1)
            for value, px in self.ticks(axis, step)
        ]
        for axis, px, colour in sorted(lines, key=lambda line: -sum(line[2])):  # dark ones last
            box = [0, 0, *self.camera.size.tolist()]
            box[axis], box[axis + 2] = math.floor(px), 1
            self._ground.fill(colour, box)

    def _draw_robot(
        self, brush: Brush, body: np.ndarray, pose: np.ndarray, saturated: np.ndarray
    ) -> None:
        brush.fill(body, BODY)
        brush.outline(body, LINE * self._unit, EDGE)
        width = self._roller_width * self.camera.scale
        shapes = zip(self._robot.wheels, self._robot.rollers, saturated, strict=True)
        for wheel, rollers, full in shapes:
            brush.fill(self._seen(wheel, pose), SATURATED if full else TYRE)
            axes = self._seen(rollers, pose)
            brush.stroke(axes[:, 0], axes[:, 1], width, ROLLER)
        brush.fill(self._seen(self._robot.nose, pose), EDGE)
        brush.dot(self.camera.project(pose[:2]), 4.0 * self._unit, EDGE)

    def _draw_ghost(self, brush: Brush, body: np.ndarray, pose: np.ndarray) -> None:
        brush.outline(body, 1.5 * self._unit, REFERENCE)
        brush.outline(self._seen(self._robot.nose, pose), 1.5 * self._unit, REFERENCE)
        brush.dot(self.camera.project(pose[:2]), 2.5 * self._unit, REFERENCE)

    def _seen(self, points: np.ndarray, pose: np.ndarray) -> np.ndarray:
        """Map body points (..., 2) m of a pose to the view, px."""
        return self.camera.project(on_floor(points, pose))

    def _metres(self, pixels: float) -> float:
        """Length on the floor of some pixels of a picture of ordinary size, m."""
        return pixels * self._unit / self.camera.scale
