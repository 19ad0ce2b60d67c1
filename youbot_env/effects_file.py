"""Effects of one's own, from a Python file anywhere: the one file that is run as code."""

from __future__ import annotations

import importlib.util
import os
import sys
import traceback
from pathlib import Path

from youbot_env.effects import Effect, register, unregister


def load_effects_file(path: str | os.PathLike) -> tuple[str, ...]:
    """Run a Python file and register the effects it defines; call it before models are read.

    Returns:
        Identifiers of the effects, in the order of the file.

    Raises:
        ValueError: no such file, a mistake in it (told with its line), or no effect in it.
    """
    path = Path(path)
    if path.suffix != ".py" or not path.is_file():
        raise ValueError(
            f"no Python file {path.name!r} with effects; check the name (the file is run as code: "
            "give none that you would not run yourself)"
        )
    name = f"effects_of_{path.stem}"
    spec = importlib.util.spec_from_file_location(name, path)
    assert spec is not None  # of a file that is there and ends in .py
    assert spec.loader is not None
    module = sys.modules[name] = importlib.util.module_from_spec(spec)
    found: list[str] = []
    try:
        spec.loader.exec_module(module)
        # A class may stand under two names.
        own = {
            item: None
            for item in vars(module).values()
            if isinstance(item, type) and issubclass(item, Effect) and item.__module__ == name
        }
        for item in own:
            if hasattr(item, "identifier"):
                found.append(register(item).identifier)
    except Exception as error:  # whatever the file raises is told
        del sys.modules[name]
        for identifier in found:
            unregister(identifier)  # all of a file or nothing
        raise ValueError(
            f"{path.name}{_line(path, error)}: {type(error).__name__}: {error}"
        ) from error
    if not found:
        del sys.modules[name]
        raise ValueError(
            f"{path.name} was run and defines no effect; it needs a subclass of "
            "youbot_env.effects.Effect with an identifier, see docs/add_an_effect.md"
        )
    return tuple(found)


def _line(path: Path, error: Exception) -> str:
    """Tell where in that file an error came from; nothing where its own text does."""
    frames = traceback.extract_tb(error.__traceback__)
    lines = [frame.lineno for frame in frames if Path(frame.filename) == path]
    return f", line {lines[-1]}" if lines else ""
