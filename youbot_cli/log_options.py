"""Logs that a user gives a command: found, read with the options that all commands share."""

from __future__ import annotations

import glob
import inspect
import math
from collections.abc import Callable, Sequence
from dataclasses import dataclass, fields, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

from youbot_cli import console
from youbot_cli.names import PLATFORM_LINE

if TYPE_CHECKING:
    from ident.doctor.finding import Finding
    from ident.log import Log
    from youbot_env.model import Model
    from youbot_env.platform_file import GivenPlatform

# Options that take all words up to the next option, for ``console.run``.
SEVERAL = ("--test",)
# What a folder of logs is searched for.
ENDINGS = (".csv", ".tsv", ".txt", ".parquet", ".bag", ".mcap", ".db3")

Logs = Annotated[
    list[str] | None,
    typer.Argument(
        metavar="[LOG ...]",
        help="Logs: files, folders of files, patterns in quotes; the bundled youbot_fit if left.",
    ),
]
Tests = Annotated[
    list[str] | None,
    typer.Option("--test", metavar="LOG ...", help="Logs to judge by, kept out of the fit."),
]


@dataclass(frozen=True)
class LogOptions:
    """How logs are read: the same options for every command.

    Attributes:
        mapping, kt, gear, platform, lever, recording, accept: what the user gave.
    """

    mapping: Annotated[
        list[str] | None,
        typer.Option(
            "--map", metavar="NAME=COLUMN", help="Column of a foreign header; may be repeated."
        ),
    ] = None
    kt: Annotated[
        float | None, typer.Option(help="Torque constant, N m/A, where a log holds currents.")
    ] = None
    gear: Annotated[
        float | None, typer.Option(help="Motor turns per wheel turn, where a log holds currents.")
    ] = None
    platform: Annotated[
        str | None,
        typer.Option(
            metavar="PLATFORM",
            help=f"The robot of the logs: a YAML file (docs/add_a_platform.md), a name, or "
            f"'{PLATFORM_LINE}'; what the log says, else --model's, if left.",
        ),
    ] = None
    lever: Annotated[
        float | None,
        typer.Option(
            metavar="M", help="l + h, m, where it is not that of the wheel table, which is scaled."
        ),
    ] = None
    recording: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME=VALUE",
            help="How the logs were recorded, where that is known: drive_hold=held, "
            "drive_offset=0.02; may be repeated.",
        ),
    ] = None
    accept: Annotated[
        list[str] | None,
        typer.Option(
            metavar="FINDING", help="Use logs in spite of a finding, by its name; may be repeated."
        ),
    ] = None

    def read(
        self,
        model: Model,
        logs: Sequence[str | Path],
        tests: Sequence[str | Path] = (),
        whole: bool = False,
    ) -> tuple[list[Log], list[Log]]:
        """Read logs to fit and logs to judge by; a bad one among several is told and left out.

        Args:
            model: its platform is that of logs that say nothing, unless an option does.
            logs, tests: files, folders and patterns.
            whole: read all rows of files however long they are.

        Raises:
            ValueError: nothing there, no usable log, or a log given twice.
        """
        from ident.doctor import LogError

        given = self.given(model)
        mapping = parse_mapping(self.mapping)
        found: list[list[Log]] = []
        for words in (logs, tests):
            read: list[Log] = []
            files, failed = find_logs(words), []
            for file in files:
                try:
                    read.append(self._load(file, given, mapping, whole))
                except LogError as error:
                    failed.append(error)
            if failed and not read:
                more = f"\n(none of the {len(files)} logs can be used)" if len(files) > 1 else ""
                raise ValueError(f"{failed[0]}{more}") from failed[0]
            for error in failed:
                console.err.print(f"left out: {error}", style="yellow", soft_wrap=True)
            found.append(read)
        refuse_double([*found[0], *found[1]])
        refuse_two_robots([*found[0], *found[1]])
        named = told_once(with_own_names([*found[0], *found[1]]))
        parts = named[: len(found[0])], named[len(found[0]) :]
        return tuple(moving_together(long_together(part)) for part in parts)

    def given(self, model: Model) -> GivenPlatform | None:
        """The platform of an option or of a model that has its own; None where logs may say it."""
        from youbot_env.platform import youbot
        from youbot_env.platform_file import GivenPlatform, read_platform

        if self.lever is not None and not (math.isfinite(self.lever) and self.lever > 0):
            raise ValueError(f"--lever {self.lever}: give l + h in m, a positive number")
        if self.platform is not None:
            return read_platform(self.platform)
        return None if model.platform == youbot() else GivenPlatform(model.platform)

    def used_models(self, models: list[Model], logs: list[Log]) -> list[Model]:
        """Models on the platform of the logs; one that was measured elsewhere keeps its own."""
        from youbot_env.platform import youbot

        given = self.platform is not None or self.lever is not None
        return [used_model(m, logs) if given or m.platform == youbot() else m for m in models]

    def _load(
        self, file: Path, given: GivenPlatform | None, mapping: dict[str, str], whole: bool
    ) -> Log:
        from ident.excerpt import load_excerpt
        from ident.log import Log

        load = Log.load if whole else load_excerpt
        return load(
            file,
            given,
            mapping or None,
            self.kt,
            self.gear,
            recording=self.recording or (),
            accept=tuple(self.accept or ()),
            lever=self.lever,
        )


