"""What all commands share: exit statuses, clear errors, tables, progress, JSON and provenance.

Exit status 0: done.  1: a check failed.  2: bad input, told in one message on stderr.  3: a fault
of the program, with its traceback.  130: stopped by Ctrl-C, which says how to go on.  With
``YOUBOT_DEBUG=1`` in the environment an error shows its traceback.
"""

from __future__ import annotations

import functools
import glob
import json
import os
import shlex
import subprocess
import sys
import textwrap
import traceback
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from datetime import UTC, datetime
from importlib.metadata import version
from pathlib import Path
from typing import Annotated, Any

import typer
import typer.core
from rich.console import Console
from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn
from rich.table import Table

from youbot_cli.origins import check_replaceable

ROOT = Path(__file__).resolve().parent.parent
FAULT, STOPPED = 3, 130
GAP = 2  # characters between columns
INDENT = {"initial_indent": "  - ", "subsequent_indent": "    "}
# Options that name a file to write; what other words of a command line name is read.
NAMING = ("", "--model", "--robot", "--test")  # what stands behind them may be a name of a file
FLAGS: set[str] = set()  # options of the running command that take no value
RESULTS = ("--out", "--json", "--truth", "--onnx", "--results", "--report", "--figure")
VERSIONED = ("numpy", "scipy", "casadi", "gymnasium", "mujoco", "torch", "stable_baselines3")
# What bad input raises; ModelFileError, LogError and ImpossibleParameters are ValueErrors.
BAD_INPUT = (ValueError, OSError, FloatingPointError, ImportError)

Json = Annotated[
    Path | None, typer.Option("--json", metavar="FILE", help="Write the results for programs.")
]
Force = Annotated[bool, typer.Option("--force", help="Replace files that another command wrote.")]
Seed = Annotated[
    int,
    typer.Option(min=0, max=2**32 - 1, help="Of everything random; equal seeds, equal results."),
]
Cluster = Annotated[
    str | None,
    typer.Option(
        metavar="ADDRESS",
        help="Workers of the Dask cluster there, tcp://HOST:8786, in place of processes of this "
        "machine; files that are named are read by them too.",
    ),
]
# A terminal that cannot show a character shows another in its place.
for stream in (sys.stdout, sys.stderr):
    if hasattr(stream, "reconfigure"):
        stream.reconfigure(errors="replace")  # ty: ignore[not-callable]
out = Console(highlight=False, markup=False, emoji=False)
err = Console(stderr=True, highlight=False, markup=False, emoji=False)


class CheckFailed(Exception):
    """A check of the command said no; the message is shown and the exit status is 1."""


class Stopped(Exception):
    """Ctrl-C stopped long work; the message says how to go on, and the exit status is 130."""


def run(command: Callable[..., None], example: str, several: tuple[str, ...] = ()) -> None:
    """Run a function with typer annotations as the command line, and exit with its status.

    Args:
        command: the function; its docstring is the help.
        example: options of one use that does something, shown in the help.
        several: options that take all words up to the next option, as in ``--model A B C``.
    """

    @functools.wraps(command)
    def guarded(*args, **options) -> None:
        try:
            command(*args, **options)
        except CheckFailed as error:
            err.print(str(error), style="red", soft_wrap=True)
            raise typer.Exit(1) from error
        except Stopped as error:
            err.print(str(error), soft_wrap=True)
            raise typer.Exit(STOPPED) from error
        except BAD_INPUT as error:
            if os.environ.get("YOUBOT_DEBUG"):
                raise
            err.print(f"error: {error}", style="red", soft_wrap=True)
            raise typer.Exit(2) from error
        except (typer.Exit, typer.Abort, typer.BadParameter):
            raise
        except BaseException as error:
            # Libraries in Rust panic past ``Exception``; an interrupt is the user's.
            if not isinstance(error, Exception) and type(error).__name__ != "PanicException":
                raise
            err.print(traceback.format_exc(), soft_wrap=True)
            what = "the memory is used up" if isinstance(error, MemoryError) else "a fault of ours"
            err.print(
                f"error: {what}, not of your files: please send us this command, the lines above "
                "and, if you can, the file",
                style="red", soft_wrap=True,
            )  # fmt: skip
            raise typer.Exit(FAULT) from error

    app = typer.Typer(
        add_completion=False,
        pretty_exceptions_enable=False,
        rich_markup_mode=None,
        context_settings={"help_option_names": ["-h", "--help"]},
    )

    class Command(typer.core.TyperCommand):
        def parse_args(self, ctx, args):
            flags = (one for one in self.params if getattr(one, "is_flag", False))
            FLAGS.update(word for one in flags for word in (*one.opts, *one.secondary_opts))
            return super().parse_args(ctx, spread(args, several))

    # The backspace keeps the lines of the example as they are.
    app.command(cls=Command, epilog=f"\b\nExample:\n  {called()} {example}")(guarded)
    for word in sys.argv[1:]:
        if not is_text(word):
            err.print(f"error: {not_text(word)}", style="red", soft_wrap=True)
            sys.exit(2)
    app(prog_name=called())


