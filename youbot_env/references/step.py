"""Steps of the velocity: the reference that asks for more than any drive can do."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass

from youbot_env.backend import Ops
from youbot_env.references.base import Motion, Reference, uniform


@dataclass(frozen=True)
class Step(Reference):
    """The centre moves to and fro along a line at constant speed, reversing every half period.

    Attributes:
        direction: direction of the line from body X at the start, rad.
    """

    direction: float = math.pi / 4

    def drawn(self, numbers: Iterator, ops: Ops) -> list:
        """See the base class: velocity along x and y, frequency."""
        speed, w = uniform(self.speed, numbers), uniform(self.frequency, numbers)
        return [speed * math.cos(self.direction), speed * math.sin(self.direction), w]

    def evaluate(self, values, t, ops: Ops) -> Motion:
        """See the base class; position is a triangle wave, acceleration zero between steps."""
        vx, vy, w = values
        cycle = t * w / (2 * math.pi)
        part = cycle - ops.floor(cycle)
        forward = ops.where(part < 0.5, 1.0, -1.0)
        travelled = ops.where(part < 0.5, part, 1.0 - part) * (2 * math.pi) / w
        zero = 0.0 * t
        return Motion(
            (vx * travelled, vy * travelled, zero), (vx * forward, vy * forward, zero), (zero,) * 3
        )
