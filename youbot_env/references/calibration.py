"""The calibration motions I-IV of the paper (section 3) and sequences of motions."""

from __future__ import annotations

import itertools
import math
from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property
from typing import ClassVar

import numpy as np

from youbot_env.backend import FLOAT, Ops
from youbot_env.platform import Platform, youbot
from youbot_env.references.base import Motion, Reference, uniform
from youbot_env.references.harmonic import Harmonic, axis


@dataclass(frozen=True)
class _Turn(Harmonic):
    """A turn to and fro about a fixed point of the body, Omega periodic with mean Omega^3 = 0.

    The yaw rate holds two sines (1 and 2 times the frequency), so that inertia and friction are
    told apart at more than one frequency.
    """

    platform: Platform = field(default_factory=youbot)
    harmonics = (0, 0, 2)
    pivot = True
    side: ClassVar[str]

    def drawn(self, numbers: Iterator, ops: Ops) -> list:
        """See the base class; the pivot is the lever L away from O."""
        speed, w = uniform(self.speed, numbers), uniform(self.frequency, numbers)
        lever = self.platform.lever
        px, py = (0.0, lever) if self.side == "left" else (-lever, 0.0)
        rate = speed / lever
        # Yaw rate 0.7 sin(w t) + 0.45 sin(2 w t), as yaw; its peak is 1.
        sines = ((0.7 * rate / w, w, -math.pi / 2), (0.45 * rate / (2 * w), 2 * w, -math.pi / 2))
        start = sum(amplitude for amplitude, _, _ in sines)
        return [px, py, *axis(px), *axis(py), *axis(start, 0.0, *sines)]


@dataclass(frozen=True)
class MotionI(_Turn):
    """Turn about (0, +L): V_X = L Omega, V_Y = 0."""

    side = "left"


@dataclass(frozen=True)
class MotionII(_Turn):
    """Turn about (-L, 0): V_X = 0, V_Y = L Omega."""

    side = "rear"


@dataclass(frozen=True)
class MotionIII(Harmonic):
    """Translation without turning, V_X and V_Y independent."""

    harmonics = (2, 2, 0)

    def drawn(self, numbers: Iterator, ops: Ops) -> list:
        """See the base class."""
        speed, w = uniform(self.speed, numbers), uniform(self.frequency, numbers)
        share = speed / math.sqrt(2)
        quarter = -math.pi / 2
        values = []
        for first, second in ((1.0, 3.0), (2.0, 5.0)):
            sines = [
                (0.6 * share / (first * w), first * w, quarter),
                (0.4 * share / (second * w), second * w, quarter),
            ]
            values += axis(sum(amplitude for amplitude, _, _ in sines), 0.0, *sines)
        return [*values, *axis()]


@dataclass(frozen=True)
class MotionIV(Harmonic):
    """Straight line of the centre at constant speed while Omega swings."""

    yaw_rate: float = 1.0
    harmonics = (0, 0, 1)

    def drawn(self, numbers: Iterator, ops: Ops) -> list:
        """See the base class."""
        speed, w = uniform(self.speed, numbers), uniform(self.frequency, numbers)
        swing = (self.yaw_rate / w, w, -math.pi / 2)
        return [*axis(0.0, speed), *axis(), *axis(swing[0], 0.0, swing)]


@dataclass(frozen=True)
class Sequence(Reference):
    """References one after the other, each starting at the pose where the last one ended.

    Attributes:
        parts: the references.
        lengths: how long each lasts, s; the last goes on.
    """

    parts: tuple[Reference, ...] = ()
    lengths: tuple[float, ...] = ()

    def __post_init__(self) -> None:
        super().__post_init__()
        if not self.parts or len(self.parts) != len(self.lengths):
            raise ValueError(
                f"Sequence: {len(self.parts)} parts and {len(self.lengths)} lengths; give one each"
            )

    @property
    def duration(self) -> float:
        """Sum of the lengths, s."""
        return sum(self.lengths)

    @property
    def joints(self) -> tuple[float, ...]:
        """Where one part follows another, s."""
        return tuple(itertools.accumulate(self.lengths[:-1]))

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """See the base class; each part is preceded by the displacement that joins it on."""
        drawn = [part.draw(rng).tolist() for part in self.parts]
        return np.array([float(v) for v in self._joined(drawn, FLOAT)])

    def drawn(self, numbers: Iterator, ops: Ops) -> list:
        """See ``draw``."""
        return self._joined([part.drawn(numbers, ops) for part in self.parts], ops)

    @cached_property
    def draws(self) -> int | None:
        """See the base class."""
        counts = [part.draws for part in self.parts]
        known = [count for count in counts if count is not None]
        return sum(known) if len(known) == len(counts) else None

    def _joined(self, drawn: list, ops: Ops) -> list:
        values, place, yaw = [], (0.0, 0.0), 0.0
        for part, length, own in zip(self.parts, self.lengths, drawn, strict=True):
            first = part.evaluate(own, 0.0, ops).pose
            last = part.evaluate(own, length, ops).pose
            turn = yaw - first[2]
            c, s = ops.cos_sin(turn)

            def rotated(pose: tuple, c=c, s=s) -> tuple:
                return c * pose[0] - s * pose[1], s * pose[0] + c * pose[1]

            x, y = rotated(first)
            shift = (place[0] - x, place[1] - y)
            values += [*shift, turn, *own]
            x, y = rotated(last)
            place, yaw = (x + shift[0], y + shift[1]), last[2] + turn
        return values

    def evaluate(self, values, t, ops: Ops) -> Motion:
        """See the base class."""
        at, start, chosen = 0, 0.0, None
        for part, length in zip(self.parts, self.lengths, strict=True):
            size = part.size
            x, y, turn = values[at : at + 3]
            local = part.evaluate(values[at + 3 : at + 3 + size], t - start, ops)
            moved = _displace(local, x, y, turn, ops)
            chosen = moved if chosen is None else _where(t >= start, moved, chosen, ops)
            at, start = at + 3 + size, start + length
        assert chosen is not None  # there is a part
        return chosen


def calibration_sequence(
    speed: float = 0.3, frequency: float = 0.8, seconds: float = 112.0, platform=None
) -> Sequence:
    """Motions I, III, II, IV in the order of the paper's experiment, each a quarter of the time."""
    platform = platform or youbot()
    parts = (
        MotionI(speed, frequency, platform),
        MotionIII(speed, frequency),
        MotionII(speed, frequency, platform),
        MotionIV(speed, frequency),
    )
    return Sequence(parts=parts, lengths=(seconds / 4,) * 4)


def _displace(motion: Motion, x, y, turn, ops: Ops) -> Motion:
    c, s = ops.cos_sin(turn)

    def rotate(part: tuple) -> tuple:
        return part[0] * c - part[1] * s, part[0] * s + part[1] * c

    px, py = rotate(motion.pose)
    return Motion(
        (px + x, py + y, motion.pose[2] + turn),
        (*rotate(motion.rate), motion.rate[2]),
        (*rotate(motion.acceleration), motion.acceleration[2]),
    )


def _where(condition, new: Motion, old: Motion, ops: Ops) -> Motion:
    pairs = zip(new, old, strict=True)
    return Motion(
        *(
            tuple(ops.where(condition, a, b) for a, b in zip(one, other, strict=True))
            for one, other in pairs
        )
    )
