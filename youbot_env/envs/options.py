"""Checks of what a user passes to ``reset`` and ``step``, shared by all environments."""

from __future__ import annotations

from dataclasses import dataclass, fields
from typing import Any

import numpy as np

from youbot_env.backend import Ops
from youbot_env.references import Motion, Reference

# Half widths of the random start offset.
OFFSET = (0.05, 0.05, 0.1)


@dataclass(frozen=True)
class EpisodeOptions:
    """What ``reset(options=...)`` may say.

    Attributes:
        offset: start displaced from the reference pose by (ahead, left, yaw), m, m, rad.
        velocity: start velocity (V_X, V_Y, Omega).
        follow: start with the velocity of the reference.
        reference: reference of this episode.
    """

    offset: tuple[float, float, float] | None = None
    velocity: tuple[float, float, float] | None = None
    follow: bool = False
    reference: Reference | None = None

    @classmethod
    def parse(cls, options: dict[str, Any] | None) -> EpisodeOptions:
        """Check names and shapes.

        Raises:
            ValueError: an unknown option or one that is not three finite numbers.
        """
        options = dict(options or {})
        unknown = set(options) - {field.name for field in fields(cls)}
        if unknown:
            raise ValueError(
                f"reset options {sorted(unknown)} are unknown; known: "
                f"{[field.name for field in fields(cls)]}"
            )
        for name in ("offset", "velocity"):
            if options.get(name) is not None:
                value = np.asarray(options[name], float)
                if value.shape != (3,) or not np.isfinite(value).all():
                    raise ValueError(
                        f"reset option {name} = {options[name]!r}; give three finite numbers"
                    )
                options[name] = tuple(value.tolist())
        reference = options.get("reference")
        if reference is not None and not isinstance(reference, Reference):
            raise ValueError(
                f"reset option reference = {reference!r}; give a youbot_env.references.Reference"
            )
        return cls(**options)

    def offset_from(self, numbers) -> tuple:
        """Return the start offset (ahead, left, yaw): the given one, or a random one.

        Three ``numbers`` are drawn in [0, 1) whether they are needed or not, so that an option does
        not change what is drawn after it.
        """
        if self.offset is not None:
            return self.offset
        return tuple(half * (2.0 * u - 1.0) for half, u in zip(OFFSET, numbers, strict=True))

    def start(self, first: Motion, offset: tuple, ops: Ops) -> tuple[tuple, tuple]:
        """Return start pose and body velocity for a reference that begins with ``first``."""
        yaw = first.pose[2]
        c, s = ops.cos_sin(yaw)
        pose = (
            first.pose[0] + offset[0] * c - offset[1] * s,
            first.pose[1] + offset[0] * s + offset[1] * c,
            yaw + offset[2],
        )
        if self.velocity is not None:
            return pose, self.velocity
        return pose, first.twist(ops) if self.follow else (0.0, 0.0, 0.0)


def as_numbers(action, shape: tuple[int, ...], what: str) -> np.ndarray:
    """Return what a user passed to ``step`` as an array of real numbers.

    Args:
        action: anything.
        shape: that it has to have.
        what: it is, for messages: "action has" or "actions have".

    Raises:
        ValueError: not numbers, complex ones, numbers beyond 64 bits, or another shape.
    """
    try:
        array = np.asarray(action)
    except (TypeError, ValueError, OverflowError) as error:
        raise ValueError(f"{what} no shape ({error}); this environment takes {shape}") from error
    if array.shape != shape:
        raise ValueError(f"{what} shape {array.shape}; this environment takes {shape}")
    if array.dtype.kind not in "biuf":
        raise ValueError(f"{what} type {array.dtype}; give real numbers, for example float32")
    return array


def diverged(t: float, where: str = "") -> FloatingPointError:
    """The error of a simulation whose reward is no number any more, at time t, s."""
    return FloatingPointError(
        f"the simulation left the finite numbers at t = {t:.3f} s{where}; use a smaller "
        "torque_limit, or a slower start"
    )


def check_action(action, shape: tuple[int, ...]) -> list[float]:
    """Return the action as floats clipped to [-1, 1].

    Raises:
        ValueError: wrong shape or type, or a value that is not a finite number.
    """
    values = as_numbers(action, shape, "action has").astype(float).tolist()
    for index, value in enumerate(values):
        if not -1.0 <= value <= 1.0:
            if value != value or value in (float("inf"), float("-inf")):
                raise ValueError(f"action[{index}] = {value}; actions must be finite numbers")
            values[index] = 1.0 if value > 0 else -1.0
    return values
