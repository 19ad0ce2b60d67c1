"""Motions of a hand: one velocity after another, each held for a while."""

from __future__ import annotations

import math
from collections.abc import Iterator
from dataclasses import dataclass
from typing import ClassVar

from youbot_env.backend import Ops
from youbot_env.references.base import Motion, Range, Reference, uniform
from youbot_env.references.eased import smooth_step


@dataclass(frozen=True)
class Strokes(Reference):
    """The velocity in the room changes at ``changes`` instants and is held between them.

    Values of an episode: the period, s, and of each change its time, s, and what it adds to the
    velocity, m/s, m/s, rad/s.  The velocity is zero at both ends of the period, after which the
    motion goes on from where it is.

    Attributes:
        ramp: how long a change takes, s.
        changes: number of changes of a period.
    """

    ramp: float = 0.3
    changes: ClassVar[int]

    def velocities(self, numbers: Iterator, ops: Ops) -> tuple[list, list]:
        """How long each velocity is held, K - 1 components, s, and the velocities, three each."""
        raise NotImplementedError

    def drawn(self, numbers: Iterator, ops: Ops) -> list:
        """See the base class."""
        held, velocities = self.velocities(numbers, ops)
        held = [ops.maximum(seconds, 1.2 * self.ramp) for seconds in held]
        rest = (0.0, 0.0, 0.0)
        values, now = [], 0.0
        starts, ends = [rest, *velocities], [*velocities, rest]
        for before, after, seconds in zip(starts, ends, [*held, 0.0], strict=True):
            values += [now, *(a - b for a, b in zip(after, before, strict=True))]
            last, now = now, now + seconds
        return [last + ops.maximum(sum(held) / len(held), self.ramp), *values]

    def evaluate(self, values, t, ops: Ops) -> Motion:
        """See the base class."""
        period = values[0]
        cycles = ops.floor(t / period)
        inside = t - cycles * period
        pose, rate, acceleration = ([0.0 * t] * 3 for _ in range(3))
        for k in range(self.changes):
            start, *change = values[1 + 4 * k : 5 + 4 * k]
            passed, pace, slope = smooth_step(inside - start, self.ramp, ops)
            # The path of a whole period, for the periods that are over.
            whole = cycles * (period - start - 0.5 * self.ramp)
            for axis, step in enumerate(change):
                pose[axis] = pose[axis] + step * (passed + whole)
                rate[axis] = rate[axis] + step * pace
                acceleration[axis] = acceleration[axis] + step * slope
        return Motion(tuple(pose), tuple(rate), tuple(acceleration))


@dataclass(frozen=True)
class Joystick(Strokes):
    """A hand on a joystick: on each axis rest or a speed, held for about half a period.

    The period is 2 pi / frequency.  Where the robot is far from its start the hand prefers to drive
    it back.

    Attributes:
        yaw_rate: largest, rad/s.
    """

    yaw_rate: Range = 0.8
    changes: ClassVar[int] = 41

    def velocities(self, numbers: Iterator, ops: Ops) -> tuple[list, list]:
        """See the base class."""
        speed, yaw_rate = uniform(self.speed, numbers), uniform(self.yaw_rate, numbers)
        half = math.pi / uniform(self.frequency, numbers)
        held = [half * uniform((0.3, 1.7), numbers) for _ in range(self.changes - 1)]
        limits = (speed / math.sqrt(2), speed / math.sqrt(2), yaw_rate)
        place, velocities = [0.0, 0.0, 0.0], []
        for seconds in held:
            velocity = []
            for axis, limit in enumerate(limits):
                size = uniform((0.2, 1.0), numbers)
                moves, homeward, side = next(numbers) < 0.6, next(numbers) < 0.7, next(numbers)
                any_way = ops.where(side < 0.5, -1.0, 1.0)
                way = ops.where(homeward, -ops.sign(place[axis]), any_way)
                way = ops.where(ops.abs(way) < 0.5, 1.0, way)
                velocity.append(ops.where(moves, limit * size * way, 0.0))
                place[axis] = place[axis] + seconds * velocity[-1]
            velocities.append(tuple(velocity))
        return held, velocities


@dataclass(frozen=True)
class Square(Strokes):
    """Ahead, left, back, right, a turn to the left and one back, with a rest after each.

    All six take 2 pi / frequency.

    Attributes:
        yaw_rate: of the turns, rad/s.
    """

    yaw_rate: Range = 0.8
    changes: ClassVar[int] = 13

    def velocities(self, numbers: Iterator, ops: Ops) -> tuple[list, list]:
        """See the base class."""
        speed, turn = uniform(self.speed, numbers), uniform(self.yaw_rate, numbers)
        leg = 2.0 * math.pi / uniform(self.frequency, numbers) / 6.0
        sides = [(speed, 0, 0), (0, speed, 0), (-speed, 0, 0), (0, -speed, 0), (0, 0, turn),
                 (0, 0, -turn)]  # fmt: skip
        velocities = [part for side in sides for part in (side, (0.0, 0.0, 0.0))]
        return [leg * share for share in (0.7, 0.3) * 6], velocities
