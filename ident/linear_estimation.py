"""The linear regression of some logs solved, with what is not known of their recording."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from ident.estimators import (
    Estimate,
    instrumental_variables,
    least_squares,
    reference_motion,
)
from ident.identifiability import Seen
from ident.log import Log
from ident.noise import DOUBTED, noisier_speeds
from ident.recording import Recording
from ident.regression import Regression, build_regression
from youbot_env.model import Model

PLAIN = "least squares"


@dataclass(frozen=True, eq=False)
class LinearEstimation:
    """Least squares, and instrumental variables where wanted, within what the logs see.

    Attributes:
        seen: directions that are estimated.
        model: platform and effects.
        corner: of the filters, rad/s.
        clusters: stretches of time for the covariance.
        instruments: whether the logs' references serve as instruments.
    """

    seen: Seen
    model: Model
    corner: float
    clusters: int
    instruments: bool

    def regression(self, logs: list[Log]) -> Regression:
        """Rows of all logs."""
        return Regression.join([build_regression(log, self.model, self.corner) for log in logs])

    def solve(self, logs: list[Log], regression: Regression) -> dict[str, Estimate]:
        """Estimates of the seen directions by method.

        There is no instrumental one where the instruments leave something unmoved.
        """
        reduced = self.seen.reduce(regression)
        found = {PLAIN: least_squares(reduced, None, self.clusters)}
        if self.instruments:
            moved = [
                build_regression(log, self.model, self.corner, reference_motion).H for log in logs
            ]
            robust = _instrumented(reduced, np.concatenate(moved) @ self.seen.basis, self.clusters)
            if robust is not None:
                found["instrumental variables"] = robust
        return found

    def of(self, records: list[Recording], regression: Regression) -> dict[str, Estimate]:
        """As ``solve``, with covariances that hold the errors of the logs' clocks.

        Each is moved by a standard error in turn.  What noise of the speeds does to least squares,
        in the columns and through the loops that answer to it, is taken back; half of it stays in
        doubt.
        """
        logs = [record.log for record in records]
        found = self.solve(logs, regression)
        extra = {method: np.zeros_like(one.covariance) for method, one in found.items()}
        pulled = self._pulled(logs, found[PLAIN])
        found[PLAIN] = replace(found[PLAIN], values=found[PLAIN].values - pulled)
        extra[PLAIN] += np.outer(DOUBTED * pulled, DOUBTED * pulled)
        for number, record in enumerate(records):
            if not record.error:
                continue
            others = [*logs]
            others[number] = record.moved()
            for method, moved in self.solve(others, self.regression(others)).items():
                if method in found:
                    step = moved.values - found[method].values
                    extra[method] += np.outer(step, step)
        return {
            method: replace(one, covariance=one.covariance + extra[method])
            for method, one in found.items()
        }

    def _pulled(self, logs: list[Log], found: Estimate) -> np.ndarray:
        """(k,) by how much noise of the speeds shifts least squares.

        As much noise once more shifts them by as much again.
        """
        total = np.zeros(len(found.values))
        for number, log in enumerate(logs):
            for noisy in noisier_speeds(log):
                others = [*logs]
                others[number] = noisy
                reduced = self.seen.reduce(self.regression(others))
                shifted = least_squares(reduced, None, self.clusters).values
                total += 0.5 * (shifted - found.values)
        return total


def _instrumented(regression: Regression, rows: np.ndarray, clusters: int) -> Estimate | None:
    """The instrumental estimate, or None where the instruments leave something unmoved."""
    try:
        estimate = instrumental_variables(regression, rows, None, clusters)
    except np.linalg.LinAlgError:
        return None
    return estimate if np.all(estimate.standard_errors > 0) else None
