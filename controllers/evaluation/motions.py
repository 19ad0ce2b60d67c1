"""What is followed: references at a frequency, and how long a run of them is measured."""

from __future__ import annotations

import math
from dataclasses import dataclass

from youbot_env.references import Reference, make_reference

# Peak yaw rate of the eight, rad/s, from the frequency on at which its usual swing would exceed it;
# the peak speed is the same at all frequencies, and so the torques stay possible.
YAW_RATE, SWING = 0.8, 0.5
REFERENCES = ("eight", "circle", "multisine", "step")
FREQUENCIES = (0.1, 0.25, 0.5, 1.0, 2.0, 3.0, 4.0)
# Time before the measurement, s; whole half periods are measured, at least and at most so long, s.
SETTLE, SHORTEST, LONGEST = 1.0, 4.0, 12.6


@dataclass(frozen=True)
class Motion:
    """One reference at one frequency.

    Attributes:
        name: of the reference.
        frequency: base frequency, rad/s.
        speed: peak speed of the centre, m/s.
        length: how long it is measured, s; None for whole half periods.
    """

    name: str
    frequency: float
    speed: float = 0.3
    length: float | None = None

    def __post_init__(self) -> None:
        if self.name not in REFERENCES:
            raise ValueError(f"reference {self.name!r}; choose one of {', '.join(REFERENCES)}")
        if not 0.01 <= self.frequency <= 10:
            raise ValueError(f"frequency {self.frequency:g} rad/s; give 0.01 to 10")
        if not 0 < self.speed <= 0.8:
            raise ValueError(f"speed {self.speed:g} m/s; give up to 0.8, the robot's own limit")

    @property
    def reference(self) -> Reference:
        """The reference itself."""
        options = {"speed": self.speed, "frequency": self.frequency}
        if self.name == "circle":
            # With a tangential heading the motion of the body is steady at every frequency; with a
            # fixed one the body velocity turns, which is what the dynamics have to follow.
            options |= {"heading": "fixed"}
        if self.name == "eight":
            options |= {"yaw_amplitude": min(SWING, YAW_RATE / self.frequency)}
        return make_reference(self.name, **options)

    @property
    def seconds(self) -> float:
        """How long it is measured after ``SETTLE``, s."""
        half = math.pi / self.frequency
        if self.length is not None:
            return self.length
        return min(math.ceil(SHORTEST / half) * half, LONGEST)
