"""What a policy looks at: the tracking task in the frame of the robot, errors first."""

from __future__ import annotations

import numpy as np

from controllers.preview import preview_weights
from youbot_env.backend import NUMPY
from youbot_env.envs.task import TrackingTask
from youbot_env.references import rotate_to_body

# Times from now at which a policy sees the twist of the reference, s.
AHEAD = (0.02, 0.04, 0.06, 0.08)
BODY = ("ahead", "left", "yaw")
NAMES = (
    *(f"pose error {axis}" for axis in BODY),
    *(f"velocity error {axis}" for axis in BODY),
    *(f"velocity of the reference {axis}" for axis in BODY),
    *(f"its change in {1e3 * t:.0f} ms, {axis}" for t in AHEAD for axis in BODY),
)


class Features:
    """Turns observations into features; nothing is remembered.

    Differences that matter to the millimetre stand by themselves, where a network need not find
    them between large numbers.  The heading in the world is left out: the floor is level for a
    policy, so what it learns in one direction holds in all.

    Args:
        task: layout of the observation.

    Raises:
        ValueError: the preview ends before the last instant that a policy sees.
    """

    def __init__(self, task: TrackingTask):
        reach = task.preview_times[-1]
        if reach < AHEAD[-1] - 1e-9:
            raise ValueError(
                f"preview = {task.preview} with preview_stride = {task.preview_stride} reaches "
                f"{reach:g} s; a policy looks {AHEAD[-1]:g} s ahead: give more preview"
            )
        self._weights = preview_weights(task, AHEAD).astype(np.float32)

    def __call__(self, seen: np.ndarray) -> np.ndarray:
        """Features (robots, d) float32, named by ``NAMES``, of observations (robots, ...)."""
        seen = np.asarray(seen, np.float32)
        error = seen[:, :3]
        twists = seen[:, 8:].reshape(len(seen), -1, 3)
        now = twists[:, 0]
        change = np.einsum("tp,rpk->rtk", self._weights, twists) - now[:, None]
        # The turn from the frame of the reference into that of the robot is minus the yaw error.
        turn = (NUMPY.cos(error[:, 2:]), -NUMPY.sin(error[:, 2:]))
        along = np.concatenate([now[:, None], change], axis=1)
        along = np.stack(rotate_to_body(tuple(np.moveaxis(along, 2, 0)), turn), axis=2)
        parts = (error, along[:, 0] - seen[:, 3:6], along.reshape(len(seen), -1))
        return np.concatenate(parts, axis=1)