def is_text(name: str) -> bool:
    """Whether the name of a file can be written down: its bytes are UTF-8."""
    return not any("\ud800" <= letter <= "\udfff" for letter in name)


def not_text(name: str) -> str:
    """What is said of a name that cannot: results have to name their files."""
    shown = name.encode("utf-8", "surrogateescape").decode("utf-8", "replace")
    return f"the name {shown!r} is not UTF-8, no result could name it; rename the file"


def spread(words: Iterable[str], several: tuple[str, ...]) -> list[str]:
    """Repeat an option before each of its values: ``--model A B`` is ``--model A --model B``."""
    result, option, waiting, plain = [], "", False, False
    for word in words:
        plain = plain or word == "--"
        if plain or (word.startswith("-") and word != "-"):
            option, waiting = word if word in several else "", True
        elif option:
            result += [] if waiting else [option]
            waiting = False
        result.append(word)
    return result


def check_results(*paths: Path | None, force: bool, command: str | None = None) -> None:
    """Refuse, before a long computation, results that could not be written or would be missed.

    Args:
        paths: of the results; None where there is none.
        force: replace what another command wrote.
        command: how this command names itself in what it writes, if not by its command line.

    Raises:
        ValueError: as ``check_writable``; or a file that another command wrote, see ``origins``.
    """
    check_writable(*paths)
    if not force:
        check_replaceable(paths, command or command_line())


def check_writable(*paths: Path | None) -> None:
    """Refuse files that could not be written.

    Raises:
        ValueError: a folder, a place that is no folder or not ours, one file named twice, a file
            that the command reads, or a device.
    """
    chosen = [path for path in paths if path is not None]
    for number, path in enumerate(chosen):
        place = next(p for p in path.absolute().parents if p.exists())
        if path.resolve() in [other.resolve() for other in chosen[:number]]:
            raise ValueError(f"two results cannot both go to {str(path)!r}; rename one")
        if path.exists() and _named(path) > _named_as_result(path):
            raise ValueError(
                f"{str(path)!r} is read by this command; a result never replaces what it was made "
                "of: choose another name"
            )
        if path.exists() and not (path.is_dir() or path.is_file()):
            raise ValueError(f"cannot write {str(path)!r}: it is a device; choose a file")
        if path.is_dir():
            raise ValueError(f"cannot write {str(path)!r}: it is a folder; add a file name")
        if not place.is_dir():
            raise ValueError(f"cannot write {str(path)!r}: {place.name!r} is no folder; rename it")
        if not os.access(path if path.exists() else place, os.W_OK):
            raise ValueError(f"cannot write {str(path)!r}: no permission; choose another place")


def _named(path: Path) -> int:
    """How many words of the command line mean a file, through links, patterns and names."""
    words = [part for word in sys.argv[1:] for part in (word, word.partition("=")[2]) if part]
    files = [name for word in words for name in (glob.glob(word) or [word])]
    files += _by_name()
    return sum(os.path.exists(name) and os.path.samefile(name, path) for name in files)


