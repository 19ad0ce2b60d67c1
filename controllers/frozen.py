"""Tells a velocity sensor that stands still from a robot that does.

A sensor that shows the same digits again and again may be right: the robot stands, or drives
steadily, and the sensor has coarse steps.  It is wrong where the velocity must have changed.  That
needs no law of friction: as long as the velocity is the same, what resists is the same force,
whatever it is.  So the velocity that the torques make is a straight line over time, but for what
coarse steps hide; a bend is a change of velocity that nothing shows.  A robot that stands may be
held by dry friction or a wall, whatever the torques; there, and else too, the pose tells.
"""

from __future__ import annotations

import numpy as np

from controllers.gate import HELD, POSE_NOISE, SPEED_NOISE, inertia
from youbot_env.envs.task import TrackingTask
from youbot_env.model import Model

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
