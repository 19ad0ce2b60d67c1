"""Log formats, one file each; every ``Loader`` subclass in this folder is found by itself."""

from __future__ import annotations

import importlib
import pkgutil
from functools import cache
from pathlib import Path

from ident.doctor.finding import LogError
from ident.loaders.base import Loader, Table, refuse
from youbot_env.platform import Platform

__all__ = ["Loader", "Table", "find_loader", "loaders", "read"]


@cache
def loaders() -> tuple[Loader, ...]:
    """All loaders, in the order in which they are asked."""
    found = {}
    for module in pkgutil.iter_modules(__path__):
        loaded = importlib.import_module(f"{__name__}.{module.name}")
        for item in vars(loaded).values():
            if isinstance(item, type) and issubclass(item, Loader) and hasattr(item, "identifier"):
                found[item.identifier] = item()
    return tuple(sorted(found.values(), key=lambda loader: -loader.priority))


def find_loader(path: Path) -> Loader:
    """Return the loader that recognises a file or folder.

    Raises:
        LogError: the path does not exist, or no loader recognises it.
    """
    if not path.exists():
        raise refuse(path, f"{str(path)!r} does not exist", "file", "check the path")
    for loader in loaders():
        if loader.recognises(path):
            return loader
    known = ", ".join(loader.title for loader in loaders())
    raise refuse(path, "the format is unknown", "file", f"give one of these: {known}")


def read(path: Path, platform: Platform) -> Table:
    """Read a log of any known format into a table of columns.

    Raises:
        LogError: the file cannot be read, whatever the library that reads it thinks of it.
    """
    loader = find_loader(path)
    try:
        return loader.read(path, platform)
    except (LogError, MemoryError):
        raise
    except BaseException as error:
        # Readers of binary formats panic over damaged files, past ``Exception``.
        panic = type(error).__name__ == "PanicException"
        if not (panic or isinstance(error, Exception)):
            raise
        what = "" if panic else f": {(str(error).splitlines() or [type(error).__name__])[0][:200]}"
        raise refuse(
            path, f"damaged, or no {loader.title} file{what}", "file", "copy or write it again"
        ) from error
