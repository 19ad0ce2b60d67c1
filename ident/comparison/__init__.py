"""Models against a measurement: how large the error is, where it is, and when it is worst."""

from ident.comparison.beside import Beside, beside
from ident.comparison.result import Comparison, compare
from ident.comparison.shares import Regime
from ident.comparison.standing import Standing, rank

__all__ = ["Beside", "Comparison", "Regime", "Standing", "beside", "compare", "rank"]
