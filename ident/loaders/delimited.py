"""Text tables: CSV with comma, semicolon or tab, ``#`` comments, names in the first line."""

from __future__ import annotations

import io
import re
from pathlib import Path

import numpy as np
import polars as pl

from ident.doctor.declared import known_unit
from ident.loaders.base import Loader, Table, head, refuse
from ident.loaders.joint_columns import name_joints
from ident.loaders.long_files import Kept, liveliest_lines
from ident.loaders.stamps import find_time
from ident.remembered import comments, recall
from youbot_env.platform import Platform

SEPARATORS = (",", ";", "\t")
MOST_COLUMNS = 2000
DEEPEST = 40  # lines among which the first row of numbers is looked for
MOST_HEADERS = 4  # lines beyond the names
NUMBER = re.compile(
    r"^[+-]?(\d+([.,]\d*)?|[.,]\d+)([eE][+-]?\d+)?$|^[+-]?(nan|inf)$", re.IGNORECASE
)


class DelimitedLoader(Loader):
    """CSV and its relatives; whatever looks like text is tried with it."""

    identifier = "csv"
    title = "CSV (comma, semicolon or tab)"
    priority = -10

    def recognises(self, path: Path) -> bool:
        """Text, an empty file (refused with its own words), or a name that promises a table."""
        if not path.is_file():
            return False
        first = head(path)
        return b"\0" not in first or path.suffix.lower() in (".csv", ".tsv", ".txt")

    def read(self, path: Path, platform: Platform) -> Table:
        """Read all cells as text; the doctor turns them into numbers and names bad ones."""
        return self._table(path, platform, None)

    def read_excerpt(self, path: Path, platform: Platform, most_rows: int) -> Table:
        """See the base class."""
        return self._table(path, platform, most_rows)

    def _table(self, path: Path, platform: Platform, most_rows: int | None) -> Table:
        kept = None if most_rows is None else _kept(path, most_rows)
        data = _text(path, path.read_bytes() if kept is None else kept.data)
        table = parse(data, path)
        if kept is not None:
            kept.place(table)
        try:
            recall(table, comments(data))
        except ValueError as error:
            raise refuse(path, str(error), "comments", "correct or remove the line") from error
        find_time(table)
        name_joints(table, platform)
        return table


def header(path: Path) -> list[str]:
    """Column names of a text table, as cheaply as possible; empty where there are none."""
    first = head(path)
    if not first or b"\0" in first:
        return []
    for line in first.decode("utf-8-sig", "replace").splitlines():
        if line.strip() and not line.lstrip().startswith("#"):
            return _split(line, _separator(line))
    return []


def _kept(path: Path, most: int) -> Kept | None:
    """The liveliest stretches of a file with more rows than ``most``; None where it has fewer."""
    first = head(path)
    lines = first[: first.rfind(b"\n") + 1]
    if path.stat().st_size <= len(first) or not lines or b"\0" in lines:
        return None  # short, of one line, or in another coding
    text = lines.removeprefix(b"\xef\xbb\xbf").replace(b"\r\n", b"\n")
    ends = np.flatnonzero(np.frombuffer(text, np.uint8) == ord("\n"))
    begins = np.concatenate([[0], ends[:-1] + 1])
    table = Table({}, np.empty(0, int))
    skipped = _preamble(table, text, begins, ends)
    number, names, separator = _header(text, begins, ends, path, skipped)
    number += _more_headers(table, text, begins[number:], ends[number:], names, separator)
    begin = sum(map(len, lines.splitlines(keepends=True)[:number]))
    if len(ends) <= number or _lines(path, len(lines) / len(ends), most + number) <= most + number:
        return None
    options = {"has_header": False, "separator": separator, "quote_char": None,
               "infer_schema": False, "ignore_errors": True, "truncate_ragged_lines": True,
               "schema": {f"{k}": pl.Float64 for k in range(len(names))}}  # fmt: skip

    def numbers(block: bytes) -> np.ndarray:
        frame = pl.read_csv(io.BytesIO(block), **options)
        return frame.to_numpy()

    return liveliest_lines(path, begin, most, numbers)


def _lines(path: Path, length: float, limit: int) -> int:
    """Lines of a file whose first ones have a mean length; counted where they may pass a limit."""
    size = path.stat().st_size
    if size < 0.5 * limit * length:
        return int(size / length)
    with path.open("rb") as stream:
        return sum(block.count(b"\n") for block in iter(lambda: stream.read(1 << 24), b""))


