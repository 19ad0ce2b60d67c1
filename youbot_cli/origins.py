"""What an existing file says of its origin, and whether a command may replace it without --force.

The rule: a command replaces what the same command wrote before.  For what cannot be had again, logs
and trained policies, it must have been the very same command line; for models, motions, results and
pages the same command is enough.  A page takes over a folder that is empty or holds its own page.
"""

from __future__ import annotations

import json
import re
import shlex
from collections.abc import Iterable
from dataclasses import dataclass
from html import unescape
from pathlib import Path

import yaml

from youbot_cli import COMMANDS, split_command

HEAD = 65536  # bytes of a file in which its origin stands
SCRIPT = re.compile(r"python scripts/(\w+)\.py")
STARTED = rf"(?:python scripts/\S+\.py|youbot (?:{'|'.join(COMMANDS)})\b)"
MADE = re.compile(rf"^#? ?(?:made: .* by )?({STARTED}.*)$", re.MULTILINE)
TRAINED = re.compile(r"((?:python scripts/train\.py|youbot train)[ -~]*)")
GENERATOR = re.compile(r'<meta name="generator" content="([^"]*)">')
TABLES = (".csv", ".parquet")
DRAWS = ".posterior.csv"  # robots drawn from the model that stands beside it
# Folder in that of a page, and ending of the files, in which unfinished work is kept.
PIECES, PIECE = "pieces", ".piece.json"
REMEDY = "choose another name, or replace it with --force"


@dataclass(frozen=True)
class Origin:
    """Where a file comes from.

    Attributes:
        command: the command line that wrote it; empty where it does not say.
        unique: whether it cannot be had again: a log or a policy.
    """

    command: str
    unique: bool = False

    @property
    def name(self) -> str:
        """The command of the command line, whether ``youbot`` or its script started it."""
        return _name_and_options(self.command)[0]


def check_replaceable(paths: Iterable[Path | None], command: str) -> None:
    """Refuse to replace what another command wrote.

    Args:
        paths: results of this command; None where there is none.
        command: its command line, as it is written into results.

    Raises:
        ValueError: names the file, its origin and the remedy.
    """
    chosen = [path for path in paths if path is not None]
    for path in chosen:
        if path.name == "index.html":
            _check_folder(path, chosen, command)
        elif path.is_file():
            _check(origin(path), path, command)


def origin(path: Path) -> Origin:
    """Where a file comes from, as far as it says."""
    ending = path.suffix.lower()
    if path.name.endswith(DRAWS):
        beside = path.with_name(path.name.removesuffix(DRAWS) + ".yaml")
        return origin(beside) if beside.is_file() else Origin("")
    if ending == ".npz":  # the weights of a policy; its description stands beside it
        beside = path.with_suffix(".json")
        return Origin(origin(beside).command if beside.is_file() else "", unique=True)
    if ending == ".json":
        data = _json(path)
        policy = data.get("training")
        return Origin(_command(policy if policy else data), unique=bool(policy))
    if ending in (".yaml", ".yml"):
        data = _yaml(path)
        return Origin(_command(data) or _command(data.get("about")))
    if ending == ".parquet":
        return Origin(_first(MADE, _said(path)), unique=True)
    with path.open("rb") as stream:
        text = stream.read(HEAD).decode("utf-8", "replace")
    if ending == ".html":
        return Origin(unescape(_first(GENERATOR, text)))
    if ending == ".onnx":  # made of a policy that is written beside it
        return Origin(_first(TRAINED, text))
    return Origin(_first(MADE, text), unique=ending in TABLES)


def _check(found: Origin, path: Path, command: str) -> None:
    mine = Origin(command)
    if not found.command:
        raise ValueError(f"{str(path)!r} exists and does not say what wrote it; {REMEDY}")
    if found.name != mine.name or (found.unique and not same(found.command, command)):
        raise ValueError(f"{str(path)!r} was written by '{found.command}'; {REMEDY}")


def _check_folder(page: Path, results: list[Path], command: str) -> None:
    if page.is_file():
        _check(origin(page), page, command)
    elif page.parent.is_dir():
        own = {path.resolve() for path in results}
        found = (p for p in page.parent.iterdir() if p.resolve() not in own)
        other = sorted(p.name for p in found if not _unfinished(p))
        if other:
            raise ValueError(
                f"the folder {str(page.parent)!r} holds other things ({', '.join(other[:3])}"
                f"{', ...' if len(other) > 3 else ''}) and no page of this command; choose another "
                "folder, or write into it with --force"
            )


def _unfinished(path: Path) -> bool:
    """Whether a folder holds nothing but pieces of a run that was stopped."""
    inside = path.name == PIECES and path.is_dir() and not path.is_symlink()
    return inside and all(one.name.endswith(PIECE) for one in path.iterdir())


def same(before: str, now: str) -> bool:
    """Whether two command lines write the same; never so where a log keeps how it was made."""
    (a, old), (b, new) = _name_and_options(before), _name_and_options(now)
    if "--resume" in new:  # the same run, gone on with
        old, new = (_without(words, "--resume", "--steps") for words in (old, new))
    return "--hide" not in new and (a, old) == (b, new)


def _name_and_options(command: str) -> tuple[str, list[str]]:
    """What names the command, empty if nothing does, and its options."""
    try:
        words = shlex.split(command)
    except ValueError:
        words = command.split()
    words = [word for word in words if word != "--force"]
    if words[:1] == ["youbot"]:
        name, options = split_command(words[1:])
        return COMMANDS.get(name, ""), options
    script = SCRIPT.fullmatch(" ".join(words[:2]))
    return (script[1] if script else ""), words[2:]


def _without(words: list[str], flag: str, option: str) -> list[str]:
    kept, values = [], iter(words)
    for word in values:
        if word == option:
            next(values, None)
        elif word != flag and not word.startswith(f"{option}="):
            kept.append(word)
    return kept


def _command(data: object) -> str:
    """The command line in what results say of their provenance."""
    history = data.get("provenance") if isinstance(data, dict) else None
    command = history.get("command") if isinstance(history, dict) else None
    return command if isinstance(command, str) else ""


def _json(path: Path) -> dict:
    try:
        data = json.loads(path.read_bytes())
    except (ValueError, RecursionError):
        return {}
    return data if isinstance(data, dict) else {}


def _yaml(path: Path) -> dict:
    from youbot_env.strict_yaml import read_yaml

    try:
        data = read_yaml(path)
    except (yaml.YAMLError, ValueError):
        return {}
    return data if isinstance(data, dict) else {}


def _said(path: Path) -> str:
    import polars as pl

    try:
        return f"made: {pl.read_parquet_metadata(path).get('made', '')}"
    except (pl.exceptions.PolarsError, OSError, ValueError):
        return ""


def _first(pattern: re.Pattern, text: str) -> str:
    found = pattern.search(text)
    return found.group(1) if found else ""
