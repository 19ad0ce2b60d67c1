"""How a controller does on robots and seeds that no training has seen."""

from __future__ import annotations

from dataclasses import dataclass

import gymnasium as gym
import numpy as np

import youbot_env
from controllers.base import Controller
from controllers.evaluation.motions import Motion
from youbot_env.envs.randomization import Randomization
from youbot_env.envs.task import LOST_DISTANCE, LOST_YAW
from youbot_env.model import Model
from youbot_env.simulation import Sensors

gym.register_envs(youbot_env)

# Seeds of trials begin here; those of training are drawn from 32 bits.
FIRST_SEED = 1_000_000


@dataclass(frozen=True)
class Trial:
    """One motion, driven once for every seed; equal seeds give equal motions, starts and noise.

    Attributes:
        motion: name of the reference, as ``controllers.evaluation.motions`` defines it.
        frequency: rad/s.
        robots: number of seeds.
        seconds: length of a run, s.
        settle: the settled errors are those after this time, s.
        noise: whether the observations carry the noise of the sensors.
        seed: the first seed.
    """

    motion: str = "multisine"
    frequency: float = 1.0
    robots: int = 100
    seconds: float = 10.0
    settle: float = 2.0
    noise: bool = True
    seed: int = FIRST_SEED


@dataclass(frozen=True)
class Errors:
    """Rms errors of each run, (robots,); a lost robot counts with the errors that lose it.

    Attributes:
        run: position over the whole run, with the start from a displaced rest, m.
        position: position after ``Trial.settle``, m.
        heading: yaw after ``Trial.settle``, rad.
        lost: whether it lost its reference.
    """

    run: np.ndarray
    position: np.ndarray
    heading: np.ndarray
    lost: np.ndarray

    def as_dict(self) -> dict:
        """Means over the robots, and how many were lost, for JSON."""
        return {
            "run_m": float(self.run.mean()),
            "position_m": float(self.position.mean()),
            "heading_rad": float(self.heading.mean()),
            "lost": int(self.lost.sum()),
        }


def drive(
    controller: Controller, trial: Trial, robot: Model, randomization: Randomization | None = None
) -> Errors:
    """Drive robots side by side.

    Args:
        controller: what drives.
        trial: what is driven.
        robot: the true robot.
        randomization: draws other true robots around it, one for each seed.
    """
    dt = controller.settings.dt
    steps, settle = round(trial.seconds / dt), round(trial.settle / dt)
    envs = gym.make_vec(
        "YouBot-v0", trial.robots, vectorization_mode="vector_entry_point", model=robot,
        randomization=randomization, reference=Motion(trial.motion, trial.frequency).reference,
        sensors=Sensors() if trial.noise else None, max_episode_steps=steps + 1,
        autoreset_mode="SameStep", **controller.env_kwargs,
    )  # fmt: skip
    seen, _ = envs.reset(seed=trial.seed)
    state, start = None, np.ones(trial.robots, bool)
    lost, errors = np.zeros(trial.robots, bool), np.empty((steps, trial.robots, 3))
    for step in range(steps):
        action, state = controller.predict(seen, state, start)
        seen, _, failed, _, info = envs.step(action)
        lost, start = lost | failed, failed
        errors[step] = info["pose"] - info["reference_pose"]
    envs.close()
    yaw = errors[..., 2] ** 2
    square = (errors[..., :2] ** 2).sum(axis=2)
    square[:, lost], yaw[:, lost] = LOST_DISTANCE**2, LOST_YAW**2
    return Errors(
        np.sqrt(square.mean(axis=0)),
        np.sqrt(square[settle:].mean(axis=0)),
        np.sqrt(yaw[settle:].mean(axis=0)),
        lost,
    )
