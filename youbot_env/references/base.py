"""What a reference motion is: values drawn once an episode, and a pose at every time.

A reference is the desired pose of O in the world, with velocity and acceleration, in closed form.
``drawn`` makes the values of one episode from random numbers; ``evaluate`` takes them as
components.  Both are functions over components, so one source serves a single robot (floats), a
vector environment (one column of values a robot) and an optimal-control problem (symbols).
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from functools import cached_property
from typing import Any, NamedTuple

import numpy as np

from youbot_env.backend import FLOAT, NUMPY, Ops

Range = float | tuple[float, float]
# Speed, m/s, and frequency, rad/s, beyond which positions would lose their digits.
LARGEST = 1e4


class Motion(NamedTuple):
    """Desired motion at one instant, world frame, each (x, y, yaw) in components.

    Attributes:
        pose: m, m, rad (yaw not wrapped).
        rate: first time derivative, m/s, m/s, rad/s.
        acceleration: second time derivative, m/s^2, m/s^2, rad/s^2.
    """

    pose: tuple
    rate: tuple
    acceleration: tuple

    def heading(self, ops: Ops) -> tuple:
        """(cos yaw, sin yaw) of the desired pose."""
        return ops.cos_sin(self.pose[2])

    def twist(self, ops: Ops) -> tuple:
        """Body velocities (V_X, V_Y, Omega) of a robot that follows exactly."""
        return rotate_to_body(self.rate, self.heading(ops))

    def twist_rate(self, ops: Ops) -> tuple:
        """Time derivative of ``twist``: (V_X', V_Y', Omega')."""
        heading = self.heading(ops)
        ax, ay, ao = rotate_to_body(self.acceleration, heading)
        vx, vy, om = rotate_to_body(self.rate, heading)
        return ax + om * vy, ay - om * vx, ao


def rotate_to_body(vector: tuple, heading: tuple) -> tuple:
    """Turn a world vector (x, y, yaw part) into the frame with heading (cos yaw, sin yaw)."""
    c, s = heading
    return vector[0] * c + vector[1] * s, vector[1] * c - vector[0] * s, vector[2]


@dataclass(frozen=True)
class Reference:
    """Base of all references.

    Attributes:
        speed: peak speed of the centre, m/s; a pair is drawn uniformly each episode.
        frequency: base angular frequency, rad/s; a pair is drawn uniformly each episode.
    """

    speed: Range = 0.3
    frequency: Range = 0.5

    def __post_init__(self) -> None:
        for name, low in (("speed", 0.0), ("frequency", 1e-6)):
            value = getattr(self, name)
            ends = value if isinstance(value, tuple) else (value, value)
            numbers = all(isinstance(end, int | float | np.number) for end in ends)
            if not numbers or len(ends) != 2 or not low <= ends[0] <= ends[1] <= LARGEST:
                raise ValueError(
                    f"{type(self).__name__}: {name} = {value!r}; give a number of at least {low} "
                    f"and at most {LARGEST:g}, or a (low, high) pair"
                )

    def drawn(self, numbers: Iterator, ops: Ops) -> list:
        """Values of one episode, P components, from numbers drawn uniformly in [0, 1).

        P and how many numbers are taken are the same for every episode.
        """
        raise NotImplementedError

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """Return the values (P,) of one episode; P is the same for every draw."""
        return np.array([float(v) for v in self.drawn(iter(rng.random, None), FLOAT)])

    @cached_property
    def draws(self) -> int | None:
        """How many numbers ``drawn`` takes; None where only ``draw`` is known."""
        order = [vars(kind) for kind in type(self).__mro__]
        owner = {name: next(k for k, own in enumerate(order) if name in own)
                 for name in ("draw", "drawn")}  # fmt: skip
        if owner["draw"] < owner["drawn"] or type(self).drawn is Reference.drawn:
            return None
        taken: list[float] = []

        def count() -> float:
            taken.append(0.5)
            return 0.5

        self.drawn(iter(count, None), FLOAT)
        return len(taken)

    def evaluate(self, values, t, ops: Ops) -> Motion:
        """Desired motion at time t, s, from P values in components."""
        raise NotImplementedError

    @cached_property
    def constant(self) -> np.ndarray | None:
        """The values (P,) where every episode has the same ones, else None."""
        first, second = (self.draw(np.random.default_rng(seed)) for seed in (0, 1))
        return first if np.array_equal(first, second) else None

    @cached_property
    def size(self) -> int:
        """P, the number of values of one episode."""
        return len(self.draw(np.random.default_rng(0)))

    @property
    def duration(self) -> float:
        """How long the motion lasts, s; infinite where it repeats."""
        return float("inf")

    @property
    def joints(self) -> tuple[float, ...]:
        """Times, s, at which the velocity may jump, time zero left out."""
        return ()

    def sample(self, times: np.ndarray, seed: int | None = None) -> Motion:
        """Evaluate one episode on a time grid (N,); entries are arrays (N,)."""
        values = self.draw(np.random.default_rng(seed))
        motion = self.evaluate([float(v) for v in values], np.asarray(times, float), NUMPY)
        return Motion(
            *(tuple(np.broadcast_to(c, np.shape(times)) for c in part) for part in motion)
        )


def uniform(value: Range, numbers: Iterator) -> Any:
    """Draw from a (low, high) pair; a number is returned as it is, without taking a random one."""
    if not isinstance(value, tuple):
        return float(value)
    low, high = float(value[0]), float(value[1])
    return low + (high - low) * next(numbers)
