"""Ways of spoiling tables: the text of a CSV, and the columns of a Parquet file."""

from __future__ import annotations

import io
from collections.abc import Callable

import numpy as np
import polars as pl

CELLS = (
    "", "nan", "inf", "-inf", "1e300", "-1e308", "1e-320", "abc", "1,5", "0x10", "1_000", "\u00e9",
    "9" * 400, "--", "None", '"', "\u0663", "true", "1e9999", "2026-01-01", "-", "0", "1;2", "#",
)  # fmt: skip
COMMENTS = (
    "# platform: {\"name\": 3}", "# platform: youbot", "# platform: " + "[" * 3000, "# made: x",
    "# platform: {\"name\": \"a\", \"wheels\": [1e400]}", "# findings: [[]]",
    "# findings: [[1, 2, 3, 4, 5]]", "# findings: {}", "# recording: drive_offset=1e300",
    "# recording: drive_hold=nothing", "# recording: =", "# accept: nothing", "# accept: spikes",
)  # fmt: skip


class Text:
    """Lines of a text table in parts: comments, names and rows of cells."""

    def __init__(self, data: bytes):
        lines = data.decode("utf-8", "replace").splitlines()
        first = next((k for k, line in enumerate(lines) if not line.startswith("#")), 0)
        self.comments, names = lines[:first], lines[first] if lines else ""
        self.separator = max(",;\t ", key=names.count)
        self.names = names.split(self.separator)
        self.rows = [line.split(self.separator) for line in lines[first + 1 :]]

    def bytes(self) -> bytes:
        rows = [self.separator.join(row) for row in (self.names, *self.rows)]
        return ("\n".join([*self.comments, *rows]) + "\n").encode("utf-8", "surrogateescape")


def on_text(change: Callable) -> Callable:
    def spoil(rng, data: bytes) -> bytes:
        table = Text(data)
        if len(table.names) > 1 and len(table.rows) > 2:
            change(rng, table)
        return table.bytes()

    return spoil


def cells(rng, t: Text) -> None:
    column = int(rng.integers(len(t.names)))
    for row in rng.integers(0, len(t.rows), rng.integers(1, 6)):
        if rng.random() < 0.3:
            column = int(rng.integers(len(t.names)))
        if column < len(t.rows[row]):
            t.rows[row][column] = CELLS[rng.integers(len(CELLS))]


def numbers(rng, t: Text) -> None:
    """Whole columns or stretches of them with other numbers."""
    column, value = int(rng.integers(len(t.names))), CELLS[rng.integers(len(CELLS))]
    begin, end = sorted(rng.integers(0, len(t.rows) + 1, 2)) if rng.random() < 0.7 else (0, None)
    for row in t.rows[begin:end]:
        if column < len(row):
            row[column] = value


def columns(rng, t: Text) -> None:
    """A column less, twice, elsewhere; with its name or without."""
    a, b = rng.integers(0, len(t.names), 2)
    how, named = rng.integers(4), rng.random() < 0.6
    for row in [*([t.names] if named else []), *t.rows]:
        if max(a, b) >= len(row):
            continue
        if how == 0:
            del row[a]
        elif how == 1:
            row.insert(b, row[a])
        else:
            row[a], row[b] = row[b], row[a]


def names(rng, t: Text) -> None:
    a, b = rng.integers(0, len(t.names), 2)
    new = (
        t.names[b], t.names[a].upper(), f'"{t.names[a]}"', f"{t.names[a]} [rpm]", "", "x" * 5000,
        f"{t.names[a]}_ms", t.names[a][:-1], "time", "\u00e9\u00df", "wheel_velocity_bl", "1.5",
        f" {t.names[a]} ", "stamp", "field.header.stamp", "wheel_current_fl", "wheel_angle_fl",
    )  # fmt: skip
    t.names[a] = new[rng.integers(len(new))]


def rows(rng, t: Text) -> None:
    begin, end = sorted(rng.integers(0, len(t.rows) + 1, 2))
    end = min(end, begin + int(2 ** rng.uniform(0, 9)))
    piece = t.rows[begin:end]
    how = rng.integers(5)
    if how == 0:
        t.rows[begin:end] = []
    elif how == 1:
        t.rows[begin:end] = [list(row) for row in piece for _ in range(2)]
    elif how == 2:
        t.rows[begin:end] = [piece[k] for k in rng.permutation(len(piece))]
    elif how == 3:
        t.rows[begin:end] = piece[::-1]
    else:
        t.rows[begin:end] = piece + [list(row) for row in piece]


