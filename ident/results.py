"""What results share: numbers with their uncertainty, and how consoles and notebooks show them."""

from __future__ import annotations

import html
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ident.consistency import decode, lump_weights
from ident.identifiability import Seen
from ident.log import Log
from youbot_env.model import Model
from youbot_env.parameters import UNITS

# Where a value the logs do not determine comes from.
UNSEEN = "rests on the prior model"
# Where a value comes from that would be impossible, as far as the logs determine it.
AT_BOUND = "held at the bound of what is possible"
# Logs of which all names are told.
MOST_NAMES = 4


@dataclass(frozen=True)
class Quantity:
    """A number with its uncertainty.

    Attributes:
        value, unit: as printed.
        se: standard error; ci95: 95 % interval; None where the log says nothing.
        source: estimator that gave it.
    """

    value: float
    unit: str
    se: float | None
    ci95: tuple[float, float] | None
    source: str

    def as_dict(self) -> dict[str, Any]:
        """Return what JSON shows."""
        interval = list(self.ci95) if self.ci95 else None
        return {"value": self.value, "unit": self.unit, "se": self.se, "ci95": interval}


def quantities(
    model: Model, seen: Seen, factor: float, source: str
) -> tuple[dict[str, Quantity], dict[str, Quantity], dict[str, dict[str, Quantity]]]:
    """Parameters, lumps and parameters of effects of an identified model.

    Args:
        model: with values and covariance.
        seen: what the logs determine.
        factor: half width of an interval in standard errors.
        source: estimator the model was taken from.
    """
    names, values, covariance = model.names(), model.values(), np.array(model.covariance)
    at = [names.index(name) for name in seen.names]

    def quantity(value: float, weights: np.ndarray, unit: str) -> Quantity:
        if all(names[k] in seen.held for k in np.flatnonzero(weights)):
            return Quantity(float(value), unit, None, None, AT_BOUND)
        se = float(np.sqrt(max(weights @ covariance @ weights, 0.0)))
        if se == 0.0 or not (np.isfinite(se) and seen.determines(weights[at])):
            return Quantity(float(value), unit, None, None, UNSEEN)
        return Quantity(float(value), unit, se, (value - factor * se, value + factor * se), source)

    parameters = {
        name: quantity(value, gradient, UNITS[name])
        for name, (value, gradient) in decode(model).items()
    }
    lumped = {
        lump: quantity(float(weights @ np.array(values)), weights, unit)
        for lump, (weights, unit) in lump_weights(model).items()
    }
    extra: dict[str, dict[str, Quantity]] = {}
    for k, name in enumerate(names[7:], start=7):
        identifier, flat = name.split(".")
        effect = next(a.effect for a in model.effects if a.identifier == identifier)
        weights = np.eye(len(names))[k]
        unit = effect.parameter_of(flat).unit
        extra.setdefault(identifier, {})[flat] = quantity(values[k], weights, unit)
    return parameters, lumped, extra


def listed_names(logs: Sequence[Log]) -> str:
    """Names of logs in words; of many the first, and how many more."""
    if len(logs) > MOST_NAMES:
        return f"{logs[0].name} and {len(logs) - 1} more"
    return " + ".join(log.name for log in logs)


def annotated(model: Model, parameters: dict[str, Quantity], method: str, logs: list[Log]) -> Model:
    """The model with where its parameters come from, their errors, and what it rests on."""
    used = listed_names(logs)
    return replace(
        model,
        sources={
            name: q.source if q.se is None else f"{q.source}, {used}"
            for name, q in parameters.items()
        },
        standard_errors={name: q.se for name, q in parameters.items() if q.se is not None},
        provenance={
            "logs": [{"name": log.name, "sha256": log.digest} for log in logs],
            "method": method,
        },
    )


MOST_ROWS = 24


class Shown:
    """What all results have in common.

    A result says ``headline`` and ``table``, writes itself by ``as_dict``, and draws itself by
    ``plot``; nothing of it computes.
    """

    def headline(self) -> str:
        """The result in a sentence."""
        raise NotImplementedError

    def table(self) -> dict[str, list[Any]]:
        """Columns by heading, all equally long; numbers as numbers, None where there is none."""
        raise NotImplementedError

    def as_dict(self) -> dict[str, Any]:
        """What the script of the same name writes as JSON."""
        raise NotImplementedError

    def plot(self):
        """Draw the result.

        Returns:
            matplotlib.figure.Figure: notebooks show it; ``savefig`` writes it.
        """
        raise NotImplementedError

    def to_dict(self) -> dict[str, Any]:
        """The same as ``as_dict``."""
        return self.as_dict()

    def to_polars(self):
        """``table`` as a ``polars.DataFrame``."""
        import polars

        return polars.DataFrame(self.table(), strict=False)

    def to_pandas(self):
        """``table`` as a ``pandas.DataFrame``.

        Raises:
            ImportError: pandas is not installed.
        """
        try:
            import pandas
        except ImportError as error:
            raise ImportError(
                "to_pandas needs pandas, which this project does not: pip install pandas, or use "
                "to_polars()"
            ) from error
        return pandas.DataFrame(self.table())

    def __repr__(self) -> str:
        head, rows, more = self._texts()
        widths = [max(map(len, column)) for column in zip(head, *rows, strict=True)]
        lines = [
            "  ".join(cell.ljust(width) for cell, width in zip(row, widths, strict=True)).rstrip()
            for row in (head, *rows)
        ]
        return "\n".join([f"{type(self).__name__}: {self.headline()}", *lines, *more])

    def _repr_html_(self) -> str:
        head, rows, more = self._texts()

        def row(cells: list[str], kind: str) -> str:
            return "".join(f"<{kind}>{html.escape(cell)}</{kind}>" for cell in cells)

        body = "".join(f"<tr>{row(cells, 'td')}</tr>" for cells in rows)
        return (
            f"<p><b>{type(self).__name__}</b>: {html.escape(self.headline())}</p>"
            f"<table><thead><tr>{row(head, 'th')}</tr></thead><tbody>{body}</tbody></table>"
            + "".join(f"<p>{html.escape(line)}</p>" for line in more)
        )

    def _texts(self) -> tuple[list[str], list[list[str]], list[str]]:
        """Headings, rows, and how many rows are left out."""
        columns = self.table()
        rows = [[_text(cell) for cell in row] for row in zip(*columns.values(), strict=True)]
        left = len(rows) - MOST_ROWS
        return list(columns), rows[:MOST_ROWS], [f"... {left} more"] * (left > 0)


def _text(cell: Any) -> str:
    if cell is None:
        return ""
    return f"{cell:.4g}" if isinstance(cell, float) else str(cell)


def quantity_columns(quantities: dict[str, Any]) -> dict[str, list[Any]]:
    """Columns of quantities (``ident.results.Quantity``) by name."""
    ends = [q.ci95 or (None, None) for q in quantities.values()]
    return {
        "name": list(quantities),
        "value": [float(q.value) for q in quantities.values()],
        "low": [None if low is None else float(low) for low, _ in ends],
        "high": [None if high is None else float(high) for _, high in ends],
        "unit": [q.unit for q in quantities.values()],
        "source": [q.source for q in quantities.values()],
    }
