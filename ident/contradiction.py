"""Whether the wheels contradict each other: more wheels than freedoms are bound by rolling."""

from __future__ import annotations

import numpy as np
from scipy.linalg import null_space

from ident.log import Log
from ident.white_noise import white_variance

# Mean squared contradiction of the wheels, in units of their noise, from which they disagree.
CONTRADICTION = 2.0


def wheels_agree(log: Log) -> bool:
    """Tell whether the wheels contradict each other by no more than their noise.

    More wheels than freedoms are bound by ideal rolling.  Where they keep to it, rollers and slip
    cannot be what a model leaves unexplained; where they do not, or cannot show it, they may be.
    Wheels of other radii than assumed contradict each other in proportion to the motion, which
    rollers do not; that part is left out.
    """
    if log.wheel_velocity is None:
        return False
    jacobian = log.platform.jacobian_array
    free = null_space(jacobian.T)
    if free.shape[1] == 0:
        return False
    expected = float(np.mean(white_variance(log, log.wheel_velocity) @ free**2))
    contradiction = log.wheel_velocity @ free
    motion = log.wheel_velocity @ np.linalg.pinv(jacobian).T
    contradiction -= motion @ np.linalg.lstsq(motion, contradiction)[0]
    return float(np.mean(contradiction**2)) < CONTRADICTION * expected
