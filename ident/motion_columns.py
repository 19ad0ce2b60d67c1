"""Columns of the regression for a motion known exactly, with no filter and no noise.

They are the same physics at unit parameters as in ``ident.regression``, with the motion's own twist
and twist rate in place of filtered measurements.
"""

from __future__ import annotations

import numpy as np

from ident.log import Log
from ident.regression import linear_names
from ident.signals import measure
from youbot_env import dynamics
from youbot_env.backend import NUMPY
from youbot_env.dynamics import Theta
from youbot_env.model import Model
from youbot_env.references import Motion


def motion_columns(motion: Motion, model: Model) -> np.ndarray:
    """Columns (..., 3, 7) of theta for an exactly known motion, force rows times the lever L."""
    v, rate = motion.twist(NUMPY), motion.twist_rate(NUMPY)
    geometry, lever = model.platform.geometry, model.platform.lever
    columns = []
    for unit in np.eye(7).tolist():
        theta = Theta(*unit)
        parts = (
            dynamics.momentum(geometry, theta, rate),
            dynamics.centripetal(theta, v),
            dynamics.friction(geometry, theta, v),
        )
        rows = [sum(terms) for terms in zip(*parts, strict=True)]
        columns.append(np.stack(np.broadcast_arrays(*rows, v[0])[:3], axis=-1))
    return np.stack(columns, axis=-1) * np.array([lever, lever, 1.0])[:, None]


def effect_columns(motion: Motion, time: np.ndarray, model: Model) -> np.ndarray:
    """Columns (N, 3, q) of the linear parameters of effects, from their laws at unit steps."""
    names = linear_names(model)[7:]
    if not names:
        return np.empty((len(time), 3, 0))
    theta = motion_columns(motion, model)
    platform, scale = model.platform, np.array([model.platform.lever] * 2 + [1.0])
    wrench = theta @ np.array(model.values()[:7]) / scale
    J = platform.jacobian_array
    log = Log(
        "motion", platform, time, body_velocity=np.stack(motion.twist(NUMPY), -1),
        wheel_torque=wrench @ np.linalg.pinv(J), pose=np.stack(motion.pose, -1),
    )  # fmt: skip
    seen = measure(log, model)

    def left_side(measured) -> np.ndarray:
        force = np.stack(np.broadcast_arrays(*measured.interval_wrenches()[0], time[:-1])[:3], -1)
        side, change = -force * scale, measured.robot.theta_change(measured.signals, NUMPY)
        for column, extra in enumerate(change or ()):
            side = side + theta[:-1, :, column] * np.broadcast_to(extra, time.shape)[:-1, None]
        return side

    start, values, columns = left_side(seen), np.array(model.values()), []
    for name in names:
        moved = values.copy()
        moved[model.names().index(name)] += 1.0
        columns.append(left_side(seen.with_values(moved)) - start)
    inner = np.stack(columns, axis=-1)
    return np.concatenate([inner, inner[-1:]])
