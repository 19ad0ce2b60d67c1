"""The runs of a comparison as one table, and the figures one asks of it."""

from __future__ import annotations

import math
from collections.abc import Callable, Sequence
from dataclasses import asdict

import numpy as np
import polars as pl

from controllers.evaluation.run import Run
from controllers.evaluation.statistics import Figure, gap_closed, mean, ratio
from controllers.evaluation.subjects import NOMINAL, ORACLE

ERRORS = ("position", "heading", "velocity", "yaw_rate")


class Results:
    """All runs.

    Attributes:
        table: one row a run, columns as the fields of ``Run``.
    """

    def __init__(self, runs: Sequence[Run]):
        table = pl.DataFrame([asdict(run) for run in runs], infer_schema_length=None)
        self.table = table.sort("plant", "controller", "model", "reference", "frequency", "robot")

    def of(self, column: str) -> list:
        """Different values of a column, sorted."""
        return self.table[column].unique().sort().to_list()

    def robots(self, metric: str, **which) -> np.ndarray:
        """A figure of each robot (R,), mean over its motions.

        Args:
            metric: a column of the table.
            **which: a value, or a list of them, of other columns.
        """
        wanted = [
            pl.col(name).is_in(list(value) if isinstance(value, list | tuple) else [value])
            for name, value in which.items()
        ]
        chosen = self.table.filter(wanted).group_by("robot").agg(pl.col(metric).mean())
        return chosen.sort("robot")[metric].to_numpy()

    def mean(self, metric: str, **which) -> Figure:
        """Mean over robots."""
        return mean(self.robots(metric, **which))

    def ratio(self, metric: str, worse: dict, better: dict, **which) -> Figure:
        """How many times smaller a metric is with one choice than with another."""
        return _paired(ratio, [self.robots(metric, **one, **which) for one in (worse, better)])

    def gap_closed(self, metric: str, controller: str, model: str, **which) -> Figure:
        """Share of the way from nominal to oracle that a model goes, for one controller."""
        which |= {"controller": controller}
        models = (NOMINAL, model, ORACLE)
        return _paired(gap_closed, [self.robots(metric, model=name, **which) for name in models])


def _paired(statistic: Callable[..., Figure], errors: list[np.ndarray]) -> Figure:
    """The figure, or nan where a run to compare with is missing."""
    if len(errors[0]) and len({len(one) for one in errors}) == 1:
        return statistic(*errors)
    return Figure(math.nan, math.nan, math.nan, 0)
