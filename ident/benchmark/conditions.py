"""How a record is taken: motion, speed, rate and jitter, drawn anew for every robot."""

from __future__ import annotations

from dataclasses import asdict, dataclass
from typing import Any

import numpy as np

from ident.log import Log
from youbot_env.measurement import HELD, HOLDS, instruments
from youbot_env.model import Model
from youbot_env.references import Reference, SmoothRandom, calibration_sequence
from youbot_env.simulation import Sensors, record_closed_loop

# Length of the record that is fitted and of the one that only verifies, s.
FIT_SECONDS, VERIFY_SECONDS = 112.0, 48.0
# The wheel-speed loops of a real drive run faster than its log, Hz.
LOOP_RATE = 1000.0


@dataclass(frozen=True)
class Conditions:
    """One way to record.

    Attributes:
        rate: samples a second, Hz.
        jitter: uniform scatter of the sample times, in sample times.
        motion: ``calibration`` (motions I, III, II, IV) or ``smooth_random``.
        speed: peak speed of the centre, m/s.
        frequency: base frequency of the motion, rad/s.
        loop_rate: rate of the wheel-speed loops, Hz; None: the log's, each torque held for its row.
        row: ``sampled`` or ``averaged`` torque of a row.
    """

    rate: float = 100.0
    jitter: float = 0.0
    motion: str = "calibration"
    speed: float = 0.3
    frequency: float = 0.8
    loop_rate: float | None = LOOP_RATE
    row: str = "sampled"

    @classmethod
    def draw(cls, rng: np.random.Generator, fast: bool = False) -> Conditions:
        """Draw conditions.

        Seven in ten records are at 100 Hz without jitter, three in five at the usual speed, four in
        five with the calibration motions.

        Args:
            rng: source of chance.
            fast: 100 Hz always; a delay of the drive shows little at 50 Hz, and makes loops that
                run at the log's rate oscillate.
        """
        kind = rng.choice(3, p=(0.7, 0.15, 0.15))
        usual, calibration = rng.uniform() < 0.6, rng.uniform() < 0.8
        speed, frequency = rng.uniform(0.2, 0.4), rng.uniform(0.5, 1.2)
        return cls(
            rate=50.0 if kind == 1 and not fast else 100.0,
            jitter=0.3 if kind == 2 else 0.0,
            motion="calibration" if calibration else "smooth_random",
            speed=0.3 if usual else round(float(speed), 3),
            frequency=0.8 if usual else round(float(frequency), 3),
        )

    def as_dict(self) -> dict:
        """Return the conditions by name."""
        return asdict(self)

    @property
    def second(self) -> bool:
        """Whether the diagnosis gets the verifying record."""
        return True

    def of_recording(self) -> dict[str, dict[str, float]]:
        """Effects of the recording, by identifier, that undo what was done to the rows."""
        row = HELD if self.loop_rate is None else self.row
        return {"drive_hold": {"kind": HOLDS.index(row)}}

    def rows(self, robot: Model) -> dict[str, Any]:
        """Arguments of ``record_closed_loop`` and ``record_motion`` that make the rows."""
        effects = robot.with_effects(self.of_recording()).effects
        return {
            "loop_rate": self.loop_rate,
            "row": self.row,
            "instrument": instruments(effects, robot.platform),
        }

    def driven(self, robot: Model, second: bool) -> Model:
        """The robot as it is in the record, or in the second one: floor, load, battery."""
        return robot

    def kept(self, log: Log, rng: np.random.Generator) -> Log:
        """What of a record is left in the file."""
        return log

    def fitting(self, seconds: float = FIT_SECONDS) -> Reference:
        """Return the motion of the record that is fitted."""
        if self.motion == "calibration":
            return calibration_sequence(self.speed, self.frequency, seconds)
        return SmoothRandom(self.speed, 2.0 * self.frequency)

    def verifying(self) -> Reference:
        """Return the motion of the record that verifies: always another one."""
        return SmoothRandom(self.speed, 1.5)

    def times(self, seconds: float, rng: np.random.Generator) -> np.ndarray:
        """Sample times (N,), s."""
        count = round(seconds * self.rate)
        late = self.jitter * rng.uniform(-0.5, 0.5, count)
        return (np.arange(count) + late) / self.rate


def record(
    name: str,
    robot: Model,
    reference: Reference,
    times: np.ndarray,
    sensors: Sensors,
    seed: np.random.SeedSequence,
    conditions: Conditions | None = None,
) -> Log:
    """Drive a robot on its wheel-speed loops and return what its sensors show.

    Args:
        name: of the log.
        robot: the true robot.
        reference: the motion.
        times: (N,) of the rows, s.
        sensors: their noise.
        seed: of motion and noise.
        conditions: how it is recorded; None: loops at the rate of the log, each torque held.
    """
    number = int(seed.generate_state(1)[0])
    how = {} if conditions is None else conditions.rows(robot)
    channels = record_closed_loop(robot, reference, times, sensors, seed=number, **how)
    return Log(name, robot.platform, **channels)
