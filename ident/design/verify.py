"""Simulated experiments: whether a motion delivers the intervals that were expected of it."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ident.design.criterion import NORMAL, quantities
from ident.design.noise import RATE
from ident.estimators import instrumental_variables, reference_motion
from ident.log import Log
from ident.regression import build_regression
from youbot_env.model import Model
from youbot_env.references import Reference
from youbot_env.simulation import Sensors, record_closed_loop


@dataclass(frozen=True)
class Experiment:
    """The same motion recorded and identified many times, with other noise each time.

    Attributes:
        model: the robot that was simulated.
        estimates: (R, 7) theta.
        covariance: (7, 7) mean of what the estimator reported.
    """

    model: Model
    estimates: np.ndarray
    covariance: np.ndarray

    def scatter(self) -> dict[str, float]:
        """Half widths of 95 % intervals from the scatter of the estimates."""
        return self._half_widths(np.cov(self.estimates.T))

    def reported(self) -> dict[str, float]:
        """Half widths of 95 % intervals that the estimator reported."""
        return self._half_widths(self.covariance)

    def _half_widths(self, covariance: np.ndarray) -> dict[str, float]:
        pairs = quantities(self.model).items()
        return {
            name: NORMAL * float(np.sqrt(q.gradient @ covariance @ q.gradient)) for name, q in pairs
        }


def simulate(
    reference: Reference,
    model: Model,
    seconds: float,
    runs: int = 20,
    seed: int = 0,
    sensors: Sensors | None = None,
    progress: Callable[[float], None] | None = None,
) -> Experiment:
    """Drive the plant along a motion with wheel loops and sensors, and identify from each log.

    Args:
        reference: the motion.
        model: the robot; it has no effects beyond the seven parameters.
        seconds: length of each log, s.
        runs: number of logs, 3 or more.
        seed: of all noise.
        sensors: noise of the record.
        progress: called with the number of runs done.
    """
    if runs < 3:
        raise ValueError(f"runs = {runs}; a scatter needs 3 or more")
    if model.effects:
        raise ValueError(
            f"model {model.name!r} has effects {[a.identifier for a in model.effects]}; simulate "
            "without them, expected intervals know the seven parameters only"
        )
    times = np.arange(round(seconds * RATE)) / RATE
    estimates, covariances = [], []
    for run in range(runs):
        # One seed a run makes every run's noise its own; the motion itself draws nothing.
        number = int(np.random.SeedSequence([seed, run]).generate_state(1)[0])
        columns = record_closed_loop(model, reference, times, sensors or Sensors(), seed=number)
        log = Log(f"run {run}", model.platform, **columns)
        regression = build_regression(log, model)
        instruments = build_regression(log, model, transform=reference_motion).H
        estimate = instrumental_variables(regression, instruments)
        estimates.append(estimate.values)
        covariances.append(estimate.covariance)
        if progress is not None:
            progress(run + 1)
    return Experiment(model, np.array(estimates), np.mean(covariances, axis=0))
