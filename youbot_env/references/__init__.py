"""Reference motions by name; each is an object with a speed (m/s) and a frequency (rad/s)."""

from __future__ import annotations

import os
from pathlib import Path

from youbot_env.arguments import check_kind
from youbot_env.references.base import Motion, Reference, rotate_to_body
from youbot_env.references.calibration import (
    MotionI,
    MotionII,
    MotionIII,
    MotionIV,
    Sequence,
    calibration_sequence,
)
from youbot_env.references.designed import (
    MOTIONS,
    Fourier,
    MotionFileError,
    load_motion,
    save_motion,
)
from youbot_env.references.eased import Eased
from youbot_env.references.harmonic import Circle, Eight, Harmonic, Multisine, SmoothRandom
from youbot_env.references.step import Step
from youbot_env.references.strokes import Joystick, Square

__all__ = [
    "REFERENCES",
    "Circle",
    "Eased",
    "Eight",
    "Fourier",
    "Harmonic",
    "Joystick",
    "Motion",
    "MotionFileError",
    "MotionI",
    "MotionII",
    "MotionIII",
    "MotionIV",
    "Multisine",
    "Reference",
    "Sequence",
    "SmoothRandom",
    "Square",
    "Step",
    "calibration_sequence",
    "load_motion",
    "make_reference",
    "rotate_to_body",
    "save_motion",
]

REFERENCES = {
    "circle": Circle,
    "eight": Eight,
    "multisine": Multisine,
    "step": Step,
    "smooth_random": SmoothRandom,
    "joystick": Joystick,
    "square": Square,
    "I": MotionI,
    "II": MotionII,
    "III": MotionIII,
    "IV": MotionIV,
    "calibration": calibration_sequence,
}


def make_reference(reference: str | os.PathLike | Reference, **options) -> Reference:
    """Return a reference given by name or motion file, or the object itself.

    Args:
        reference: a name of ``REFERENCES``, the name of a shipped motion or the path of a motion
            file, see ``load_motion``, or a ``Reference``.
        **options: arguments of the named reference (speed, frequency, ...).

    Raises:
        ValueError: unknown name or unusable motion file.
        TypeError: no reference at all, or an unknown option.
    """
    if isinstance(reference, Reference):
        if options:
            raise TypeError(f"{sorted(options)}: give options with a name, not with an object")
        return reference
    kinds = (str, os.PathLike)
    check_kind("reference", reference, kinds, "a name, the path of a motion file or a Reference")
    is_file = Path(reference).suffix in (".yaml", ".yml")
    if is_file or (reference not in REFERENCES and MOTIONS.find(reference)):
        if options:
            raise ValueError(
                f"motion file {os.fspath(reference)!r} states its own motion; leave out "
                f"{sorted(options)}"
            )
        return load_motion(reference)
    if reference not in REFERENCES:
        raise ValueError(
            f"unknown reference {reference!r}; known: {sorted(REFERENCES)}, the shipped motions "
            f"{MOTIONS.names()}, or a motion file ending in .yaml"
        )
    return REFERENCES[str(reference)](**options)
