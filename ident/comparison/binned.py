"""Means of a residual over the values of a signal, with intervals from stretches of time."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.distributions import student_quantile

BINS = 20
# A bin seen in fewer stretches says nothing.
LEAST_STRETCHES = 4


@dataclass(frozen=True)
class Binned:
    """Means over B bins of a signal; NaN where the log says too little.

    Attributes:
        centre: (B,) middle of each bin.
        mean: (B,) mean of the residual there.
        half: (B,) half width of its 95 % interval.
    """

    centre: np.ndarray
    mean: np.ndarray
    half: np.ndarray


def bin_means(
    signal: np.ndarray,
    residual: np.ndarray,
    stretch: np.ndarray,
    span: tuple[float, float] | None = None,
    bins: int = BINS,
) -> Binned:
    """Average a residual over bins of equal width of a signal.

    Args:
        signal, residual: (N,).
        stretch: (N,) number of the stretch of time of each row.
        span: ends of the first and last bin; all but the outermost percent of the signal when None.
        bins: B.
    """
    low, high = np.percentile(signal, (1, 99)) if span is None else span
    edges = np.linspace(low, max(high, low + 1e-9), bins + 1)
    number = _numbers(signal, edges)
    inside = (number >= 0) & (number < bins)
    number, count = number[inside], int(stretch.max()) + 1
    cell = number * count + stretch[inside]

    def sums(values: np.ndarray) -> np.ndarray:
        return np.bincount(cell, values, bins * count).reshape(bins, count)

    rows = sums(np.ones(len(cell)))
    total, clusters = rows.sum(axis=1), np.count_nonzero(rows, axis=1)
    safe = np.maximum(total, 1)
    mean = sums(residual[inside]).sum(axis=1) / safe
    parts = sums(residual[inside] - mean[number]) / safe[:, None]
    spare = np.maximum(clusters - 1, 1)
    error = np.sqrt(clusters / spare * np.sum(parts**2, axis=1))
    half = student_quantile(0.975, spare) * error
    known = clusters >= min(LEAST_STRETCHES, count)
    return Binned(
        0.5 * (edges[1:] + edges[:-1]), np.where(known, mean, np.nan), np.where(known, half, np.nan)
    )


def cell_medians(
    x: np.ndarray, y: np.ndarray, residual: np.ndarray, bins: int, fewest: int
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Median residuals over cells of a plane.

    Args:
        x, y: (N,) coordinates.
        residual: (N, C).
        bins: B, cells along each side; they span all but the outermost percent of the rows.
        fewest: rows a cell must hold to say something.

    Returns:
        edges along x and y (B + 1,), and medians (B, B, C), first index along x, NaN where empty.
    """
    edges = [np.linspace(*np.percentile(v, (0.5, 99.5)), bins + 1) for v in (x, y)]
    i, j = (_numbers(v, e) for v, e in zip((x, y), edges, strict=True))
    inside = (i >= 0) & (i < bins) & (j >= 0) & (j < bins)
    cell, values = (i * bins + j)[inside], residual[inside]
    order = np.argsort(cell, kind="stable")
    cells, first = np.unique(cell[order], return_index=True)
    medians = np.full((bins * bins, residual.shape[1]), np.nan)
    for where, rows in zip(cells, np.split(values[order], first[1:]), strict=True):
        if len(rows) >= fewest:
            medians[where] = np.median(rows, axis=0)
    return *edges, medians.reshape(bins, bins, -1)


def _numbers(values: np.ndarray, edges: np.ndarray) -> np.ndarray:
    """Bin of each value; the last bin holds its upper edge, as in a histogram."""
    return np.digitize(values, edges) - 1 - (values == edges[-1])
