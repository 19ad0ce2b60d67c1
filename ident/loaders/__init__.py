"""Log formats, one file each.

Every ``Loader`` subclass in this folder is found by itself; ``register`` adds others.
"""

from __future__ import annotations

import importlib
import pkgutil
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache
from pathlib import Path

from ident.doctor.finding import LogError
from ident.loaders.base import Loader, Table, refuse
from youbot_env.arguments import check_free
from youbot_env.platform import Platform

__all__ = [
    "Loader",
    "Table",
    "damage_told",
    "find_loader",
    "loaders",
    "read",
    "register",
    "unregister",
]

# Loaders from outside this folder.
_EXTRA: dict[str, Loader] = {}


def register(loader: type[Loader]) -> type[Loader]:
    """Make a format defined outside this folder known; usable as a decorator.

    It is asked before shipped formats of the same priority.

    Raises:
        TypeError: no subclass of ``Loader``.
        ValueError: it states no identifier or title, lacks ``recognises`` or ``read``, or the
            identifier belongs to another format already.
    """
    if not (isinstance(loader, type) and issubclass(loader, Loader)):
        raise TypeError(f"loader = {loader!r}; give a subclass of ident.loaders.Loader")
    missing = [name for name in ("identifier", "title") if not getattr(loader, name, None)]
    missing += [n for n in ("recognises", "read") if getattr(loader, n) is getattr(Loader, n)]
    if missing:
        raise ValueError(f"loader class {loader.__qualname__} does not state {missing}")
    known = {**_shipped(), **_EXTRA}.get(loader.identifier)
    check_free(f"format {loader.identifier!r}", loader, None if known is None else type(known))
    _EXTRA[loader.identifier] = loader()
    return loader


def unregister(identifier: str) -> None:
    """Forget a format that was registered from outside; no harm if there is none."""
    _EXTRA.pop(identifier, None)


def loaders() -> tuple[Loader, ...]:
    """All loaders, in the order in which they are asked."""
    return tuple(sorted({**_EXTRA, **_shipped()}.values(), key=lambda one: -one.priority))


@cache
def _shipped() -> dict[str, Loader]:
    found = {}
    for module in pkgutil.iter_modules(__path__):
        loaded = importlib.import_module(f"{__name__}.{module.name}")
        for item in vars(loaded).values():
            if isinstance(item, type) and issubclass(item, Loader) and hasattr(item, "identifier"):
                found[item.identifier] = item()
    return found


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
    if path.is_dir():
        what = "it is a folder, and neither a ROS 2 bag nor a DataTrace"
        raise refuse(path, what, "folder", "give the file of a log")
    known = ", ".join(loader.title for loader in loaders())
    raise refuse(path, "the format is unknown", "file", f"give one of these: {known}")


def read(
    path: Path, platform: Platform, loader: Loader | None = None, most_rows: int | None = None
) -> Table:
    """Read a log of any known format into a table of columns.

    Args:
        path: the file or folder.
        platform: whose wheels the columns are of.
        loader: of its format; found if left.
        most_rows: of CSV and Parquet with more the liveliest stretches are read; None for all.

    Raises:
        LogError: the file cannot be read, whatever the library that reads it thinks of it.
    """
    loader = loader or find_loader(path)
    with damage_told(path, f"damaged, or no {loader.title} file", Exception):
        if most_rows is not None:
            return loader.read_excerpt(path, platform, most_rows)
        return loader.read(path, platform)


@contextmanager
def damage_told(path: Path, what: str, *kinds: type[Exception]) -> Iterator[None]:
    """Turn what libraries think of a damaged file into the one error of logs.

    Args:
        path: of the log.
        what: is wrong with it if they fail.
        kinds: of exceptions that are failures of them; panics of libraries in Rust, which go past
            ``Exception``, always are.
    """
    try:
        yield
    except (LogError, MemoryError):
        raise
    except BaseException as error:
        panic = type(error).__name__ == "PanicException"
        if not (panic or isinstance(error, kinds)):
            raise
        text = "" if panic else f": {(str(error).splitlines() or [type(error).__name__])[0][:200]}"
        raise refuse(path, f"{what}{text}", "file", "copy or write it again") from error
