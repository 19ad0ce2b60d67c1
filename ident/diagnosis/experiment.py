"""The motion that would tell rivals apart best, by simulating each of them along a menu."""

from __future__ import annotations

import itertools
from dataclasses import dataclass
from typing import Any

import numpy as np

from ident.diagnosis.menu import SECONDS, menu
from ident.free_values import free_directions
from ident.log import Log
from ident.scaled_fit import output_weights, settled
from ident.sensitivity import COARSE, Linearised
from youbot_env.model import Model
from youbot_env.references import Reference
from youbot_env.simulation import record_closed_loop
from youbot_env.simulation.sensors import IDEAL

# Rate of the simulated records, Hz.
RATE = 50.0
# Errors of a free run remember each other over about this time, s: so long is one observation.
MEMORY = 0.3
# Odds beyond this are as good as certain.
CERTAIN = 1e6


@dataclass(frozen=True)
class Experiment:
    """A motion to record next.

    Attributes:
        motion: name in the menu.
        purpose: what it does, in words.
        minutes: length.
        separates: effects that it tells apart.
        odds: of the true one of the two that look most alike, after the record; None where the
            record is asked for because there is none to rely on.
        alternatives: the other motions with their odds, best first.
    """

    motion: str
    purpose: str
    minutes: float
    separates: tuple[str, ...]
    odds: float | None
    alternatives: tuple[tuple[str, float], ...] = ()

    @property
    def command(self) -> str:
        """What records the motion with a simulated robot."""
        return f"youbot record --motion {self.motion} --seconds {60 * self.minutes:g}"

    def as_dict(self) -> dict[str, Any]:
        """Return what JSON shows."""
        return {
            "motion": self.motion,
            "purpose": self.purpose,
            "minutes": self.minutes,
            "separates": list(self.separates),
            "odds": self.odds,
            "command": self.command,
            "alternatives": [{"motion": name, "odds": odds} for name, odds in self.alternatives],
        }


# What to record where a log decides nothing.
CALIBRATION = Experiment("calibration", "the paper's motions I to IV", 112.0 / 60.0, (), None)


def separating(models: dict[str, Model], error: float) -> Experiment | None:
    """Choose the motion along which rivals differ most.

    Each rival in turn is the robot; how much of its motion another one cannot follow, even after
    all its parameters are fitted again, is counted in units of the error that is there anyway.

    Args:
        models: each rival refined, by effect.
        error: mean squared scaled free-run error of a model that is right.

    Returns:
        None where no motion of the menu tells them apart.
    """
    found = {}
    for name, motion in menu().items():
        if name == CALIBRATION.motion:
            continue  # what it tells beyond the others is in the jumps between its motions
        pairs = itertools.permutations(models.values(), 2)
        distances = [distance(robot, other, motion) for robot, other in pairs]
        # Twice the logarithm of the odds of the robot against its rival.
        found[name] = min(distances) / max(error, 1e-12)
    odds = {name: float(min(np.exp(min(x / 2, 50.0)), CERTAIN)) for name, x in found.items()}
    order = sorted(odds, key=lambda name: -found[name])
    if odds[order[0]] < 2.0:
        return None
    best = order[0]
    purpose = menu()[best].purpose  # ty: ignore[missing-attribute]
    others = tuple((name, odds[name]) for name in order[1:])
    return Experiment(best, purpose, SECONDS / 60.0, tuple(models), odds[best], others)


def distance(robot: Model, other: Model, motion: Reference) -> float:
    """Squared scaled error that ``other`` leaves of ``robot``'s motion, by independent times."""
    times = np.arange(round(SECONDS * RATE)) / RATE
    try:
        channels = record_closed_loop(robot, motion, times, IDEAL, seed=0, fraction=COARSE)
    except ValueError:
        return 0.0
    if not all(np.all(np.isfinite(c)) for c in channels.values()):
        return 0.0
    log = Log("experiment", robot.platform, **channels)
    sim = Linearised.of(log, other)
    weights = output_weights(log)
    directions = free_directions(other)
    moving = np.any(directions != 0, axis=1)
    # The first window starts with a jerk that is no part of the motion.
    columns = settled(sim, sim.value_columns(moving) * weights[:, None])[1:]
    columns = columns.reshape(-1, columns.shape[-1]) @ directions[moving]
    left = settled(sim, sim.residual * weights)[1:]
    shape, left = left.shape, left.reshape(-1)
    if not (np.all(np.isfinite(left)) and np.all(np.isfinite(columns))):
        return 0.0
    scale = np.linalg.norm(columns, axis=0)
    columns = columns / np.where(scale > 0, scale, 1.0)
    left = left - columns @ np.linalg.lstsq(columns, left, rcond=1e-9)[0]
    # A mean over the outputs, as the error is one; each stretch of MEMORY counts once.
    seconds = shape[0] * shape[1] / RATE
    return float(np.mean(left**2)) * seconds / MEMORY * shape[2]
