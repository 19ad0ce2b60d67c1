"""Whether the wheels contradict each other: more wheels than freedoms are bound by rolling."""

from __future__ import annotations

import numpy as np
from scipy.linalg import null_space

from ident.log import Log
from ident.noise import speed_variance

# Mean squared contradiction of the wheels, in units of their noise, from which they disagree.
CONTRADICTION = 2.0
# Free-run error of robots with real rollers beyond noise, in contradictions of their wheels: of 15
# simulated ones up to 1.9 without their ripple in the model and 0.4 to 1 with it; rollers differ.
ROLLING, RIPPLED = 2.0, 1.0
# Largest such error as a share of the wheels' speed: sound rollers of 30 robots reach 0.08.
SOUND = 0.1


def wheels_agree(log: Log, whole: bool = False) -> bool:
    """Tell whether the wheels contradict each other by no more than their noise.

    More wheels than freedoms are bound by ideal rolling.  Where they keep to it, rollers and slip
    cannot be what a model leaves unexplained; where they do not, or cannot show it, they may be.
    Wheels of other radii than assumed contradict each other in proportion to the motion, which
    rollers do not; that part is left out.

    Args:
        log: the record.
        whole: with that part, so that the wheels must have the platform's radii.
    """
    found = contradiction(log, whole)
    return found is not None and found[0] < CONTRADICTION * found[1]


def rolling_variance(log: Log, rippled: bool = False) -> np.ndarray:
    """(m,) variances of the outputs that real rollers may leave.

    A wheel that moves as the others do not tells what rolling does to it; where wheels cannot
    contradict each other, nothing is known and nothing excused.  Wheels that contradict each other
    more than sound rollers make them slip or have other radii, which is to be found, not excused.

    Args:
        log: the record.
        rippled: whether the ripple of the rollers is in the model, and explains what it should.

    Returns:
        (rad/s)^2 of n wheel speeds, or of body velocities where these are logged.
    """
    found = contradiction(log)
    wheels = len(log.platform.wheels)
    each = 0.0
    if found is not None:
        factor = RIPPLED if rippled else ROLLING
        each = factor**2 * max(found[0] - found[1], 0.0)
        each = min(each, SOUND**2 * float(np.mean(log.wheel_velocity**2)))
    variance = np.full(wheels, each)
    if log.body_velocity is None:
        return variance
    return np.linalg.pinv(log.platform.jacobian_array) ** 2 @ variance


def contradiction(log: Log, whole: bool = False) -> tuple[float, float] | None:
    """Mean square of what contradicts rolling and what noise explains of it, (rad/s)^2.

    None where wheels cannot show it.

    Args:
        log: the record.
        whole: with what is in proportion to the motion, as other radii make it.
    """
    if log.wheel_velocity is None:
        return None
    jacobian = log.platform.jacobian_array
    free = null_space(jacobian.T)
    if free.shape[1] == 0:
        return None
    expected = float(np.mean(speed_variance(log) @ free**2))
    against = log.wheel_velocity @ free
    if not whole:
        motion = log.wheel_velocity @ np.linalg.pinv(jacobian).T
        against -= motion @ np.linalg.lstsq(motion, against)[0]
    return float(np.mean(against**2)), expected
