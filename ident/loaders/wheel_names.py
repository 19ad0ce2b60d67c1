"""Which wheel a joint, file or column of somebody else belongs to, by its name."""

from __future__ import annotations

import re
from collections.abc import Iterable

from youbot_env.platform import Platform

CORNERS = {("front", "left"): "fl", ("front", "right"): "fr",
           ("rear", "left"): "rl", ("rear", "right"): "rr"}  # fmt: skip
WORDS = {"back": "rear", "hind": "rear", "forward": "front"}
# Two letters at once: end and side, or side and end.  "rl" is rear left: nobody means right left.
SHORT = {
    "fl": ("front", "left"), "lf": ("front", "left"),
    "fr": ("front", "right"), "rf": ("front", "right"),
    "rl": ("rear", "left"), "bl": ("rear", "left"), "lb": ("rear", "left"),
    "lr": ("rear", "left"),
    "rr": ("rear", "right"), "br": ("rear", "right"), "rb": ("rear", "right"),
}  # fmt: skip
# Joints that stand at a corner and are no wheel.
OTHERS = {"caster", "steer", "steering", "roller", "suspension", "arm", "finger"}
PART = re.compile(r"[A-Z]?[a-z]+|[A-Z]+(?![a-z])|\d+")
JOINED = re.compile(r"^(front|rear|back|left|right)(front|rear|back|left|right)$")


def words_of(text: str) -> list[str]:
    """Words of a name in small letters: ``FrontLeft_wheel1`` is front, left, wheel, 1."""
    found: list[str] = []
    for part in PART.findall(text):
        word = part.lower()
        joined = JOINED.match(word)
        pieces = list(joined.groups()) if joined else list(SHORT.get(word, (word,)))
        found += [WORDS.get(piece, piece) for piece in pieces]
    return found


def corner(text: str) -> str:
    """The corner that a name speaks of (fl, fr, rl, rr), or "" where it is none or several."""
    words = set(words_of(text))
    found = [short for both, short in CORNERS.items() if words >= set(both)]
    return found[0] if len(found) == 1 else ""


def match_wheels(names: Iterable[str], platform: Platform) -> dict[str, str]:
    """Find the name that belongs to each wheel.

    Args:
        names: joints or columns of one kind.
        platform: gives the wheels; corners are known by any usual name, others by their own.

    Returns:
        ``{wheel: name}``; empty where a wheel has no name or several.
    """
    usable = [name for name in names if not OTHERS & set(words_of(name))]
    found: dict[str, str] = {}
    for wheel in platform.wheel_names:
        if wheel in CORNERS.values():
            fitting = [name for name in usable if corner(name) == wheel]
        else:
            own = set(words_of(wheel))
            fitting = [name for name in usable if own <= set(words_of(name))]
        if len(fitting) > 1:
            fitting = [name for name in fitting if "wheel" in words_of(name)]
        if len(fitting) != 1:
            return {}
        found[wheel] = fitting[0]
    return found if len(set(found.values())) == len(found) else {}
