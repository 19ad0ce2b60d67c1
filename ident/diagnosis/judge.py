"""Which error judges: the free run, or the forces at the measured motion.

Where a loop keeps the speed, the motion holds no acceleration to speak of and the effort is what
was measured.  A simulation that is driven by that effort drifts away by whatever noise it holds, a
robot of many tons follows best, and right laws look worse than wrong ones.  In windows far shorter
than the robot's time constant, with the inertias where they were, a free run is the error of the
forces at the measured motion.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.lib.stride_tricks import sliding_window_view

from ident.consistency import lump_weights
from ident.diagnosis.settings import SETTINGS
from ident.identifiability import Seen, observe_regression
from ident.log import CHANNELS, Log
from ident.regression import Regression, build_regression
from youbot_env.model import Model

FILTERED = ("wheel_torque", "wheel_voltage", "wheel_velocity", "body_velocity")
INERTIAL = ("m0", "I0", "I1", "max", "may")
# Combinations of which motion with any acceleration determines one.
INERTIAS = ("x1+x3", "x2+x3")


def inertia_is_seen(logs: Sequence[Log], model: Model) -> bool:
    """Tell whether the motion of some logs accelerates enough to show any inertia.

    Noise of rollers may hide the inertia of a robot that accelerates all the time; its friction
    shows in a free run all the same.
    """
    if not all(map(_steady, logs)):
        return True
    regression = Regression.join([build_regression(log, model) for log in logs])
    observed = observe_regression(regression, model)
    start = dict(zip(model.names(), model.values(), strict=True))
    names = regression.names
    seen = Seen.of(observed, regression, np.array([start[name] for name in names]), model)
    at = [model.names().index(name) for name in names]
    lumps = lump_weights(model)
    return any(seen.determines(lumps[lump][0][at]) for lump in INERTIAS)


def _steady(log: Log) -> bool:
    """Tell whether the robot holds its speed more than half of the time that it moves."""
    width = max(1, round(SETTINGS.force_mean / log.dt))
    level = log.velocity() * (1.0, 1.0, log.platform.lever)
    changes, size = [], max(float(np.sqrt(np.mean(level**2) * 3)), 1e-9)
    for start, stop in log.spans:
        count = (stop - start) // width
        blocks = level[start : start + count * width] / size
        means = blocks.reshape(count, width, 3).mean(axis=1)
        changes.append(np.linalg.norm(np.diff(means, axis=0), axis=1))
    changes = np.concatenate(changes)
    return (
        not len(changes) or float(np.median(changes)) < SETTINGS.steady_motion * SETTINGS.force_mean
    )


def judged_by_force(log: Log) -> Log:
    """The log with windows so short that a free run is the error of the forces.

    Drive and velocities pass one moving mean, as a regression filters both sides of its equations:
    single rows of a current hold more noise than force.
    """
    width = 2 * round(0.5 * SETTINGS.force_mean / log.dt) + 1
    kept, starts, means = [], [], {name: [] for name in FILTERED if getattr(log, name) is not None}
    for start, stop in log.spans:
        if stop - start < width + 2:
            continue
        starts.append(sum(map(len, kept)))
        kept.append(np.arange(start + width // 2, stop - width // 2))
        for name, parts in means.items():
            rows = sliding_window_view(getattr(log, name)[start:stop], width, axis=0)
            parts.append(rows.mean(axis=-1))
    if not kept:
        return replace(log, window=SETTINGS.force_window)
    rows = np.concatenate(kept)
    values = {name: getattr(log, name)[rows] for name in ("time", *CHANNELS)
              if getattr(log, name) is not None}  # fmt: skip
    values |= {name: np.concatenate(parts) for name, parts in means.items()}
    return replace(log, **values, starts=tuple(starts), window=SETTINGS.force_window)
