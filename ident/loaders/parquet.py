"""Parquet tables with the column names of a log."""

from __future__ import annotations

import os
import sys
from collections.abc import Iterator
from contextlib import contextmanager
from itertools import pairwise
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from ident.loaders.base import Loader, Table, head, refuse
from ident.loaders.joint_columns import name_joints
from ident.loaders.long_files import cut_told, livelier, liveliest_rows, spans
from ident.loaders.stamps import find_time
from ident.remembered import NAMES, recall
from youbot_env.platform import Platform

if TYPE_CHECKING:
    import polars as pl

# Rows times columns of one file, 0.4 GB as numbers: 40 minutes of 20 columns at 1 kHz. Compressed,
# such a file may be small: 323 kB held 3 GB.
MOST_CELLS = 50_000_000


@contextmanager
def _no_panic_shown() -> Iterator[None]:
    """Keep Rust from writing its panics to the process's stderr; they come as exceptions, too."""
    sys.stderr.flush()
    shown, nowhere = os.dup(2), os.open(os.devnull, os.O_WRONLY)
    try:
        os.dup2(nowhere, 2)
        yield
    finally:
        os.dup2(shown, 2)
        os.close(shown)
        os.close(nowhere)


class ParquetLoader(Loader):
    """One Parquet file."""

    identifier = "parquet"
    title = "Parquet"

    def recognises(self, path: Path) -> bool:
        """The file says so itself, or its name does."""
        return path.is_file() and (head(path, 4) == b"PAR1" or path.suffix == ".parquet")

    def read(self, path: Path, platform: Platform) -> Table:
        """Read all columns; numbers stay numbers, text goes through the same checks as CSV."""
        return self._table(path, platform, None)

    def read_excerpt(self, path: Path, platform: Platform, most_rows: int) -> Table:
        """See the base class."""
        return self._table(path, platform, most_rows)

    def _table(self, path: Path, platform: Platform, most_rows: int | None) -> Table:
        import polars as pl

        try:
            with _no_panic_shown():
                # Both come from the metadata, before any row is unpacked.
                rows = pl.scan_parquet(path).select(pl.len()).collect().item()
                columns = len(pl.read_parquet_schema(path))
                if most_rows is not None and rows > most_rows:
                    frame, lines = _liveliest(path, rows, most_rows)
                elif rows * columns <= MOST_CELLS:
                    frame, lines = pl.read_parquet(path), np.arange(1, rows + 1)
                else:
                    frame = None
                stated = pl.read_parquet_metadata(path)
        except (pl.exceptions.PolarsError, OSError, ValueError) as error:
            text = str(error).splitlines()[0]
            raise refuse(path, f"damaged Parquet ({text})", "file", "copy it again") from error
        if frame is None:
            size = f"{rows} rows of {columns} columns are more than {MOST_CELLS:,} numbers"
            raise refuse(path, size, "file", "cut the log or leave columns out")
        if not len(frame):
            raise refuse(path, "there is no row", "file", "record again")
        table = Table({}, lines, "row")
        if len(lines) < rows:
            table.cuts = np.append(False, np.diff(lines) > 1)
            cut_told(table, rows)
        try:
            recall(table, {name: stated[name] for name in NAMES if name in stated})
        except ValueError as error:
            raise refuse(path, str(error), "metadata", "write the file again") from error
        for name, column in zip(frame.columns, frame.iter_columns(), strict=True):
            if column.dtype in (pl.Duration, pl.Datetime):
                table.units[name] = "s"  # so that it cannot pass for a torque or a speed
            if column.dtype == pl.Duration:
                column = column.dt.total_nanoseconds().cast(pl.Float64) * 1e-9
            elif column.dtype == pl.Datetime:
                column = column.dt.epoch("ns").cast(pl.Float64) * 1e-9
            table.columns[name] = column
        find_time(table)
        name_joints(table, platform)
        return table


def _liveliest(path: Path, rows: int, most: int) -> tuple[pl.DataFrame, np.ndarray]:
    """The liveliest stretches of a table, and the numbers of their rows from 1 on."""
    import polars as pl

    scan, kept, lines, changes = pl.scan_parquet(path), [], [], []
    for begin, end in pairwise(np.linspace(0, rows, spans(most) + 1).astype(int).tolist()):
        part = scan.slice(begin, end - begin).collect()
        numbers = part.select(pl.selectors.numeric().cast(pl.Float64))
        chosen, changed = liveliest_rows(numbers.to_numpy())
        chosen_rows = np.arange(chosen.start, chosen.stop)
        kept.append(part[chosen_rows])  # a slice would hold all of the part
        lines.append(begin + chosen_rows + 1)
        changes.append(changed)
    best = livelier(np.array(changes), list(map(len, lines)), most)
    return pl.concat([kept[k] for k in best]), np.concatenate([lines[k] for k in best])
