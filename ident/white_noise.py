"""The white part of a measured signal, from its second differences."""

from __future__ import annotations

import numpy as np

from ident.log import Log

# White noise becomes this much larger in second differences: 1 + 4 + 1.
AMPLIFIED = 6.0
# Median of |x| of a normal variable in standard deviations.
MEDIAN = 0.6745


def second_differences(log: Log, signal: np.ndarray) -> np.ndarray:
    """(N', k) second differences of a signal (N, k) inside the contiguous pieces of a log."""
    return np.concatenate([np.diff(signal[a:b], 2, axis=0) for a, b in log.spans])


def spread(values: np.ndarray) -> np.ndarray:
    """(...) standard deviations of normal values (N, ...), robust against steps."""
    return np.median(np.abs(values), axis=0) / MEDIAN


def white_variance(log: Log, signal: np.ndarray) -> np.ndarray:
    """(k,) variances of the white part of a signal (N, k)."""
    return spread(second_differences(log, signal)) ** 2 / AMPLIFIED
