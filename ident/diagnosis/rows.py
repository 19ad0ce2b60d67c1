"""Rows of the table of evidence: averaged samples, independent stretches, scores."""

from __future__ import annotations

import numpy as np

from ident.residuals import settled
from ident.sensitivity import Linearised

# Averages over samples bring the rows to about this rate, Hz, faster than the robot can answer.
RATE = 25.0
# Stretches of about this length, s, longer than the robot remembers, are taken as independent.
STRETCH = 0.8


def stretches(rows: np.ndarray, sim: Linearised) -> np.ndarray:
    """Rows (W, l, m, n) of windows as rows (stretches, r, n)."""
    windows, length, _, count = rows.shape
    parts = max(1, round(length * samples_a_row(sim) * sim.log.dt / STRETCH))
    length -= length % parts
    return rows[:, :length].reshape(windows * parts, -1, count)


def samples_a_row(sim: Linearised) -> int:
    """Samples that are averaged to one row."""
    return max(1, round(1.0 / (RATE * sim.log.dt)))


def score(rows: np.ndarray, share: np.ndarray, base: int) -> np.ndarray:
    """(stretches, n - base - 1) inner products of columns and errors, less what the base takes."""
    left = rows[..., base:] - rows[..., :base] @ share
    return np.einsum("srk,sr->sk", left[..., :-1], left[..., -1], optimize=True)


def summed(scores: np.ndarray, together: np.ndarray) -> np.ndarray:
    """Scores (stretches, k) summed over what goes together, by ascending numbers (stretches,)."""
    first = np.flatnonzero(np.diff(together, prepend=-1))
    return np.add.reduceat(scores, first, axis=0)


def averaged(sim: Linearised, rows: np.ndarray) -> np.ndarray:
    """Settled samples (W, L, m, n) averaged to about RATE, as rows (W, l, m, n)."""
    rows = settled(sim, rows)
    together = samples_a_row(sim)
    count = rows.shape[1] // together
    rows = rows[:, : count * together].reshape(len(rows), count, together, *rows.shape[2:])
    # A mean over k samples of white noise has k times less variance: each row stands for k.
    rows = rows.mean(axis=2) * np.sqrt(together)
    return np.nan_to_num(rows)
