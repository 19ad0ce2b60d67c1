"""Folders written by the youBot driver's DataTrace: one file a joint, values separated by spaces.

Driver signs, time in ms from the start of the trace; NaN where the driver had no value.
"""

from __future__ import annotations

import io
import re
from pathlib import Path

import numpy as np
import polars as pl

from ident.loaders.base import Loader, Table, head, refuse
from ident.loaders.wheel_names import corner
from ident.loaders.youbot_driver import sign
from youbot_env.platform import Platform

HEADER = "# time [milliseconds]"
# Places of the columns used, from 0.
TIME, ANGLE, VELOCITY, CURRENT, TORQUE = 0, 8, 10, 12, 13
WIDTH = 14
NUMBERS = {"1": "fl", "2": "fr", "3": "rl", "4": "rr"}


class DataTraceLoader(Loader):
    """A folder with one trace for each base joint."""

    identifier = "datatrace"
    title = "youBot DataTrace folder"

    def recognises(self, path: Path) -> bool:
        """A folder in which a file carries the header of a trace."""
        return path.is_dir() and bool(_traces(path))

    def read(self, path: Path, platform: Platform) -> Table:
        """Read the traces of all wheels and bring them to the time of the first."""
        files = {}
        for file in _traces(path):
            wheel = _wheel(file, path)
            if wheel in files:
                raise refuse(
                    path,
                    f"{files[wheel].relative_to(path)} and {file.relative_to(path)} are both of "
                    f"wheel {wheel}",
                    "folder",
                    "leave one trace a wheel in the folder",
                )
            files[wheel] = file
        missing = [wheel for wheel in platform.wheel_names if wheel not in files]
        if missing:
            raise refuse(
                path,
                f"no trace of the wheels {missing}; found {sorted(w for w in files if w)}",
                "folder",
                "name each file or its folder after its joint (fl, fr, bl, br or 1 to 4)",
            )
        traces = {wheel: _read(files[wheel], path) for wheel in platform.wheel_names}
        time = traces[platform.wheel_names[0]][:, TIME]
        table = Table({"time": time * 1e-3}, np.arange(1, len(time) + 1), "sample")
        table.names = {"time": "time"}
        for wheel, trace in traces.items():
            self._add(table, wheel, trace, time, sign(wheel, platform))
        table.tell("signs of the youBot driver", "all traces", "turned into paper signs")
        return table

    def _add(self, table: Table, wheel: str, trace: np.ndarray, time, factor: float) -> None:
        channels = {"wheel_velocity": VELOCITY, "wheel_position": ANGLE}
        channels["wheel_torque"] = TORQUE
        if np.isnan(trace[:, TORQUE]).all():
            channels["wheel_current"] = CURRENT
            del channels["wheel_torque"]
        for channel, column in channels.items():
            values = factor * trace[:, column]
            if len(trace) != len(time) or np.any(trace[:, TIME] != time):
                values = np.interp(time, trace[:, TIME], values)
                # Traces are started one after the other; beyond one step there is no value.
                step = float(np.nanmedian(np.diff(time)))
                first, last = trace[0, TIME] - step, trace[-1, TIME] + step
                values[(time < first) | (time > last)] = np.nan
            name = f"{wheel} {channel.removeprefix('wheel_')}"
            table.columns[name] = values
            table.names[f"{channel}_{wheel}"] = name


def _traces(path: Path) -> list[Path]:
    files = [*path.glob("*"), *path.glob("*/*")]
    return sorted(f for f in files if f.is_file() and HEADER.encode() in head(f, 4096))


def _wheel(file: Path, folder: Path) -> str:
    """Wheel of a trace: from its place in the folder, else from its first comments."""
    comments = [line for line in head(file, 4096).decode("utf-8", "replace").splitlines()
                if line.startswith("#") and not line.startswith(HEADER)]  # fmt: skip
    for text in (str(file.relative_to(folder)), *comments):
        if corner(text):
            return corner(text)
        plain = text.lower()
        if "firmware" not in plain and "date" not in plain:
            digits = re.findall(r"(?<!\d)[1-4](?!\d)", plain)
            if digits:
                return NUMBERS[digits[-1]]
    return ""


def _read(file: Path, folder: Path) -> np.ndarray:
    """(N, 14) numbers of one trace."""
    place = str(file.relative_to(folder))
    lines = file.read_bytes().splitlines()
    kept = [(n, line) for n, line in enumerate(lines, 1) if line.strip() and line[:1] != b"#"]
    if kept and len(kept[-1][1].split()) < WIDTH:
        kept.pop()  # the last line of a trace that was cut off
    for number, line in kept:
        if len(line.split(maxsplit=WIDTH)) < WIDTH:
            raise refuse(
                folder, f"{len(line.split())} values where a trace has {WIDTH} or more",
                f"{place}, line {number}", "repair the line",
            )  # fmt: skip
    if len(kept) < 2:
        raise refuse(folder, "there are no values", place, "record again")
    body = b"\n".join(b" ".join(line.split(maxsplit=WIDTH)[:WIDTH]) for _, line in kept)
    text = pl.read_csv(io.BytesIO(body + b"\n"), has_header=False, separator=" ",
                       infer_schema=False, quote_char=None)  # fmt: skip
    trace = np.empty(text.shape)
    for index, column in enumerate(text.iter_columns()):
        plain = column.str.to_lowercase().str.strip_prefix("-").str.replace("nan.*", "nan")
        numbers = column.cast(pl.Float64, strict=False)
        bad = (numbers.is_null() & (plain != "nan")).to_numpy()
        if bad.any():
            row = int(np.flatnonzero(bad)[0])
            raise refuse(
                folder, f"{column[row]!r} is not a number",
                f"{place}, line {kept[row][0]}, column {index + 1}", "repair the line",
            )  # fmt: skip
        trace[:, index] = numbers.fill_null(np.nan).to_numpy()
    return trace
