"""One training run: from a recipe and a robot to a policy."""

from __future__ import annotations

import time
from collections.abc import Callable
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np
import torch
from stable_baselines3 import PPO, SAC
from stable_baselines3.common.base_class import BaseAlgorithm
from stable_baselines3.common.callbacks import BaseCallback
from stable_baselines3.common.vec_env import VecMonitor, VecNormalize

import youbot_env
from controllers import find, make
from controllers.training.checkpoint import FILE, Checkpoint
from controllers.training.export import to_policy
from controllers.training.lesson import Lesson
from controllers.training.recipe import Recipe
from controllers.training.trial import Trial, drive
from controllers.training.vec_env import StableVecEnv
from controllers.training.worlds import make_world, motions
from youbot_env.model import Model
from youbot_env.simulation import Sensors

gym.register_envs(youbot_env)

KINDS = {"ppo": PPO, "residual": PPO, "sac": SAC}
ACTIVATIONS = {"tanh": torch.nn.Tanh, "relu": torch.nn.ReLU}
# The policy is looked at, and a checkpoint written, twenty times a run, but not more often than
# is worth its time.
LOOKS, LOOK_STEPS = 20, 10_000
LAST_RATE = 0.02
# Time between two messages on how far a run is, s.
SHOW_EVERY = 0.2
LOOK = Trial("multisine", robots=20, seconds=4.0)


@dataclass(frozen=True)
class Look:
    """The policy at one moment of a run, without exploration.

    Attributes:
        steps: control periods so far.
        seconds: wall time so far.
        reward: mean reward of a step in the episodes that ended last, with exploration.
        position, heading: rms errors of ``Trial``, settled, m and rad.
    """

    steps: int
    seconds: float
    reward: float
    position: float
    heading: float