def _text(path: Path, data: bytes) -> bytes:
    if not (data[:4096].strip() or data.strip()):
        raise refuse(path, "the file is empty", "line 1", "record again or check the copy")
    if data[:2] in (b"\xff\xfe", b"\xfe\xff"):
        data = data.decode("utf-16").encode()
    data = data.removeprefix(b"\xef\xbb\xbf")
    if (place := data.find(b"\0")) >= 0:
        line = data.count(b"\n", 0, place) + 1
        raise refuse(
            path,
            f"byte {place} is NUL: a binary or damaged file",
            f"line {line}",
            "give a text table, or the file under the name of its own format",
        )
    if b"\r" in data:
        data = data.replace(b"\r\n", b"\n").replace(b"\r", b"\n")
    return data if data.endswith(b"\n") else data + b"\n"


def _separator(line: str) -> str:
    return max(SEPARATORS, key=line.count)


def _split(line: str, separator: str) -> list[str]:
    return [name.strip().strip("\"'").strip() for name in line.split(separator)]


def parse(data: bytes, path: Path) -> Table:
    """Find header and rows in the bytes of a text table; ``path`` is named in errors."""
    codes = np.frombuffer(data, np.uint8)
    ends = np.flatnonzero(codes == ord("\n"))
    begins = np.concatenate([[0], ends[:-1] + 1])
    table = Table({}, np.empty(0, int))
    number, names, separator = _header(
        data, begins, ends, path, _preamble(table, data, begins, ends)
    )
    number += _more_headers(table, data, begins[number:], ends[number:], names, separator)
    begins, ends = begins[number:], ends[number:]
    lines = np.arange(number + 1, number + 1 + len(begins))
    if not len(lines):
        raise refuse(path, "there is no row after the names", f"line {number}", "record again")
    body = memoryview(data)[begins[0] :]
    keep = (codes[begins] != ord("#")) & (ends > begins)
    cells = _cells(data, separator, begins, ends)
    if not keep.all() or np.any(cells != len(names)):
        if keep.any() and np.all(cells[keep][:-1] == len(names) + 1) and len(names) > 1:
            names = [*names, ""]  # a separator at the end of each row
        elif keep.any() and not names[-1] and np.all(cells[keep][:-1] == len(names) - 1):
            names = names[:-1]  # a separator at the end of the names alone
        wrong = keep & (cells != len(names))
        if wrong.any():
            _ragged(table, path, wrong, cells, lines, names, separator)
            keep &= ~wrong
        pairs = zip(begins[keep], ends[keep], strict=True)
        body = b"\n".join(data[begin:end] for begin, end in pairs) + b"\n"
        lines = lines[keep]
    if not len(lines):
        raise refuse(path, "there is no row after the names", f"line {number}", "record again")
    unique = [f"{index}" for index in range(len(names))]
    frame = _frame(body, separator, unique)
    table.lines = lines
    for name, column in zip(names, unique, strict=True):
        if name or frame[column].null_count() < len(frame):
            table.columns[name or "(no name)"] = frame[column]
    return table


def _frame(body: bytes, separator: str, names: list[str]) -> pl.DataFrame:
    """Read cells as numbers, or all as text where one is no number."""
    options = {"has_header": False, "separator": separator, "quote_char": None,
               "new_columns": names, "infer_schema": False}  # fmt: skip
    try:
        return pl.read_csv(
            io.BytesIO(body), schema_overrides=dict.fromkeys(names, pl.Float64), **options
        )
    except pl.exceptions.ComputeError:
        # A byte that is no text spoils its cell and nothing else.
        text = bytes(body).decode("utf-8", "replace").encode()
        return pl.read_csv(io.BytesIO(text), **options)


def _preamble(table: Table, data: bytes, begins, ends) -> int:
    """Lines of text above the names, which have as many cells as the first row of numbers."""
    texts = [
        data[b:e].decode("utf-8", "replace") for b, e in zip(begins[:DEEPEST], ends, strict=False)
    ]
    rows = [(n, _split(t, _separator(t))) for n, t in enumerate(texts) if t.strip() and t[0] != "#"]
    above: list[tuple[int, list[str]]] = []
    for number, cells in rows:
        if len(cells) > 2 and sum(map(_number, cells)) > 0.5 * len(cells):
            break
        above.append((number, cells))
    else:
        return 0
    wide = {len(cells), len(cells) + 1}
    if not above or len(above[0][1]) in wide or len(above[0][1]) == len(cells) - 1:
        return 0
    skipped = next((n for n, names in above if len(names) in wide), 0)
    if skipped:
        table.tell(f"{skipped} lines above the names", "line 1", "left out")
    return skipped


