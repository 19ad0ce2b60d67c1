"""The whole loop as a page in a browser: check, compare, find what is missing, add it, use it."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from youbot_cli import console, effect_options
from youbot_cli.log_options import SEVERAL, Logs, Tests, find_logs, parse_mapping

MISSING = "the page needs NiceGUI: pip install 'youbot-workbench[workbench]'"


def main(
    logs: Logs = None,
    test: Tests = None,
    model: Annotated[
        str, typer.Option(help="Model to start from: model file, nominal or paper.")
    ] = "nominal",
    mapping: Annotated[
        list[str] | None,
        typer.Option("--map", metavar="NAME=COLUMN", help="Column of a foreign header."),
    ] = None,
    platform: Annotated[
        str | None, typer.Option(help="The robot of the logs: a name, a YAML file or a line.")
    ] = None,
    effects: effect_options.EffectsFile = None,
    session: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Open a session that was saved there.")
    ] = None,
    port: Annotated[int | None, typer.Option(help="A free one if left.")] = None,
    host: Annotated[
        str,
        typer.Option(
            help="Address to listen on. Any but this machine's own needs a token, which "
            "is shown with the address."
        ),
    ] = "127.0.0.1",
    token: Annotated[
        str | None, typer.Option(help="Token that other machines have to give; drawn if left.")
    ] = None,
    browser: Annotated[bool, typer.Option(help="Open a browser at the page.")] = True,
    seed: console.Seed = 0,
) -> None:
    """Open the workbench: a local page that shows the whole loop; Ctrl-C ends it."""
    from youbot_env.model_file import load_model

    parse_mapping(mapping)
    effect_options.load_effects(effects)
    settings = None
    if logs:
        load_model(model)
        settings = {
            "logs": _files(logs), "tests": _files(test or ()), "mapping": list(mapping or ()),
            "model": str(Path(model).resolve()) if Path(model).is_file() else model,
            "platform": platform, "seed": seed,
            "effects": None if effects is None else str(effects.resolve()),
        }  # fmt: skip
    elif test:
        raise ValueError("--test without a log to fit; give LOG first")
    try:
        from youbot_workbench.server import serve
    except ImportError as error:
        raise ImportError(f"{MISSING} ({error})") from error
    serve(settings, host, port, token, browser, None if session is None else str(session),
          lambda address: console.out.print(f"workbench: {address}", soft_wrap=True))  # fmt: skip


def _files(words: Sequence[str | Path]) -> list[str]:
    """Logs that words name: bundled ones by their name, others by where they lie."""
    from ident.log import BUNDLED

    found = []
    for word in words:
        bundled = not Path(word).exists() and BUNDLED.find(word) is not None
        found += [str(word)] if bundled else [str(path.resolve()) for path in find_logs([word])]
    return found


def start() -> None:
    """Run the command line."""
    console.run(main, "youbot_fit --test youbot_test", SEVERAL)
