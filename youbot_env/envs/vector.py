"""Many copies of ``TrackingEnv`` advanced together."""

from __future__ import annotations

import math
from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from youbot_env.arguments import check_kind
from youbot_env.envs.law import Law
from youbot_env.envs.options import EpisodeOptions, as_numbers, diverged
from youbot_env.envs.robots import USUAL, make_robots
from youbot_env.envs.settings import TrackingSettings
from youbot_env.envs.step_buffer import StepBuffer
from youbot_env.plant import State

# Copies of one environment: a million take about 2 GB.
MOST_COPIES = 1_000_000


class TrackingVectorEnv(VectorEnv):
    """The native vector environment behind ``gym.make_vec("YouBot-v0", num_envs=...)``.

    Copy i with seed s + i does what ``gym.make("YouBot-v0", ...)`` does with that seed; arguments,
    spaces, reward and ends are those of ``TrackingEnv``.  Three arguments more: ``autoreset_mode``
    (next step, same step or disabled), ``max_episode_steps``, and ``compiled``.

    Where there is a C compiler, a period of all copies is one call of machine code, which is traced
    from the equations of the single environment and kept in a folder of the user's cache; numbers
    are single precision but for sums over time, and agree with the single environment to 1e-6.
    ``compiled=False`` evaluates the same by NumPy, 5 to 50 times slower, as is done without a
    compiler.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": []}

    def __init__(
        self,
        num_envs: int = 1,
        max_episode_steps: int = 1000,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
        compiled: bool = True,
        **settings: Any,
    ):
        """Make ``num_envs`` copies; ``settings`` are fields of ``TrackingSettings``."""
        if not isinstance(num_envs, int) or not 1 <= num_envs <= MOST_COPIES:
            raise ValueError(
                f"num_envs = {num_envs!r}; give a whole number from 1 to {MOST_COPIES}"
            )
        if render_mode is not None:
            raise ValueError(
                f"render_mode = {render_mode!r}: the native vector environment draws nothing; use "
                'vectorization_mode="sync" or a single environment to look at the robot'
            )
        self.metadata = {**self.metadata, "autoreset_mode": AutoresetMode(autoreset_mode)}
        self.num_envs, self.max_episode_steps = num_envs, max_episode_steps
        chosen = TrackingSettings(**settings)
        self.model, self.task, self.reference = chosen.robot, chosen.task, chosen.followed
        self.randomization, self.reveal_parameters = chosen.randomization, chosen.reveal_parameters
        self.sensors, self.wheel_loop, self._noise_scale = chosen.sensors, chosen.loop, chosen.noise
        self.single_action_space = self.task.action_space
        self.single_observation_space = self.task.observation_space
        self.action_space = batch_space(self.single_action_space, num_envs)
        self.observation_space = batch_space(self.single_observation_space, num_envs)
        check_kind("compiled", compiled, (bool, np.bool_), "True or False")
        self._law = Law.of(chosen)
        self._robots = make_robots(self._law, num_envs, max_episode_steps, bool(compiled))
        self._every = np.arange(num_envs, dtype=np.int32)
        self._shown = np.ones(num_envs, bool)
        self._seen: StepBuffer | None = None

    @property
    def _state(self) -> State:
        """Components of all copies, in place."""
        return self._robots.state

    # Resetting

    def reset(self, *, seed: int | list[int | None] | None = None, options=None):
        """Start new episodes, in all copies or those of ``options["reset_mask"]``."""
        options = dict(options or {})
        mask = options.pop("reset_mask", None)
        chosen = EpisodeOptions.parse(options)
        if chosen.reference is not None:
            raise ValueError("reset option reference: the copies of a vector environment share one")
        if mask is None:
            rows = self._every
        else:
            mask = np.asarray(mask)
            if mask.shape != (self.num_envs,) or mask.dtype != np.bool_ or not mask.any():
                raise ValueError(
                    f"reset_mask must be a boolean array of shape ({self.num_envs},) with a True"
                )
            rows = np.flatnonzero(mask).astype(np.int32)
        if self._seen is None and len(rows) < self.num_envs:
            raise gym.error.ResetNeeded("call reset() without a mask first")
        self._seed(seed)
        self._robots.begin(rows, chosen)
        seen = self._robots.layout.new()
        self._robots.look(self._every, seen)
        self._done = self._done & ~np.isin(self._every, rows) if self._seen else ~self._shown
        self._seen = seen
        return seen.observation, self._info(seen) | self._revealed(rows)

    def _seed(self, seed) -> None:
        if isinstance(seed, int | np.integer):
            seed = [int(seed) + i for i in range(self.num_envs)]
        if seed is None:
            seed = [None] * self.num_envs
        if len(seed) != self.num_envs:
            raise ValueError(f"{len(seed)} seeds for {self.num_envs} copies; give one each")
        old = self._robots.generators
        if not old or any(s is not None for s in seed):
            generators = [
                seeding.np_random(s)[0] if s is not None or rng is None else rng
                for s, rng in zip(seed, old or [None] * self.num_envs, strict=True)
            ]
            self._robots.reseed(generators)

    def _revealed(self, rows: np.ndarray) -> dict[str, Any]:
        """Part of the information at a reset: the true robots, where the user asked for them."""
        if not self.reveal_parameters:
            return {}
        names = self.model.names()
        values = np.asarray(self._robots.values, float).reshape(len(names), -1)
        shown = np.broadcast_to(values, (len(names), max(values.shape[1], self.num_envs)))
        shown = shown[:, : self.num_envs].copy()
        mask = np.isin(np.arange(self.num_envs), rows)
        parts = dict(zip(names, shown, strict=True))
        parts |= {f"_{name}": mask for name in names}
        return {"true_parameters": parts, "_true_parameters": mask}

    # Stepping

    def step(self, actions):
        """Apply actions (num_envs, n) for ``dt``."""
        if self._seen is None:
            raise gym.error.ResetNeeded("call reset() before step()")
        actions = self._check(actions)
        mode, ended = self.metadata["autoreset_mode"], self._done
        if mode is AutoresetMode.NEXT_STEP:
            seen, rows = self._robots.period(actions, ended)
        else:
            if ended.any():
                raise gym.error.ResetNeeded(
                    f"copies {np.flatnonzero(ended)[:5].tolist()} have ended; reset them with "
                    "options['reset_mask']"
                )
            seen, rows = self._robots.step(actions), self._every[:0]
        self._seen, self._done = seen, seen.done
        if not math.isfinite(np.vdot(seen.reward, seen.reward)):
            copy = int(np.flatnonzero(~np.isfinite(seen.reward))[0])
            raise diverged(float(seen.time[copy]), f" in copy {copy}")
        observation, info = seen.observation, self._info(seen)
        if rows.size:
            info |= self._revealed(rows)
        if mode is AutoresetMode.SAME_STEP and self._done.any():
            info = self._same_step(seen, info)
        return observation, seen.reward, seen.terminated, seen.truncated, info

    def _same_step(self, seen: StepBuffer, info: dict) -> dict:
        ended, rows = seen.done.copy(), np.flatnonzero(seen.done).astype(np.int32)
        final = np.full(self.num_envs, None, dtype=object)
        for i in rows:
            final[i] = seen.observation[i].copy()
        last = {name: value.copy() for name, value in info.items() if not name.startswith("_")}
        last |= {f"_{name}": ended for name in last}
        self._robots.begin(rows, USUAL)
        self._robots.look(rows, seen)
        self._done = np.zeros(self.num_envs, bool)
        ends = {"final_obs": final, "_final_obs": ended, "final_info": last, "_final_info": ended}
        return self._info(seen) | self._revealed(rows) | ends

    def _check(self, actions) -> np.ndarray:
        given = as_numbers(actions, self.action_space.shape, "actions have")
        if given.dtype == np.float32:
            array = given
        else:
            with np.errstate(over="ignore"):
                array = given.astype(np.float32)
        total = np.vdot(array, array)
        # A NaN or an infinity anywhere makes the sum so, and one product is the fastest sum.
        if not math.isfinite(total):
            finite = np.isfinite(given)
            if not finite.all():
                copy, wheel = np.argwhere(~finite)[0]
                raise ValueError(
                    f"actions[{copy}, {wheel}] = {given[copy, wheel]}; actions must be finite "
                    "numbers"
                )
            # Finite, but too large for single precision or for a sum.
            array = np.clip(given, -1.0, 1.0).astype(np.float32)
        return array

    def _info(self, seen: StepBuffer) -> dict[str, Any]:
        info = seen.information()
        return info | {f"_{name}": self._shown for name in info}
