"""Motions that show one kind of behaviour each, and the one that would tell rivals apart best.

``python -m ident.diagnosis.experiments`` writes them to youbot_env/motions, where ``youbot record
--motion`` and the environments find them.
"""

from __future__ import annotations

import itertools
import math
from dataclasses import dataclass
from typing import Any

import numpy as np

from ident.diagnosis.settings import SETTINGS
from ident.log import Log
from ident.parameter_space import free_directions
from ident.residuals import output_weights, settled
from ident.sensitivity import COARSE, Linearised
from youbot_env.model import Model
from youbot_env.references import MOTIONS, Fourier, Reference, calibration_sequence, save_motion
from youbot_env.simulation import record_closed_loop
from youbot_env.simulation.sensors import IDEAL


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
    odds = {
        name: float(min(np.exp(min(x / 2, 50.0)), SETTINGS.certain_odds))
        for name, x in found.items()
    }
    order = sorted(odds, key=lambda name: -found[name])
    if odds[order[0]] < 2.0:
        return None
    best = order[0]
    purpose = menu()[best].purpose  # ty: ignore[missing-attribute]
    others = tuple((name, odds[name]) for name in order[1:])
    return Experiment(
        best, purpose, SETTINGS.experiment_seconds / 60.0, tuple(models), odds[best], others
    )


def distance(robot: Model, other: Model, motion: Reference) -> float:
    """Squared scaled error that ``other`` leaves of ``robot``'s motion, by independent times."""
    times = (
        np.arange(round(SETTINGS.experiment_seconds * SETTINGS.experiment_rate))
        / SETTINGS.experiment_rate
    )
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
    # A mean over the outputs, as the error is one; each stretch that errors remember counts once.
    seconds = shape[0] * shape[1] / SETTINGS.experiment_rate
    return float(np.mean(left**2)) * seconds / SETTINGS.error_memory * shape[2]


def menu() -> dict[str, Reference]:
    """Motions by name; those other than ``calibration`` are files of that name."""
    return {
        "calibration": calibration_sequence(seconds=SETTINGS.experiment_seconds),
        "slow_ramps": _sines(0.25, "slow ramps through zero",
                             ((1, 0.12, 0.0), (3, 0.03, 1.0)), ((1, 0.12, 2.0), (2, 0.05, 0.4)),
                             ((1, 0.25, 4.0), (3, 0.1, 2.0))),
        "fast_reversals": _sines(1.5, "fast reversals",
                                 ((1, 0.15, 0.0), (2, 0.15, 1.0)), ((1, 0.12, 2.1), (3, 0.12, 0.3)),
                                 ((2, 0.4, 4.0), (3, 0.3, 0.9))),
        "spin": _sines(0.5, "spin on the spot", (), (), ((1, 0.8, 0.0), (3, 0.3, 1.3))),
        "four_headings": _sines(0.1, "straight runs at all headings",
                                ((4, 0.22, 0.0), (10, 0.08, 1.0)),
                                ((5, 0.22, 2.0), (11, 0.08, 0.2)), ((1, 0.45, 0.0),)),
        "chirp": _sines(0.5, "oscillations up to 3 Hz",
                        tuple((n, 0.12 / math.sqrt(n), 1.7 * n) for n in (1, 2, 4, 8, 16, 36)),
                        tuple((n, 0.12 / math.sqrt(n), 2.3 * n) for n in (1, 3, 5, 10, 20, 32)),
                        tuple((n, 0.35 / math.sqrt(n), 0.9 * n) for n in (1, 2, 6, 12, 24))),
        "fast": _sines(0.4, "large speeds",
                       ((1, 0.35, 0.0), (3, 0.15, 1.0)), ((2, 0.3, 2.0), (3, 0.12, 0.1)),
                       ((1, 0.6, 3.0), (4, 0.3, 1.0))),
        "single_wheel": _sines(0.6, "wheels turning alone: forward, sideways and yaw together",
                               ((1, 0.15, 0.0), (2, 0.1, 0.0)), ((1, 0.15, math.pi), (3, 0.1, 0.0)),
                               ((1, 0.39, 0.0), (2, 0.2, math.pi))),
    }  # fmt: skip


def _sines(frequency: float, purpose: str, *axes: tuple[tuple[int, float, float], ...]) -> Fourier:
    """Motion of (harmonic, peak speed, phase) on x, y (m/s) and yaw (rad/s)."""
    count = max(n for sines in axes for n, _, _ in sines)
    amplitudes, phases = [], []
    for sines in axes:
        sizes, starts = [0.0] * count, [0.0] * count
        for n, speed, phase in sines:
            sizes[n - 1] = speed / (n * frequency)
            starts[n - 1] = math.remainder(phase, 2 * math.pi)
        amplitudes.append(tuple(sizes))
        phases.append(tuple(starts))
    speed = sum(speed for sines in axes[:2] for _, speed, _ in sines)
    return Fourier(speed=max(speed, 0.01), frequency=frequency, amplitudes=tuple(amplitudes),
                   phases=tuple(phases), purpose=purpose)  # fmt: skip


if __name__ == "__main__":
    for name, motion in menu().items():
        if isinstance(motion, Fourier):
            save_motion(motion, MOTIONS.folder / f"{name}.yaml")
