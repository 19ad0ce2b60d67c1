"""The runs of a comparison as one table, and the figures one asks of it."""

from __future__ import annotations

from collections.abc import Sequence
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
        return ratio(self.robots(metric, **worse, **which), self.robots(metric, **better, **which))

    def gap_closed(self, metric: str, controller: str, model: str, **which) -> Figure:
        """Share of the way from nominal to oracle that a model goes, for one controller."""
        errors = [
            self.robots(metric, controller=controller, model=name, **which)
            for name in (NOMINAL, model, ORACLE)
        ]
        return gap_closed(*errors)