def _number(cell: str) -> bool:
    return bool(NUMBER.match(cell))


def _header(data: bytes, begins, ends, path: Path, skipped: int = 0) -> tuple[int, list[str], str]:
    """Return (lines up to and with the names, names, separator)."""
    comment, places = "", zip(begins[skipped:], ends[skipped:], strict=True)
    for number, (begin, end) in enumerate(places, skipped + 1):
        line = data[begin:end].decode("utf-8", "replace").strip("\n ")
        if line.startswith("#"):
            comment = line.lstrip("# ")
            continue
        if not line.strip():
            continue
        separator = _separator(line)
        names = _split(line, separator)
        if all(_number(name) or not name for name in names):
            above = _split(comment, separator)
            if comment and len(above) == len(names):
                return number - 1, above, separator
            raise refuse(
                path,
                f"it begins with {names[0]!r} where the column names belong",
                f"line {number}",
                "put the names of the columns (time, wheel_velocity_fl, ...) into the first line",
            )
        break
    else:
        raise refuse(path, "there are only comments", "file", "record again")
    where = f"line {number}"
    if len(names) == 1:
        raise refuse(
            path,
            f"only one column name, {names[0][:60]!r}",
            where,
            "separate columns by comma, semicolon or tab",
        )
    if len(names) > MOST_COLUMNS:
        raise refuse(path, f"{len(names)} columns", where, f"a log has at most {MOST_COLUMNS}")
    if any("\ufffd" in name or not name.isprintable() for name in names):
        raise refuse(path, f"names are not text: {names[0][:20]!r}", where, "give a text table")
    lower = [name.lower() for name in names if name]
    twice = sorted({name for name in lower if lower.count(name) > 1})
    if twice:
        raise refuse(path, f"columns {twice} stand there twice", where, "rename or delete one")
    return number, names, separator


def _more_headers(table: Table, data: bytes, begins, ends, names, separator: str) -> int:
    """Take further lines of a header, units and other names of the columns; return how many."""
    count, told = 0, []
    for begin, end in zip(begins[:MOST_HEADERS], ends, strict=False):
        cells = _split(data[begin:end].decode("utf-8", "replace"), separator)
        cells = cells[:-1] if len(cells) == len(names) + 1 and not cells[-1] else cells
        words = [cell for cell in cells if cell]
        # Data that begin with a line of missing values have a time there.
        if not words or len(cells) != len(names) or any(map(_number, words)):
            break
        count += 1
        known = sum(known_unit(word.strip("[]()")) for word in words)
        if known > 0.5 * len(words):
            table.units |= {
                name: cell.strip("[]()") for name, cell in zip(names, cells, strict=True) if cell
            }
            told.append("units")
        elif len(set(words)) == len(words):
            pairs = zip(names, cells, strict=True)
            table.aliases |= {("", cell): name for name, cell in pairs if cell}
            told.append("other names")
        else:
            told.append("text")
    if told:
        table.tell(
            f"{count + 1} header lines: names, {', '.join(told)}", "header",
            "units are used, columns go by any of their names",
        )  # fmt: skip
    return count


def _cells(data: bytes, separator: str, begins, ends) -> np.ndarray:
    """Count the cells of each line."""
    places = np.flatnonzero(np.frombuffer(data, np.uint8) == ord(separator))
    return np.searchsorted(places, ends) - np.searchsorted(places, begins) + 1


def _ragged(table: Table, path: Path, wrong, cells, lines, names, separator) -> None:
    """Drop a truncated last line and a few broken ones; refuse more."""
    places = np.flatnonzero(wrong)
    one = places[0]
    text = f"{cells[one]} cells where the names are {len(names)}"
    where = f"line {lines[one]}"
    if len(places) > max(1, 0.01 * len(lines)):
        hint = "write decimal points, not commas" if separator == "," else "repair the file"
        if np.all(cells[places] == 1):
            hint = "use one separator in the whole file"
        raise refuse(path, f"{text}; {len(places)} lines are broken", where, hint)
    what = f"{text}; the file is cut off there" if one == len(lines) - 1 else text
    table.tell(f"{what} ({len(places)} such lines)", where, "broken lines left out")
