"""Answers of slow questions, kept so that a run that was stopped need not ask them again.

Inside ``keeping`` the slow functions of this package look whether their answer was kept before.  It
counts for equal arguments only, down to the last bit: a record of which one digit differs is
another question.  The store decides about code and settings.
"""

from __future__ import annotations

import hashlib
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from contextvars import ContextVar
from dataclasses import fields, is_dataclass
from typing import Any, Protocol, TypeVar

import numpy as np

from youbot_env.effects import Effect

Answer = TypeVar("Answer")


class Store(Protocol):
    """What keeps answers, in types that JSON has."""

    def find(self, name: str) -> Any:
        """What was kept under a name, or None."""

    def keep(self, name: str, value: Any) -> Any:
        """Keep a value under a name."""


_STORE: ContextVar[Store | None] = ContextVar("store", default=None)


@contextmanager
def keeping(store: Store) -> Iterator[None]:
    """Keep answers in a store while the body runs, in this thread."""
    before = _STORE.set(store)
    try:
        yield
    finally:
        _STORE.reset(before)


def kept(
    what: str,
    asked: Any,
    answer: Callable[[], Answer],
    pack: Callable[[Answer], Any],
    unpack: Callable[[Any], Answer],
) -> Answer:
    """The answer to a question, or what was kept of it.

    Args:
        what: name of the question.
        asked: everything that the answer depends on, see ``fingerprint``.
        answer: finds it; without chance.
        pack: turns an answer into types that JSON has, without rounding.
        unpack: turns that into the same answer again.
    """
    store = _STORE.get()
    if store is None:
        return answer()
    name = f"{what} {fingerprint(asked)}"
    known = store.find(name)
    if known is not None:
        return unpack(known)
    found = answer()
    store.keep(name, pack(found))
    return found


def fingerprint(value: Any) -> str:
    """SHA-256 of a value: numbers, text, arrays, effects, and sequences, mappings, dataclasses.

    Raises:
        TypeError: another type, of which equality means nothing.
    """
    digest = hashlib.sha256()
    _feed(digest.update, value)
    return digest.hexdigest()


def _feed(write: Callable[[bytes], None], value: Any) -> None:
    """Write down a value; kind and length of everything come first, so that nothing runs together.

    A dataclass is its fields: what it has computed besides follows from them.
    """
    if isinstance(value, np.generic):
        value = value.item()
    if value is None or isinstance(value, bool | int | float | str):
        text = repr(value).encode("utf-8", "surrogateescape")
        write(f"{type(value).__name__} {len(text)} ".encode() + text)
    elif isinstance(value, np.ndarray):
        write(f"array {value.dtype.str} {value.shape} ".encode() + value.tobytes())
    elif isinstance(value, Effect):
        _feed(write, ("effect", value.identifier))
    elif isinstance(value, list | tuple):
        write(f"sequence {len(value)} ".encode())
        for item in value:
            _feed(write, item)
    elif isinstance(value, Mapping):
        write(f"mapping {len(value)} ".encode())
        for item in value.items():
            _feed(write, item)
    elif is_dataclass(value) and not isinstance(value, type):
        write(f"{type(value).__name__} ".encode())
        for field in fields(value):
            _feed(write, (field.name, getattr(value, field.name)))
    else:
        raise TypeError(f"{type(value).__name__} has no fingerprint; give what it is made of")
