"""What integrated wheel speeds do not know of the wheel angles, and what that does to a fit.

Laws that read the wheel angle get the integral of the measured speeds.  Its error is a random walk
that lasts over all windows, so no scatter between windows shows it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ident.dead_reckoning import wheel_speeds
from ident.sensitivity import Linearised
from ident.white_noise import white_variance


def drifted(sim: Linearised, rng: np.random.Generator) -> Linearised:
    """The log simulated once more, with wheel angles as wrong as integrated noise makes them."""
    if not len(sim.windows.angles):
        return sim
    log, speed = sim.log, wheel_speeds(sim.log)
    noise = np.sqrt(white_variance(log, speed)) * rng.normal(size=speed.shape)
    walk = np.cumsum(noise * np.gradient(log.time)[:, None], axis=0)
    rows = (sim.windows.index - 1).ravel()
    windows = replace(sim.windows, angles=sim.windows.angles + walk[rows].T)
    after = windows.simulate(sim.model.values())
    return replace(sim, windows=windows, states=np.concatenate([sim.states[:, :1], after], axis=1))
