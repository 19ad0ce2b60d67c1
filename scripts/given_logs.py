"""Logs that a user gives a script: read, mapped to names, and none of them twice."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import console
import typer

from ident.log import Log
from youbot_env.platform import Platform

LOGS = console.ROOT / "logs"
FIT, TEST = LOGS / "youbot_fit.csv", LOGS / "youbot_test.csv"


Recorded = Annotated[
    list[str] | None,
    typer.Option(
        "--recording", metavar="NAME=VALUE",
        help="How the logs were recorded, where that is known: drive_hold=held, drive_offset=0.02; "
        "may be repeated.",
    ),
]  # fmt: skip


def read_log(
    path: Path,
    platform: Platform,
    mapping: dict[str, str],
    kt: float | None,
    gear: float | None,
    recording: list[str] | None = None,
) -> Log:
    """Read a log; a log that is not there is told with what to do."""
    if not path.exists():
        raise ValueError(
            f"no log {console.shown(path)!r}; check the name, or record one with "
            "python scripts/record.py"
        )
    return Log.load(path, platform, mapping or None, kt, gear, recording=recording or ())


def parse_mapping(arguments: list[str] | None) -> dict[str, str]:
    """Turn ``NAME=COLUMN`` arguments into a mapping of log names to columns."""
    mapping: dict[str, str] = {}
    for argument in arguments or ():
        name, given, column = (part.strip() for part in argument.partition("="))
        if not (name and given and column):
            raise ValueError(f"--map {argument}: write NAME=COLUMN, as in --map time=stamp")
        if name in mapping:
            raise ValueError(f"--map {argument}: {name} is given twice; leave one out")
        mapping[name] = column
    return mapping


def refuse_double(logs: list[Log]) -> None:
    """Refuse a log that is given twice: it would count double, or judge what it has taught."""
    seen: dict[str, str] = {}
    for log in logs:
        if log.digest in seen:
            raise ValueError(
                f"logs {seen[log.digest]} and {log.source} are the same record; leave one out, and "
                "judge by one that is not fitted"
            )
        seen[log.digest] = log.source
