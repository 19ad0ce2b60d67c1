"""Files too long to hold: of equal parts the stretches in which most happens, read one by one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from ident.chance import ranks
from ident.doctor.finding import Finding
from ident.doctor.table import Table

# Of files with more rows so many are used, 50 minutes at 100 Hz, in stretches of that many rows.
# Identification of 360 000 rows takes 1.2 GB, of 300 000 XXX.
MOST_ROWS, STRETCH = 300_000, 2_000


def liveliest(changes: np.ndarray) -> int:
    """Number of the stretch in which most happens.

    Channels count by the rank of a stretch among the others, so that neither units nor the size of
    a gross error matter.

    Args:
        changes: (k, c) how much each of c channels changes in each of k stretches; NaN for nothing.
    """
    changes = np.nan_to_num(changes, nan=0.0)
    return int(np.argmax(sum(ranks(channel) for channel in changes.T)))


def liveliest_rows(values: np.ndarray) -> slice:
    """Rows of the liveliest of the stretches that a part of a file (n, c) is cut into."""
    count = max(1, len(values) // STRETCH)
    edges = np.linspace(0, len(values), count + 1).astype(int)
    with np.errstate(all="ignore"):
        changes = np.array([values[a:b].var(axis=0) for a, b in pairwise(edges)])
    chosen = liveliest(changes)
    begin = int(edges[chosen])
    return slice(begin, min(int(edges[chosen + 1]), begin + STRETCH))


@dataclass(frozen=True)
class Kept:
    """What was kept of a long text table.

    Attributes:
        data: its head and the lines of all stretches.
        first: number of the first line of head and stretches in the file, from 1 on.
        count: how many lines each has.
        lines: how many the file has.
    """

    data: bytes
    first: tuple[int, ...]
    count: tuple[int, ...]
    lines: int

    def place(self, table: Table) -> None:
        """Give the rows of a table that was parsed from ``data`` their lines in the file."""
        ends = np.cumsum(self.count)
        part = np.searchsorted(ends, table.lines, side="left")
        table.lines = np.array(self.first)[part] + table.lines - (ends - self.count)[part] - 1
        table.cuts = np.append(False, (np.diff(part) > 0) & (np.diff(table.lines) > 1))
        cut_told(table, self.lines - self.count[0])


def cut_told(table: Table, rows: int) -> None:
    """Say that a table holds stretches of one with so many rows."""
    used = len(table.lines)
    what = f"{rows} rows are more than are looked at: {used} are used"
    remedy = f"of equal parts of the file the {STRETCH} rows each in which most happens"
    table.findings.append(Finding("fixed", what, "file", remedy, "excerpt"))


def liveliest_lines(
    path: Path, begin: int, most: int, numbers: Callable[[bytes], np.ndarray]
) -> Kept:
    """Keep the head of a text file and the liveliest stretches of what is behind it.

    Args:
        path: of the file.
        begin: byte at which its rows begin.
        most: rows to keep.
        numbers: turns lines into their cells (n, c), NaN where one is no number.
    """
    with path.open("rb") as stream:
        head = stream.read(begin)
        kept, first, count = [head], [1], [head.count(b"\n")]
        line = count[0]
        for lines in _spans(stream, begin, path.stat().st_size, max(1, most // STRETCH)):
            ends = np.flatnonzero(np.frombuffer(lines, np.uint8) == ord("\n")) + 1
            rows = liveliest_rows(numbers(lines)[: len(ends)])
            edges = np.append(0, ends)
            kept.append(lines[edges[rows.start] : edges[rows.stop]])
            first.append(line + rows.start + 1)
            count.append(rows.stop - rows.start)
            line += len(ends)
    return Kept(b"".join(kept), tuple(first), tuple(count), line)


def _spans(stream, begin: int, size: int, count: int) -> Iterator[bytes]:
    """Whole lines of equal parts of a file, of which the stream stands at the first."""
    for k in range(1, count + 1):
        end = begin + (size - begin) * k // count
        lines = stream.read(max(0, end - stream.tell())) + stream.readline()
        if lines:
            yield lines if lines.endswith(b"\n") else lines + b"\n"
