"""From columns of a file to channels of a log: names, aliases, signs and units in the names."""

from __future__ import annotations

import difflib
import re

import numpy as np
import polars as pl

from ident.doctor.finding import Finding, LogError
from ident.doctor.record import Record
from ident.doctor.table import Table
from youbot_env.channels import channel_columns
from youbot_env.platform import Platform

MISSING = ("", "nan", "na", "n/a", "null", "none", "-", "--", "?")
CORNERS = {"bl": "rl", "br": "rr"}
SCALES = {
    "rad/s": 1.0, "deg/s": np.pi / 180, "rpm": 2 * np.pi / 60, "rev/s": 2 * np.pi,
    "m": 1.0, "mm": 1e-3, "cm": 1e-2, "m/s": 1.0, "mm/s": 1e-3, "cm/s": 1e-2,
    "rad": 1.0, "deg": np.pi / 180, "s": 1.0, "ms": 1e-3, "us": 1e-6, "ns": 1e-9,
    "N m": 1.0, "Nm": 1.0, "N cm": 1e-2, "Ncm": 1e-2, "mN m": 1e-3, "mNm": 1e-3,
    "A": 1.0, "mA": 1e-3, "V": 1.0, "mV": 1e-3, "%": 1e-2,
}  # fmt: skip
DECORATED = re.compile(r"^(?P<minus>-?)\s*(?P<name>.*?)\s*(?:[\[(](?P<unit>[^\])]*)[\])])?$")


def examine_columns(
    table: Table, source: str, platform: Platform, mapping: dict[str, str] | None
) -> Record:
    """Find the columns of a log and turn their cells into numbers.

    Args:
        table: as the loader left it.
        source: file name.
        platform: gives the wheel names.
        mapping: ``{log name: column}``; a column may carry a minus and a unit in brackets, as in
            ``-left_front [rpm]``.

    Raises:
        LogError: no time, half a channel, a name twice, cells that are not numbers.
    """
    stated = {**table.names, **(mapping or {})}
    chosen = _choose(table, source, platform, stated)
    missing = [] if "time" in chosen else ["time"]
    record = Record(source, platform, np.empty(0), table.lines, table.unit_of_place)
    record.findings = list(table.findings)
    numbers = {}
    turned: dict[str, list[str]] = {}
    for name, (column, factor, unit) in chosen.items():
        numbers[name] = factor * _numbers(table.columns[column], column, record)
        if abs(factor) != 1:
            turned.setdefault(f"the unit is {unit}: turned into SI", []).append(column)
        if factor < 0:
            turned.setdefault("negated as the mapping asks", []).append(column)
    for what, columns in turned.items():
        record.fixed("units", what, "columns " + ", ".join(columns), "used like this")
    record.stop_on_error()
    if missing:
        names = list(table.columns)
        near = difflib.get_close_matches("time", [n.lower() for n in names], 1, 0.5)
        hint = f" (is it {near[0]!r}?)" if near else ""
        record.refuse(
            "columns",
            f"there is no column 'time'; the columns are {names[:40]}",
            "header",
            f"name it with --map time=COLUMN{hint}",
            final=True,
        )
        record.stop_on_error()
    record.time = numbers["time"]
    record.breaks = np.zeros(len(record.time), bool)
    for channel, names in channel_columns(platform).items():
        there = [name for name in names if name in numbers]
        if there and len(there) < len(names):
            absent = [name for name in names if name not in numbers]
            record.refuse(
                "columns",
                f"{there} without {absent}",
                "header",
                f"add the columns or name them with --map {absent[0]}=COLUMN",
                final=True,
            )
        elif there:
            record.channels[channel] = np.stack([numbers[name] for name in names], axis=1)
            record.columns[channel] = tuple(chosen[name][0] for name in names)
    record.stop_on_error()
    used = {column for column, _, _ in chosen.values()}
    # Inertial sensors are part of the format, though nothing reads them yet.
    unknown = [c for c in table.columns if c not in used and not c.lower().startswith("imu_")]
    if unknown:
        listed = ", ".join(unknown[:30]) + (", ..." if len(unknown) > 30 else "")
        record.fixed("columns", f"{len(unknown)} unknown columns: {listed}", "header", "ignored")
    return record


