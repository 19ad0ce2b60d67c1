"""Checks of arguments whose message names the argument, its value and what to give instead."""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from typing import Any


def check_kind(name: str, value: object, kinds: type | tuple[type, ...], wanted: str) -> None:
    """Refuse a value of another type.

    Raises:
        TypeError: names the argument.
    """
    if not isinstance(value, kinds):
        raise TypeError(f"{name} = {value!r} is of type {type(value).__name__}; give {wanted}")


def check_number(name: str, value: object, low: float, high: float = math.inf) -> None:
    """Refuse what is no number from ``low`` to ``high``, both included; NaN is none.

    Raises:
        ValueError: names the argument.
    """
    if isinstance(value, bool) or not isinstance(value, int | float) or not low <= value <= high:
        span = f"from {low:g} to {high:g}" if math.isfinite(high) else f"of at least {low:g}"
        raise ValueError(f"{name} = {value!r}; give a number {span}")


def several(value: object, *single: type) -> list:
    """What was given as a list: one thing of some kinds, or no iterable, counts as one."""
    return [value] if isinstance(value, single) or not isinstance(value, Iterable) else list(value)


def check_free(what: str, kind: type, known: type | None) -> None:
    """Refuse a class under a name that belongs to another one.

    One that is defined anew at the same place takes that of the old.

    Raises:
        ValueError: says where the other class stands.
    """
    places = [f"{one.__module__}.{one.__qualname__}" for one in (known, kind) if one is not None]
    if len(set(places)) > 1:
        raise ValueError(f"{what} exists already: {places[0]}")


def check_names(name: str, value: Any, wanted: str) -> Mapping[str, Any]:
    """Return a mapping whose keys are names.

    Raises:
        TypeError: names the argument.
    """
    check_kind(name, value, Mapping, wanted)
    for key in value:
        check_kind(f"key of {name}", key, str, "a name")
    return value
