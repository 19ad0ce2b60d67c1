"""Orders of the wheel angle at which what a model leaves unexplained repeats most."""

from __future__ import annotations

import numpy as np
from scipy.signal import find_peaks

from ident.dead_reckoning import wheel_angles
from ident.log import Log
from ident.regression import build_regression
from youbot_env.model import Model

# Orders looked at, periods a turn: slower ones are the motion itself.
LOWEST, HIGHEST = 0.8, 24.0
# Bins of the angle, rad, fine enough for the highest order, and length of the transform.
BIN, LENGTH = 0.04, 1 << 16


def strongest_orders(log: Log, model: Model, count: int = 3) -> tuple[float, ...]:
    """Orders of the largest peaks in the spectrum over wheel angles of the residual torques.

    The residual is that of the filtered equations; the sum of its values over each small range of
    an angle is transformed once, whatever the order.
    """
    if log.wheel_velocity is None or len(log.pieces()) > 1:
        return ()
    regression = build_regression(log, model)
    known = dict(zip(model.names(), model.values(), strict=True))
    residual = regression.residual(np.array([known[name] for name in regression.names]))
    residual = residual / (regression.lever, regression.lever, 1.0)
    torque = residual @ np.linalg.pinv(log.platform.jacobian_array)
    angle = wheel_angles(log)[np.searchsorted(log.time, regression.time)]
    power = np.zeros(LENGTH // 2 + 1)
    for wheel in range(angle.shape[1]):
        bins = ((angle[:, wheel] - angle[:, wheel].min()) / BIN).astype(int)
        if bins.max() >= LENGTH:
            bins %= LENGTH
        held = np.bincount(bins, torque[:, wheel] - torque[:, wheel].mean(), LENGTH)
        power += np.abs(np.fft.rfft(held)) ** 2
    order = 2 * np.pi * np.fft.rfftfreq(LENGTH, BIN)
    inside = (order > LOWEST) & (order < HIGHEST)
    order, power = order[inside], power[inside]
    peaks, _ = find_peaks(power)
    best = peaks[np.argsort(-power[peaks])[:count]]
    return tuple(order[best].tolist())
