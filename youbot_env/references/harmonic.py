"""References made of sines: circle, eight, multisine, smooth random motion."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from youbot_env.backend import Ops
from youbot_env.references.base import Motion, Range, Reference, uniform


@dataclass(frozen=True)
class Harmonic(Reference):
    """Each of x, y, yaw is ``offset + drift t + sum of A sin(w t + phase)``.

    Class attributes:
        harmonics: number of sines in x, y and yaw.
        pivot: whether the path is that of a point of the body other than O; two values more.
    """

    harmonics: ClassVar[tuple[int, int, int]]
    pivot: ClassVar[bool] = False

    def evaluate(self, values, t, ops: Ops) -> Motion:
        """See the base class; values: [pivot x, pivot y], then offset, drift, (A, w, phase)..."""
        at = 2 if self.pivot else 0
        axes = []
        for count in self.harmonics:
            position, rate = values[at] + values[at + 1] * t, values[at + 1]
            acceleration = 0.0 * t
            for k in range(count):
                a, w, phase = values[at + 2 + 3 * k : at + 5 + 3 * k]
                angle = w * t + phase
                cosine, sine = ops.cos_sin(angle)
                sine = a * sine
                position = position + sine
                rate = rate + (a * w) * cosine
                acceleration = acceleration - (w * w) * sine
            axes.append((position, rate, acceleration))
            at += 2 + 3 * count
        motion = Motion(*zip(*axes, strict=True))
        return about_pivot(motion, values[0], values[1], ops) if self.pivot else motion


def about_pivot(motion: Motion, px, py, ops: Ops) -> Motion:
    """Motion of O when ``motion`` is that of the body point (px, py), m."""
    yaw, rate, acceleration = (part[2] for part in motion)
    c, s = ops.cos_sin(yaw)
    dx, dy = px * c - py * s, px * s + py * c
    pose = (motion.pose[0] - dx, motion.pose[1] - dy, yaw)
    speed = (motion.rate[0] + rate * dy, motion.rate[1] - rate * dx, rate)
    turn = rate * rate
    second = (
        motion.acceleration[0] + acceleration * dy + turn * dx,
        motion.acceleration[1] - acceleration * dx + turn * dy,
        acceleration,
    )
    return Motion(pose, speed, second)


def axis(offset=0.0, drift=0.0, *sines: tuple) -> list:
    """Values of one axis: offset, drift and (amplitude, angular frequency, phase) of each sine."""
    return [offset, drift, *itertools.chain(*sines)]


@dataclass(frozen=True)
class Circle(Harmonic):
    """A circle through the start, driven once every 2 pi / frequency.

    Attributes:
        heading: ``tangent`` turns with the path, ``fixed`` keeps the heading.
        random_phase: start anywhere on the circle, in either direction.
    """

    heading: str = "tangent"
    random_phase: bool = False
    harmonics = (1, 1, 0)

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.heading not in ("tangent", "fixed"):
            raise ValueError(f"Circle: heading = {self.heading!r}; choose 'tangent' or 'fixed'")

    def drawn(self, numbers: Iterator, ops: Ops) -> list:
        """See the base class."""
        speed, w = uniform(self.speed, numbers), uniform(self.frequency, numbers)
        start, side = 0.0, 1.0
        if self.random_phase:
            start = 2 * math.pi * next(numbers)
            side = ops.where(next(numbers) < 0.5, -1.0, 1.0)
        radius, w = speed / w, side * w
        # Centre at 'side * radius' to the left of the start heading.
        place = start - side * math.pi / 2
        tangent = self.heading == "tangent"
        x = axis(-radius * ops.cos(place), 0.0, (radius, w, place + math.pi / 2))
        y = axis(-radius * ops.sin(place), 0.0, (radius, w, place))
        return [*x, *y, start if tangent else 0.0, w if tangent else 0.0]


@dataclass(frozen=True)
class Eight(Harmonic):
    """A lying figure of eight with a swinging heading.

    Attributes:
        yaw_amplitude: swing of the heading, rad.
    """

    yaw_amplitude: float = 0.5
    harmonics = (1, 1, 1)

    def drawn(self, numbers: Iterator, ops: Ops) -> list:
        """See the base class; the centre is crossed at full speed."""
        speed, w = uniform(self.speed, numbers), uniform(self.frequency, numbers)
        size = speed / (w * math.sqrt(2))
        return [
            *axis(0.0, 0.0, (size, w, 0.0)),
            *axis(0.0, 0.0, (size / 2, 2 * w, 0.0)),
            *axis(0.0, 0.0, (self.yaw_amplitude, w, 0.0)),
        ]


@dataclass(frozen=True)
class Multisine(Harmonic):
    """Sines at one to five times the frequency on every axis, phases drawn each episode.

    Attributes:
        yaw_rate: peak of the yaw rate, rad/s.
    """

    yaw_rate: Range = 0.8
    count: ClassVar[int] = 5
    harmonics = (5, 5, 5)

    def multiples(self, numbers: Iterator) -> list:
        """Frequencies in units of the base frequency, ``count`` components."""
        return [float(k) for k in range(1, self.count + 1)]

    def drawn(self, numbers: Iterator, ops: Ops) -> list:
        """See the base class; the speed limit holds for the sum of all sines of x and y."""
        speed, w = uniform(self.speed, numbers), uniform(self.frequency, numbers)
        limits = (speed / math.sqrt(2), speed / math.sqrt(2), uniform(self.yaw_rate, numbers))
        values = []
        for limit in limits:
            frequencies = [w * multiple for multiple in self.multiples(numbers)]
            share = [uniform((0.5, 1.0), numbers) for _ in frequencies]
            whole = sum(share)
            phases = [2 * math.pi * next(numbers) for _ in frequencies]
            amplitudes = [
                limit * part / whole / f for part, f in zip(share, frequencies, strict=True)
            ]
            start = -sum(a * ops.sin(p) for a, p in zip(amplitudes, phases, strict=True))
            values += axis(start, 0.0, *zip(amplitudes, frequencies, phases, strict=True))
        return values


@dataclass(frozen=True)
class SmoothRandom(Multisine):
    """Three sines an axis, their frequencies drawn between 0.3 and 1 times the frequency."""

    count: ClassVar[int] = 3
    harmonics = (3, 3, 3)

    def multiples(self, numbers: Iterator) -> list:
        """See the base class."""
        return [uniform((0.3, 1.0), numbers) for _ in range(self.count)]
