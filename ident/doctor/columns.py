"""From columns of a file to channels of a log: names, aliases, signs and units in the names."""

from __future__ import annotations

import difflib
import re
from typing import NamedTuple

import numpy as np
import polars as pl

from ident.doctor.declared import UnitError, factor_of, known_unit
from ident.doctor.finding import Finding, LogError
from ident.doctor.record import Record
from ident.doctor.table import Table
from youbot_env.channels import channel_columns
from youbot_env.platform import Platform

# What no sensor of a robot gives, in any unit (nanoseconds since 1970 are 2e18): read from memory
# that was never written, and too large to be squared.
IMPOSSIBLE = 1e30
MISSING = ("", "nan", "na", "n/a", "null", "none", "-", "--", "?")
CORNERS = {"bl": "rl", "br": "rr"}
DECORATED = re.compile(r"^(?P<minus>-?)\s*(?P<name>.*?)\s*(?:[\[(](?P<unit>[^\])]*)[\])])?$")


class Chosen(NamedTuple):
    """A column that was found for a log name.

    Attributes:
        column: its name in the table.
        minus: whether a mapping turns its sign round.
        unit: declared unit; empty for none, which is SI or found by the doctor.
        stated: whether a user's mapping names it.
    """

    column: str
    minus: bool
    unit: str
    stated: bool


def examine_columns(
    table: Table,
    source: str,
    platform: Platform,
    mapping: dict[str, str] | None,
    gear: float | None = None,
) -> Record:
    """Find the columns of a log and turn their cells into numbers.

    Args:
        table: as the loader left it.
        source: file name.
        platform: gives the wheel names.
        mapping: ``{log name: column}``; a column may carry a minus and a unit in brackets, as in
            ``-left_front [rpm]``; ``wheel_fl`` stands for all of a joint.
        gear: motor turns per wheel turn, for what is declared to be of the motor.

    Raises:
        LogError: no time, half a channel, a name twice, cells that are not numbers.
    """
    chosen = _choose(table, source, platform, mapping or {})
    missing = [] if "time" in chosen else ["time"]
    record = Record(source, platform, np.empty(0), table.lines, table.unit_of_place)
    record.findings, record.header = list(table.findings), tuple(table.columns)
    numbers = {}
    turned: dict[str, list[str]] = {}
    for name, (column, minus, unit, stated) in chosen.items():
        factor = _factor(record, name, column, unit, gear, stated)
        if factor is None:
            continue
        numbers[name] = (-factor if minus else factor) * _numbers(
            table.columns[column], column, record
        )
        record.units[name] = unit
        if factor != 1:
            turned.setdefault(f"the unit is {unit}: turned into SI", []).append(column)
        if minus:
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
    record.breaks = np.zeros(len(record.time), bool) if table.cuts is None else table.cuts
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
            record.columns[channel] = tuple(chosen[name].column for name in names)
    if table.unnamed and not {"wheel_velocity", "wheel_position"} & set(record.channels):
        wheel = platform.wheel_names[0]
        record.refuse(
            "columns",
            f"none of the joints could be told to be a wheel ({', '.join(platform.wheel_names)}); "
            f"the joints are {', '.join(table.unnamed[:40])}",
            "bag",
            f"name them with --map wheel_{wheel}=JOINT for each wheel",
            final=True,
        )
    record.stop_on_error()
    used = {one.column for one in chosen.values()}
    # Inertial sensors are part of the format, though nothing reads them yet.
    unknown = [c for c in table.columns if c not in used and not c.lower().startswith("imu_")]
    if unknown:
        listed = ", ".join(unknown[:30]) + (", ..." if len(unknown) > 30 else "")
        record.fixed("columns", f"{len(unknown)} unknown columns: {listed}", "header", "ignored")
    return record


def _choose(
    table: Table, source: str, platform: Platform, mapping: dict[str, str]
) -> dict[str, Chosen]:
    """Find a column for each log name: by the mapping, by the loader, by its own name."""
    known = {name for names in channel_columns(platform).values() for name in names} | {"time"}
    columns = _by_plain_name(table)
    chosen: dict[str, Chosen] = {}
    usual = _expanded(table.usual, table, columns, platform)
    there = [(name, text) for name, text in usual if _resolve(text, name, table, columns)]
    if there and len(there) < len(usual):
        absent = ", ".join(text for name, text in usual if (name, text) not in there)
        table.findings.append(
            Finding(
                "warning",
                f"no columns {absent}",
                "header",
                "the platform's file names them",
                "columns",
            )
        )
    for name, text, of_user in [
        *((name, text, False) for name, text in table.names.items()),
        *((name, text, True) for name, text in there),
        *((name, text, True) for name, text in _expanded(mapping, table, columns, platform)),
    ]:
        if name not in known:
            near = difflib.get_close_matches(name, known, 1)
            hint = f"did you mean {near[0]!r}? " if near else ""
            raise _error(source, f"{name!r} is no name of a log", f"{hint}known: {sorted(known)}")
        found = _resolve(text, name, table, columns)
        if found is None:
            raise _error(
                source,
                f"the mapping {name}={text} names no column",
                f"the columns are {list(table.columns)[:40]}",
            )
        chosen[name] = found._replace(stated=of_user)
    taken = {one.column for one in chosen.values()}
    stated = set(chosen)
    for plain, column in columns.items():
        name = _canonical(plain, platform)
        if column in taken or name not in known or name in stated:
            continue
        if name in chosen and chosen[name].column != column:
            raise _error(
                source,
                f"columns {chosen[name].column!r} and {column!r} are both {name}",
                "rename or delete one",
            )
        chosen[name] = Chosen(column, False, _unit_of(column, table), False)
    return chosen