@dataclass
class Run:
    """A training run.

    Args:
        recipe: how to learn.
        world: robots to learn on, a name of ``worlds.WORLDS``.
        model: the robot in their middle.
        seed: of everything random.
        checkpoints: folder for checkpoints, or None.
        tensorboard: folder for TensorBoard, or None.
        looks: how often the policy is looked at on the way; 20 times, in short runs less, if 0.

    Attributes:
        algorithm: the learner of Stable-Baselines3.
        curve: looks so far.
        seconds: wall time so far.
    """

    recipe: Recipe
    world: str
    model: Model
    seed: int = 0
    checkpoints: Path | None = None
    tensorboard: Path | None = None
    looks: int = 0
    curve: list[Look] = field(default_factory=list, init=False)
    seconds: float = field(default=0.0, init=False)

    def __post_init__(self) -> None:
        torch.set_num_threads(1)
        self.looks = self.looks or max(1, min(LOOKS, self.recipe.steps // LOOK_STEPS))
        self.residual = None
        if self.recipe.algorithm == "residual":
            self.residual = make("residual", self.model, policy="zero")
        self.algorithm = self._make_algorithm(0)
        self.env: VecNormalize = self.algorithm.get_env()

    def resume(self) -> None:
        """Go on from the checkpoint in ``checkpoints``.

        What was learned, and the memory of SAC, are restored to the bit; the episodes in progress
        start anew, with seeds of their own.

        Raises:
            ValueError: no checkpoint there, one of another run, or one that is damaged.
        """
        state = Checkpoint.load(self.checkpoints, self._identity())
        self.algorithm = self._make_algorithm(state.steps)
        self.env = self.algorithm.get_env()
        try:
            state.restore(self.algorithm, self.env)
            self.curve = [Look(**look) for look in state.curve]
        except (TypeError, ValueError) as error:
            raise ValueError(
                f"{self.checkpoints / FILE}: {error}; leave out --resume to start anew"
            ) from error
        self.seconds = state.seconds

    def learn(self, show: Callable[[int, float], None] = lambda steps, speed: None) -> None:
        """Learn until the recipe's number of steps is reached.

        Args:
            show: called now and then with steps so far and steps a second.
        """
        left = self.recipe.steps - self.algorithm.num_timesteps
        if left > 0:
            watch = _Watch(self, show)
            self.algorithm.learn(left, callback=watch, reset_num_timesteps=False)
            watch.clock()
        self.look()

    def look(self) -> Look:
        """Try the policy as it is, add it to the curve and write a checkpoint."""
        episodes = self.algorithm.ep_info_buffer or []
        per_step = [e["r"] / e["l"] for e in episodes]
        trial = drive(
            make(self.recipe.algorithm, self.model, policy=self.policy()), LOOK, self.model
        )
        self.curve.append(
            Look(
                int(self.algorithm.num_timesteps), round(self.seconds, 2),
                float(np.mean(per_step)) if per_step else float("nan"),
                float(trial.position.mean()), float(trial.heading.mean()),
            )
        )  # fmt: skip
        if self.checkpoints is not None:
            state = Checkpoint.of(self.algorithm, self.env, self.seconds, map(asdict, self.curve))
            state.save(self.checkpoints, self._identity())
        return self.curve[-1]

    def policy(self, training: dict[str, Any] | None = None):
        """The policy as it is now."""
        task = self.env.get_attr("task")[0]
        return to_policy(self.algorithm, self.env, self.recipe, task, training or {})

    def _identity(self) -> dict[str, Any]:
        """What a checkpoint must share with the run that goes on from it."""
        return {
            "recipe": {k: v for k, v in self.recipe.as_dict().items() if k != "steps"},
            "world": self.world,
            "model": dict(zip(self.model.names(), self.model.values(), strict=True)),
            "seed": self.seed,
        }

    def _make_algorithm(self, start: int) -> BaseAlgorithm:
        recipe = self.recipe
        seed = int(np.random.SeedSequence([self.seed, start]).generate_state(1)[0])
        robot, randomization = make_world(self.world, self.model)
        shared = find(recipe.algorithm).Settings().shared()
        native = gym.make_vec(
            "YouBot-v0", recipe.copies, vectorization_mode="vector_entry_point",
            autoreset_mode="SameStep", max_episode_steps=recipe.episode, model=robot,
            randomization=randomization, reference=motions(),
            sensors=Sensors() if recipe.noise else None, **shared,
        )  # fmt: skip
        lesson = Lesson(StableVecEnv(native), recipe.reward, self.residual, recipe.share)
        env = VecNormalize(VecMonitor(lesson), gamma=recipe.gamma)
        network = {"net_arch": list(recipe.layers), "activation_fn": ACTIVATIONS[recipe.activation]}
        if recipe.algorithm != "sac":
            network["log_std_init"] = recipe.log_std
        return KINDS[recipe.algorithm](
            "MlpPolicy", env, gamma=recipe.gamma, policy_kwargs=network, device="cpu",
            learning_rate=lambda left: recipe.rate * max(left, LAST_RATE),
            seed=seed, tensorboard_log=self.tensorboard,
            **recipe.extra,
        )  # fmt: skip


class _Watch(BaseCallback):
    """Keeps the time, tells how far the run is, and looks at the policy at equal distances."""

    def __init__(self, run: Run, show: Callable[[int, float], None]):
        super().__init__()
        self._run, self._show = run, show
        self._last = self._shown = time.perf_counter()
        self._begun, self._first = self._last, run.algorithm.num_timesteps
        self._every = run.recipe.steps / run.looks
        self._next = self._first + self._every

    def clock(self) -> None:
        """Add the time since the last call to that of the run."""
        now = time.perf_counter()
        self._run.seconds += now - self._last
        self._last = now

    def _on_step(self) -> bool:
        now = time.perf_counter()
        if now - self._shown > SHOW_EVERY:
            self._shown = now
            self._show(self.num_timesteps, (self.num_timesteps - self._first) / (now - self._begun))
        return True

    def _on_rollout_start(self) -> None:
        if self.num_timesteps >= self._next:
            self._next += self._every
            self.clock()
            self._run.look()
