"""What a controller does where an observation is no observation: raise, hold, or brake.

A sensor that shows the same digits again and again may be right: the robot stands, or drives
steadily, and the sensor has coarse steps.  It is wrong where the velocity must have changed.  That
needs no law of friction: as long as the velocity is the same, what resists is the same force,
whatever it is.  So the velocity that the torques make is a straight line over time, but for what
coarse steps hide; a bend is a change of velocity that nothing shows.  A robot that stands may be
held by dry friction or a wall, whatever the torques; there, and else too, the pose tells.
"""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from controllers.gate import BRAKE_TIME, HELD, POSE_NOISE, SPEED_NOISE, Gate, inertia
from controllers.inverse import feedforward
from youbot_env.backend import FLOAT
from youbot_env.envs.task import TrackingTask
from youbot_env.model import Model
from youbot_env.plant import ModelStructure

if TYPE_CHECKING:
    from controllers.base import Settings


# Repetitions before anything is said: through so few points there is always a line.
EQUAL = 4
# Bend, rms, that a model with a wrong mass or a late drive may feign, m/s, m/s, rad/s.
BEND = (0.01, 0.01, 0.02)
# What coarse steps hide, in units of the smallest change that was seen: that is one step of one
# wheel, and each of four may be anywhere within its own.
STEPS = 4.0
# Changes below this are rounding, m/s and rad/s.
ROUNDING = 1e-6


class Frozen:
    """Watches the velocities of robots.

    The memory holds: the last velocity; its smallest change so far, zero where there was none;
    whether the sensor stands still; how often in turn it repeated itself; the velocity V that the
    torques have made since then; and the sums of V, of V times its number, and of V squared.

    Args:
        model: its inertia says what torques do.
        task: what an action means, and the period.

    Attributes:
        size: length of the memory.
    """

    size = 3 + 3 + 1 + 1 + 3 + 9

    def __init__(self, model: Model, task: TrackingTask):
        self._dt = task.dt
        wrench = task.torque_limit * task.platform.jacobian_array.T
        self._gain = task.dt * np.linalg.solve(inertia(model), wrench).T

    def __call__(
        self, velocity: np.ndarray, action: np.ndarray, drift: np.ndarray, memory: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Judge one sample of each robot.

        Args:
            velocity: (robots, 3) as it is observed, m/s, m/s, rad/s.
            action: (robots, wheels) the last one, torques over their limit.
            drift: (robots, 3) ``Gate.drift`` up to the last sample, m, m, rad.
            memory: (robots, size); zeros at the start of an episode.

        Returns:
            Which sensors stand still, (robots,) bool, and the memory for the next call.
        """
        last, least, told = memory[:, :3], memory[:, 3:6], memory[:, 6] > 0.0
        with np.errstate(invalid="ignore", over="ignore"):
            change = np.abs(velocity - last)
        equal = (change == 0.0).all(axis=1)
        smaller = (change > ROUNDING) & ((change < least) | (least == 0.0))
        least = np.where(smaller, change, least)
        if not equal.any():  # as almost always
            return equal, np.hstack([velocity, least, np.zeros((len(memory), self.size - 6))])
        count = np.where(equal, memory[:, 7] + 1.0, 0.0)[:, None]
        made, *sums = np.split(memory[:, 8:], 4, axis=1)
        made = made + action @ self._gain
        sums = [old + new for old, new in zip(sums, (made, count * made, made**2), strict=True)]
        moves = (np.abs(velocity) > SPEED_NOISE) & (least > 0.0)
        bent = (moves & (_bend(count, *sums) > BEND + 0.5 * STEPS * least)).any(axis=1)
        # Of a sensor that never changed nobody knows the steps.
        unseen = np.where(least > 0.0, STEPS * least, SPEED_NOISE)
        allowed = POSE_NOISE + HELD * np.abs(velocity) + unseen * self._dt * count
        elsewhere = np.abs(drift) > allowed
        still = equal & (told | ((count[:, 0] >= EQUAL) & (bent | elsewhere.any(axis=1))))
        line = np.hstack([made, *sums]) * (equal & moves.any(axis=1))[:, None]
        return still, np.hstack([velocity, least, still[:, None], count, line])


def _bend(count: np.ndarray, total: np.ndarray, moment: np.ndarray, square: np.ndarray):
    """(robots, 3) rms of points 0, 1 ... count beside the straight line through them, the first 0.

    Args:
        count: (robots, 1) number of the last point.
        total, moment, square: (robots, 3) sums of the points, of each times its number, of squares.
    """
    points = count + 1.0
    spread = np.maximum(points * (points**2 - 1.0) / 12.0, 1.0)
    slope = (moment - 0.5 * count * total) / spread
    left = square - total**2 / points - slope**2 * spread
    return np.sqrt(np.maximum(left, 0.0) / points)


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
        structure = ModelStructure.of(self._model)
        velocity = tuple(seen[3:6].tolist())
        yaw = float(np.arctan2(seen[7], seen[6]))
        rates = tuple(-v / BRAKE_TIME for v in velocity)
        robot, state = structure.bind(self._model.values()), structure.rest((0.0, 0.0, yaw))
        limit = task.torque_limit
        return np.array(feedforward(robot, state, velocity, rates, 0.0, limit, FLOAT)) / limit
