"""Least squares on inner products, after the columns that are always fitted have been removed."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

# Directions weaker than this, in columns of unit length, are left alone.
WEAK = 1e-6


@dataclass(frozen=True, eq=False)
class Reduced:
    """Inner products, less what the base columns explain, of a fit and of what it is judged on.

    Attributes:
        fit, judge: (n - base, n - base), the error last; base coefficients come from the fit.
        share: (base, n - base) base coefficients.
    """

    fit: np.ndarray
    judge: np.ndarray
    share: np.ndarray

    @classmethod
    def of(cls, fit: np.ndarray, judge: np.ndarray, base: int) -> Reduced:
        """Take the first ``base`` columns out of two tables (n, n), as the first one fits them."""
        share = _pseudo_inverse(fit[:base, :base]) @ fit[:base, base:]
        left = fit[base:, base:] - fit[base:, :base] @ share
        cross = judge[base:, :base] @ share
        inner = share.T @ judge[:base, :base] @ share
        return cls(left, judge[base:, base:] - cross - cross.T + inner, share)

    def beyond(self, mine: np.ndarray) -> Reduced:
        """The same with further columns that are always fitted."""
        share = self.inverse(mine) @ self.fit[mine]
        left = self.fit - self.fit[:, mine] @ share
        cross = self.judge[:, mine] @ share
        inner = share.T @ self.judge[np.ix_(mine, mine)] @ share
        return Reduced(left, self.judge - cross - cross.T + inner, self.share)

    @property
    def before(self) -> float:
        """Squared error without any effect."""
        return float(self.judge[-1, -1])

    def inverse(self, mine: np.ndarray, ridge: float = 0.0) -> np.ndarray:
        """(k, k) inverse of the fitted inner products of columns (k,), counted behind the base."""
        inner = self.fit[np.ix_(mine, mine)]
        return _pseudo_inverse(inner + ridge * np.eye(len(mine)))

    def solve(self, mine: np.ndarray, ridge: float = 0.0, ends=(-np.inf, np.inf)) -> np.ndarray:
        """(k,) coefficients, held between two ends."""
        return np.clip(self.inverse(mine, ridge) @ self.fit[mine, -1], *ends)

    def loss(self, mine: np.ndarray, ridge: float = 0.0, ends=(-np.inf, np.inf)) -> float:
        """Squared error that is judged, with the coefficients that were fitted."""
        b = self.solve(mine, ridge, ends)
        inner = self.judge[np.ix_(mine, mine)]
        return float(self.judge[-1, -1] - 2 * b @ self.judge[mine, -1] + b @ inner @ b)


def _pseudo_inverse(inner: np.ndarray) -> np.ndarray:
    """Inverse in the directions that are seen; columns had unit length over all windows."""
    strength, turn = np.linalg.eigh(0.5 * (inner + inner.T))
    strong = strength > WEAK
    return (turn[:, strong] / strength[strong]) @ turn[:, strong].T
