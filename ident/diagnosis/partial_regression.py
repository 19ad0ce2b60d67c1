"""Partial regression: least squares beside columns always fitted, and its p values."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.diagnosis.settings import SETTINGS
from ident.distributions import false_discoveries, fisher_above


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
    strong = strength > SETTINGS.weak_column
    return (turn[:, strong] / strength[strong]) @ turn[:, strong].T


def wild_p_values(
    scores: list[np.ndarray], families: np.ndarray, seed: int = 0
) -> tuple[np.ndarray, np.ndarray]:
    """P values of everything tried, by family and adjusted for all families with a name.

    Wild cluster bootstrap of the scores: signs of whole stretches are drawn anew, and the smallest
    p value that all forms of an effect reach in a draw is compared with that of each form.  It
    covers errors that are correlated within stretches, the forms, and profiles of parameters that
    only exist with the effect.  Over effects the rate of false discoveries is controlled
    (Benjamini-Hochberg): where nothing is hidden that is the rate of any false name.

    Args:
        scores: (stretches, k) inner products of columns and errors, of each thing tried.
        families: effect that each belongs to; what has no name is one family of its own.
        seed: of the draws.

    Returns:
        Within families, and adjusted.
    """
    rng = np.random.default_rng(seed)
    count = len(scores[0]) if scores else 0
    signs = rng.choice([-1.0, 1.0], (SETTINGS.wild_draws, count))
    single, drawn = np.ones(len(scores)), np.ones((len(scores), SETTINGS.wild_draws))
    for trial, mine in enumerate(scores):
        turn = _whitened(mine)
        freedom = turn.shape[1]
        if freedom == 0 or count < SETTINGS.clusters_each * freedom:
            continue
        white = mine @ turn
        both = np.concatenate([white.sum(axis=0)[None], signs @ white])
        squared = np.minimum((both**2).sum(axis=1), count * (1 - 1e-12))
        ratio = (count - freedom) / freedom * squared / (count - squared)
        p = fisher_above(ratio, freedom, count - freedom)
        single[trial], drawn[trial] = p[0], p[1:]
    within, best = np.ones(len(single)), {}
    for family in np.unique(families):
        mine = families == family
        rank = np.count_nonzero(drawn[mine].min(axis=0)[None] <= single[mine, None], axis=1)
        within[mine] = np.maximum(single[mine], (1 + rank) / (1 + SETTINGS.wild_draws))
        best[family] = within[mine].min()
    effects = [family for family in best if family]
    adjusted = within.copy()
    for k, family in enumerate(families):
        if family:
            rivals = [within[k] if other == family else best[other] for other in effects]
            adjusted[k] = false_discoveries(rivals)[effects.index(family)]
    return within, adjusted


def _whitened(scores: np.ndarray) -> np.ndarray:
    """(k, r) combinations of scores with unit scatter, leaving out those without any."""
    strength, turn = np.linalg.eigh(scores.T @ scores)
    strong = strength > 1e-9 * max(strength[-1], 1e-300)
    return turn[:, strong] / np.sqrt(strength[strong])
