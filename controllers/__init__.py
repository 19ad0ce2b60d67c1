"""Controllers by name.

Every ``Controller`` subclass with a name in this folder is found; ``register`` adds others.
"""

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
from youbot_env.arguments import check_free, check_kind
from youbot_env.envs.task import LEVELS
from youbot_env.model import Model
from youbot_env.model_file import load_model

__all__ = [
    "Controller",
    "Settings",
    "controller_names",
    "find",
    "make",
    "register",
    "unregister",
]

# Controllers from outside this folder.
_EXTRA: dict[str, type[Controller]] = {}


@cache
def _found() -> dict[str, type[Controller]]:
    found = {}
    for module in pkgutil.iter_modules(__path__):
        loaded = importlib.import_module(f"{__name__}.{module.name}")
        for item in vars(loaded).values():
            if isinstance(item, type) and issubclass(item, Controller) and "name" in vars(item):
                found[item.name] = item
    return found


def register(controller: type[Controller]) -> type[Controller]:
    """Make a controller defined outside this folder known by its name; usable as a decorator.

    Raises:
        TypeError: no subclass of ``Controller``.
        ValueError: it states no name or level, lacks ``act``, or the name belongs to another
            controller already.
    """
    if not (isinstance(controller, type) and issubclass(controller, Controller)):
        raise TypeError(f"controller = {controller!r}; give a subclass of controllers.Controller")
    what = f"controller class {controller.__qualname__}"
    name = vars(controller).get("name")
    if not (isinstance(name, str) and name):
        raise ValueError(f'{what} states no name; write name = "..." in it')
    if controller.action_level not in LEVELS:
        raise ValueError(
            f"{what}: action_level {controller.action_level!r} is none of {sorted(LEVELS)}"
        )
    if controller.act is Controller.act:
        raise ValueError(f"{what} does nothing; override act")
    known = {**_found(), **_EXTRA}.get(name)
    check_free(f"controller {name!r}", controller, known)
    _EXTRA[name] = controller
    return controller


def unregister(name: str) -> None:
    """Forget a controller that was registered from outside; no harm if there is none."""
    _EXTRA.pop(name, None)


def controller_names() -> tuple[str, ...]:
    """Names that ``make`` knows, sorted."""
    return tuple(sorted({**_found(), **_EXTRA}))


def find(name: str) -> type[Controller]:
    """The class of a controller, to read its ``Settings`` or what it needs.

    Raises:
        ValueError: unknown name.
    """
    known = {**_found(), **_EXTRA}
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
