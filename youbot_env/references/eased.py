"""A motion that begins from rest, and rests where its velocity would jump."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, field
from functools import cached_property

import numpy as np

from youbot_env.backend import Ops
from youbot_env.references.base import Motion, Reference

# How long records take to bring a motion up to speed, s.  0.3 m/s within it is at most 0.56 m/s^2,
# a sixth of what the drives of the youBot can give, so that they start far from their limit.
EASE_IN = 1.0


@dataclass(frozen=True)
class Eased(Reference):
    """Another reference along its own path, at rest at time zero and where its parts join.

    The other reference is read at ``phase(t)`` instead of t.  The pace ``phase'`` rises from zero
    by the smooth step ``10 s^3 - 15 s^4 + 6 s^5`` of ``s = t / seconds``; before each joint of the
    reference it falls to zero in the same way and rises again, so velocity and acceleration change
    without a kink.  The motion is ``seconds / 2`` late after the start, and ``seconds`` more after
    every joint.  Before time zero it rests.

    Attributes:
        of: the reference that is eased.
        seconds: how long the pace takes to rise or to fall, s; 0 for none.
    """

    of: Reference = field(kw_only=True)
    seconds: float = field(default=EASE_IN, kw_only=True)

    def __post_init__(self) -> None:
        super().__post_init__()
        if not 0 <= self.seconds < float("inf"):
            raise ValueError(f"Eased: seconds = {self.seconds}; give 0 or more")

    @property
    def duration(self) -> float:
        """How long the motion lasts, s."""
        return self.of.duration + self.seconds * (0.5 + len(self.of.joints))

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """See the base class."""
        return self.of.draw(rng)

    def drawn(self, numbers: Iterator, ops: Ops) -> list:
        """See the base class."""
        return self.of.drawn(numbers, ops)

    @cached_property
    def draws(self) -> int | None:
        """See the base class."""
        return self.of.draws

    def evaluate(self, values, t, ops: Ops) -> Motion:
        """See the base class; pace and its derivative come from the chain rule."""
        if self.seconds == 0:
            return self.of.evaluate(values, t, ops)
        phase, pace, change = smooth_step(t, self.seconds, ops)
        for number, joint in enumerate(self.of.joints):
            fall = joint + number * self.seconds
            for sign, start in ((-1.0, fall), (1.0, fall + self.seconds)):
                parts = smooth_step(t - start, self.seconds, ops)
                phase, pace, change = (
                    whole + sign * part
                    for whole, part in zip((phase, pace, change), parts, strict=True)
                )
        motion = self.of.evaluate(values, phase, ops)
        pairs = zip(motion.rate, motion.acceleration, strict=True)
        return Motion(
            motion.pose,
            tuple(pace * rate for rate in motion.rate),
            tuple(pace * pace * second + change * rate for rate, second in pairs),
        )


def smooth_step(t, seconds: float, ops: Ops) -> tuple:
    """A pace that rises from 0 to 1 after time zero: its integral, s, itself, its rate, 1/s."""
    t = ops.maximum(t, 0.0)
    s = ops.minimum(t / seconds, 1.0)
    cube, left = s * s * s, 1.0 - s
    phase = t + seconds * (cube * s * (2.5 - 3.0 * s + s * s) - s)
    pace = cube * (10.0 - 15.0 * s + 6.0 * s * s)
    return phase, pace, 30.0 * s * s * left * left / seconds
