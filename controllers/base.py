"""What a controller is: observation in, action out, and a memory the caller may keep.

The calls are those of Stable-Baselines3, so its ``evaluate_policy`` runs every controller, on one
robot or on many at once.  A controller sees observations and a model, nothing else.  Samples that
no robot can have moved to are replaced before it sees them (``Gate``); for those that are no
numbers at all, ``on_invalid`` says what to do.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, fields
from typing import Any, ClassVar

import numpy as np

from controllers.guard import Guard
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
        on_invalid: what to do at an observation with a number that is not finite, or whose
            velocities repeat while the robot cannot have kept them (``Frozen``): ``raise`` a
            ``ValueError``; ``hold`` the last action, for 0.1 s at most, then brake; ``brake``.
            To brake is to command velocity 0 where wheel-speed loops follow, and else the torques,
            N m over ``torque_limit``, with which the model slows down from the last known velocity
            with a time constant of 0.2 s.
        gate: whether finite samples that no robot can have moved to are replaced, see ``Gate``, and
            velocities that stand still are told.
    """

    dt: float = 0.01
    preview: int = 5
    preview_stride: int = 1
    torque_limit: float = 4.0
    speed_limit: float = 0.8
    yaw_rate_limit: float = 1.6
    on_invalid: str = "raise"
    gate: bool = True

    def shared(self) -> dict[str, Any]:
        """What the environment must know too: arguments of ``TrackingTask``."""
        own = ("on_invalid", "gate")
        names = [field.name for field in fields(Settings) if field.name not in own]
        return {name: getattr(self, name) for name in names}

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
        self.task = TrackingTask(model.platform, self.action_level, **settings.shared())
        self._length = self.task.observation_space.shape[0]
        self._memory: np.ndarray | None = None
        self.set_model(model)

    @property
    def env_kwargs(self) -> dict[str, Any]:
        """Arguments that an environment for this controller needs.

        For example ``gym.make("YouBot-v0", model=robot, **controller.env_kwargs)``.
        """
        return {"action_level": self.action_level, **self.settings.shared()}

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
        self._guard = Guard(model, self.task, self.settings)
        self.reset()

    def reset(self) -> None:
        """Forget what was seen and commanded."""
        self._memory = None

    def predict(
        self,
        observation,
        state=None,
        episode_start=None,
        deterministic: bool = True,
        wheel_angle=None,
    ):
        """Return ``(action, state)`` for one observation or a batch of them.

        Args:
            observation: (d,) or (robots, d), as ``TrackingEnv`` describes it.
            state: what the previous call returned; None lets the controller use the one it kept
                since ``reset``.
            episode_start: whether each observation is the first of an episode, a bool or
                (robots,); None says none is, except right after ``reset``.
            deterministic: accepted as in Stable-Baselines3; nothing here is random.
            wheel_angle: (n,) or (robots, n), rad, what the encoders show now
                (``env.unwrapped.wheel_angle``), zero where it was zero in the log that the model
                was identified from.  Only models whose effects read it gain by it; None lets the
                controller reckon it from the velocities.

        Returns:
            Actions in [-1, 1], (n,) or (robots, n) float32, and the memory, (m,) or (robots, m).

        Raises:
            ValueError: an observation or wheel angles of another size, or an observation that is
                not finite, or whose velocities stand still, where ``on_invalid`` is ``raise``.
        """
        seen = np.asarray(observation, float)
        single = seen.ndim == 1
        seen = np.atleast_2d(seen)
        self._check(seen)
        kept = self._memory if state is None else np.atleast_2d(np.asarray(state, float))
        own = self.start()
        start = np.concatenate([own, np.zeros(self._guard.size)])
        if kept is None or (state is None and len(kept) != len(seen)):
            kept = np.repeat(start[None], len(seen), axis=0)
        elif kept.shape != (len(seen), len(start)):
            raise ValueError(
                f"state has shape {kept.shape}, {len(seen)} observations need "
                f"{(len(seen), len(start))}; pass what predict() returned, or None"
            )
        if episode_start is not None and np.any(episode_start):
            kept = np.where(np.reshape(episode_start, (-1, 1)), start, kept)
        kept, guard = np.hsplit(kept, [len(own)])
        kept = np.where(self._guard.known(guard), kept, own)
        if wheel_angle is not None:
            kept = self.turned(kept, self._checked_angle(wheel_angle, len(seen)))
        seen, guard = self._guard.admit(seen, guard)
        action, memory = self.act(seen, kept)
        action = np.clip(action, -1.0, 1.0)
        if self._guard.invalid(guard).any():
            action = self._guard.instead(action, seen, guard)
            memory = self.resent(memory, action)
        memory = np.hstack([memory, self._guard.sent(action, guard)])
        self._memory = memory
        action = action.astype(np.float32)
        return (action[0], memory[0]) if single else (action, memory)

    def start(self) -> np.ndarray:
        """What ``act`` remembers at the start of an episode, (m,); never empty."""
        return np.zeros(1)

    def act(self, seen: np.ndarray, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return actions (robots, n) and new memory (robots, m); subclasses implement it."""
        raise NotImplementedError

    def turned(self, memory: np.ndarray, angle: np.ndarray) -> np.ndarray:
        """Memory (robots, m) for ``act`` with measured wheel angles (robots, n), rad."""
        return memory

    @property
    def uses_wheel_angle(self) -> bool:
        """Whether measured wheel angles change what it does."""
        return False

    def resent(self, memory: np.ndarray, action: np.ndarray) -> np.ndarray:
        """Memory (robots, m) of ``act`` where other actions (robots, n) are sent than it chose."""
        return memory

    def _check(self, seen: np.ndarray) -> None:
        if seen.ndim != 2 or seen.shape[1] != self._length:
            raise ValueError(
                f"observation has shape {seen.shape[-2:]}, controller {self.name!r} needs "
                f"(..., {self._length}); make the environment with **controller.env_kwargs = "
                f"{self.env_kwargs}"
            )

    def _checked_angle(self, angle, robots: int) -> np.ndarray:
        angle, wheels = np.atleast_2d(np.asarray(angle, float)), len(self.task.platform.wheels)
        if angle.shape != (robots, wheels):
            raise ValueError(
                f"wheel_angle has shape {angle.shape}, {robots} observations need "
                f"{(robots, wheels)}: one angle for each wheel"
            )
        return angle
