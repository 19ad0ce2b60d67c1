"""Estimation within the directions that the logs see; along the others the prior is kept.

A direction without a trace is not estimated: noise in the columns would make numbers of it, with
small standard errors and no meaning.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import orth

from ident.estimators import Estimate
from ident.observability import SMALL, Observability, coordinate_factors, parameter_sizes
from ident.regression import Regression
from youbot_env.model import Model

ROUNDING = 1e-6


@dataclass(frozen=True)
class Seen:
    """The affine space ``start + basis @ b`` in which an estimate is looked for.

    Attributes:
        names: (P,) of the regression's parameters.
        start: (P,) prior values.
        sizes: (P,) what one unit of each coordinate is worth.
        basis: (P, k) directions that are seen.
        null: (P - k, P) directions that are not.
        held: names of parameters that are held at a bound.
    """

    names: tuple[str, ...]
    start: np.ndarray
    sizes: np.ndarray
    basis: np.ndarray
    null: np.ndarray
    held: tuple[str, ...] = ()

    @classmethod
    def of(
        cls, observability: Observability, regression: Regression, start: np.ndarray, model: Model
    ) -> Seen:
        """Take the directions from an analysis of the regression; model gives the sizes."""
        names = regression.names
        scale = coordinate_factors(names, model)
        sizes, null = parameter_sizes(names, model), observability.null / scale
        free = np.eye(len(names))
        if regression.allowed is not None:
            free = orth(regression.allowed / sizes[:, None])
        # Null directions that are not allowed anyway leave rounding only.
        blind = null / sizes
        blind /= np.linalg.norm(blind, axis=1, keepdims=True)
        _, strength, right = np.linalg.svd(blind @ free)
        seen = free @ right[np.count_nonzero(strength > ROUNDING) :].T
        return cls(names, start, sizes, sizes[:, None] * seen, null)

    def reduce(self, regression: Regression) -> Regression:
        """Rows whose unknowns are the coordinates b."""
        y = regression.y - regression.H @ self.start
        names = tuple(f"b{k}" for k in range(self.basis.shape[1]))
        return replace(regression, names=names, H=regression.H @ self.basis, y=y, allowed=None)

    def restore(self, estimate: Estimate) -> Estimate:
        """Turn an estimate of b into one of the parameters."""
        return replace(
            estimate,
            names=self.names,
            values=self.start + self.basis @ estimate.values,
            covariance=self.basis @ estimate.covariance @ self.basis.T,
            undetermined=orth((self.null / self.sizes).T) if len(self.null) else self.null.T,
            scale=1.0 / self.sizes,
        )

    def determines(self, weights: np.ndarray) -> bool:
        """Whether the logs alone fix ``weights @ parameters`` (P,)."""
        moved = np.abs(self.null @ weights)
        return bool(np.all(moved <= SMALL * np.abs(self.null * weights).sum(axis=1)))
