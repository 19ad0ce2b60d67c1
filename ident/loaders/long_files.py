"""Files too long to hold: of equal parts the stretches in which most happens, read one by one."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from itertools import pairwise
from pathlib import Path

import numpy as np

from ident.distributions import ranks
from ident.doctor.finding import Finding
from ident.doctor.table import Table

# Of files with more rows so many are read, 50 minutes at 100 Hz, in stretches of that many rows:
# with 15 columns the doctor takes 0.4 GB for them, and a file of 24 hours has 8.6 million.
MOST_ROWS, STRETCH = 300_000, 2_000
# Of so many times as many equal parts of the time as there are to be stretches the livelier ones
# are kept: a robot that stands half of the day shows as much as one that never does.
SPANS = 2


def liveliness(changes: np.ndarray) -> np.ndarray:
    """(k,) how much happens in each of k stretches, for comparing them.

    Channels count by the rank of a stretch among the others, so that neither units nor the size of
    a gross error matter.

    Args:
        changes: (k, c) how much each of c channels changes in each of them; NaN for nothing.
    """
    changes = np.nan_to_num(changes, nan=0.0)
    return np.sum([ranks(channel) for channel in changes.T], axis=0)


def livelier(changes: np.ndarray, lengths: np.ndarray, most: float) -> np.ndarray:
    """Numbers, in their order, of the liveliest stretches (k, c) that are as long as ``most``."""
    order = np.argsort(-liveliness(changes), kind="stable")
    count = np.searchsorted(np.cumsum(np.asarray(lengths)[order]), most * (1 + 1e-9), side="right")
    return np.sort(order[: max(1, int(count))])


def spans(most: int) -> int:
    """Number of parts of a file of which ``most`` rows are kept."""
    return SPANS * max(1, most // STRETCH)


def liveliest_rows(values: np.ndarray) -> tuple[slice, np.ndarray]:
    """Rows of the liveliest stretch of a part of a file (n, c), and how much changes there (c,)."""
    count = max(1, len(values) // STRETCH)
    edges = np.linspace(0, len(values), count + 1).astype(int)
    with np.errstate(all="ignore"):
        changes = np.array([values[a:b].var(axis=0) for a, b in pairwise(edges)])
    chosen = int(np.argmax(liveliness(changes)))
    begin = int(edges[chosen])
    return slice(begin, min(int(edges[chosen + 1]), begin + STRETCH)), changes[chosen]


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
    remedy = f"{STRETCH} rows each from all of the file, those in which most happens"
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
        kept, first, count, changes = [], [], [], []
        line = above = head.count(b"\n")
        for lines in _spans(stream, begin, path.stat().st_size, spans(most)):
            ends = np.flatnonzero(np.frombuffer(lines, np.uint8) == ord("\n")) + 1
            rows, changed = liveliest_rows(numbers(lines)[: len(ends)])
            changes.append(changed)
            edges = np.append(0, ends)
            kept.append(lines[edges[rows.start] : edges[rows.stop]])
            first.append(line + rows.start + 1)
            count.append(rows.stop - rows.start)
            line += len(ends)
    best = livelier(np.array(changes), count, most).tolist()
    return Kept(
        head + b"".join(kept[k] for k in best),
        (1, *(first[k] for k in best)),
        (above, *(count[k] for k in best)),
        line,
    )


def _spans(stream, begin: int, size: int, count: int) -> Iterator[bytes]:
    """Whole lines of equal parts of a file, of which the stream stands at the first."""
    for k in range(1, count + 1):
        end = begin + (size - begin) * k // count
        lines = stream.read(max(0, end - stream.tell())) + stream.readline()
        if lines:
            yield lines if lines.endswith(b"\n") else lines + b"\n"
