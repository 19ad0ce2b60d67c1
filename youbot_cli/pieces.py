"""Finished pieces of long work, kept in a folder so that a run that was stopped can go on."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import Any

from youbot_cli import console
from youbot_cli.origins import PIECE, PIECES

# What a result rests on besides what the caller says: code, models and trained policies.
ROOMS, KINDS = ("youbot_env", "ident", "controllers"), (".py", ".yaml", ".npz")


class Pieces:
    """One JSON file for each finished piece, named by a hash of everything it depends on.

    Files that are damaged, or of other settings, other inputs or other code, are as good as none.
    Used as ``with pieces:`` around the whole work, what was found there is told, they are removed
    once it is done, and Ctrl-C says how to go on.

    Args:
        folder: where they are kept; made with the first.
        settings: what all pieces depend on (options, seed, ``digest`` of input files); JSON.
    """

    def __init__(self, folder: Path, settings: dict[str, Any]):
        self.folder = folder
        used = console.provenance()["versions"]
        self._settings = {"settings": settings, "code": code_version(), "versions": used}

    def __enter__(self) -> Pieces:
        kept = [_read(path) for path in self.folder.glob(f"*{PIECE}")]
        own = self._key("")
        usable = sum(1 for one in kept if one and one["key"] | {"piece": ""} == own)
        where = console.shown(self.folder)
        if usable:
            console.err.print(f"going on from {_counted(usable)} in {where}", soft_wrap=True)
        if usable < len(kept):
            console.err.print(
                f"{_counted(len(kept) - usable)} in {where} damaged, or of other inputs, options "
                "or code: made anew",
                style="yellow", soft_wrap=True,
            )  # fmt: skip
        return self

    def __exit__(self, kind, error, trace) -> None:
        if kind is None:
            self.remove()
        elif issubclass(kind, KeyboardInterrupt):
            raise console.Stopped(
                f"stopped; what is finished is kept in {console.shown(self.folder)}: the same "
                "command goes on from there"
            ) from None

    def find(self, name: str) -> Any:
        """What was kept under a name, or None."""
        key = self._key(name)
        kept = _read(self._path(key))
        return kept["value"] if kept and kept["key"] == key else None

    def keep(self, name: str, value: Any) -> Any:
        """Keep a piece, whole or not at all.

        Args:
            name: of the piece.
            value: in types that JSON has, not None.

        Returns:
            The value as ``find`` gives it, so that a run that goes on ends like one in one go.
        """
        from youbot_env.model_file import write_atomically

        key = self._key(name)
        kept = {"key": key, "sha256": _digest_of(value), "value": value}
        text = json.dumps(kept)
        write_atomically(self._path(key), text)
        return json.loads(text)["value"]

    def once(self, name: str, call: Callable[[], Any]) -> Any:
        """What was kept under a name, or what the call gives, which is then kept."""
        found = self.find(name)
        return self.keep(name, call()) if found is None else found

    def remove(self) -> None:
        """Remove all pieces in the folder, those of other settings too, and the folder."""
        for path in self.folder.glob(f"*{PIECE}"):
            path.unlink(missing_ok=True)
        if self.folder.is_dir() and not any(self.folder.iterdir()):
            self.folder.rmdir()

    def _key(self, name: str) -> dict[str, Any]:
        # As it comes out of a file again.
        return json.loads(json.dumps(self._settings | {"piece": name}))

    def _path(self, key: dict) -> Path:
        text = json.dumps(key, sort_keys=True)
        return self.folder / f"{hashlib.sha256(text.encode()).hexdigest()[:20]}{PIECE}"


def _read(path: Path) -> dict[str, Any] | None:
    """What a file of a piece holds; None where it is not what was written."""
    try:
        kept = json.loads(path.read_text(encoding="utf-8"))
    except (OSError, ValueError, RecursionError):
        return None
    whole = isinstance(kept, dict) and isinstance(kept.get("key"), dict) and "value" in kept
    return kept if whole and kept.get("sha256") == _digest_of(kept["value"]) else None


def _digest_of(value: Any) -> str:
    """SHA-256 of a value as JSON writes it."""
    return hashlib.sha256(json.dumps(value).encode()).hexdigest()


def _counted(pieces: int) -> str:
    return f"{pieces} finished piece{'s' if pieces > 1 else ''}"


def place(command: str, report: Path | None, json_file: Path | None) -> Path:
    """Folder for the pieces of a command: in its report, else beside its file, else in runs."""
    if report is not None:
        return report / PIECES
    beside = Path("runs") if json_file is None else json_file.parent
    return beside / f"{command if json_file is None else json_file.stem}.{PIECES}"


def digest(paths: Iterable[Path | None]) -> list[str]:
    """SHA-256 of the files."""
    return [hashlib.sha256(path.read_bytes()).hexdigest() for path in paths if path is not None]


def code_version() -> str:
    """Fingerprint of the packages, models and policies."""
    from ident.benchmark.store import files_of, fingerprint

    return fingerprint(path for path in files_of(ROOMS) if path.suffix in KINDS)
