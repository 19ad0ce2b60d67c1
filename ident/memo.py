"""Intermediate results that models evaluated in a row share."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from youbot_env.dynamics import Theta
from youbot_env.model import Model

# Results that are kept for the next models.
RECENT = 16


class Memo:
    """The results used last, by key."""

    def __init__(self) -> None:
        self._kept: dict[tuple, Any] = {}

    def of(self, key: tuple, make: Callable[[], Any]) -> Any:
        """What was made for a key before, or now."""
        found = self._kept.pop(key) if key in self._kept else make()
        while len(self._kept) >= RECENT:
            self._kept.pop(next(iter(self._kept)))
        self._kept[key] = found  # in the order of last use
        return found


def part_of(model: Model, values, hooks: tuple[str, ...]) -> tuple:
    """Effects of a model that override one of some hooks, with their values: part of a key."""
    at, found = len(Theta._fields), []
    for active in model.effects:
        size = len(active.values)
        if any(active.effect.acts(hook) for hook in hooks):
            found.append((active.identifier, tuple(active.values), tuple(values[at : at + size])))
        at += size
    return tuple(found)
