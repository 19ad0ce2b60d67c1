"""Which model predicts best, and whether the others are worse by more than chance."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np

from ident.comparison.result import Comparison
from ident.comparison.shares import DRAWS
from ident.comparison.stretches import LEAST_WINDOWS, window_errors


@dataclass(frozen=True)
class Standing:
    """One model beside the best.

    Attributes:
        comparison: the model against the log.
        ratio: its free-run error over that of the best model.
        ci95: interval of the ratio from windows drawn for both alike; None where the log has too
            few, and for the best itself.
    """

    comparison: Comparison
    ratio: float
    ci95: tuple[float, float] | None

    @property
    def worse(self) -> bool:
        """Whether it is worse than the best by more than chance."""
        return self.ci95 is not None and self.ci95[0] > 1.0

    def as_dict(self) -> dict[str, Any]:
        """Return what JSON shows."""
        return {
            "model": self.comparison.model.name,
            "nrmse": self.comparison.run.nrmse,
            "times_the_best": self.ratio,
            "ci95": None if self.ci95 is None else list(self.ci95),
            "worse": self.worse,
        }


def rank(found: list[Comparison], seed: int = 0) -> list[Standing]:
    """Order comparisons with one log by free-run error, the best first.

    A run that grows without bound comes last.
    """
    ordered = sorted(found, key=lambda c: (not np.isfinite(c.run.nrmse), c.run.nrmse))
    best = window_errors(ordered[0].run)
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(1,)))
    drawn = rng.integers(0, len(best), (DRAWS, len(best)))
    standings = []
    for comparison in ordered:
        ratio, span = comparison.run.nrmse / ordered[0].run.nrmse, None
        other = window_errors(comparison.run)
        if comparison is not ordered[0] and len(best) >= LEAST_WINDOWS and np.isfinite(ratio):
            ratios = np.sqrt(other[drawn].mean(axis=1) / best[drawn].mean(axis=1))
            span = tuple(float(q) for q in np.quantile(ratios, [0.025, 0.975]))
        standings.append(Standing(comparison, float(ratio), span))
    return standings
