"""How a result looks in a console and a notebook: a sentence, a table, a figure."""

from __future__ import annotations

import html
from typing import Any

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
    """Columns of quantities (``ident.quantities.Quantity``) by name."""
    ends = [q.ci95 or (None, None) for q in quantities.values()]
    return {
        "name": list(quantities),
        "value": [float(q.value) for q in quantities.values()],
        "low": [None if low is None else float(low) for low, _ in ends],
        "high": [None if high is None else float(high) for _, high in ends],
        "unit": [q.unit for q in quantities.values()],
        "source": [q.source for q in quantities.values()],
    }
