"""What a policy sees, does and earns while it learns."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from gymnasium import spaces
from stable_baselines3.common.vec_env import VecEnvWrapper

from controllers.rl_features import NAMES, Features
from controllers.rl_residual import Residual
from controllers.training.vec_env import StableVecEnv
from youbot_env.backend import NUMPY


@dataclass(frozen=True)
class Reward:
    """What a step earns.

        mean over scales of 1 / (1 + d^2 / scale^2)  -  change * mean (a - a_before)^2  -  lost

    with ``d^2 = distance^2 + (arm * yaw error)^2`` of the true pose after the step and the actions
    a that the policy chose.  The reward of the environment is flat within the last centimetre;
    here each scale is a slope that leads to the next finer one.

    Attributes:
        scales: m.
        arm: weighs yaw against distance, m.
        change: price of restless torques.
        lost: price of losing the reference, which ends the episode.
    """

    scales: tuple[float, ...] = (0.05, 0.01, 0.002)
    arm: float = 0.5
    change: float = 0.02
    lost: float = 5.0

    def __call__(self, error: tuple, change: np.ndarray, lost: np.ndarray) -> np.ndarray:
        """Rewards (copies,) of pose errors (ahead, left, yaw), action changes and losses."""
        d = error[0] ** 2 + error[1] ** 2 + (self.arm * error[2]) ** 2
        near = sum(1.0 / (1.0 + d / scale**2) for scale in self.scales) / len(self.scales)
        price = self.change * np.mean(change**2, axis=1) + self.lost * lost
        return (near - price).astype(np.float32)


class Lesson(VecEnvWrapper):
    """Features instead of observations, the reward of learning, and computed torque if residual.

    Args:
        venv: the tracking environment, action level ``torque``.
        reward: what is earned.
        residual: controller whose torques the actions correct, or None.
        share: factor on the actions, see ``Policy``.
    """

    def __init__(
        self,
        venv: StableVecEnv,
        reward: Reward,
        residual: Residual | None = None,
        share: float = 1.0,
    ):
        self.task = venv.env.task
        features = spaces.Box(-np.inf, np.inf, (len(NAMES),), np.float32)
        super().__init__(venv, observation_space=features)
        self._features, self._reward = Features(self.task), reward
        self._residual, self._share = residual, share
        self._memory: np.ndarray | None = None
        self._seen = np.zeros((self.num_envs, *venv.observation_space.shape), np.float32)
        self._before = np.zeros((self.num_envs, *self.action_space.shape))
        self._fresh = np.ones(self.num_envs, bool)

    def reset(self) -> np.ndarray:
        """Start new episodes."""
        self._seen, self._fresh[:] = self.venv.reset(), True
        self._before[:] = 0.0
        return self._features(self._seen)

    def step_async(self, actions: np.ndarray) -> None:
        """Send the actions, as a correction of computed torque where there is one."""
        self._chosen, torque = np.clip(actions, -1.0, 1.0), self._share * actions
        if self._residual is not None:
            memory = np.repeat(self._residual.start()[None], self.num_envs, axis=0)
            if self._memory is not None:
                memory = np.where(self._fresh[:, None], memory, self._memory)
            torque, self._memory = self._residual.corrected(
                self._seen, memory, self._share * self._chosen
            )
        self.venv.step_async(torque)

    def step_wait(self):
        """Step; see the base class."""
        self._seen, _, done, infos = self.venv.step_wait()
        error = self._error()
        change = np.where(self._fresh[:, None], 0.0, self._chosen - self._before)
        reward = self._reward(error, change, self.venv.terminated)
        self._before, self._fresh = self._chosen, done.copy()
        for i in np.flatnonzero(done):
            last = infos[i]["terminal_observation"]
            infos[i]["terminal_observation"] = self._features(last[None])[0]
        return self._features(self._seen), reward, done, infos

    def _error(self) -> tuple:
        """True pose errors after the step, before any copy was reset."""
        info = self.venv.final_info
        pose, wanted = tuple(info["pose"].T), tuple(info["reference_pose"].T)
        return self.task.error(pose, NUMPY.cos_sin(pose[2]), wanted, NUMPY)
