"""Motions of a hand: one velocity after another, each held for a while."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import numpy as np

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

    def velocities(self, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """Draw how long each velocity is held (K - 1,), s, and the velocities (K - 1, 3)."""
        raise NotImplementedError

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """See the base class."""
        held, velocities = self.velocities(rng)
        held = np.maximum(held, 1.2 * self.ramp)
        times = np.concatenate([[0.0], np.cumsum(held)])
        rest = np.zeros((1, 3))
        change = np.diff(np.concatenate([rest, velocities, rest]), axis=0)
        period = times[-1] + max(held.mean(), self.ramp)
        return np.array([period, *np.column_stack([times, change]).ravel()])

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

    def velocities(self, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """See the base class."""
        speed, yaw_rate = uniform(self.speed, rng), uniform(self.yaw_rate, rng)
        half = math.pi / uniform(self.frequency, rng)
        held = half * rng.uniform(0.3, 1.7, self.changes - 1)
        limits = np.array([speed, speed, yaw_rate]) / (math.sqrt(2), math.sqrt(2), 1.0)
        place, velocities = np.zeros(3), []
        for seconds in held:
            size = rng.uniform(0.2, 1.0, 3) * (rng.uniform(size=3) < 0.6)
            back = np.where(rng.uniform(size=3) < 0.7, -np.sign(place), rng.choice((-1, 1), 3))
            velocities.append(limits * size * np.where(back == 0.0, 1.0, back))
            place = place + seconds * velocities[-1]
        return held, np.array(velocities)


@dataclass(frozen=True)
class Square(Strokes):
    """Ahead, left, back, right, a turn to the left and one back, with a rest after each.

    All six take 2 pi / frequency.

    Attributes:
        yaw_rate: of the turns, rad/s.
    """

    yaw_rate: Range = 0.8
    changes: ClassVar[int] = 13

    def velocities(self, rng: np.random.Generator) -> tuple[np.ndarray, np.ndarray]:
        """See the base class."""
        speed, turn = uniform(self.speed, rng), uniform(self.yaw_rate, rng)
        leg = 2.0 * math.pi / uniform(self.frequency, rng) / 6.0
        sides = [(speed, 0, 0), (0, speed, 0), (-speed, 0, 0), (0, -speed, 0), (0, 0, turn),
                 (0, 0, -turn)]  # fmt: skip
        velocities = [part for side in sides for part in (side, (0.0, 0.0, 0.0))]
        return leg * np.tile((0.7, 0.3), 6), np.array(velocities)
