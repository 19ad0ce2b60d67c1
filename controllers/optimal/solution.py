"""What a solver of the tracking problem takes and returns."""

from __future__ import annotations

from typing import NamedTuple, Protocol

import numpy as np


class Request(NamedTuple):
    """One problem.

    Attributes:
        state: flat state at its beginning.
        pose: pose of the reference then, (3,).
        twists: velocities of the reference at the ends of the steps, (steps + 1, 3).
        delayed: the same as much later as the drive lags; what the drive is commanded for.
        t, h: time of the beginning and length of a step, s.
        values: values of the model.
        weights: ``problem.Weights`` as one vector.
        deviations, du: trajectory and commands to start from, less those of the reference,
            (steps + 1, 6) and (steps, n); zeros where there is no previous solution.
    """

    state: np.ndarray
    pose: np.ndarray
    twists: np.ndarray
    delayed: np.ndarray
    t: float
    h: float
    values: np.ndarray
    weights: np.ndarray
    deviations: np.ndarray
    du: np.ndarray


class Solution(NamedTuple):
    """Its answer.

    Attributes:
        solved: whether it may be used.
        status: the solver's own word for it.
        iterations: of the nonlinear solver.
        deviations, du: as in ``Request``.
        reference: commands along the reference, (steps, n), N m.
    """

    solved: bool
    status: str
    iterations: int
    deviations: np.ndarray
    du: np.ndarray
    reference: np.ndarray


class Solver(Protocol):
    """Solves tracking problems of one structure; values and weights are run-time inputs."""

    def solve(self, request: Request) -> Solution:
        """Solve one problem, never raising for a problem that cannot be solved."""
        ...
