"""Experiment design: the motion that tells most about what one wants to know."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import asdict, dataclass, replace
from os import PathLike
from typing import Any

from ident.design.calibration import Calibration, best_calibration
from ident.design.criterion import Criterion, intervals, quantities
from ident.design.limits import Limits
from ident.design.noise import RATE, NoiseModel
from ident.design.search import Candidate, Search, plans, search_motion
from ident.design.verify import Experiment, simulate
from ident.results import Shown
from ident.threads import one_thread
from youbot_env.model import Model
from youbot_env.model_file import load_model
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


@dataclass(frozen=True, repr=False)
class Design(Shown):
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

    def headline(self) -> str:
        """See the base class."""
        return (
            f"{self.seconds:g} s for {self.target} on {self.model.name}, beside motions I-IV "
            "of the same length and limits"
        )

    def table(self) -> dict[str, list[Any]]:
        """Half widths of 95 % intervals that both motions are expected to give."""
        mine, theirs = self.expected(), self.expected_calibration()
        return {
            "quantity": list(mine),
            "designed": [float(half) for half in mine.values()],
            "motions I-IV": [float(theirs[name]) for name in mine],
        }

    def as_dict(self) -> dict[str, Any]:
        """Return what JSON shows."""
        return {
            "target": self.target,
            "seconds": self.seconds,
            "motion": asdict(self.motion),
            "expected": self.expected(),
            "expected_calibration": self.expected_calibration(),
        }

    def plot(self):
        """Expected intervals of the designed motion as shares of those of motions I-IV."""
        from ident.report.gains import design_figure

        return design_figure.on_canvas(self.expected(), self.expected_calibration())

    def _intervals(self, source: Candidate | Calibration) -> dict[str, float]:
        return intervals(source.information.covariance(self.seconds * RATE), self.model)


@one_thread
def design_motion(
    target: str,
    model: str | PathLike | Model = "nominal",
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
        model: robot that noise, torques and intervals are expected for, its file or name; its
            effects are left out.
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
    limits = limits or Limits()
    model = replace(load_model(model), effects=(), covariance=None)
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
