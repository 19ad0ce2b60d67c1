"""Physical effects, one file each; every ``Effect`` subclass in this folder is found by itself."""

from __future__ import annotations

import difflib
import importlib
import pkgutil
from collections.abc import Iterator
from contextlib import contextmanager
from functools import cache

from youbot_env.arguments import check_free
from youbot_env.effects.base import Effect, Parameter, Signals

__all__ = [
    "Effect",
    "Parameter",
    "Signals",
    "effect_names",
    "get_effect",
    "left_out",
    "register",
    "unregister",
]

STATED = ("identifier", "title", "equation", "link", "parameters")
LINKS = ("drive", "shaft", "roller", "body", "kinematics", "sensor")
HOOKS = (
    "drive",
    "delay",
    "shaft",
    "roller",
    "body",
    "inertial",
    "kinematics",
    "slip",
    "restore",
)

_EXTRA: dict[str, type[Effect]] = {}
_LEFT_OUT: set[str] = set()


@cache
def _shipped() -> dict[str, type[Effect]]:
    found = {}
    for module in pkgutil.iter_modules(__path__):
        loaded = importlib.import_module(f"{__name__}.{module.name}")
        for item in vars(loaded).values():
            if isinstance(item, type) and issubclass(item, Effect) and hasattr(item, "identifier"):
                found[item.identifier] = item
    return found


def register(effect: type[Effect]) -> type[Effect]:
    """Make an effect defined outside this folder known by its identifier; usable as a decorator.

    Raises:
        ValueError: the class does not state what an effect is, or the identifier belongs to
            another effect already.
    """
    missing = [name for name in STATED if not getattr(effect, name, None)]
    if missing:
        raise ValueError(f"effect class {effect.__qualname__} does not state {missing}")
    if effect.link not in LINKS:
        raise ValueError(f"effect {effect.identifier!r}: link {effect.link!r} is none of {LINKS}")
    if not any(effect.acts(hook) for hook in HOOKS):
        raise ValueError(f"effect {effect.identifier!r} does nothing; override one of {HOOKS}")
    known = {**_shipped(), **_EXTRA}.get(effect.identifier)
    check_free(f"effect {effect.identifier!r}", effect, known)
    _EXTRA[effect.identifier] = effect
    return effect


def unregister(identifier: str) -> None:
    """Forget an effect that was registered from outside this folder; no harm if there is none."""
    _EXTRA.pop(identifier, None)


@contextmanager
def left_out(*identifiers: str) -> Iterator[None]:
    """The library without some effects: diagnosis does not look for them, a robot may have them."""
    before = set(_LEFT_OUT)
    _LEFT_OUT.update(identifiers)
    try:
        yield
    finally:
        _LEFT_OUT.clear()
        _LEFT_OUT.update(before)


def effect_names() -> tuple[str, ...]:
    """Identifiers of all known effects, sorted."""
    return tuple(sorted({**_shipped(), **_EXTRA}.keys() - _LEFT_OUT))


def get_effect(identifier: str) -> Effect:
    """Return the effect of that identifier.

    Raises:
        ValueError: there is none; the message names the nearest.
    """
    known = {**_shipped(), **_EXTRA}
    if identifier not in known:
        near = difflib.get_close_matches(identifier, known, 1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        raise ValueError(
            f"unknown effect {identifier!r}; {hint}known effects: {sorted(known)}; one of your own "
            "is made known by its file, --effects FILE.py"
        )
    return known[identifier]()
