"""Time of a table that has no column ``time``: two columns of seconds and nanoseconds, or a stamp.

Names as ``rostopic echo -p``, PlotJuggler and drivers write them.
"""

from __future__ import annotations

import re

import numpy as np
import polars as pl

from ident.loaders.base import Table

# Words for the whole and the fractional part of a stamp.
SECONDS, NANOSECONDS = ("sec", "secs", "seconds", "s"), ("nanosec", "nsec", "nsecs", "nanoseconds")
# Columns that are a time of their own, the stamp of a message before the time of its arrival.
STAMPS = ("header_stamp", "stamp", "timestamp", "time_stamp", "__time", "%time", "t", "time")
# Units that may stand behind such a name.
ENDS = {"": "", "_s": "s", "_ms": "ms", "_us": "us", "_ns": "ns", "_sec": "s"}
BILLION = 1e-9


def find_time(table: Table) -> None:
    """Give a table its time, where it has none under that name."""
    plain = {_plain(name): name for name in reversed(table.columns)}
    if "time" in plain:
        _from_dates(table, plain["time"])
        return
    for name, column in plain.items():
        stem, word = _ends_with(name, SECONDS)
        if not word:
            continue
        others = (n for n in plain if _ends_with(n, NANOSECONDS)[1] and n.startswith(stem))
        other = next((n for n in others if _ends_with(n, NANOSECONDS)[0] == stem), None)
        if other is None:
            continue
        whole, part = _floats(table.columns[column]), _floats(table.columns[plain[other]])
        if whole is not None and part is not None:
            table.columns["time"] = whole + BILLION * part
            table.tell(
                f"time is in {column} and {plain[other]}", "header", "put together as seconds"
            )
            return
    for name, unit in ((f"{word}{end}", unit) for word in STAMPS for end, unit in ENDS.items()):
        if name not in plain:
            continue
        _from_dates(table, plain[name])
        if _floats(table.columns[plain[name]]) is not None:
            table.names.setdefault("time", plain[name])
            if unit:
                table.units.setdefault(plain[name], unit)
            return


def _from_dates(table: Table, column: str) -> None:
    """Turn a column of dates with the time of day into seconds."""
    cells = table.columns[column]
    if not isinstance(cells, pl.Series) or cells.dtype != pl.String or _floats(cells) is not None:
        return
    try:
        dates = cells.str.strip_chars(" \"'").str.to_datetime(time_unit="ns", strict=False)
    except pl.exceptions.PolarsError:
        return
    if dates.null_count() < 0.1 * len(dates):
        seconds = (dates - dates.drop_nulls()[0]).dt.total_nanoseconds().cast(pl.Float64) * BILLION
        table.columns[column] = seconds
        table.tell("dates with the time of day", f"column {column}", "turned into s from the first")


def _plain(name: str) -> str:
    """Small letters and underscores, without unit and the ``field.`` of rostopic."""
    name = re.sub(r"\s*[\[(][^\])]*[\])]$", "", name.strip().lower())
    return re.sub(r"[\s./\-]+", "_", name).removeprefix("field_")


def _ends_with(name: str, words: tuple[str, ...]) -> tuple[str, str]:
    """Stem and last word of a name that ends with one of some words; empty otherwise."""
    stem, _, word = name.rpartition("_")
    return (stem, word) if word in words else ("", "")


def _floats(column) -> np.ndarray | None:
    """Numbers of a column that can be a time; None where it is text or stands still at 0."""
    if isinstance(column, pl.Series):
        column = column.cast(pl.Float64, strict=False).fill_null(np.nan).to_numpy()
    values = np.asarray(column, float)
    finite = values[np.isfinite(values)]
    return values if len(finite) > 0.5 * len(values) and np.any(finite != 0) else None
