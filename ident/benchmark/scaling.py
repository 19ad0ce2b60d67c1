"""How large a hidden effect is: what it adds to or takes from the wheel torques of a record.

Size is measured on a record without noise, as what the equations of the robot without the effect
leave unexplained, spread over the wheels; so it is the same for a law of friction, a drive that
delivers something else than it logs, and a payload.
"""

from __future__ import annotations

import math
from collections.abc import Callable

import numpy as np

from ident.benchmark.hidden import Hidden, hide
from ident.log import Log
from ident.regression import build_regression
from youbot_env.model import Model

# Filters this fast (rad/s) leave differences between neighbouring samples; the first half second,
# in which the loops catch up with a motion that has begun without them, does not count.
CORNER, SETTLE = 1000.0, 500.0
TOLERANCE, TRIES = 0.02, 12
# Largest change of the amount in one try, as a natural logarithm.
LEAP = 1.5


def torque_share(log: Log, robot: Model) -> float:
    """What the robot's own equations leave of a record, as a share of the rms wheel torque."""
    regression = build_regression(log, robot, corner=CORNER, settle=SETTLE)
    residual = regression.residual(np.array(robot.values()))
    wrench = residual / (regression.lever, regression.lever, 1.0)
    # Torques of least norm that give this wrench.
    torque = wrench @ np.linalg.pinv(robot.platform.jacobian_array)
    return float(np.sqrt(np.mean(torque**2) / np.mean(log.wheel_torque**2)))


def amount_for(
    share: float, hidden: Hidden, robot: Model, drive: Callable[[Model], Log]
) -> tuple[float, float]:
    """Find the amount at which an effect is worth a share of the torques of its record.

    Args:
        share: wanted, of the rms torque.
        hidden: the drawn effect.
        robot: the robot without it.
        drive: records a robot without noise.

    Returns:
        ``(amount, share reached)``; less than wanted where a bound stops the effect, or where the
        wheel loops become unstable with more of it.

    Raises:
        ValueError: the effect does not reach the share, and no bound is in the way.
    """
    # What the trapezoids of the equations themselves leave is not the effect's.
    floor = torque_share(drive(robot), robot)

    def reached(amount: float) -> float:
        whole = torque_share(drive(hide(robot, [(hidden, amount)])), robot)
        return math.sqrt(max(whole**2 - floor**2, 0.0))

    most = math.log(hidden.largest())
    place, slope, last = min(0.0, most), 1.0, None
    low, high, below = -math.inf, math.inf, 0.0
    for _ in range(TRIES):
        found = reached(math.exp(place))
        error = math.log(max(found, 1e-9) / share)
        if abs(error) < TOLERANCE or (place >= most and error < 0):
            return math.exp(place), found
        if error < 0 and place > low:
            low, below = place, found
        high = min(high, place) if error >= 0 else high
        if last is not None and place != last[0]:
            slope = max((error - last[1]) / (place - last[0]), 0.3)
        last = (place, error)
        place = min(place - min(max(error / slope, -LEAP), LEAP), most)
        if not low < place < high:
            # A secant across a threshold (a limit that is met or not) leads away; halve instead.
            place = 0.5 * (low + high)
    if abs(error) < 5 * TOLERANCE:
        return math.exp(last[0]), found
    if high - low < LEAP / 100:
        # A little more and the wheel loops, which a delay destabilises, shake the robot.
        return math.exp(low), below
    raise ValueError(
        f"{hidden.effect.identifier}: a share of {share:.3g} of the torques is not reached, "
        f"the last try gave {found:.3g}"
    )
