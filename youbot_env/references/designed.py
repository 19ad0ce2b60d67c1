"""A motion made for one purpose: explicit sines on three axes, kept in a file of a few lines."""

from __future__ import annotations

import math
import os
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
import yaml

from youbot_env.model_file import write_atomically
from youbot_env.references.harmonic import Harmonic
from youbot_env.schema import MOST_SINES, MOTION, SINE
from youbot_env.shipped import Shipped
from youbot_env.strict_yaml import read_yaml

AXES = ("x", "y", "yaw")
KIND = "fourier"
# Commands of older results name them in models/motions.
MOTIONS = Shipped(Path(__file__).parents[1] / "motions", ".yaml", ("motions", "models/motions"))


class MotionFileError(ValueError):
    """A motion file that cannot be used; the message says where and what to do."""


@dataclass(frozen=True)
class Fourier(Harmonic):
    """Sum of sines at whole multiples of a base frequency on x, y and yaw, world frame.

    ``x(t) = sum_k A_k (sin(k w t + p_k) - sin p_k)``, so the motion starts at the origin with yaw
    zero and repeats every ``period``.

    Attributes:
        speed: largest speed of the centre, m/s (told, not used).
        frequency: base angular frequency w, rad/s.
        amplitudes: A_k of each axis, m, m, rad; as many on every axis.
        phases: p_k of each axis, rad.
        purpose: what the motion is for, in a word.
        about: where it comes from; written to the file.
    """

    frequency: float = 0.5
    amplitudes: tuple[tuple[float, ...], ...] = ((), (), ())
    phases: tuple[tuple[float, ...], ...] = ((), (), ())
    purpose: str = ""
    about: dict[str, Any] = field(default_factory=dict, compare=False)

    def __post_init__(self) -> None:
        super().__post_init__()
        shapes = {len(row) for row in (*self.amplitudes, *self.phases)}
        if len(self.amplitudes) != 3 or len(self.phases) != 3 or len(shapes) != 1:
            raise ValueError(
                f"Fourier: {[len(row) for row in self.amplitudes]} amplitudes and "
                f"{[len(row) for row in self.phases]} phases; give equally many on x, y and yaw"
            )

    @property
    def harmonics(self) -> tuple[int, int, int]:
        """Number of sines on each axis."""
        count = len(self.amplitudes[0])
        return count, count, count

    @property
    def period(self) -> float:
        """Time after which twist and torques repeat, s."""
        return 2 * math.pi / self.frequency

    def draw(self, rng: np.random.Generator) -> np.ndarray:
        """See the base class; nothing is drawn."""
        values = fourier_values(np.array(self.amplitudes), np.array(self.phases), self.frequency)
        return np.array([float(np.ravel(value)[0]) for value in values])


def fourier_values(amplitudes: np.ndarray, phases: np.ndarray, frequency: float) -> list:
    """Values of ``Harmonic.evaluate`` for arrays (..., 3, N) of amplitudes and phases.

    Each value is a column (..., 1), so that many motions can be evaluated on one time grid.
    """
    values: list = []
    for axis in range(3):
        a, p = amplitudes[..., axis, :], phases[..., axis, :]
        start = -np.sum(a * np.sin(p), axis=-1, keepdims=True)
        values += [start, 0.0]
        for k in range(a.shape[-1]):
            values += [a[..., k, None], (k + 1) * frequency, p[..., k, None]]
    return values


def load_motion(source: str | os.PathLike) -> Fourier:
    """Read a motion file.

    Args:
        source: its path, or the name of one in the folder ``motions`` of the working directory or
            of a shipped one (``chirp``, ``m0``, ...).

    Raises:
        MotionFileError: unreadable, malformed, or with missing or unknown entries.
    """
    path = MOTIONS.find(source)
    if path is None:
        raise MotionFileError(
            f"no motion file {str(source)!r}; give one of the shipped motions {MOTIONS.names()} or "
            "the path of a file (youbot design --out writes one)"
        )
    try:
        return _from_dict(read_yaml(path))
    except (yaml.YAMLError, UnicodeDecodeError, TypeError, ValueError) as error:
        raise MotionFileError(f"{path}: {error}") from error


def save_motion(motion: Fourier, path: str | os.PathLike) -> None:
    """Write a motion file, whole or not at all."""
    write_atomically(path, motion_text(motion))


def motion_text(motion: Fourier) -> str:
    """The content of a motion file."""
    lines = [
        "# Calibration motion, world frame: sum over k of A_k sin(k w t + p_k), less its start.",
        "# Each line of x, y, yaw holds [A_k m or rad, p_k rad] for k = 1, 2, ...",
    ]
    head = {
        "kind": KIND, "purpose": motion.purpose, "frequency": float(motion.frequency),
        "speed": float(motion.speed),  # ty: ignore[invalid-argument-type]
    }  # fmt: skip
    lines.append(yaml.safe_dump(head, sort_keys=False).rstrip())
    for axis, amplitudes, phases in zip(AXES, motion.amplitudes, motion.phases, strict=True):
        lines.append(f"{axis}:" if amplitudes else f"{axis}: []")
        pairs = zip(amplitudes, phases, strict=True)
        lines += [f"  - [{_short(a)}, {_short(p)}]" for a, p in pairs]
    if motion.about:
        about = yaml.safe_dump({"about": motion.about}, sort_keys=False, allow_unicode=True)
        lines.append(about.rstrip())
    return "\n".join(lines) + "\n"


def _short(number: float) -> str:
    """Nine digits where they say it exactly, else all."""
    text = f"{number:.9g}"
    return text if float(text) == number else repr(float(number))


def _from_dict(data: object) -> Fourier:
    if not isinstance(data, dict):
        raise ValueError(f"expected entries {list(MOTION.names)}, found {type(data).__name__}")
    unknown = [key for key in data if key not in MOTION.names]
    missing = [key for key in MOTION.needed if key not in data]
    if unknown or missing:
        raise ValueError(
            f"missing entries {missing}, unknown entries {unknown}; a motion file has "
            f"{list(MOTION.names)}"
        )
    if data["kind"] != KIND:
        raise ValueError(f"kind {data['kind']!r} is not known; this version reads {KIND!r}")
    rows = [_pairs(axis, data[axis]) for axis in AXES]
    return Fourier(
        speed=MOTION["speed"].check(float(data.get("speed", 0.3)), ""),
        frequency=MOTION["frequency"].check(float(data["frequency"]), ""),
        amplitudes=tuple(tuple(row[:, 0].tolist()) for row in rows),
        phases=tuple(tuple(row[:, 1].tolist()) for row in rows),
        purpose=str(data.get("purpose", "")),
        about=dict(data.get("about") or {}),
    )


def _pairs(axis: str, entries: Any) -> np.ndarray:
    """Amplitudes and phases (N, 2) of one axis."""
    for number, entry in enumerate(entries if isinstance(entries, list) else [entries], 1):
        whole = isinstance(entry, list) and len(entry) == 2
        if not whole or not all(isinstance(v, int | float) and math.isfinite(v) for v in entry):
            raise ValueError(
                f"{axis}: line {number} holds {entry!r}; give a pair [amplitude, phase] of finite "
                "numbers"
            )
        for part, value in zip(SINE.entries, entry, strict=True):
            part.check(value, f"{axis}, line {number}: ")
    if len(entries) > MOST_SINES:
        raise ValueError(f"{axis}: {len(entries)} sines; give at most {MOST_SINES}")
    return np.array(entries, float).reshape(-1, 2)
