"""What a controller is: observation in, action out, and a memory the caller may keep.

The calls are those of Stable-Baselines3, so its ``evaluate_policy`` runs every controller, on one
robot or on many at once.  A controller sees observations and a model, nothing else.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any, ClassVar

import numpy as np

from youbot_env.arguments import check_kind
from youbot_env.envs.task import TrackingTask
from youbot_env.model import Model


@dataclass(frozen=True, kw_only=True)
class Settings:
    """What the controller and the environment must agree on; subclasses add gains.

    Attributes:
        dt: control period, s.
        preview: number of future reference twists in the observation.
        preview_stride: control periods between two of them.
        torque_limit: torque of action 1, N m.
        speed_limit, yaw_rate_limit: body velocities of action 1 on the kinematic level, m/s and
            rad/s.
    """

    dt: float = 0.01
    preview: int = 5
    preview_stride: int = 1
    torque_limit: float = 4.0
    speed_limit: float = 0.8
    yaw_rate_limit: float = 1.6

    def require_positive(self, *names: str) -> None:
        """Raise ``ValueError`` where a setting is not a positive finite number."""
        for name in names:
            value = getattr(self, name)
            if isinstance(value, bool) or not (
                isinstance(value, int | float) and 0 < value < math.inf
            ):
                raise ValueError(f"{name} = {value!r}; give a positive number")


class Controller:
    """Base of all controllers.

    A subclass in a file of this folder that has a ``name`` is found by ``make``.

    Class attributes:
        name: what ``make`` calls it.
        action_level: ``torque`` or ``velocity``, see ``youbot_env.envs.tracking``.
        uses_model: whether another model of the same platform changes what it does.
        Settings: dataclass of its settings.

    Attributes:
        model: what the controller believes about the robot.
        settings: its settings.
        task: layout of observation and action.
    """

    name: ClassVar[str]
    action_level: ClassVar[str] = "torque"
    uses_model: ClassVar[bool] = True
    Settings: ClassVar[type[Settings]] = Settings

    def __init__(self, model: Model, settings: Settings):
        check_kind("model", model, Model, "a Model, as load_model returns it")
        check_kind("settings", settings, Settings, "the controller's Settings")
        self.settings = settings
        shared = {field.name: getattr(settings, field.name) for field in fields(Settings)}
        self.task = TrackingTask(model.platform, self.action_level, **shared)
        self._length = self.task.observation_space.shape[0]
        self._memory: np.ndarray | None = None
        self.set_model(model)

    @property
    def env_kwargs(self) -> dict[str, Any]:
        """Arguments that an environment for this controller needs.

        For example ``gym.make("YouBot-v0", model=robot, **controller.env_kwargs)``.
        """
        shared = {field.name: getattr(self.settings, field.name) for field in fields(Settings)}
        return {"action_level": self.action_level, **shared}

    def set_model(self, model: Model) -> None:
        """Believe another model of the same platform from now on, e.g. an identified one.

        Raises:
            ValueError: the model has other wheels.
            ImpossibleParameters: no robot can have these parameters.
        """
        if model.platform != self.task.platform:
            raise ValueError(
                f"model {model.name!r} is of platform {model.platform.name!r}, this controller was "
                f"made for {self.task.platform.name!r}; make another controller"
            )
        self.model = model.check()
        self.reset()

    def reset(self) -> None:
        """Forget what was seen and commanded."""
        self._memory = None

    def predict(self, observation, state=None, episode_start=None, deterministic: bool = True):
        """Return ``(action, state)`` for one observation or a batch of them.

        Args:
            observation: (d,) or (robots, d), as ``TrackingEnv`` describes it.
            state: what the previous call returned; None lets the controller use the one it kept
                since ``reset``.
            episode_start: whether each observation is the first of an episode, a bool or
                (robots,); None says none is, except right after ``reset``.
            deterministic: accepted as in Stable-Baselines3; nothing here is random.

        Returns:
            Actions in [-1, 1], (n,) or (robots, n) float32, and the memory, (m,) or (robots, m).

        Raises:
            ValueError: an observation of another size, or one that is not finite.
        """
        seen = np.asarray(observation, float)
        single = seen.ndim == 1
        seen = np.atleast_2d(seen)
        self._check(seen)
        kept = self._memory if state is None else np.atleast_2d(np.asarray(state, float))
        start = self.start()
        if kept is None or (state is None and len(kept) != len(seen)):
            kept = np.repeat(start[None], len(seen), axis=0)
        elif kept.shape != (len(seen), len(start)):
            raise ValueError(
                f"state has shape {kept.shape}, {len(seen)} observations need "
                f"{(len(seen), len(start))}; pass what predict() returned, or None"
            )
        if episode_start is not None and np.any(episode_start):
            kept = np.where(np.reshape(episode_start, (-1, 1)), start, kept)
        action, memory = self.act(seen, kept)
        self._memory = memory
        action = np.clip(action, -1.0, 1.0).astype(np.float32)
        return (action[0], memory[0]) if single else (action, memory)

    def start(self) -> np.ndarray:
        """Memory (m,) at the start of an episode; never empty."""
        return np.zeros(1)

    def act(self, seen: np.ndarray, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return actions (robots, n) and new memory (robots, m); subclasses implement it."""
        raise NotImplementedError

    def _check(self, seen: np.ndarray) -> None:
        if seen.ndim != 2 or seen.shape[1] != self._length:
            raise ValueError(
                f"observation has shape {seen.shape[-2:]}, controller {self.name!r} needs "
                f"(..., {self._length}); make the environment with **controller.env_kwargs = "
                f"{self.env_kwargs}"
            )
        if not np.isfinite(seen.sum()):
            row, column = np.argwhere(~np.isfinite(seen))[0]
            raise ValueError(f"observation[{row}, {column}] = {seen[row, column]} is not finite")
