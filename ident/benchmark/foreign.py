"""Conditions of logs that nobody here made: every assumption of the other conditions, dropped.

What the estimators take for granted where a log comes from this project's own defaults is drawn
here: loops that run at any rate, rows that are held, sampled or averaged, filters, clocks that are
off, coarse steps, torque noise that lasts, motions of a hand, channels that are missing, a second
record that carries or climbs something else.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ident.benchmark.conditions import FIT_SECONDS, Conditions
from ident.log import Log
from youbot_env.model import Model
from youbot_env.references import Joystick, Reference, SmoothRandom, Square, calibration_sequence

# Rates of the wheel loops and of the log, Hz, and how often each is drawn.
LOOPS, LOOPS_DRAWN = (200.0, 500.0, 1000.0), (0.3, 0.3, 0.4)
RATES, RATES_DRAWN = (100.0, 50.0, 200.0, 20.0), (0.6, 0.25, 0.1, 0.05)
ROWS, ROWS_DRAWN = ("sampled", "averaged", "held"), (0.5, 0.3, 0.2)
MOTIONS = ("calibration", "smooth_random", "joystick", "square")
MOTIONS_DRAWN = (0.35, 0.25, 0.25, 0.15)
# Two in five records have one fault of their instruments; drawn between these sizes.  A drive whose
# rows are early is a drive with a delay, whatever one calls it.
FAULTS = {
    "drive_filter": ("T", 0.004, 0.015),
    "velocity_filter": ("T", 0.004, 0.015),
    "drive_offset": ("d", 0.0, 0.03),
    "speed_quantisation": ("q", 0.03, 0.12),
}
FAULTY = 0.4
# One record in four has torque noise that lasts, N m and s.
LASTING, NOISE, CORRELATION = 0.25, (0.02, 0.08), (0.05, 0.3)
# What may be another in the verifying record: load, kg, slope, rad, share of the torque.
DIFFERENCES = (("load", 2.0, 6.0), ("slope", 0.004, 0.012), ("battery", 0.90, 0.96))
POSE, REFERENCE, SECOND, DIFFERS = 0.7, 0.6, 0.8, 0.25


@dataclass(frozen=True)
class Foreign(Conditions):
    """One way to record of another laboratory.

    Attributes:
        second_motion: motion of the verifying record.
        fault: effect of the recording and its values, or None.
        noise: standard deviation of the torque noise that lasts, N m.
        correlation: its correlation time, s.
        pose, reference: whether the record has these channels.
        second: whether there is a verifying record.
        differs: what of the robot is another in the verifying record: ``load`` (kg), ``slope``
            (rad) or ``battery`` (share of the torque), with its size, or None.
    """

    second_motion: str = "smooth_random"
    fault: tuple[str, str, float] | None = None
    noise: float = 0.0
    correlation: float = 0.1
    pose: bool = True
    reference: bool = True
    second: bool = True
    differs: tuple[str, float] | None = None

    @classmethod
    def draw(cls, rng: np.random.Generator, fast: bool = False) -> Foreign:
        """Draw conditions; see the constants of this file for how often what is drawn.

        Args:
            rng: source of chance.
            fast: 100 Hz or more, motions that tell a delay.
        """
        row = str(rng.choice(ROWS, p=ROWS_DRAWN))
        rate = float(rng.choice(RATES, p=RATES_DRAWN))
        loop = float(rng.choice(LOOPS, p=LOOPS_DRAWN))
        motion, other = (str(m) for m in rng.choice(MOTIONS, 2, p=MOTIONS_DRAWN))
        if fast:
            rate, motion = max(rate, 100.0), "calibration" if motion == "square" else motion
        if row == "held":
            rate, loop = max(rate, 100.0), 0.0  # slower loops than that are unstable
        name = str(rng.choice(list(FAULTS)))
        value, low, high = FAULTS[name]
        fault = (name, value, round(float(rng.uniform(low, high)), 4))
        lasting = rng.uniform() < LASTING
        what, low, high = DIFFERENCES[rng.integers(len(DIFFERENCES))]
        differs = (what, round(float(rng.uniform(low, high)), 4))
        if loop and loop % rate:
            loop = 1000.0  # whole loop steps in a row
        speed, frequency = rng.uniform(0.2, 0.45), rng.uniform(0.5, 1.2)
        return cls(
            rate=rate,
            motion=motion,
            speed=round(float(speed), 3),
            frequency=round(float(frequency), 3),
            loop_rate=max(loop, rate) if loop else None,
            row="sampled" if row == "held" else row,
            # The last part of a calibration is one motion, on two axes.
            second_motion="smooth_random" if other in (motion, "calibration") else other,
            fault=fault if rng.uniform() < FAULTY else None,
            noise=round(float(rng.uniform(*NOISE)), 4) if lasting else 0.0,
            correlation=round(float(rng.uniform(*CORRELATION)), 3),
            pose=rng.uniform() < POSE,
            reference=rng.uniform() < REFERENCE,
            second=rng.uniform() < SECOND,
            differs=differs if rng.uniform() < DIFFERS else None,
        )

    def fitting(self, seconds: float = FIT_SECONDS) -> Reference:
        """See the base class."""
        return self._motion(self.motion, seconds)

    def verifying(self) -> Reference:
        """See the base class."""
        return self._motion(self.second_motion, FIT_SECONDS)

    def _motion(self, name: str, seconds: float) -> Reference:
        if name == "calibration":
            return calibration_sequence(self.speed, self.frequency, seconds)
        kinds = {"smooth_random": SmoothRandom, "joystick": Joystick, "square": Square}
        return kinds[name](self.speed, 2.0 * self.frequency)

    def of_recording(self) -> dict[str, dict[str, float]]:
        """See the base class."""
        found = super().of_recording()
        if self.fault is not None:
            name, value, size = self.fault
            found[name] = {value: size}
        return found

    def driven(self, robot: Model, second: bool) -> Model:
        """See the base class."""
        present = {active.identifier for active in robot.effects}
        extra = {}
        if second and self.differs is not None:
            kind, size = self.differs
            if kind == "load":
                theta = robot.parameters
                loaded = replace(theta, m0=theta.m0 + size, I0=theta.I0 + 0.02 * size)
                robot = replace(robot, parameters=loaded)
            elif kind == "slope":
                extra["floor_slope"] = {"sx": size, "sy": -0.5 * size}
            else:
                extra["torque_gain"] = {"e": size - 1.0}
        return robot.with_effects({n: v for n, v in extra.items() if n not in present})

    def kept(self, log: Log, rng: np.random.Generator) -> Log:
        """See the base class."""
        if self.noise > 0.0:
            from scipy.signal import lfilter

            # First-order noise with its standard deviation from the first row on.
            keep = np.exp(-np.median(np.diff(log.time)) / self.correlation)
            white = rng.normal(size=log.wheel_torque.shape)
            start = white[:1]
            white[1:] *= np.sqrt(1.0 - keep**2)
            lasting = lfilter([1.0], [1.0, -keep], white, axis=0, zi=0.0 * start)[0]
            log = replace(log, wheel_torque=log.wheel_torque + self.noise * lasting)
        return replace(
            log,
            pose=log.pose if self.pose else None,
            reference=log.reference if self.reference else None,
        )
