"""A platform that a user gives: a name, one line of numbers, or a small YAML file.

The file may also say how logs of the robot are read, so that it is said once.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import yaml

from youbot_env import schema
from youbot_env.model_file import ModelFileError, platform_from_dict
from youbot_env.platform import PLATFORMS, Platform, mecanum, youbot
from youbot_env.strict_yaml import read_yaml

LINE = "R=0.05 r=0.015 l=0.15 h=0.2"
LETTERS = {
    "R": "wheel radius, m",
    "r": "roller radius, m",
    "l": "half the distance between left and right wheels, m",
    "h": "half the distance between front and rear wheels, m",
    "m": "mass of a wheel, kg",
}
READING = ("map", "kt", "gear")


@dataclass(frozen=True)
class GivenPlatform:
    """A platform and what is known of its logs.

    Attributes:
        platform: wheel table and radii.
        mapping: ``{log name: column}`` of foreign headers; a column that a log lacks is no error.
        kt: torque constant of a motor, N m/A, or None.
        gear: motor turns per wheel turn, or None.
    """

    platform: Platform
    mapping: dict[str, str] = field(default_factory=dict)
    kt: float | None = None
    gear: float | None = None


def read_platform(text: str) -> GivenPlatform:
    """Read a platform from its name, from ``R=.. r=.. l=.. h=..``, or from a YAML file.

    The file is a model file, or the content of its section ``platform``, or the letters of the
    line, with an optional section ``log`` of ``map``, ``kt`` and ``gear``.

    Raises:
        ModelFileError: none of these, a missing or unknown entry, or wheels that cannot be.
    """
    if text in PLATFORMS:
        return GivenPlatform(PLATFORMS[text]())
    if "=" in text and not Path(text).exists():
        return GivenPlatform(_from_line(text))
    path = Path(text)
    if not path.is_file():
        raise ModelFileError(
            f"no platform {text!r}; give a YAML file, one of {', '.join(PLATFORMS)}, or a line as "
            f"'{LINE}'"
        )
    try:
        return _from_file(read_yaml(path), path.stem)
    except (yaml.YAMLError, UnicodeDecodeError) as error:
        raise ModelFileError(f"{path.name} is not valid YAML: {error}") from error
    except ValueError as error:
        raise ModelFileError(f"{path.name}: {error}") from error


def _from_file(data: object, name: str) -> GivenPlatform:
    if not isinstance(data, dict):
        raise ModelFileError("it holds no entries; write 'wheel_radius: 0.05' and the like")
    data = dict(data)
    log = data.pop("log", None) or {}
    table = data.get("platform", {"name": name, **data})
    if isinstance(table, dict) and "R" in table:
        letters = {key: value for key, value in table.items() if key != "name"}
        platform = _mecanum(str(table.get("name", name)), letters)
    else:
        platform = platform_from_dict(table)
    if not isinstance(log, dict) or set(log) - set(READING):
        raise ModelFileError(f"log: {log!r}; it may hold {', '.join(READING)}")
    mapping = log.get("map") or {}
    if not isinstance(mapping, dict):
        raise ModelFileError(f"log: map = {mapping!r}; write one 'log_name: column' a line")
    numbers = {key: _positive(log[key], key) for key in ("kt", "gear") if log.get(key) is not None}
    return GivenPlatform(platform, {str(k): str(v) for k, v in mapping.items()}, **numbers)


def _from_line(text: str) -> Platform:
    entries: dict[str, object] = {}
    for word in text.replace(",", " ").split():
        letter, _, value = word.partition("=")
        if letter in entries:
            raise ModelFileError(f"platform {text!r}: {letter} stands twice; remove one")
        entries[letter] = value
    return _mecanum("mecanum", entries)


def _mecanum(name: str, entries: dict[str, object]) -> Platform:
    """Four mecanum wheels; a roller radius that is not given is to R as the youBot's."""
    for letter in entries:
        if letter not in LETTERS:
            known = ", ".join(f"{letter} ({words})" for letter, words in LETTERS.items())
            raise ModelFileError(f"{letter!r} is none of {known}; write '{LINE}'")
    missing = [letter for letter in "Rlh" if letter not in entries]
    if missing:
        words = ", ".join(f"{letter} ({LETTERS[letter]})" for letter in missing)
        raise ModelFileError(f"{words} is missing; write '{LINE}'")
    found, usual = {k: _positive(value, k) for k, value in entries.items()}, youbot()
    roller = found.get("r", found["R"] * usual.roller_radius / usual.wheel_radius)
    mass = found.get("m", usual.wheel_mass)
    sizes = {"wheel_radius": found["R"], "roller_radius": roller, "wheel_mass": mass}
    try:
        for key, value in sizes.items():
            schema.PLATFORM[key].check(value, "")
        for letter in "lh":
            schema.WHEEL["distance"].check(found[letter], f"{letter}, a ")
        return mecanum(name, found["l"], found["h"], found["R"], roller, mass)
    except ValueError as error:
        raise ModelFileError(str(error)) from error


def _positive(value: Any, name: str) -> float:
    try:
        number = float(value)
    except (TypeError, ValueError):
        number = math.nan
    if not (math.isfinite(number) and number > 0):
        raise ModelFileError(f"{name} = {value!r} must be a positive number")
    return number
