"""Reference motions by name; each is an object with a speed (m/s) and a frequency (rad/s)."""

from __future__ import annotations

from youbot_env.references.base import Motion, Reference, rotate_to_body
from youbot_env.references.calibration import (
    MotionI,
    MotionII,
    MotionIII,
    MotionIV,
    Sequence,
    calibration_sequence,
)
from youbot_env.references.harmonic import Circle, Eight, Harmonic, Multisine, SmoothRandom
from youbot_env.references.step import Step

__all__ = [
    "REFERENCES",
    "Circle",
    "Eight",
    "Harmonic",
    "Motion",
    "MotionI",
    "MotionII",
    "MotionIII",
    "MotionIV",
    "Multisine",
    "Reference",
    "Sequence",
    "SmoothRandom",
    "Step",
    "calibration_sequence",
    "make_reference",
    "rotate_to_body",
]

REFERENCES = {
    "circle": Circle,
    "eight": Eight,
    "multisine": Multisine,
    "step": Step,
    "smooth_random": SmoothRandom,
    "I": MotionI,
    "II": MotionII,
    "III": MotionIII,
    "IV": MotionIV,
    "calibration": calibration_sequence,
}


def make_reference(reference: str | Reference, **options) -> Reference:
    """Return a reference given by name, or the object itself.

    Args:
        reference: a name of ``REFERENCES`` or a ``Reference``.
        **options: arguments of the named reference (speed, frequency, ...).

    Raises:
        ValueError: unknown name; TypeError: unknown option.
    """
    if isinstance(reference, Reference):
        if options:
            raise TypeError(f"{sorted(options)}: give options with a name, not with an object")
        return reference
    if reference not in REFERENCES:
        raise ValueError(f"unknown reference {reference!r}; known: {sorted(REFERENCES)}")
    return REFERENCES[reference](**options)
