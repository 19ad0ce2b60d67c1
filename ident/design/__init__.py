"""Experiment design: the motion that tells most about what one wants to know."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

from ident.design.calibration import Calibration, best_calibration
from ident.design.criterion import Criterion, intervals, quantities
from ident.design.limits import Limits
from ident.design.noise import RATE, NoiseModel
from ident.design.search import Candidate, Search, plans, search_motion
from ident.design.verify import Experiment, simulate
from ident.threads import one_thread
from youbot_env.model import Model
from youbot_env.references import Fourier
from youbot_env.simulation import Sensors

__all__ = [
    "Criterion",
    "Design",
    "Experiment",
    "Limits",
    "NoiseModel",
    "design_motion",
    "intervals",
    "quantities",
    "simulate",
]

# Fewer sines than this cannot tell seven parameters apart.
FEWEST = 3


@dataclass(frozen=True)
class Design:
    """A designed motion beside the paper's, at equal time and limits.

    Attributes:
        target: what it is for.
        model: the robot that intervals are expected for.
        limits: what both motions keep to.
        seconds: length of the experiment, s.
        motion: the designed reference.
        calibration: motions I-IV at the base frequencies best for the target.
        candidates: all motions that the search ended in, the best first.
    """

    target: str
    model: Model
    limits: Limits
    seconds: float
    motion: Fourier
    calibration: Calibration
    candidates: list[Candidate]

    def expected(self) -> dict[str, float]:
        """Half widths of the 95 % intervals that the designed motion is expected to give."""
        return self._intervals(self.candidates[0])

    def expected_calibration(self) -> dict[str, float]:
        """The same for motions I-IV."""
        return self._intervals(self.calibration)

    def _intervals(self, source: Candidate | Calibration) -> dict[str, float]:
        return intervals(source.information.covariance(self.seconds * RATE), self.model)


@one_thread
def design_motion(
    target: str,
    model: Model,
    seconds: float = 60.0,
    limits: Limits | None = None,
    harmonics: int = 8,
    starts: int = 8,
    seed: int = 0,
    sensors: Sensors | None = None,
    progress: Callable[[float], None] | None = None,
) -> Design:
    """Design a calibration motion.

    Args:
        target: a parameter (``m0``, ``a_x``, ...), a combination (``x1+x3``), ``x1`` .. ``x7``,
            ``A`` (all parameters, each in sizes of itself) or ``D`` (volume of all intervals).
        model: robot that noise, torques and intervals are expected for, the nominal one as a rule;
            its effects are left out.
        seconds: length of the experiment, s.
        limits: speed, yaw rate, accelerations and torque.
        harmonics: sines an axis, 3 or more.
        starts: random starts of the search.
        seed: of the starts.
        sensors: noise that is expected.
        progress: called with the share of the work done.

    Raises:
        ValueError: an unknown target, or a request that no motion can meet.
    """
    limits, model = limits or Limits(), replace(model, effects=(), covariance=None)
    if harmonics < FEWEST or starts < 1:
        raise ValueError(
            f"harmonics = {harmonics}, starts = {starts}; give {FEWEST} or more harmonics and one "
            "or more starts"
        )
    shortest = 2 * math.pi * limits.speed / limits.acceleration * harmonics / 2
    if not (math.isfinite(seconds) and seconds >= shortest):
        raise ValueError(
            f"seconds = {seconds}; {harmonics} harmonics at {limits.speed} m/s and "
            f"{limits.acceleration} m/s^2 need {shortest:.3g} s or more"
        )
    criterion, noise = Criterion.of(target, model), NoiseModel.of(model, sensors)
    calibration = best_calibration(criterion, model, limits, seconds, noise)
    search = Search(criterion, model, limits, harmonics, noise)
    found = search_motion(search, plans(limits, harmonics, seconds, starts, seed), progress)
    return Design(target, model, limits, seconds, found[0].motion, calibration, found)
