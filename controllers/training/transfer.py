"""How much a controller loses on a robot that has what its training, or its model, lacks."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from controllers.base import Controller
from controllers.evaluation.statistics import Figure, mean, ratio
from controllers.training.exam import MOTIONS, TRIAL
from controllers.training.trial import Trial, drive
from youbot_env.envs.randomization import Randomization
from youbot_env.model import Model


@dataclass(frozen=True)
class Transfer:
    """One controller on robots that it knows and on the hidden one, seed by seed.

    Attributes:
        label: which controller.
        known, hidden: settled position errors (seeds,), rms over all motions, m.
        with_start: the same over the whole runs on the hidden robot, m.
        heading: settled yaw errors on the hidden robot, rad.
        lost: runs on either robot that lost their reference.
    """

    label: str
    known: np.ndarray
    hidden: np.ndarray
    with_start: np.ndarray
    heading: np.ndarray
    lost: int

    @property
    def degradation(self) -> Figure:
        """What the hidden robot costs, m; negative where those of the training are harder."""
        return mean(self.hidden - self.known)

    def as_dict(self) -> dict:
        """What JSON shows."""
        return {
            "known_m": mean(self.known).as_dict(),
            "hidden_m": mean(self.hidden).as_dict(),
            "degradation_m": self.degradation.as_dict(),
            "degradation_factor": ratio(self.hidden, self.known).as_dict(),
            "hidden_with_start_m": mean(self.with_start).as_dict(),
            "hidden_heading_rad": mean(self.heading).as_dict(),
            "lost": self.lost,
        }


def transfer(
    label: str,
    controller: Controller,
    known: Model,
    hidden: Model,
    randomization: Randomization | None = None,
    trial: Trial = TRIAL,
) -> Transfer:
    """Drive every motion on both robots, once for every seed.

    Args:
        label: which controller.
        controller: what drives.
        known: the robot in the middle of its training, or the model it believes.
        hidden: the other robot.
        randomization: draws the robots of its training around the known one.
        trial: seeds, length and noise; its motion is replaced.
    """
    trials = [replace(trial, motion=motion) for motion in MOTIONS]
    before = [drive(controller, one, known, randomization) for one in trials]
    after = [drive(controller, one, hidden) for one in trials]
    return Transfer(
        label,
        _rms([errors.position for errors in before]),
        _rms([errors.position for errors in after]),
        _rms([errors.run for errors in after]),
        _rms([errors.heading for errors in after]),
        sum(int(errors.lost.sum()) for errors in before + after),
    )


def saved(worse: Transfer, better: Transfer) -> Figure:
    """How much smaller the error of the second on the hidden robot is, m, paired by seed."""
    return mean(worse.hidden - better.hidden)


def _rms(errors: list[np.ndarray]) -> np.ndarray:
    return np.sqrt(np.mean(np.square(errors), axis=0))
