"""Quantiles and probabilities of Student's, Fisher's and the normal distribution, and rank tests.

The same as in ``scipy.stats``, which takes longer to import than a log to identify.
"""

from __future__ import annotations

import numpy as np
from scipy.special import fdtrc, stdtr, stdtrit


def student_quantile(p: float, freedom: float | np.ndarray) -> float | np.ndarray:
    """Value below which a share ``p`` of Student's distribution lies; ``stats.t.ppf``."""
    return stdtrit(freedom, p)


def student_above(value, freedom: float | np.ndarray) -> float | np.ndarray:
    """Probability that Student's variable exceeds a value; ``stats.t.sf``."""
    return stdtr(freedom, -value)


def fisher_above(ratio, over: float, under: float) -> float | np.ndarray:
    """Probability that Fisher's ratio exceeds a value; ``stats.f.sf``.

    Args:
        ratio: of two variances.
        over, under: degrees of freedom of the one above and the one below.
    """
    # What rounding makes of a ratio of 0 is exceeded surely.
    return fdtrc(over, under, np.maximum(ratio, 0.0))


def false_discoveries(chances, dependent: bool = False) -> np.ndarray:
    """Probabilities (n,) adjusted so that a limit on them bounds the share of false discoveries.

    Args:
        chances: (n,) of each discovery if nothing were there.
        dependent: Benjamini and Yekutieli's rule, for chances that depend on one another in any
            way; else Benjamini and Hochberg's.
    """
    chances = np.asarray(chances, float)
    count = len(chances)
    order, rank = np.argsort(chances), np.arange(1, count + 1)
    adjusted = chances[order] * (count / rank)
    if dependent:
        adjusted = adjusted * np.sum(1 / rank)
    result = np.empty(count)
    result[order] = np.minimum.accumulate(adjusted[::-1])[::-1]
    return np.clip(result, 0.0, 1.0)


def rank_correlation_chance(a: np.ndarray, b: np.ndarray) -> float:
    """Probability of Spearman's correlation of two samples (n,), n > 2, if they had none.

    NaN where one of them is constant: it has no order.
    """
    first, second = (ranks(x) for x in (a, b))
    spread = first.std() * second.std()
    if spread == 0.0:
        return float("nan")
    found = np.corrcoef(first, second)[0, 1]
    freedom = len(first) - 2
    # Rounding may leave a correlation beyond 1; that of the same order is as sure as can be.
    left = max((1.0 - found) * (1.0 + found), 0.0)
    value = abs(found) * np.sqrt(freedom / left) if left else np.inf
    return float(2.0 * student_above(value, freedom))


def ranks(values: np.ndarray) -> np.ndarray:
    """Ranks (n,) of values from 1 on; equal ones share the mean of theirs."""
    _, place, count = np.unique(values, return_inverse=True, return_counts=True)
    return (np.cumsum(count) - (count - 1) / 2)[place]
