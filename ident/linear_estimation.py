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
from ident.log import Log
from ident.observability import column_noise
from ident.recording import Recording
from ident.recursive import sample_times
from ident.regression import Regression, build_regression
from ident.seen import Seen
from youbot_env.model import Model


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
        found = {"least squares": least_squares(reduced, None, self.clusters)}
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

        Each is moved by a standard error in turn.  That of least squares also holds what noise in
        the regressors does to it, which no scatter shows.
        """
        logs = [record.log for record in records]
        found = self.solve(logs, regression)
        extra = {method: np.zeros_like(one.covariance) for method, one in found.items()}
        pulled = self._attenuation(regression, found["least squares"].values)
        extra["least squares"] += np.outer(pulled, pulled)
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

    def _attenuation(self, regression: Regression, values: np.ndarray) -> np.ndarray:
        """(k,) by how much noise in the columns pulls least squares toward nothing.

        Of the Gramian ``H'H`` a part N is noise of the columns; the estimate is then short by about
        ``(H'H)^-1 N theta``.
        """
        basis, noise = self.seen.basis, column_noise(regression)
        weights = sample_times(regression)
        seen = regression.H @ basis
        gramian = np.einsum("n,nap,naq->pq", weights, seen, seen)
        theta = self.seen.start + basis @ values
        return np.linalg.lstsq(gramian, basis.T @ noise @ theta, rcond=None)[0]


def _instrumented(regression: Regression, rows: np.ndarray, clusters: int) -> Estimate | None:
    """The instrumental estimate, or None where the instruments leave something unmoved."""
    try:
        estimate = instrumental_variables(regression, rows, None, clusters)
    except np.linalg.LinAlgError:
        return None
    return estimate if np.all(estimate.standard_errors > 0) else None