def reads_logs(command: Callable[..., None]) -> Callable[..., None]:
    """Decorate a command: its parameter ``options`` becomes the options of ``LogOptions``."""
    shared = get_type_hints(LogOptions, include_extras=True)
    signature = inspect.signature(command, eval_str=True)
    parameters = []
    for parameter in signature.parameters.values():
        if parameter.name != "options":
            parameters.append(parameter.replace(kind=inspect.Parameter.KEYWORD_ONLY))
            continue
        parameters += [
            inspect.Parameter(
                field.name, inspect.Parameter.KEYWORD_ONLY,
                default=field.default, annotation=shared[field.name],
            )
            for field in fields(LogOptions)
        ]  # fmt: skip

    def wide(**arguments) -> None:
        chosen = {field.name: arguments.pop(field.name) for field in fields(LogOptions)}
        command(**arguments, options=LogOptions(**chosen))

    expanded: Any = wide
    expanded.__name__, expanded.__doc__ = command.__name__, command.__doc__  # ty: ignore[missing-attribute]
    expanded.__signature__ = signature.replace(parameters=parameters)
    expanded.__annotations__ = {p.name: p.annotation for p in parameters}
    return expanded


def or_bundled(
    logs: list[str] | None, tests: list[str] | None
) -> tuple[list[str | Path], list[str | Path]]:
    """Logs to fit and to judge by; the bundled pair where none is given to fit."""
    from ident.log import BUNDLED

    if logs:
        return list(logs), list(tests or ())
    fit, test = (BUNDLED.folder / f"youbot_{name}.csv" for name in ("fit", "test"))
    return [fit], list(tests or [test])


def find_logs(words: Sequence[str | Path]) -> list[Path]:
    """Files of a command line: patterns are expanded, folders that are no log are looked into.

    The names of bundled logs are known, see ``youbot_env.shipped``.

    Raises:
        ValueError: a word that is no file, or a pattern or folder without logs.
    """
    from ident.log import find_log

    files: list[Path] = []
    for word in words:
        path = find_log(word)
        if path.exists():
            found = [path] if path.is_file() or _is_log(path) else _inside(path)
        else:
            found = [Path(name) for name in sorted(glob.glob(str(word), recursive=True))]
        for file in found:
            if not console.is_text(str(file)):
                raise ValueError(console.not_text(str(file)))
        if not found and path.is_dir():
            raise ValueError(
                f"{console.shown(word)!r} is a folder, and no log lies directly in it (a file "
                f"ending in {', '.join(ENDINGS)}, a ROS 2 bag or a DataTrace); give the folder of "
                "the logs, or a pattern in quotes"
            )
        if not found:
            raise ValueError(
                f"no log {console.shown(word)!r}; check the name, or record one with youbot record"
            )
        files += found
    return files


def _is_log(folder: Path) -> bool:
    from ident.doctor import LogError
    from ident.loaders import find_loader

    try:
        find_loader(folder)
    except LogError:
        return False
    return True


def _inside(folder: Path) -> list[Path]:
    """Logs directly in a folder: files by their endings, and folders that are bags or traces."""
    return sorted(
        path
        for path in folder.iterdir()
        if (path.is_dir() and _is_log(path)) or path.suffix.lower() in ENDINGS
    )


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


def refuse_two_robots(logs: list[Log]) -> None:
    """Refuse logs that name different platforms."""
    for log in logs[1:]:
        if log.platform.geometry != logs[0].platform.geometry:
            raise ValueError(
                f"log {log.source} is of platform {log.platform.name!r}, log {logs[0].source} of "
                f"{logs[0].platform.name!r} with other wheels; give logs of one robot, or the "
                "platform of all with --platform"
            )


def with_own_names(logs: list[Log]) -> list[Log]:
    """Logs whose files have the same name, numbered: results are kept by it."""
    names = [log.source for log in logs]
    count: dict[str, int] = {}
    told = []
    for log in logs:
        count[log.source] = number = count.get(log.source, 0) + 1
        if names.count(log.source) > 1:
            log = replace(log, name=f"{log.name} ({number})", source=f"{log.source} ({number})")
        told.append(log)
    return told


def told_once(logs: list[Log]) -> list[Log]:
    """Logs of which only the first says what would be said of all: the youBot's table was used."""
    from ident.log import YOUBOT_TABLE

    first, told = False, []
    for log in logs:
        kept = tuple(f for f in log.findings if not (first and f.what == YOUBOT_TABLE))
        first |= any(f.what == YOUBOT_TABLE for f in log.findings)
        told.append(log if len(kept) == len(log.findings) else replace(log, findings=kept))
    return told


def long_together(logs: list[Log]) -> list[Log]:
    """Logs without the warning that each is short, where they are given with enough others."""
    from ident.diagnosis.settings import SETTINGS

    if sum(log.duration for log in logs) < SETTINGS.least_seconds:
        return logs
    return [replace(log, findings=tuple(f for f in log.findings if f.name != "short"))
            for log in logs]  # fmt: skip


def moving_together(logs: list[Log]) -> list[Log]:
    """Logs without the warning that an axis hardly moves in each, where another log moves it."""
    still = [{f.what.partition(":")[0] for f in log.findings if f.name == "rest"} for log in logs]
    always = set.intersection(*still) if still else set()

    def kept(finding: Finding) -> bool:
        of_axis = finding.name == "rest" and finding.what.startswith("hardly any")
        return not of_axis or finding.what.partition(":")[0] in always

    return [replace(log, findings=tuple(filter(kept, log.findings))) for log in logs]


def used_model(model: Model, logs: list[Log]) -> Model:
    """The model on the platform with which its logs were read."""
    platform = logs[0].platform
    return model if model.platform == platform else replace(model, platform=platform)


def digests(logs: Sequence[Log]) -> dict[str, str]:
    """SHA-256 of logs by file name, for the provenance of a result."""
    return {log.source: log.digest for log in logs}


def one_or_all(logs: list[Log]) -> Log | list[Log] | None:
    """What functions take that judge by one log or by several: None, the log, or the list."""
    return logs[0] if len(logs) == 1 else logs or None