def header(rng, t: Text) -> None:
    how = rng.integers(8)
    if how == 0:
        t.names, t.rows = t.rows[0], t.rows[1:]
    elif how == 1:
        t.rows.insert(int(rng.integers(len(t.rows))), list(t.names))
    elif how == 2:
        t.rows.insert(0, ["s", *["rad/s"] * (len(t.names) - 1)])
    elif how == 3:
        t.rows.insert(0, [""] * len(t.names))
    elif how == 4:
        t.names += [f"c{k}" for k in range(int(rng.integers(1, 3000)))]
    elif how == 5:
        t.separator = ",;\t |"[rng.integers(5)]
    elif how == 6:
        t.comments.append(t.separator.join(t.names))
    else:
        t.rows = t.rows[: int(rng.integers(0, 4))]


def comments(rng, t: Text) -> None:
    t.comments.insert(int(rng.integers(len(t.comments) + 1)), COMMENTS[rng.integers(len(COMMENTS))])


TABLE: dict[str, Callable] = {
    "cells replaced": on_text(cells), "stretch of a column replaced": on_text(numbers),
    "columns moved": on_text(columns), "column renamed": on_text(names),
    "rows moved": on_text(rows), "header changed": on_text(header),
    "comment added": on_text(comments),
}  # fmt: skip


# Parquet


def on_frame(change: Callable) -> Callable:
    def spoil(rng, data: bytes) -> bytes:
        try:
            frame, said = pl.read_parquet(data), pl.read_parquet_metadata(io.BytesIO(data))
            said = {k: v for k, v in said.items() if k != "ARROW:schema"}
            frame, said = change(rng, frame, said)
        except KeyboardInterrupt:
            raise
        except BaseException:  # an earlier step has left no table, or columns of another kind
            return data
        stream = io.BytesIO()
        kind = ("zstd", "snappy", "uncompressed")[rng.integers(3)]
        frame.write_parquet(stream, compression=kind, metadata=said)
        return stream.getvalue()

    return spoil


def frame_cells(rng, f: pl.DataFrame, said):
    name = f.columns[rng.integers(f.width)]
    values = f[name].to_list()
    for row in rng.integers(0, f.height, rng.integers(1, 6)) if f.height else ():
        values[row] = (None, np.nan, np.inf, 1e300, -1e308, 0.0, 1e-320)[rng.integers(7)]
    return f.with_columns(pl.Series(name, values, strict=False)), said


def frame_types(rng, f: pl.DataFrame, said):
    name, n = f.columns[rng.integers(f.width)], f.height
    column = f[name]
    other = (
        lambda: column.cast(pl.String), lambda: column.cast(pl.Float32),
        lambda: column.cast(pl.Int64, strict=False), lambda: pl.Series(name, [[1.0]] * n),
        lambda: pl.Series(name, [True] * n), lambda: pl.Series(name, [None] * n),
        lambda: pl.Series(name, [{"a": 1.0}] * n), lambda: pl.Series(name, [b"\xff"] * n),
        lambda: column.cast(pl.Int64, strict=False).cast(pl.Datetime("us")),
        lambda: column.cast(pl.Int64, strict=False).cast(pl.Duration("ns")),
        lambda: pl.Series(name, ["a"] * n, dtype=pl.Categorical),
        lambda: pl.Series(name, ["1.5"] * n), lambda: column.cast(pl.Int8, strict=False),
        lambda: column.cast(pl.Int32, strict=False).cast(pl.Date),
        lambda: column.cast(pl.Decimal(30, 9), strict=False),
        lambda: pl.Series(name, [[0.0, 1.0]] * n, dtype=pl.Array(pl.Float64, 2)),
    )  # fmt: skip
    return f.with_columns(other[rng.integers(len(other))]().alias(name)), said


def frame_columns(rng, f: pl.DataFrame, said):
    a, b = f.columns[rng.integers(f.width)], f.columns[rng.integers(f.width)]
    how = rng.integers(4)
    if how == 0:
        return f.drop(a), said
    if how == 1:
        return f.with_columns(f[a].alias(f"{b}_2")), said
    if how == 2:
        return f.select([f.columns[k] for k in rng.permutation(f.width)]), said
    new = (a.upper(), "", "\u00e9", "x" * 5000, "stamp", a[:-1])[rng.integers(6)]
    return (f if new in f.columns else f.rename({a: new})), said


def frame_rows(rng, f: pl.DataFrame, said):
    how = rng.integers(4)
    if how == 0:
        return f[: int(rng.integers(0, 4))], said
    if how == 1:
        return f[rng.permutation(f.height).tolist()], said
    if how == 2:
        return pl.concat([f, f]), said
    begin, end = sorted(rng.integers(0, f.height + 1, 2))
    return pl.concat([f[:begin], f[end:]]), said


def frame_metadata(rng, f: pl.DataFrame, said):
    name, _, text = COMMENTS[rng.integers(len(COMMENTS))].removeprefix("# ").partition(": ")
    return f, said | {name: text}


FRAME: dict[str, Callable] = {
    "cells replaced": on_frame(frame_cells), "column of another type": on_frame(frame_types),
    "columns moved": on_frame(frame_columns), "rows moved": on_frame(frame_rows),
    "comment added": on_frame(frame_metadata),
}  # fmt: skip