def _by_plain_name(table: Table) -> dict[str, str]:
    """Columns by their names with and without a unit in brackets."""
    columns = {_decorated(column)[0]: column for column in reversed(table.columns)}
    return dict(reversed(columns.items())) | {column: column for column in table.columns}


def _resolve(text: str, name: str, table: Table, columns: dict[str, str]) -> Chosen | None:
    """The column that a mapping means: by its name, by another one, with minus and unit."""
    plain, minus, unit = _decorated(text)
    channel = name.rpartition("_")[0]
    for words, sign, own in (
        (text, False, ""),
        (text.removeprefix("-").strip(), text.startswith("-"), ""),
        (plain, minus, unit),
    ):
        for aliases in (
            columns,
            {alias: column for (of, alias), column in table.aliases.items() if of in ("", channel)},
        ):
            if words in aliases:
                column = aliases[words]
                return Chosen(column, sign, own or _unit_of(column, table), False)
    return None


def _expanded(
    mapping: dict[str, str], table: Table, columns: dict[str, str], platform: Platform
) -> list[tuple[str, str]]:
    """A mapping in which ``wheel_fl=JOINT`` became one entry for each thing known of the joint."""
    entries = []
    for given, text in mapping.items():
        name = _canonical(given, platform)
        channels = {channel for channel, _ in table.aliases if channel}
        if name.removeprefix("wheel_") not in platform.wheel_names or not name.startswith("wheel_"):
            entries.append((name, text))
            continue
        wheel = name.removeprefix("wheel_")
        there = [c for c in sorted(channels) if _resolve(text, f"{c}_{wheel}", table, columns)]
        entries += [(f"{channel}_{wheel}", text) for channel in there] or [(name, text)]
    return entries


def _unit_of(column: str, table: Table) -> str:
    return _decorated(column)[2] or table.units.get(column, "")


def _factor(
    record: Record, name: str, column: str, unit: str, gear: float | None, stated: bool
) -> float | None:
    """Factor to SI of a column; None where its unit makes it useless."""
    if not unit:
        return 1.0
    try:
        return factor_of(unit, name, record.platform, gear)
    except UnitError as error:
        if stated or name == "time" or name.startswith("wheel"):
            remedy = f"give the unit in brackets, --map {name}='{_decorated(column)[0]} [UNIT]'"
            if not record.refuse("units", str(error), f"column {column}", remedy):
                return 1.0
        else:
            record.warn("units", str(error), f"column {column}", "the column is not used")
    return None


def _error(source: str, what: str, remedy: str) -> LogError:
    return LogError(source, [Finding("error", what, "header", remedy, "columns")])


def _decorated(text: str) -> tuple[str, bool, str]:
    """Take ``-name [unit]`` apart: (name, whether there is a minus, unit)."""
    match = DECORATED.match(text)
    unit = (match["unit"] or "").strip()
    if unit and not known_unit(unit):
        return text, False, ""
    return match["name"], bool(match["minus"]), unit


def log_name(column: str, platform: Platform) -> str:
    """The log name that a column spells, whatever its unit; any text where it spells none."""
    return _canonical(_decorated(column)[0], platform)


def _canonical(column: str, platform: Platform) -> str:
    """Lower case, underscores, and the corner names of the driver (bl, br) as rl, rr."""
    name = re.sub(r"[\s.\-]+", "_", column.strip().lower())
    stem, _, corner = name.rpartition("_")
    if corner in CORNERS and CORNERS[corner] in platform.wheel_names and stem.startswith("wheel"):
        return f"{stem}_{CORNERS[corner]}"
    return name


def _numbers(cells, column: str, record: Record) -> np.ndarray:
    """Turn cells into floats; missing and impossible ones become NaN."""
    numbers = _floats(cells, column, record)
    with np.errstate(invalid="ignore"):
        return np.where(np.abs(numbers) < IMPOSSIBLE, numbers, np.nan)


def _floats(cells, column: str, record: Record) -> np.ndarray:
    """Turn cells into floats; missing ones become NaN, other text is refused by line."""
    if not isinstance(cells, pl.Series):
        return np.asarray(cells, float)
    if cells.dtype.is_numeric():
        return cells.cast(pl.Float64).fill_null(np.nan).to_numpy().copy()
    if cells.dtype in (pl.Categorical, pl.Enum):
        cells = cells.cast(pl.String)
    if cells.dtype not in (pl.String, pl.Boolean, pl.Null):
        record.refuse(
            "cells",
            f"its cells are no numbers but {cells.dtype}",
            f"column {column}",
            "write one number a cell",
        )
        return np.full(len(cells), np.nan)
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
