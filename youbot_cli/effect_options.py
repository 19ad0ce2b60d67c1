"""Effects that a user gives a command: names with sizes, or a file with effects of one's own."""

from __future__ import annotations

from collections.abc import Iterable
from pathlib import Path
from typing import Annotated

import typer

from youbot_cli import console

Effects = Annotated[
    list[str] | None,
    typer.Option(
        "--effect",
        metavar="NAME[.PARAMETER][=VALUE]",
        help="Add a physical effect of docs/effects.md, of typical size where no value is given; "
        "may be repeated.",
    ),
]

EffectsFile = Annotated[
    Path | None,
    typer.Option(
        "--effects",
        metavar="FILE.py",
        help="Python file with effects of your own (docs/add_an_effect.md). IT IS RUN: give none "
        "that you would not run yourself.",
    ),
]


def parse_effects(arguments: Iterable[str] | None) -> dict[str, dict[str, float] | None]:
    """Turn ``NAME``, ``NAME=VALUE`` and ``NAME.PARAMETER=VALUE`` into what ``with_effects`` takes.

    Raises:
        ValueError: an unknown effect, a value that is not a number, or something given twice.
    """
    from youbot_env.effects import get_effect

    effects: dict[str, dict[str, float] | None] = {}
    for argument in arguments or ():
        place, given, text = argument.partition("=")
        name, dot, parameter = place.strip().partition(".")
        first = get_effect(name).parameters[0].name
        if not given:
            if dot:
                raise ValueError(f"--effect {argument}: give a value, {argument}=VALUE")
            if name in effects:
                raise ValueError(f"--effect {argument}: {name} is given twice; leave one out")
            effects[name] = None
            continue
        words = [word for known in get_effect(name).parameters for word in known.choices]
        try:
            value = text if text in words else float(text)
        except ValueError:
            raise ValueError(
                f"--effect {argument}: {text!r} is not a number; write {place}=VALUE, with a "
                "decimal point"
            ) from None
        values, parameter = effects.setdefault(name, {}), parameter if dot else first
        if values is None or parameter in values:
            raise ValueError(f"--effect {argument}: {name} is given twice; leave one out")
        values[parameter] = value
    return effects


def load_effects(path: Path | None) -> tuple[str, ...]:
    """Run a file and make its effects known, if one is given; call it before models are read.

    Raises:
        ValueError: what is wrong with the file.
    """
    from youbot_env.effects_file import load_effects_file

    try:
        return () if path is None else load_effects_file(path)
    except ValueError as error:
        raise ValueError(f"--effects {console.shown(path)}: {error}") from error
