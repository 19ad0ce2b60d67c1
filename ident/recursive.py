"""The recursive estimator of the paper (eq. 10) in information form, one sample at a time.

``Y' = H'H - f Y``, ``b' = H'z - f b``, estimate ``Y^-1 b``.  The information form is the exact
solution of the paper's equations for P and the estimate; it has no covariance that could drift or
turn indefinite.
"""

from __future__ import annotations

import itertools
import math

import numpy as np

from ident.regression import Regression


class RecursiveLeastSquares:
    """Estimator that is updated while samples arrive.

    Args:
        start: (P,) estimate before the first sample, the paper's x0.
        uncertainty: (P,) standard deviations of that guess, in the parameters' units, for a
            residual density of one; large values forget the guess.
        forgetting: rate f at which old samples fade, 1/s; zero remembers everything.

    Attributes:
        information: (P, P) matrix Y.
        moment: (P,) vector b.
    """

    def __init__(self, start: np.ndarray, uncertainty: np.ndarray, forgetting: float = 0.0):
        start, uncertainty = np.asarray(start, float), np.asarray(uncertainty, float)
        if start.shape != uncertainty.shape or not (uncertainty > 0).all():
            raise ValueError(
                f"start {start.shape} and uncertainty {uncertainty.shape} must have one shape and "
                "uncertainties must be positive"
            )
        if forgetting < 0:
            raise ValueError(f"forgetting = {forgetting} 1/s must not be negative")
        self.forgetting = forgetting
        self.information = np.diag(uncertainty**-2.0)
        self.moment = self.information @ start

    def update(self, H: np.ndarray, z: np.ndarray, dt: float) -> None:
        """Take in one sample: H (rows, P), z (rows,), valid for dt seconds."""
        if self.forgetting:
            keep = math.exp(-self.forgetting * dt)
            self.information *= keep
            self.moment *= keep
        weighted = H.T * dt
        self.information += weighted @ H
        self.moment += weighted @ z

    def update_many(self, H: np.ndarray, z: np.ndarray, dt: np.ndarray) -> None:
        """Take in N samples at once: H (N, rows, P), z (N, rows), dt (N,) s; same result."""
        weight = np.asarray(dt, float)
        if self.forgetting:
            left = np.cumsum(dt[::-1])[::-1] - dt
            weight = weight * np.exp(-self.forgetting * left)
            keep = math.exp(-self.forgetting * float(np.sum(dt)))
            self.information *= keep
            self.moment *= keep
        flat = H.reshape(-1, H.shape[-1])
        weighted = flat * np.repeat(weight, H.shape[1])[:, None]
        self.information += weighted.T @ flat
        self.moment += weighted.T @ z.ravel()

    @property
    def estimate(self) -> np.ndarray:
        """(P,) present estimate."""
        scale = np.sqrt(np.diag(self.information))
        scaled = self.information / np.outer(scale, scale)
        return np.linalg.solve(scaled, self.moment / scale) / scale


def sample_times(regression: Regression) -> np.ndarray:
    """(N,) s, the time each row of a regression stands for."""
    step = np.diff(regression.time, prepend=2 * regression.time[0] - regression.time[1])
    inside = np.diff(regression.piece, prepend=regression.piece[0]) == 0
    return np.where(inside, step, np.median(step))


def history(
    regression: Regression, start: np.ndarray, uncertainty: np.ndarray, points: int = 400
) -> tuple[np.ndarray, np.ndarray]:
    """Estimates while the log runs (paper Fig. 6).

    Returns:
        ``(time (K,) s, estimates (K, P))``; the last row is the recursive estimate of the log.
    """
    estimator = RecursiveLeastSquares(start, uncertainty)
    dt, count = sample_times(regression), len(regression.time)
    edges = np.unique(np.linspace(0, count, min(points, count) + 1).astype(int))
    estimates = []
    for a, b in itertools.pairwise(edges):
        estimator.update_many(regression.H[a:b], regression.y[a:b], dt[a:b])
        estimates.append(estimator.estimate)
    return regression.time[edges[1:] - 1], np.array(estimates)
