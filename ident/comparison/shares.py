"""How the squared error divides over regimes, with intervals, and where it gathers for sure.

Residuals are coloured, so everything random is taken from the scatter between stretches of time,
never from single rows.  Many regimes are looked at and they overlap, so those that are flagged are
chosen under control of the false discovery rate for any dependence (Benjamini-Yekutieli).  With
residuals that depend on nothing, 1 to 4 % of logs have a flagged regime.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ident.comparison.moments import Moments, wheel_torques
from ident.comparison.regimes import Slice, slices
from ident.distributions import false_discoveries, student_above
from ident.estimators import cluster_numbers
from ident.regression import Regression

# Stretches of time from whose scatter the intervals are taken, and how short they may be, s.
STRETCHES, SHORTEST = 24, 1.0
DRAWS = 1000
# Share of false ones among the flagged regimes.
FALSE_DISCOVERIES = 0.05
# A regime of less time, or seen in fewer stretches, says nothing.
LEAST_TIME, LEAST_STRETCHES = 0.02, 4


@dataclass(frozen=True)
class Regime:
    """A kind of moment, and its part in the squared equation error.

    Attributes:
        name: in words, e.g. ``a wheel near standstill``.
        kind: axis, wheel, speed, reversal, direction, heading, wheel angle, place, time, torque.
        of: the error it is a share of: ``all``, or ``wheel fl`` for regimes of that wheel.
        share_of_error, share_of_time: of the whole record; an axis or a wheel counts as one of so
            many components.
        ci95: interval of ``share_of_error`` from resampled stretches of time.
        excess_ci95: interval of ``excess``, the share of time drawn along with that of the error.
        p: of a share of error no larger than the share of time.
        p_adjusted: the same under control of the false discovery rate over all regimes.
    """

    name: str
    kind: str
    of: str
    share_of_error: float
    share_of_time: float
    ci95: tuple[float, float]
    excess_ci95: tuple[float, float]
    p: float
    p_adjusted: float = 1.0

    @property
    def excess(self) -> float:
        """How much more error than time: above one the error gathers here."""
        return self.share_of_error / self.share_of_time

    @property
    def flagged(self) -> bool:
        """Whether the error gathers here by more than chance, all regimes considered."""
        return self.p_adjusted < FALSE_DISCOVERIES

    def as_dict(self) -> dict[str, Any]:
        """Return what JSON shows."""
        return {
            "regime": self.name,
            "kind": self.kind,
            "of": self.of,
            "share_of_error": self.share_of_error,
            "share_of_time": self.share_of_time,
            "ci95": list(self.ci95),
            "excess": self.excess,
            "excess_ci95": list(self.excess_ci95),
            "p": self.p,
            "p_adjusted": self.p_adjusted,
            "significant": self.flagged,
        }


def stretch_numbers(regression: Regression) -> np.ndarray:
    """(N,) number of the stretch of time each row belongs to."""
    rows = np.median(np.diff(regression.time)) * len(regression.time)
    return cluster_numbers(regression, int(np.clip(rows / SHORTEST, LEAST_STRETCHES, STRETCHES)))


def locate(
    moments: Moments, regression: Regression, residual: np.ndarray, rng: np.random.Generator
) -> tuple[Regime, ...]:
    """Divide the squared residual (N, 3) over regimes; flagged ones first, then by excess."""
    divide = _Division(stretch_numbers(regression), rng)
    axes = residual**2
    wheels = wheel_torques(residual, moments.platform) ** 2
    found = []
    for part in slices(moments):
        regime = divide(part, axes, wheels, moments.platform.wheel_names)
        if regime is not None:
            found.append(regime)
    adjusted = false_discoveries([regime.p for regime in found], dependent=True)
    judged = [replace(r, p_adjusted=float(p)) for r, p in zip(found, adjusted, strict=True)]
    return tuple(sorted(judged, key=lambda regime: (not regime.flagged, -regime.excess)))


class _Division:
    """Shares of error and time from sums over stretches (S,), which are what is resampled."""

    def __init__(self, stretch: np.ndarray, rng: np.random.Generator):
        self._stretch, self._count = stretch, int(stretch.max()) + 1
        self._drawn = rng.integers(0, self._count, (DRAWS, self._count))
        self._rows = self._sums(np.ones(len(stretch)))

    def __call__(self, part: Slice, axes, wheels, names) -> Regime | None:
        """The regime, or None where the log shows too little of it."""
        of, whole, inside = "all", axes.sum(axis=1), axes.sum(axis=1)
        if part.axis is not None:
            inside = axes[:, part.axis]
        if part.wheel is not None:
            inside = wheels[:, part.wheel]
            whole = wheels.sum(axis=1) if part.mask is None else inside
            of = "all" if part.mask is None else f"wheel {names[part.wheel]}"
        if part.mask is None:
            time = self._rows / (axes if part.wheel is None else wheels).shape[1]
        else:
            inside, time = inside * part.mask, self._sums(part.mask.astype(float))
        share_of_time = float(time.sum() / self._rows.sum())
        present = np.count_nonzero(time)
        if not LEAST_TIME < share_of_time < 1 - LEAST_TIME or present < LEAST_STRETCHES:
            return None
        inside, whole = self._sums(inside), self._sums(whole)
        share = float(inside.sum() / whole.sum())
        drawn = inside[self._drawn].sum(axis=1) / whole[self._drawn].sum(axis=1)
        times = time[self._drawn].sum(axis=1) / self._rows[self._drawn].sum(axis=1)
        excess = np.divide(drawn, times, out=np.ones(DRAWS), where=times > 0)
        # What each stretch adds to the difference of the two shares, to first order.
        parts = (inside - share * whole) / whole.sum()
        parts = parts - (time - share_of_time * self._rows) / self._rows.sum()
        spread = np.sqrt(self._count / (self._count - 1) * np.sum(parts**2))
        p = float(student_above((share - share_of_time) / max(spread, 1e-300), self._count - 1))
        return Regime(
            part.name, part.kind, of, share, share_of_time, _middle(drawn), _middle(excess), p
        )

    def _sums(self, values: np.ndarray) -> np.ndarray:
        return np.bincount(self._stretch, values, self._count)


def _middle(drawn: np.ndarray) -> tuple[float, float]:
    """The middle 95 % of what was drawn."""
    low, high = np.quantile(drawn, [0.025, 0.975])
    return float(low), float(high)
