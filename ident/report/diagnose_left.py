"""Figures of what an error depends on: the mean residual over the signals that it was found on."""

from __future__ import annotations

import numpy as np
from scipy.signal import periodogram

from ident.comparison import Comparison
from ident.comparison.moments import wheel_torques
from ident.report.compare_where import panels_figure
from ident.report.look import BODY, WHEELS

# Time since a reversal that is drawn, s.
RECENT = 1.5
# Oscillations that are looked for in the residual, Hz, as far as a log of that length shows them.
SLOWEST, FASTEST, PERIODS = 0.05, 3.0, 3


def dependence_figure(comparison: Comparison, signals: list[str]) -> bytes | None:
    """Mean of what the equations leave over the signals that it depends on.

    Args:
        comparison: of the model with everything that was added.
        signals: names of ``ident.diagnosis.lack_of_fit``.

    Returns:
        None where the log has none of the signals.
    """
    found = [panel for signal in signals for panel in _panels(comparison, signal)]
    return panels_figure(comparison, found) if found else None


def _panels(comparison: Comparison, signal: str) -> list[tuple]:
    """Panels for ``panels_figure`` of one signal; empty where the log does not have it."""
    m, force = comparison.moments, comparison.force_residual
    leveled = force / (1.0, 1.0, m.platform.lever)
    torque = wheel_torques(comparison.residual, m.platform)

    def body(title: str, values: np.ndarray, span=None) -> tuple:
        return (title, np.repeat(values[:, None], 3, axis=1), leveled, BODY, span)

    def wheels(title: str, values: np.ndarray, span=None) -> tuple:
        return (title, values, torque, WHEELS, span)

    if signal == "forward speed":
        return [body("$V_X$, m/s", m.velocity[:, 0])]
    if signal == "sideways speed":
        return [body("$V_Y$, m/s", m.velocity[:, 1])]
    if signal == "yaw rate":
        return [body("yaw rate, rad/s", m.velocity[:, 2])]
    if signal == "wheel speed":
        return [wheels("wheel speed, rad/s", m.wheel_speed)]
    if signal == "torque":
        kind = "torque, N m" if m.drive == "torque" else "voltage, V"
        return [wheels(f"wheel {kind}", m.command)]
    if signal == "history of the direction":
        since = since_reversal(m.time, m.wheel_speed)
        along = np.where(since <= RECENT, np.sign(m.wheel_speed), 0.0)
        title = "time since the wheel turned round, s"
        return [(title, since, torque * along, WHEELS, (0.0, RECENT))]
    if signal == "wheel angle" and m.wheel_angle is not None:
        angle = np.mod(np.degrees(m.wheel_angle), 360.0)
        return [wheels("wheel angle, deg", angle, (0.0, 360.0))]
    if signal == "heading" and m.pose is not None:
        heading = np.degrees(np.mod(m.pose[:, 2] + np.pi, 2 * np.pi) - np.pi)
        return [body("heading, deg", heading)]
    if signal == "place" and m.pose is not None:
        return [body("x, m", m.pose[:, 0]), body("y, m", m.pose[:, 1])]
    if signal == "time":
        period = strongest_period(m.time, leveled)
        panels = [body("time, s", m.time, (m.time[0], m.time[-1]))]
        if period is not None:
            phase = np.mod(m.time - m.time[0], period)
            title = f"time, folded at {1 / period:.3g} Hz, s"
            panels.append(body(title, phase, (0.0, period)))
        return panels
    return []


def since_reversal(time: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """(N, n) s since each wheel last changed its direction; infinite before it first did."""
    since = np.empty_like(speed)
    for k in range(speed.shape[1]):
        turned = np.append(False, np.diff(np.sign(speed[:, k])) != 0)
        last = np.maximum.accumulate(np.where(turned, time, -np.inf))
        since[:, k] = time - last
    return since


def strongest_period(time: np.ndarray, force: np.ndarray) -> float | None:
    """Period, s, at which residual forces (N, C) oscillate most; None for a short log."""
    step = float(np.median(np.diff(time)))
    even = np.arange(time[0], time[-1], step)
    evenly = np.stack([np.interp(even, time, column) for column in force.T], axis=1)
    frequency, power = periodogram(evenly, 1.0 / step, axis=0, detrend="linear")
    slowest = max(SLOWEST, PERIODS / (even[-1] - even[0]))
    inside = (frequency >= slowest) & (frequency <= min(FASTEST, 0.4 / step))
    if not np.any(inside):
        return None
    return float(1.0 / frequency[inside][np.argmax(power.sum(axis=1)[inside])])
