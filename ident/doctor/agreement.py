"""Whether channels belong together in time and size, after everything else was put right."""

from __future__ import annotations

import numpy as np

from ident.doctor.correlation import centre, explained
from ident.doctor.record import Record
from ident.doctor.smoothing import BODY_SOURCES, Smooth, smooth

SLIP = 0.15  # rms of what contradicts rolling, over the rms of wheel speeds
OFFSET = 0.05  # mean of it
LAGS = (0.15, 0.2, 0.3, 0.4, 0.6, 0.8, 1.0)  # s, by which clocks are compared
LONG = 40  # times a lag, that a log must last to show it
CLEARER, CLEAR = 0.02, 0.9  # share explained that another lag must gain, and reach
# Or, where speed and acceleration explain nearly all at any lag: the least share it must gain,
# and what it may leave of what is unexplained now.
GAINED, LEFT = 0.01, 0.12


def check_agreement(record: Record) -> None:
    """Warn when wheels contradict one another, or when clocks of channels differ."""
    signals = smooth(record)
    if len(signals.rows) < 100:
        return
    if "wheel_velocity" in signals.signals:
        _redundancy(record)
    _clocks(record, signals)


def _redundancy(record: Record) -> None:
    """Compare wheel speeds with the nearest ones that roll without slip."""
    wheels, J = record.channels["wheel_velocity"], record.platform.jacobian_array
    contradiction = wheels - wheels @ (J @ np.linalg.pinv(J)).T
    size = float(np.sqrt(np.mean(wheels**2)))
    rms = float(np.sqrt(np.mean(contradiction**2))) / size
    offset = np.abs(contradiction.mean(axis=0)).max() / size
    where = record.name("wheel_velocity")
    if offset > OFFSET:
        record.warn(
            "offset",
            f"a wheel speed has an offset: {offset:.0%} of the rms always contradicts rolling",
            where,
            "check the zero of the sensors",
        )
    elif rms > SLIP:
        record.warn(
            "slip",
            f"{rms:.0%} of the wheel speeds contradict rolling: slip, unequal wheels or noise",
            where,
            "check that no column is late or noisy; drive more gently",
        )


def _clocks(record: Record, signals: Smooth) -> None:
    """Shift each channel against the motion and see where it fits best."""
    wheels, motion = signals.signals.get("wheel_velocity"), signals.signals.get("body_velocity")
    rates = signals.rates.get("body_velocity")
    step = float(np.median(np.diff(record.time[signals.rows])))
    if wheels is not None:
        inverse = np.linalg.pinv(record.platform.jacobian_array).T
        motion, rates = wheels @ inverse, signals.rates["wheel_velocity"] @ inverse
        size = np.std(wheels, axis=0)
        each = {int(k): _lag(wheels[:, [k]], np.delete(wheels, k, axis=1), step)
                for k in np.flatnonzero(size > 0.3 * size.max())}  # fmt: skip
        worst = max(each, key=lambda k: each[k][2] - each[k][1])
        if _tell(record, each[worst], record.name("wheel_velocity", [worst])):
            return
    if motion is None:
        return
    if "wheel_torque" in signals.signals:
        lag = _lag(signals.signals["wheel_torque"], np.hstack([motion, rates]), step)
        _tell(record, lag, record.name("wheel_torque"))
    for source in BODY_SOURCES[:2]:
        if source in signals.signals:
            lag = _lag(signals.signals[source], motion, step)
            _tell(record, lag, record.name(source))


def _lag(values: np.ndarray, others: np.ndarray, step: float) -> tuple[float, float, float]:
    """Find by how much ``values`` come late: (lag in s, share explained now, and then)."""
    lags = sorted({0, *(sign * round(lag / step) for lag in LAGS for sign in (-1, 1))}, key=abs)
    shares, about = {}, centre(others)
    for lag in lags:
        a, b = max(lag, 0), len(values) + min(lag, 0)
        if b - a > LONG * abs(lag):
            shares[lag] = float(np.median(explained(values[a:b], others[a - lag : b - lag], about)))
    best = max(shares, key=shares.get)
    return best * step, shares[0], shares[best]


def _tell(record: Record, lag: tuple[float, float, float], where: str) -> bool:
    late, now, then = lag
    better = then > now + (GAINED if 1 - then < LEFT * (1 - now) else CLEARER)
    if abs(late) < LAGS[0] / 2 or then < CLEAR or not better:
        return False
    record.warn(
        "clock",
        f"{'late' if late > 0 else 'early'} by about {abs(late):.2g} s: the other channels then "
        f"explain {then:.0%} of it instead of {now:.0%}",
        where,
        "bring all columns to one clock",
    )
    return True
