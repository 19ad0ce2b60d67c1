"""What a controller does where an observation is no observation: raise, hold, or brake."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from controllers.frozen import Frozen
from controllers.gate import BRAKE_TIME, Gate
from controllers.inverse import feedforward
from youbot_env.backend import FLOAT
from youbot_env.envs.task import TrackingTask
from youbot_env.model import Model
from youbot_env.plant import Structure

if TYPE_CHECKING:
    from controllers.base import Settings

ON_INVALID = ("raise", "hold", "brake")
# How long the last action is held where no sample is a number, s; then the robot brakes.
LONGEST_HOLD = 0.1


class Guard:
    """Stands between what is observed and the law of a controller.

    The memory holds: invalid observations in turn; the last action; the memory of ``Frozen``, where
    torques are commanded; that of ``Gate``.

    Args:
        model: what the controller believes.
        task: layout of observation and action.
        settings: ``on_invalid`` and ``gate``.

    Attributes:
        size: length of the memory.

    Raises:
        ValueError: an unknown ``on_invalid``.
    """

    def __init__(self, model: Model, task: TrackingTask, settings: Settings):
        if settings.on_invalid not in ON_INVALID:
            raise ValueError(f"on_invalid = {settings.on_invalid!r}; choose one of {ON_INVALID}")
        self._model, self._task, self._settings = model, task, settings
        self._gate, self._actions = Gate(model, task), task.action_space.shape[0]
        # Wheel-speed loops follow commands that say nothing of torques.
        watched = settings.gate and task.action_level == "torque"
        self._frozen = Frozen(model, task) if watched else None
        self._behind = 1 + self._actions + (self._frozen.size if self._frozen else 0)
        self.size = self._behind + self._gate.size
        longest = max(round(LONGEST_HOLD / task.dt), 1)
        self._hold = longest if settings.on_invalid == "hold" else 0

    def admit(self, seen: np.ndarray, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Let believable samples pass and stand in for the others.

        Args:
            seen: observations (robots, d).
            memory: (robots, size).

        Returns:
            Finite observations (robots, d), and the memory with ``invalid`` counted on.

        Raises:
            ValueError: an observation is not finite, or its velocities stand still while the robot
                cannot, and ``on_invalid`` is ``raise``.
        """
        # The sum is the quick look; huge finite numbers may overflow it.
        invalid = np.zeros((len(seen), 1))
        with np.errstate(over="ignore"):
            total = seen.sum()
        if not np.isfinite(total):
            finite = np.isfinite(seen)
            if self._settings.on_invalid == "raise" and not finite.all():
                row, column = np.argwhere(~finite)[0]
                raise ValueError(
                    f"observation[{row}, {column}] = {seen[row, column]} is not finite; repair it, "
                    "or make the controller with on_invalid='hold' or 'brake'"
                )
            invalid = 1.0 - finite.all(axis=1, keepdims=True)
        split, behind = 1 + self._actions, self._behind
        watched = memory[:, split:behind]
        if self._frozen is not None:
            still, watched = self._frozen(
                seen[:, 3:6], memory[:, 1:split], self._gate.drift(memory[:, behind:]), watched
            )
            if still.any():
                self._refuse_frozen(seen, still)
                invalid = np.maximum(invalid, still[:, None])
                seen = seen.copy()
                seen[still, 3:6] = np.nan
        count = invalid * (memory[:, :1] + 1.0)
        braking = (count > self._hold).astype(float)
        believed, kept = self._gate(seen, memory[:, behind:], braking)
        if not self._settings.gate:
            believed = np.where(invalid > 0, believed, seen)
        return believed, np.hstack([count, memory[:, 1:split], watched, kept])

    def _refuse_frozen(self, seen: np.ndarray, still: np.ndarray) -> None:
        if self._settings.on_invalid == "raise":
            row = int(np.argmax(still))
            shown = ", ".join(f"{v:g}" for v in seen[row, 3:6])
            raise ValueError(
                f"observation[{row}, 3:6] = {shown} does not change, while torques or the pose say "
                "that the velocity does: its sensor stands still; repair it, or make the "
                "controller with on_invalid='hold' or 'brake'"
            )

    def known(self, memory: np.ndarray) -> np.ndarray:
        """Rows (robots, 1) of which anything was believed yet; before, no episode has begun."""
        return self._gate.known(memory[:, self._behind :])

    def invalid(self, memory: np.ndarray) -> np.ndarray:
        """Rows (robots,) whose last admitted observation was none."""
        return memory[:, 0] > 0

    def instead(self, action: np.ndarray, seen: np.ndarray, memory: np.ndarray) -> np.ndarray:
        """Actions (robots, n) with those of invalid rows held or braking; ``seen`` as admitted."""
        action = action.copy()
        for row in np.flatnonzero(self.invalid(memory)):
            held = memory[row, 0] <= self._hold
            action[row] = memory[row, 1 : 1 + self._actions] if held else self._brake(seen[row])
        return action

    def sent(self, action: np.ndarray, memory: np.ndarray) -> np.ndarray:
        """The memory with the actions (robots, n) that were sent; changes it in place."""
        memory[:, 1 : 1 + self._actions] = action
        return memory

    def _brake(self, seen: np.ndarray) -> np.ndarray:
        """Action (n,) that slows the robot down from the velocity in an admitted observation."""
        task = self._task
        if task.action_level == "velocity":
            return np.zeros(self._actions)
        structure = Structure.of(self._model)
        velocity = tuple(seen[3:6].tolist())
        yaw = float(np.arctan2(seen[7], seen[6]))
        rates = tuple(-v / BRAKE_TIME for v in velocity)
        robot, state = structure.bind(self._model.values()), structure.rest((0.0, 0.0, yaw))
        limit = task.torque_limit
        return np.array(feedforward(robot, state, velocity, rates, 0.0, limit, FLOAT)) / limit
