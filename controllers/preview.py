"""Reference twists between and beyond the previewed instants."""

from __future__ import annotations

import numpy as np
from scipy.interpolate import make_interp_spline

from youbot_env.envs.task import TrackingTask


def preview_weights(task: TrackingTask, times, derivative: int = 0) -> np.ndarray:
    """Rows that turn the previewed twists into the twist at other times.

    Interpolation is linear in the previewed values, so one matrix serves every step.

    Args:
        task: says at which instants twists are previewed.
        times: (T,) times from now, s; those after the last preview are taken at it.
        derivative: 1 gives the rate of the twist instead.

    Returns:
        (T, preview + 1): ``twist(times) = weights @ previewed``.  A cubic spline, or a polynomial
        of lower degree where fewer than four instants are known.
    """
    nodes = np.array(task.preview_times)
    times = np.minimum(np.asarray(times, float), nodes[-1])
    degree = min(3, len(nodes) - 1)
    if degree == 0:
        return np.full((len(times), 1), 1.0 - derivative)
    spline = make_interp_spline(nodes, np.eye(len(nodes)), k=degree)
    return spline(times, nu=derivative)
