"""Finished cases in an append-only file, one JSON line each, so that a run can go on later."""

from __future__ import annotations

import hashlib
import json
import os
from collections.abc import Iterable, Iterator
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
# What an answer rests on.  Pages, doctor, kinematic calibration and the bookkeeping of the
# benchmark itself change no answer.
ROOMS = ("youbot_env", "ident")
APART = ("envs", "report", "doctor", "loaders", "kinematics")
BOOKKEEPING = (
    "score.py",
    "store.py",
    "runner.py",
    "summary.py",
    "page.py",
)


def code_version() -> str:
    """Fingerprint of the code that records and diagnoses."""

    def counts(path: Path) -> bool:
        inside = path.relative_to(ROOT).parts
        bookkeeping = inside[-2] == "benchmark" and inside[-1] in BOOKKEEPING
        return path.suffix == ".py" and not (bookkeeping or set(inside) & set(APART))

    return fingerprint(filter(counts, files_of(ROOMS)))


def files_of(rooms: Iterable[str]) -> Iterator[Path]:
    """All files of some folders of the project, room by room, by name."""
    for room in rooms:
        yield from sorted((ROOT / room).rglob("*"))


def fingerprint(files: Iterable[Path]) -> str:
    """Twelve digits that names or contents of files of the project do not share with others."""
    digest = hashlib.sha256()
    for path in files:
        digest.update(path.relative_to(ROOT).as_posix().encode() + path.read_bytes())
    return digest.hexdigest()[:12]


class Store:
    """The file of finished cases.

    Attributes:
        path: of the file; folders are made.
        version: fingerprint of the code whose results count.
    """

    def __init__(self, path: str | os.PathLike, version: str):
        self.path, self.version = Path(path), version

    def finished(self) -> dict[tuple[str, str], dict[str, Any]]:
        """Records of this version by (method, case), the last of each; failed ones are left out.

        A line that a killed run left half written is passed over.
        """
        found = {}
        if not self.path.exists():
            return found
        for line in self.path.read_text(encoding="utf-8").splitlines():
            try:
                record = json.loads(line)
            except json.JSONDecodeError:
                continue
            if record["version"] == self.version and record["error"] is None:
                found[record["method"], record["case"]] = record
        return found

    def add(self, record: dict[str, Any]) -> dict[str, Any]:
        """Append a record, stamped with the version, and return it."""
        record = {"version": self.version} | record
        self.path.parent.mkdir(parents=True, exist_ok=True)
        text = json.dumps(record, allow_nan=False)
        with self.path.open("a+b") as file:
            # Begin a new line where a killed run left half of one.
            if file.tell() and self._unfinished():
                file.write(b"\n")
            file.write(text.encode() + b"\n")
        return record

    def _unfinished(self) -> bool:
        with self.path.open("rb") as file:
            file.seek(-1, os.SEEK_END)
            return file.read(1) != b"\n"
