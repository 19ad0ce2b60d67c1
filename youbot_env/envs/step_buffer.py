"""What many robots see after a period or a reset: one piece of memory, an array for each part."""

from __future__ import annotations

import numpy as np

# Robots come in groups of so many in memory; the last group is filled up.
GROUP = 64


def padded(count: int) -> int:
    """Room for so many robots: a multiple of ``GROUP``.

    It is an odd one where there are several, so that components of one robot do not all fall into
    the same lines of the cache.
    """
    groups = -(-count // GROUP)
    return GROUP * (groups if groups == 1 else groups | 1)


class StepLayout:
    """Where the parts lie, for a number of robots; makes new pieces of memory.

    Attributes:
        offsets: of each part in the piece of memory, bytes.
    """

    def __init__(self, copies: int, observed: int, wheels: int):
        self.copies, self.width = copies, padded(copies)
        parts = {
            "time": (1, np.float64), "pose": (3, np.float64), "reference_pose": (3, np.float64),
            "torque": (wheels, np.float32), "observation": (observed, np.float32),
            "reward": (1, np.float32), "terminated": (1, np.bool_), "truncated": (1, np.bool_),
            "done": (1, np.bool_),
        }  # fmt: skip
        self.offsets, self._parts, self._size = {}, [], 0
        for name, (components, kind) in parts.items():
            size = np.dtype(kind).itemsize
            shape = (copies, components) if components > 1 else (copies,)
            strides = (size, self.width * size) if components > 1 else (size,)
            if name == "observation":  # a row for each robot, as learners read them
                strides = (components * size, size)
            self._parts.append((name, shape, np.dtype(kind), self._size, strides))
            self.offsets[name] = self._size
            self._size += components * self.width * size

    def new(self) -> StepBuffer:
        """A piece of memory with nothing in it yet."""
        memory = np.empty(self._size, np.uint8)
        seen = StepBuffer()
        seen.memory = memory
        for name, shape, kind, offset, strides in self._parts:
            setattr(seen, name, np.ndarray(shape, kind, memory, offset, strides))
        ends, strides = (3, self.copies), (self.width, 1)
        seen.ends = np.ndarray(ends, bool, memory, self.offsets["terminated"], strides)
        return seen


class StepBuffer:
    """What n robots see.

    Attributes:
        time: of the episode, (n,) s.
        pose, reference_pose: (n, 3) m, m, rad.
        torque: last commanded, (n, wheels) N m.
        observation: (n, d) float32.
        reward: (n,) float32.
        terminated, truncated, done: (n,) bool, the rows of ``ends``.
        memory: in which they all lie.
    """

    time: np.ndarray
    pose: np.ndarray
    reference_pose: np.ndarray
    torque: np.ndarray
    observation: np.ndarray
    reward: np.ndarray
    terminated: np.ndarray
    truncated: np.ndarray
    done: np.ndarray
    ends: np.ndarray
    memory: np.ndarray

    INFORMATION = ("time", "pose", "reference_pose", "torque")

    def information(self) -> dict[str, np.ndarray]:
        """What stands in ``info``."""
        return {name: getattr(self, name) for name in self.INFORMATION}