def _by_name() -> list[Path]:
    """Files that words of the command line mean as names of models and logs."""
    from ident.log import BUNDLED  # takes a while, and is asked of results that exist
    from youbot_env.model_file import MODELS

    found = []
    for before, word in zip(sys.argv, sys.argv[1:], strict=False):
        option, _, name = word.partition("=")
        if not word.startswith("-"):
            # A name behind a flag does not belong to it.
            option, name = before if before.startswith("-") and before not in FLAGS else "", word
        if option in NAMING:
            found += [kind.find(name) for kind in (MODELS, BUNDLED)]
    return [path for path in found if path is not None]


def _named_as_result(path: Path) -> int:
    """How many words of the command line behind an option for results mean that file."""
    found = 0
    for option, word in zip(sys.argv[1:], sys.argv[2:], strict=False):
        name, _, value = option.partition("=")
        word = value or word
        if name in RESULTS and os.path.exists(word):
            found += os.path.samefile(word, path)
    return found


def write_json(path: Path | None, data: dict) -> None:
    """Write results for programs, whole or not at all; numbers that are not finite become null."""
    from youbot_env.model_file import write_atomically

    if path is not None:
        write_atomically(path, json.dumps(_plain(data), indent=2, allow_nan=False) + "\n")


def provenance(
    seed: int | None = None, logs: dict[str, str] | None = None, command: str | None = None
) -> dict[str, Any]:
    """How a result came about, without any absolute path.

    Args:
        seed: of the run.
        logs: SHA-256 of the logs it rests on, by name.
        command: command line, where the true one says more than it should.
    """
    from youbot_env import __version__

    used = {name: version(name.replace("_", "-")) for name in VERSIONED if name in sys.modules}
    return {
        "command": command or command_line(),
        "seed": seed,
        "versions": {"python": sys.version.split()[0], "youbot-workbench": __version__} | used,
        "logs": logs or {},
        "date": datetime.now(UTC).isoformat(timespec="seconds"),
        "git_commit": _git_commit(),
    }


def command_line() -> str:
    """The command line of this run as one can type it again, absolute paths shortened."""
    words = [word for word in sys.argv[1:] if word != "--force"]  # says nothing of the result
    words = [f"{key}{eq}{shown(value)}" for key, eq, value in map(_split_option, words)]
    return f"{called()} {shlex.join(words)}"


def called() -> str:
    """What this command is called as it was started: ``youbot NAME``, or its script."""
    started = Path(sys.argv[0]).name
    return f"python scripts/{started}" if started.endswith(".py") else started


def shown(path: str | os.PathLike) -> str:
    """A path for a record: relative to the working folder, or the bare name if it lies outside."""
    if not os.path.isabs(path):
        return str(path)
    inside = Path(path).is_relative_to(Path.cwd())
    return str(Path(path).relative_to(Path.cwd())) if inside else Path(path).name


def table(title: str, columns: Iterable[str], rows: Iterable[Iterable]) -> None:
    """Print a plain table: the first column of names, the others of numbers or words.

    Words and numbers stay whole: columns wrap between them, names last.  A table whose words do not
    fit is wider than the terminal, which is better than a name nobody can type.
    """
    columns = list(columns)
    cells = [[f"{c:.4g}" if isinstance(c, float) else str(c) for c in row] for row in rows]
    held = list(zip(columns, *cells, strict=True))
    widths = _widths(held, out.width - GAP * (len(columns) - 1))
    drawn = Table(box=None, pad_edge=False, padding=(0, GAP, 0, 0))
    for number, (column, width) in enumerate(zip(columns, widths, strict=True)):
        drawn.add_column(column, justify="right" if number else "left", width=width)
    for row in cells:
        drawn.add_row(*row)
    if title:
        out.print(title, style="italic", soft_wrap=True)
    width = max(out.width, sum(widths) + GAP * len(widths))
    Console(highlight=False, markup=False, emoji=False, width=width).print(drawn)


