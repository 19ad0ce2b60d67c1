"""Many copies of ``TrackingEnv`` advanced together by NumPy."""

from __future__ import annotations

from typing import Any, ClassVar

import gymnasium as gym
import numpy as np
from gymnasium.utils import seeding
from gymnasium.vector import AutoresetMode, VectorEnv
from gymnasium.vector.utils import batch_space

from youbot_env.backend import NUMPY, NUMPY_FAST
from youbot_env.envs.noise import BLOCK, noise_block
from youbot_env.envs.options import EpisodeOptions, as_numbers, diverged
from youbot_env.envs.reference_buffer import make_buffer
from youbot_env.envs.settings import TrackingSettings
from youbot_env.plant import ModelStructure, State
from youbot_env.simulation import choose_substeps
from youbot_env.simulation.analytic import history_length
from youbot_env.stepping import advance

# Copies of one environment: a million take about 2 GB.
MOST_COPIES = 1_000_000


class TrackingVectorEnv(VectorEnv):
    """The native vector environment behind ``gym.make_vec("YouBot-v0", num_envs=...)``.

    Copy i with seed s + i does what ``gym.make("YouBot-v0", ...)`` does with that seed; arguments,
    spaces, reward and ends are those of ``TrackingEnv``.  Two arguments more: ``autoreset_mode``
    (next step, same step or disabled) and ``max_episode_steps``.
    """

    metadata: ClassVar[dict[str, Any]] = {"render_modes": []}

    def __init__(
        self,
        num_envs: int = 1,
        max_episode_steps: int = 1000,
        autoreset_mode: AutoresetMode | str = AutoresetMode.NEXT_STEP,
        render_mode: str | None = None,
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
        self._high = self.single_observation_space.high[:, None]
        self._structure = ModelStructure.of(self.model)
        self._substeps = choose_substeps(self.model, self.task.dt)
        self._generators: list[np.random.Generator] = []
        self._buffer = make_buffer(self.reference, self.task, num_envs, max_episode_steps)
        self._state: State | None = None

    # Resetting

    def reset(self, *, seed: int | list[int | None] | None = None, options=None):
        """Start new episodes, in all copies or those of ``options["reset_mask"]``."""
        options = dict(options or {})
        mask = options.pop("reset_mask", None)
        chosen = EpisodeOptions.parse(options)
        if chosen.reference is not None:
            raise ValueError("reset option reference: the copies of a vector environment share one")
        if mask is None:
            rows = np.arange(self.num_envs)
        else:
            mask = np.asarray(mask)
            if mask.shape != (self.num_envs,) or mask.dtype != np.bool_ or not mask.any():
                raise ValueError(
                    f"reset_mask must be a boolean array of shape ({self.num_envs},) with a True"
                )
            rows = np.flatnonzero(mask)
        self._seed(seed)
        if self._state is None:
            if mask is not None and len(rows) < self.num_envs:
                raise gym.error.ResetNeeded("call reset() without a mask first")
            self._allocate()
        self._begin(rows, chosen)
        observation = self._observation(self._error())
        return observation, self._info() | self._revealed(rows)

    def _seed(self, seed) -> None:
        if isinstance(seed, int | np.integer):
            seed = [int(seed) + i for i in range(self.num_envs)]
        if seed is None:
            seed = [None] * self.num_envs
        if len(seed) != self.num_envs:
            raise ValueError(f"{len(seed)} seeds for {self.num_envs} copies; give one each")
        if not self._generators:
            self._generators = [seeding.np_random(s)[0] for s in seed]
        for i, s in enumerate(seed):
            if s is not None:
                self._generators[i] = seeding.np_random(s)[0]

    def _allocate(self) -> None:
        n, wheels = self.num_envs, len(self.task.platform.wheels)
        flat = self._structure.flatten(self._structure.rest())
        self._state = self._structure.unflatten(np.zeros(n) for _ in flat)
        self._steps, self._done = np.zeros(n, int), np.zeros(n, bool)
        self._noise, self._drawn = np.zeros((BLOCK, 6, n)), np.zeros(n, int)
        self._integral = tuple(np.zeros(n) for _ in range(wheels))
        nominal = np.array(self.model.values())
        if self.randomization is not None:
            nominal = np.repeat(nominal[:, None], n, axis=1)
        self._robot_values = nominal
        history = history_length(self._structure, self._longest_delay(), self.task.dt)
        self._commands = [tuple(np.zeros(n) for _ in range(wheels)) for _ in range(history)]
        self._bind()

    def _longest_delay(self) -> float:
        if self.randomization is None:
            return self._structure.bind(self.model.values()).delay()
        acting = [effect for effect in self._structure.effects if effect.acts("delay")]
        return sum(effect.parameters[0].bounds[1] for effect in acting)

    def _bind(self) -> None:
        self._robot = self._structure.bind(
            self._robot_values.astype(np.float32)
            if self.randomization
            else self._robot_values.tolist()
        )

    def _begin(self, rows: np.ndarray, chosen: EpisodeOptions) -> None:
        generators = [self._generators[i] for i in rows.tolist()]
        if self.randomization is not None:
            for i, rng in zip(rows, generators, strict=True):
                self._robot_values[:, i] = self.randomization.draw(self.model, rng).values()
            self._bind()
        first = self._buffer.begin(rows, generators)
        uniform = np.array([rng.random(3) for rng in generators])
        if self.sensors is not None:
            for i, rng in zip(rows, generators, strict=True):
                self._noise[:, :, i] = noise_block(self._noise_scale, rng)
        pose, velocity = chosen.start(first, tuple(chosen.offset_from(uniform).T), NUMPY)
        start = self._structure.rest(pose, velocity)
        for component, value in zip(
            self._structure.flatten(self._state), self._structure.flatten(start), strict=True
        ):
            component[rows] = value
        for command in (*self._commands, self._integral):
            for component in command:
                component[rows] = 0.0
        self._steps[rows], self._done[rows], self._drawn[rows] = 0, False, 0

    def _revealed(self, rows: np.ndarray) -> dict[str, Any]:
        """Part of the information at a reset: the true robots, where the user asked for them."""
        if not self.reveal_parameters:
            return {}
        names = self.model.names()
        values = np.reshape(self._robot_values, (len(names), -1))
        shown = np.repeat(values, self.num_envs // values.shape[1], axis=1)
        mask = np.isin(np.arange(self.num_envs), rows)
        parts = dict(zip(names, shown, strict=True))
        parts |= {f"_{name}": mask for name in names}
        return {"true_parameters": parts, "_true_parameters": mask}

    # Stepping

    def step(self, actions):
        """Apply actions (num_envs, n) for ``dt``."""
        if self._state is None:
            raise gym.error.ResetNeeded("call reset() before step()")
        action, task = self._check(actions), self.task
        mode, again = self.metadata["autoreset_mode"], np.flatnonzero(self._done)
        if mode is AutoresetMode.DISABLED and again.size:
            raise gym.error.ResetNeeded(
                f"copies {again[:5].tolist()} have ended; reset them with options['reset_mask']"
            )
        torque = self._torque(action)
        self._commands = [torque, *self._commands[:-1]]
        t = self._time()
        self._state = advance(
            self._robot, self._state, tuple(self._commands), task.dt, self._substeps, t, NUMPY_FAST
        )
        self._steps += 1
        t = self._time()
        self._buffer.advance()
        renewed = mode is AutoresetMode.NEXT_STEP and again.size > 0
        if renewed:
            self._begin(again, EpisodeOptions())
        error = self._error()
        reward, terminated = task.judge(error, action, NUMPY)
        if not np.isfinite(reward.sum()):
            copy = int(np.flatnonzero(~np.isfinite(reward))[0])
            raise diverged(float(t[copy]), f" in copy {copy}")
        truncated = (self._steps >= self.max_episode_steps) | (
            t >= self.reference.duration - task.dt / 2
        )
        if renewed:
            reward[again], terminated[again], truncated[again] = 0.0, False, False
        self._done = terminated | truncated
        observation, info = self._observation(error), self._info()
        if renewed:
            info |= self._revealed(again)
        if mode is AutoresetMode.SAME_STEP and self._done.any():
            observation, info = self._same_step(observation, info)
        return observation, reward, terminated, truncated, info

    def _same_step(self, observation: np.ndarray, info: dict) -> tuple[np.ndarray, dict]:
        ended = self._done.copy()
        rows = np.flatnonzero(ended)
        final = np.full(self.num_envs, None, dtype=object)
        for i in rows:
            final[i] = observation[i].copy()
        last = {**info, **{f"_{name}": ended for name in info if not name.startswith("_")}}
        self._begin(rows, EpisodeOptions())
        observation[rows] = self._observation(self._error(), rows)
        ends = {"final_obs": final, "_final_obs": ended, "final_info": last, "_final_info": ended}
        return observation, self._info() | self._revealed(rows) | ends

    def _check(self, actions) -> tuple:
        given = as_numbers(actions, self.action_space.shape, "actions have")
        # Slopes are evaluated in single precision; the wheel loops (integrals) are not.
        precision = np.float32 if self.task.action_level == "torque" else float
        with np.errstate(over="ignore"):
            array = np.array(given.T, dtype=precision, order="C")
            total = array.sum()
        # A NaN or an infinity anywhere makes the sum so; looking for the place can then be slow.
        if not np.isfinite(total):
            finite = np.isfinite(given)
            if not finite.all():
                copy, wheel = np.argwhere(~finite)[0]
                raise ValueError(
                    f"actions[{copy}, {wheel}] = {given[copy, wheel]}; actions must be finite "
                    "numbers"
                )
            # Finite, but too large for single precision or for a sum.
            array = np.array(np.clip(given, -1.0, 1.0).T, dtype=precision, order="C")
        return tuple(np.clip(array, -1.0, 1.0, out=array))

    def _torque(self, action: tuple) -> tuple:
        task, geometry = self.task, self.task.platform.geometry
        if task.action_level == "torque":
            return tuple(task.torque_limit * a for a in action)
        limits = (task.speed_limit, task.speed_limit, task.yaw_rate_limit)
        twist = tuple(a * limit for a, limit in zip(action, limits, strict=True))
        s = self._robot.signals(
            self._time(), self._state.velocity, self._state.pose, self._state.wheel_angle,
            self._commands[0], NUMPY,
        )  # fmt: skip
        torque, self._integral = self.wheel_loop.torque(
            geometry.wheel_velocity(twist),
            self._robot.wheel_velocity(s, NUMPY, self._state.internal), self._integral, task.dt,
            NUMPY,
        )  # fmt: skip
        return torque

    # Looking

    def _time(self) -> np.ndarray:
        return self._steps * self.task.dt

    def _error(self) -> tuple:
        """Pose error, with the heading that observing needs again."""
        self._heading = NUMPY.cos_sin(self._state.pose[2].astype(np.float32))
        self._wanted = self._buffer.pose()
        return self.task.error(self._state.pose, self._heading, self._wanted, NUMPY_FAST)

    def _observation(self, error: tuple, rows: np.ndarray | None = None) -> np.ndarray:
        velocity = self._state.velocity
        if self.sensors is not None:
            noise = self._next_noise(rows)
            error = tuple(e + k for e, k in zip(error, noise[:3], strict=True))
            velocity = tuple(v + k for v, k in zip(velocity, noise[3:], strict=True))
        flat = self.task.observe(error, velocity, self._heading, ())
        block = np.empty((len(self._high), self.num_envs), np.float32)
        for row, component in enumerate(flat):
            block[row] = component
        block[8:] = self._buffer.twists()
        np.clip(block, -self._high, self._high, out=block)
        return block.T if rows is None else block[:, rows].T

    def _next_noise(self, rows: np.ndarray | None) -> np.ndarray:
        every = np.arange(self.num_envs)
        used = every if rows is None else rows
        for i in used[self._drawn[used] == BLOCK]:
            self._noise[:, :, i] = noise_block(self._noise_scale, self._generators[i])
            self._drawn[i] = 0
        noise = np.zeros((6, self.num_envs))
        noise[:, used] = self._noise[self._drawn[used], :, used].T
        self._drawn[used] += 1
        return noise

    def _info(self) -> dict[str, Any]:
        every = np.ones(self.num_envs, bool)
        info = {
            "time": self._time(),
            "pose": np.array(self._state.pose).T,
            "reference_pose": np.array(self._wanted).T,
            "torque": np.array(self._commands[0]).T,
        }
        return info | {f"_{name}": every for name in info}
