"""Figures over paired robots, each with a bootstrap interval.

A robot is the unit that is drawn again: its runs with different controllers and models share
reference, noise and robot, and stay together.
"""

from __future__ import annotations

import warnings
from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from scipy import stats

RESAMPLES = 2000
LEVEL = 0.95


class Figure(NamedTuple):
    """A figure and its 95 % interval.

    Attributes:
        value: over all robots.
        low, high: ends of the interval; nan for a single robot.
        robots: how many it rests on.
    """

    value: float
    low: float
    high: float
    robots: int

    def as_dict(self) -> dict:
        """Return what JSON shows."""
        return {"value": self.value, "ci95": [self.low, self.high], "robots": self.robots}


def mean(errors) -> Figure:
    """Mean over robots (R,)."""
    return bootstrap(lambda e, axis=-1: np.mean(e, axis=axis), errors)


def ratio(worse, better) -> Figure:
    """How many times smaller ``better`` is: ratio of the means over robots, both (R,)."""
    return bootstrap(_ratio, worse, better)


def gap_closed(nominal, identified, oracle) -> Figure:
    """Share of the way from the nominal model to the true one, of errors (R,) each.

        (mean nominal - mean identified) / (mean nominal - mean oracle)

    Above 1 the identified model tracks better than the oracle.  Where nominal and true model are
    equally good there is no gap, and the share means nothing: look at its interval.
    """
    return bootstrap(_gap, nominal, identified, oracle)


def _ratio(worse, better, axis=-1):
    return np.mean(worse, axis=axis) / np.mean(better, axis=axis)


def _gap(nominal, identified, oracle, axis=-1):
    whole = np.mean(np.subtract(nominal, oracle), axis=axis)
    return np.mean(np.subtract(nominal, identified), axis=axis) / whole


def bootstrap(statistic: Callable, *samples) -> Figure:
    """Bias-corrected accelerated bootstrap over robots; samples (R,) are paired.

    The draws are the same for every figure, so equal runs give equal intervals.
    """
    samples = tuple(np.asarray(sample, float) for sample in samples)
    value, count = float(statistic(*samples)), len(samples[0])
    if count < 2:
        return Figure(value, np.nan, np.nan, count)
    for method in ("BCa", "percentile"):
        # Where every robot gives the same figure the acceleration is 0/0; nothing is skewed then.
        with np.errstate(divide="ignore", invalid="ignore"), warnings.catch_warnings():
            warnings.simplefilter("ignore", stats.DegenerateDataWarning)
            found = stats.bootstrap(
                samples, statistic, paired=True, vectorized=True, confidence_level=LEVEL,
                n_resamples=RESAMPLES, method=method, rng=np.random.default_rng(0),
            ).confidence_interval  # fmt: skip
        if np.isfinite([found.low, found.high]).all():
            break
    return Figure(value, float(found.low), float(found.high), count)