def _widths(columns: list[tuple[str, ...]], room: int) -> list[int]:
    """Widths of columns of cells: no less than their longest words, what is left to whole cells.

    The names come first, then the columns that lack least.
    """
    widths = [max(len(word) for cell in cells for word in [*cell.split(), ""]) for cells in columns]
    whole = [max(len(line) for cell in cells for line in [*cell.splitlines(), ""])
             for cells in columns]  # fmt: skip
    spare = room - sum(widths)
    others = sorted(range(1, len(widths)), key=lambda k: whole[k] - widths[k])
    for k in [0, *others]:
        more = min(max(spare, 0), whole[k] - widths[k])
        widths[k], spare = widths[k] + more, spare - more
    return [max(width, 1) for width in widths]


@contextmanager
def progress(title: str, total: float, unit: str = "") -> Iterator[Callable[[float], None]]:
    """Show a bar on a terminal, elsewhere a line; the body gets a function to call.

    It takes how much is done.
    """
    if not err.is_terminal:
        err.print(f"{title} ...", soft_wrap=True)
    columns = (
        TextColumn("{task.description}"),
        BarColumn(),
        TextColumn(f"{{task.completed:.0f}}/{{task.total:.0f}} {unit}"),
        TimeRemainingColumn(),
    )
    with Progress(*columns, console=err, transient=True, disable=not err.is_terminal) as bar:
        task = bar.add_task(title, total=total)
        yield lambda done: bar.update(task, completed=done)


@contextmanager
def stages(first: str) -> Iterator[Callable[[str], None]]:
    """Say what is being done: in place on a terminal, elsewhere a line for each new stage."""
    if err.is_terminal:
        with err.status(first) as status:
            yield status.update
        return
    said: list[str] = []

    def tell(what: str) -> None:
        if what not in said:
            err.print(f"{what} ...", soft_wrap=True)
        said.append(what)

    tell(first)
    yield tell


def drawable(characters: str, plain: str) -> str:
    """Characters if the terminal can show them, else the plain ones."""
    try:
        characters.encode(out.encoding)
    except (UnicodeEncodeError, LookupError):
        return plain
    return characters


def section(title: str, sentences: list[str]) -> None:
    """Print sentences under a title, or nothing when there are none."""
    if sentences:
        out.print(f"\n{title}")
        for sentence in sentences:
            width = out.width - 1
            out.print(textwrap.fill(sentence, width, **INDENT), soft_wrap=True)


def in_words(history: dict) -> dict[str, str]:
    """Provenance as name and text."""
    lines = {
        name.replace("_", " "): ", ".join(f"{k} {v}" for k, v in value.items())
        if isinstance(value, dict)
        else str(value)
        for name, value in history.items()
    }
    return {name: text for name, text in lines.items() if text and text != "None"}


def _split_option(word: str) -> tuple[str, str, str]:
    """``--key=value`` in three parts; anything else is all value."""
    return word.partition("=") if word.startswith("--") and "=" in word else ("", "", word)


def _git_commit() -> str | None:
    # An installed package may lie inside the repository of another project.
    if not (ROOT / ".git").exists():
        return None
    command = ["git", "-C", str(ROOT), "rev-parse", "HEAD"]
    try:
        answer = subprocess.run(command, capture_output=True, text=True, timeout=5, check=True)
    except (OSError, subprocess.SubprocessError):
        return None
    return answer.stdout.strip()


def _plain(value: Any) -> Any:
    """The value in types that JSON has."""
    import numpy as np

    if isinstance(value, dict):
        return {str(key): _plain(item) for key, item in value.items()}
    if isinstance(value, np.ndarray):
        return _plain(value.tolist())
    if isinstance(value, list | tuple):
        return [_plain(item) for item in value]
    if isinstance(value, np.generic):
        return _plain(value.item())
    if isinstance(value, float) and not np.isfinite(value):
        return None
    return str(value) if isinstance(value, os.PathLike) else value
