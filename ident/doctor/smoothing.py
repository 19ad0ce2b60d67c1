"""Signals of a log averaged over a short window, so that all of them can be compared."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.doctor.record import Record

WINDOW = 0.1  # s to either side
MOST_ROWS = 2000
BODY_SOURCES = ("body_velocity", "pose", "reference")


@dataclass(frozen=True)
class Smooth:
    """Signals averaged over a short window, on a coarse grid of samples.

    Attributes:
        rows: samples of the record on which the windows are centred.
        signals: (K, k) averages by channel; the pose as body velocities.
        rates: (K, k) time derivatives of the averages.
    """

    rows: np.ndarray
    signals: dict[str, np.ndarray]
    rates: dict[str, np.ndarray]


def smooth(record: Record) -> Smooth:
    """Average all channels of a record; windows do not reach over gaps."""
    if "smooth" not in record.derived:
        record.derived["smooth"] = _smooth(record)
    return record.derived["smooth"]


def _smooth(record: Record) -> Smooth:
    count = len(record.time)
    half = max(1, round(WINDOW / record.dt))
    piece = np.cumsum(record.breaks)
    inner = np.arange(2 * half, count - 2 * half)
    if len(inner):
        inner = inner[piece[inner - 2 * half] == piece[inner + 2 * half]]
    rows = inner[:: max(1, len(inner) // MOST_ROWS)]
    signals, rates = {}, {}
    for channel in ("wheel_velocity", "wheel_torque", "wheel_voltage", *BODY_SOURCES):
        values = record.get(channel)
        if values is None or not len(rows):
            continue
        if channel == "pose":
            signals[channel] = _body_motion(record.time, values, rows, half)
            before, after = (
                _body_motion(record.time, values, rows + s, half) for s in (-half, half)
            )
        else:
            total = np.concatenate([np.zeros((1, values.shape[1])), np.cumsum(values, axis=0)])
            signals[channel] = _mean(total, rows, half)
            before, after = (_mean(total, rows + s, half) for s in (-half, half))
        span = record.time[rows + half] - record.time[rows - half]
        rates[channel] = (after - before) / span[:, None]
    return Smooth(rows, signals, rates)


def _mean(total: np.ndarray, rows: np.ndarray, half: int) -> np.ndarray:
    return (total[rows + half + 1] - total[rows - half]) / (2 * half + 1)


def _body_motion(time: np.ndarray, pose: np.ndarray, rows: np.ndarray, half: int) -> np.ndarray:
    """Body velocities from a pose over windows of ``half`` samples to either side."""
    span = (time[rows + half] - time[rows - half])[:, None]
    change = (pose[rows + half] - pose[rows - half]) / span
    c, s = np.cos(pose[rows, 2]), np.sin(pose[rows, 2])
    vx, vy, turn = change.T
    return np.stack([c * vx + s * vy, c * vy - s * vx, turn], axis=1)
