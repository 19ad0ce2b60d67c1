"""A Gymnasium vector environment as Stable-Baselines3 wants it."""

from __future__ import annotations

from typing import Any

import numpy as np
from gymnasium.vector import AutoresetMode, VectorEnv
from stable_baselines3.common.vec_env import VecEnv


class StableVecEnv(VecEnv):
    """Native vector environment behind the ``VecEnv`` of Stable-Baselines3.

    Both worlds must agree on what happens when an episode ends.  Stable-Baselines3 takes the first
    observation of the next episode from the step that ended the last, and looks for the last one
    in ``infos[i]["terminal_observation"]``; an episode cut by time carries
    ``"TimeLimit.truncated"``, so that its value is bootstrapped.  Gymnasium does the same in
    autoreset mode *same step*, with ``final_obs``.  In its default mode, *next step*, an extra
    step without meaning follows each end, which would teach nonsense: it is refused.

    Args:
        env: vector environment in mode ``SAME_STEP``.

    Attributes:
        final_info: of the last step: ``info`` before the ended copies were reset.
        terminated: whether each copy failed in the last step.

    Raises:
        ValueError: another autoreset mode.
    """

    def __init__(self, env: VectorEnv):
        mode = env.metadata.get("autoreset_mode")
        if mode is not AutoresetMode.SAME_STEP:
            raise ValueError(
                f"autoreset_mode = {mode}; Stable-Baselines3 needs same-step resets: make the "
                "environment with autoreset_mode='SameStep'"
            )
        self.env = env
        super().__init__(env.num_envs, env.single_observation_space, env.single_action_space)
        self.final_info: dict[str, Any] = {}
        self.terminated = np.zeros(env.num_envs, bool)

    def reset(self) -> np.ndarray:
        """Start new episodes, seeded by ``seed`` where it was called; returns (copies, d)."""
        observation, self.final_info = self.env.reset(seed=self._seeds)
        self._reset_seeds()
        return np.array(observation)

    def step_async(self, actions: np.ndarray) -> None:
        """Take the actions of the next step."""
        self._actions = actions

    def step_wait(self):
        """Step; returns observations, rewards, ends and one dictionary of information a copy."""
        observation, reward, terminated, truncated, info = self.env.step(self._actions)
        done = terminated | truncated
        infos: list[dict[str, Any]] = [{} for _ in range(self.num_envs)]
        self.final_info = info
        if done.any():
            self.final_info = info["final_info"]
            for i in np.flatnonzero(done):
                infos[i] = {
                    "terminal_observation": info["final_obs"][i],
                    "TimeLimit.truncated": bool(truncated[i] and not terminated[i]),
                }
        self.terminated = terminated
        return np.array(observation), reward.astype(np.float32), done, infos

    def close(self) -> None:
        """Close the environment."""
        self.env.close()

    def get_attr(self, attr_name: str, indices=None) -> list:
        """The attribute of the vector environment, once for each copy asked for."""
        return [getattr(self.env, attr_name)] * len(list(self._get_indices(indices)))

    def set_attr(self, attr_name: str, value: Any, indices=None) -> None:
        """Refuse: the copies share everything."""
        raise AttributeError(f"{attr_name}: the copies share settings")

    def env_method(self, method_name: str, *method_args, indices=None, **method_kwargs) -> list:
        """Refuse: the copies are no objects of their own."""
        raise AttributeError(f"{method_name}: the copies have no methods")

    def env_is_wrapped(self, wrapper_class, indices=None) -> list[bool]:
        """No copy is wrapped by itself."""
        return [False] * len(list(self._get_indices(indices)))
