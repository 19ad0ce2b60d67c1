"""Uncertainty of a fit from leaving out one window after the other."""

from __future__ import annotations

import itertools

import numpy as np
from scipy.special import stdtrit

# Directions weaker than this share of the strongest are left alone.
WEAK = 1e-10
# Degrees of freedom that are believed in, at least.
FEWEST = 2.0


def left_one_out(
    columns: np.ndarray, error: np.ndarray, groups: np.ndarray, basis: np.ndarray
) -> np.ndarray:
    """(P, P) covariance of values from linear fits that leave out one window each (CR3).

    With few windows for many values the plain sandwich is too small: errors of a fit hide in the
    windows that pull it most.  Values that a part of the windows carries have as few degrees of
    freedom as those (Bell and McCaffrey 2002, for equal errors); their standard errors are enlarged
    so that Student's t with windows - 1 of them is right for all.

    Args:
        columns: (N, K) derivatives of the fit.
        error: (N,) what it leaves.
        groups: (N,) number of the window of each row, ascending.
        basis: (P, K) what a column moves.
    """
    scale = np.linalg.norm(columns, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    scaled, count = columns / scale, int(groups[-1]) + 1
    ends = np.searchsorted(groups, np.arange(count + 1))
    inner, scores, turn = scaled.T @ scaled, scaled.T @ error, basis / scale
    pull = _inverse(inner) @ turn.T
    moves, carried = np.zeros((count, len(scale))), np.zeros((count, len(basis)))
    for k, (start, end) in enumerate(itertools.pairwise(ends)):
        mine, left = scaled[start:end], error[start:end]
        moves[k] = _inverse(inner - mine.T @ mine) @ (scores - mine.T @ left)
        carried[k] = np.sum((mine @ pull) ** 2, axis=0)
    moves -= moves.mean(axis=0)
    wide = _enlarged(carried)
    return turn @ (moves.T @ moves * (count - 1) / count) @ turn.T * np.outer(wide, wide)


def _inverse(inner: np.ndarray) -> np.ndarray:
    return np.linalg.pinv(inner, rcond=WEAK, hermitian=True)


def _enlarged(carried: np.ndarray) -> np.ndarray:
    """(P,) quantiles of Student's t by those with as many degrees as windows less one.

    Args:
        carried: (W, P) variance of each value that comes from each window.
    """
    total = carried.sum(axis=0)
    known = total > 0
    freedom = np.full(len(total), len(carried) - 1.0)
    freedom[known] = total[known] ** 2 / np.sum(carried[:, known] ** 2, axis=0)
    freedom = np.clip(freedom, FEWEST, max(len(carried) - 1.0, FEWEST))
    return stdtrit(freedom, 0.975) / stdtrit(max(len(carried) - 1.0, FEWEST), 0.975)
