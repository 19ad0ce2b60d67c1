"""Where each copy of a vector environment should be, now and at the previewed instants.

Two ways with one face: a table when every episode follows the same reference, rings over time when
each copy has drawn its own.
"""

from __future__ import annotations

import numpy as np

from youbot_env.backend import NUMPY
from youbot_env.envs.task import TrackingTask
from youbot_env.references import Motion, Reference

# Rows beyond which a table of the whole episode is not worth its memory.
LONGEST_TABLE = 20_000


def make_buffer(
    reference: Reference, task: TrackingTask, copies: int, steps: int
) -> TableBuffer | RingBuffer:
    """Return the buffer for episodes of at most ``steps`` control periods."""
    if reference.constant is not None and steps <= LONGEST_TABLE:
        return TableBuffer(reference, task, copies, steps)
    return RingBuffer(reference, task, copies)


class TableBuffer:
    """One table over the episode, looked up by each copy's step number."""

    def __init__(self, reference: Reference, task: TrackingTask, copies: int, steps: int):
        self._steps = np.zeros(copies, int)
        times = np.arange(steps + 1 + task.preview_length) * task.dt
        motion = reference.evaluate(reference.constant.tolist(), times, NUMPY)
        self._first = Motion(*(tuple(np.ravel(c)[:1] for c in part) for part in motion))
        self._poses = _rows(motion.pose, times)
        self._twists = _rows(motion.twist(NUMPY), times).astype(np.float32)
        self._strides = np.arange(task.preview + 1) * task.preview_stride

    def begin(self, rows: np.ndarray, generators: list[np.random.Generator]) -> Motion:
        """Start the reference of some copies; returns their motion at time 0."""
        self._steps[rows] = 0
        return self._first

    def advance(self) -> None:
        """Move on by one control period."""
        self._steps += 1

    def pose(self) -> tuple:
        """Reference poses now, three components (copies,)."""
        return tuple(self._poses[:, self._steps])

    def twists(self) -> np.ndarray:
        """Body velocities now and at the previews, (3 (preview + 1), copies), float32."""
        ahead = self._strides[:, None] + self._steps
        return self._twists[:, ahead].swapaxes(0, 1).reshape(-1, len(self._steps))


class RingBuffer:
    """Each copy has values of its own; rings hold the time from now to the last preview."""

    def __init__(self, reference: Reference, task: TrackingTask, copies: int):
        self._reference, self._task = reference, task
        self._values = np.zeros((reference.size, copies))
        size = task.preview_length + 1
        self._poses, self._head = np.zeros((size, 3, copies)), 0
        self._twists = np.zeros((size, 3, copies), np.float32)
        self._steps = np.zeros(copies, int)

    def begin(self, rows: np.ndarray, generators: list[np.random.Generator]) -> Motion:
        """Draw the reference of some copies; returns their motion at time 0."""
        values = np.array([self._reference.draw(rng) for rng in generators]).T
        self._values[:, rows], self._steps[rows] = values, 0
        size = len(self._poses)
        times = np.arange(size)[:, None] * self._task.dt
        motion = self._reference.evaluate(list(values), times, NUMPY)
        slots = ((self._head + np.arange(size)) % size)[:, None]
        shape = (size, len(rows))
        parts = ((self._poses, motion.pose), (self._twists, motion.twist(NUMPY)))
        for ring, components in parts:
            block = np.stack([np.broadcast_to(c, shape) for c in components], axis=-1)
            ring[slots, :, rows] = block
        return Motion(*(tuple(np.broadcast_to(c, shape)[0] for c in part) for part in motion))

    def advance(self) -> None:
        """Move on by one control period: the oldest slot takes the newest preview."""
        self._steps += 1
        ahead = (self._steps + self._task.preview_length) * self._task.dt
        motion = self._reference.evaluate(list(self._values), ahead, NUMPY)
        for axis, (place, twist) in enumerate(zip(motion.pose, motion.twist(NUMPY), strict=True)):
            self._poses[self._head, axis], self._twists[self._head, axis] = place, twist
        self._head = (self._head + 1) % len(self._poses)

    def pose(self) -> tuple:
        """See ``TableBuffer``."""
        return tuple(self._poses[self._head])

    def twists(self) -> np.ndarray:
        """See ``TableBuffer``."""
        size = len(self._twists)
        slots = (self._head + np.arange(0, size, self._task.preview_stride)) % size
        return self._twists[slots].reshape(-1, self._twists.shape[2])


def _rows(components: tuple, times: np.ndarray) -> np.ndarray:
    return np.array([np.broadcast_to(c, times.shape) for c in components])
