"""Controllers by name; every ``Controller`` subclass with a name in this folder is found."""

from __future__ import annotations

import difflib
import importlib
import os
import pkgutil
from dataclasses import fields
from functools import cache
from typing import Any

from controllers.base import Controller, Settings
from youbot_env import __version__ as __version__
from youbot_env.arguments import check_kind
from youbot_env.model import Model
from youbot_env.model_file import load_model

__all__ = ["Controller", "Settings", "controller_names", "find", "make"]


@cache
def _found() -> dict[str, type[Controller]]:
    found = {}
    for module in pkgutil.iter_modules(__path__):
        loaded = importlib.import_module(f"{__name__}.{module.name}")
        for item in vars(loaded).values():
            if isinstance(item, type) and issubclass(item, Controller) and "name" in vars(item):
                found[item.name] = item
    return found


def controller_names() -> tuple[str, ...]:
    """Names that ``make`` knows, sorted."""
    return tuple(sorted(_found()))


def find(name: str) -> type[Controller]:
    """The class of a controller, to read its ``Settings`` or what it needs.

    Raises:
        ValueError: unknown name.
    """
    known = _found()
    check_kind("name", name, str, f"one of {sorted(known)}")
    if name not in known:
        near = difflib.get_close_matches(name, known, 1)
        hint = f"did you mean {near[0]!r}? " if near else ""
        raise ValueError(f"unknown controller {name!r}; {hint}known: {sorted(known)}")
    return known[name]


def make(name: str, model: str | os.PathLike | Model, **settings: Any) -> Controller:
    """Make a controller.

    Args:
        name: one of ``controller_names()``.
        model: what it believes about the robot: a model, a model file or a shipped name.
        **settings: fields of the controller's ``Settings``.

    Raises:
        ValueError: unknown name, or a setting with an impossible value.
        TypeError: unknown setting, or one of a wrong type.

    Example:
        >>> controller = make("computed_torque", "paper")
        >>> controller.env_kwargs["action_level"]
        'torque'
    """
    kind = find(name)
    accepted = [field.name for field in fields(kind.Settings)]
    unknown = sorted(set(settings) - set(accepted))
    if unknown:
        raise TypeError(f"controller {name!r} has no setting {unknown}; it has {accepted}")
    return kind(load_model(model), kind.Settings(**settings))
