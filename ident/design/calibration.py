"""The paper's motions I-IV at their best, as the mark that a designed motion has to beat."""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass

import numpy as np

from ident.design.criterion import Criterion
from ident.design.limits import Limits
from ident.design.noise import Information, NoiseModel
from ident.sequential import CALIBRATION
from youbot_env.model import Model
from youbot_env.references import Reference, Sequence, make_reference

# Samples in a period of the highest of a motion's sines (five times the base frequency).
SAMPLES = 100
# Base frequencies that are tried for each motion: from one period to this, rad/s.
HIGHEST, CHOICES = 8.0, 12
# Steps in which a motion's speed is brought to the limits, and how near it must come.
PASSES, SLACK = 12, 0.01


@dataclass(frozen=True)
class Calibration:
    """Motions I, III, II, IV, a quarter of the time each.

    Attributes:
        reference: the sequence.
        frequencies: base frequency of each motion in that order, rad/s.
        information: in one sample of the sequence.
        searched: combinations of frequencies that were compared.
    """

    reference: Sequence
    frequencies: tuple[float, ...]
    information: Information
    searched: int


def best_calibration(
    criterion: Criterion, model: Model, limits: Limits, seconds: float, noise: NoiseModel
) -> Calibration:
    """Exhaustive search over the base frequencies of I-IV, each with its own.

    Every motion does whole periods in its quarter, as fast as the limits allow.  Where
    one motion ends and the next begins the velocity jumps; that is left to the wheel loops.

    Raises:
        ValueError: a motion that keeps the limits at no frequency.
    """
    quarter = seconds / 4
    choices = [_choices(name, model, limits, quarter, noise) for name in CALIBRATION]
    for name, found in zip(CALIBRATION, choices, strict=True):
        if not found:
            raise ValueError(
                f"motion {name} keeps the limits {limits} at no frequency within {quarter:.3g} s; "
                "allow more yaw acceleration or more time"
            )
    combinations = list(itertools.product(*choices))
    gramian, meat = (
        np.array([sum(getattr(part[1], field) for part in parts) / 4 for parts in combinations])
        for field in ("gramian", "meat")
    )
    together = Information(gramian, meat)
    best = int(np.argmin(criterion.value(together.covariance(1.0))))
    chosen = [reference for reference, _ in combinations[best]]
    return Calibration(
        Sequence(parts=tuple(chosen), lengths=(quarter,) * 4),
        tuple(reference.frequency for reference in chosen),
        Information(gramian[best], meat[best]),
        len(combinations),
    )


def _choices(
    name: str, model: Model, limits: Limits, length: float, noise: NoiseModel
) -> list[tuple[Reference, Information]]:
    """A motion at several base frequencies within the limits, and what it tells."""
    most = max(1.0, HIGHEST * length / (2 * math.pi))
    found = []
    for periods in sorted(set(np.geomspace(1, most, CHOICES).round().astype(int).tolist())):
        frequency = 2 * math.pi * periods / length
        count = SAMPLES * periods
        time = np.arange(count) * length / count
        share = 1.0
        # The motions state the sum of their sines as speed, so the true peak may lie below; where
        # acceleration or torque binds, they must go slower.
        for _ in range(PASSES):
            reference = _motion(name, share, frequency, model, limits)
            columns, use = limits.evaluate(reference.sample(time), model)
            if 1.0 - SLACK < use.max() <= 1.0:
                break
            share *= (1.0 - SLACK / 4) / math.sqrt(use.max())
        if use.max() <= 1.0:
            found.append((reference, noise.information(columns, length / count)))
    return found


def _motion(name: str, share: float, frequency: float, model: Model, limits: Limits) -> Reference:
    """A motion with a share of the limits' speed (and yaw rate, where it has one of its own)."""
    options = {"I": {"platform": model.platform}, "II": {"platform": model.platform}}
    options["IV"] = {"yaw_rate": min(share, 1.0) * limits.yaw_rate}
    speed = share * limits.speed
    return make_reference(name, speed=speed, frequency=frequency, **options.get(name, {}))
