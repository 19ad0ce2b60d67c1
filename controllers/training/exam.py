"""Is a policy better than the kinematic controller?  Paired runs, seed by seed."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from controllers import make
from controllers.base import Controller
from controllers.evaluation.statistics import Figure, ratio
from controllers.training.trial import Errors, Trial, drive
from youbot_env.envs.randomization import Randomization
from youbot_env.model import Model

MOTIONS = ("multisine", "eight", "circle")
TRIAL = Trial()


@dataclass(frozen=True)
class Mark:
    """One motion of the exam.

    Attributes:
        trial: what was driven.
        policy, kinematic: errors of both.
        times: how many times smaller the settled position error of the policy is.
        wins: share of seeds on which it is smaller.
    """

    trial: Trial
    policy: Errors
    kinematic: Errors
    times: Figure
    wins: float

    @property
    def passed(self) -> bool:
        """Whether the policy is better beyond chance, on average over the seeds."""
        return not self.policy.lost.any() and self.times.low > 1.0

    def as_dict(self) -> dict:
        """What JSON shows; errors are means over the seeds."""
        sides = {"policy": self.policy, "kinematic": self.kinematic}
        return {
            "motion": self.trial.motion, "frequency": self.trial.frequency,
            "seeds": [self.trial.seed, self.trial.seed + self.trial.robots - 1],
            **{name: errors.as_dict() for name, errors in sides.items()},
            "times_better": self.times.as_dict(), "wins": self.wins, "passed": self.passed,
        }  # fmt: skip


def examine(
    controller: Controller,
    robot: Model,
    randomization: Randomization | None = None,
    trial: Trial = TRIAL,
    show: Callable[[int], None] | None = None,
) -> list[Mark]:
    """Drive a policy and the kinematic controller along every motion.

    Args:
        controller: the policy.
        robot: the true robot.
        randomization: draws other true robots around it, one for each seed.
        trial: seeds, length and noise; its motion is replaced.
        show: called with the number of motions done.
    """
    marks, rival = [], make("kinematic", robot)
    for number, motion in enumerate(MOTIONS, start=1):
        chosen = replace(trial, motion=motion)
        ours, theirs = (drive(one, chosen, robot, randomization) for one in (controller, rival))
        times = ratio(theirs.position, ours.position)
        wins = float(np.mean(ours.position < theirs.position))
        marks.append(Mark(chosen, ours, theirs, times, wins))
        if show is not None:
            show(number)
    return marks