def _choose(
    table: Table, source: str, platform: Platform, stated: dict[str, str]
) -> dict[str, tuple[str, float, str]]:
    """Return ``{log name: (column, factor to SI, unit)}``."""
    known = {name for names in channel_columns(platform).values() for name in names} | {"time"}
    for name, text in stated.items():
        if name not in known:
            near = difflib.get_close_matches(name, known, 1)
            hint = f"did you mean {near[0]!r}? " if near else ""
            raise _error(source, f"{name!r} is no name of a log", f"{hint}known: {sorted(known)}")
        if text not in table.columns and _decorated(text)[0] not in table.columns:
            raise _error(
                source,
                f"the mapping {name}={text} names no column",
                f"the columns are {list(table.columns)[:40]}",
            )
    chosen = {}
    for name, text in stated.items():
        column, factor, unit = (text, 1.0, "") if text in table.columns else _decorated(text)
        chosen[name] = (column, factor, unit)
    taken = {column for column, _, _ in chosen.values()}
    for column in table.columns:
        if column in taken:
            continue
        plain, factor, unit = _decorated(column)
        name = _canonical(plain, platform)
        if name not in known or name in stated:
            continue
        if name in chosen:
            raise _error(
                source,
                f"columns {chosen[name][0]!r} and {column!r} are both {name}",
                "rename or delete one",
            )
        chosen[name] = (column, abs(factor), unit)
    return chosen


def _error(source: str, what: str, remedy: str) -> LogError:
    return LogError(source, [Finding("error", what, "header", remedy, "columns")])


def _decorated(text: str) -> tuple[str, float, str]:
    """Take ``-name [unit]`` apart: (name, factor to SI with sign, unit)."""
    match = DECORATED.match(text)
    unit = (match["unit"] or "").strip()
    if unit and unit not in SCALES:
        return text, 1.0, ""
    return match["name"], (-1.0 if match["minus"] else 1.0) * SCALES.get(unit, 1.0), unit


def _canonical(column: str, platform: Platform) -> str:
    """Lower case, underscores, and the corner names of the driver (bl, br) as rl, rr."""
    name = re.sub(r"[\s.\-]+", "_", column.strip().lower())
    stem, _, corner = name.rpartition("_")
    if corner in CORNERS and CORNERS[corner] in platform.wheel_names and stem.startswith("wheel"):
        return f"{stem}_{CORNERS[corner]}"
    return name


def _numbers(cells, column: str, record: Record) -> np.ndarray:
    """Turn cells into floats; missing ones become NaN, other text is refused by line."""
    if not isinstance(cells, pl.Series):
        return np.asarray(cells, float)
    if cells.dtype.is_numeric():
        return cells.cast(pl.Float64).fill_null(np.nan).to_numpy().copy()
    numbers = cells.cast(pl.Float64, strict=False)
    if numbers.null_count():
        text = cells.fill_null("").str.strip_chars(" \"'\t").str.to_lowercase()
        blank = text.is_in(MISSING)
        numbers = text.cast(pl.Float64, strict=False)
        bad = (numbers.is_null() & ~blank).to_numpy()
        comma = text.str.contains(r"^[+-]?\d*,\d+([eE][+-]?\d+)?$").to_numpy()
        if bad.any() and np.all(comma[bad]):
            numbers = text.str.replace(",", ".").cast(pl.Float64, strict=False)
            record.fixed("cells", "decimal commas", f"column {column}", "read as decimal points")
        elif bad.any():
            row = int(np.flatnonzero(bad)[0])
            record.refuse(
                "cells",
                f"{cells[row]!r} is not a number ({int(bad.sum())} such cells)",
                f"{record.unit_of_place} {record.lines[row]}, column {column}",
                "correct the cell, or leave it empty where the value is missing",
            )
    return numbers.fill_null(np.nan).to_numpy().astype(float)
