"""Gross errors of single samples: a moving mass does not jump there and back."""

from __future__ import annotations

import numpy as np

from ident.doctor.record import Record, runs

# Channel: share of its range by which one or two samples may stand out.  Torques may do so
# at low sample rates.
SHARES = {"wheel_velocity": 0.2, "body_velocity": 0.5, "wheel_torque": 1.5, "pose": 0.15}
TYPICAL = 30.0  # times the typical height of a peak, which noise makes
FAR = 3.0  # ranges outside of where the signal lives: wrong however long it lasts
MOST = 0.02  # fraction of samples
WIDEST = 2  # samples of a spike


def check_spikes(record: Record) -> None:
    """Replace samples that stand far out of their neighbourhood."""
    for channel, share in SHARES.items():
        values = record.get(channel)
        if values is None or len(values) < 20:
            continue
        mended = values.copy()
        for column in range(values.shape[1]):
            _column(record, channel, column, mended[:, column], share)
        if np.any(mended != values):
            record.set(channel, mended)


def _column(record: Record, channel: str, column: int, values: np.ndarray, share: float) -> None:
    low, high = np.percentile(values[:: max(1, len(values) // 20000)], [1, 99])
    span = float(high - low)
    spikes = (values < low - FAR * span) | (values > high + FAR * span)
    step = np.diff(values)
    steep = max(step.max(), -step.min()) > share * span > 0
    for width in range(1, WIDEST + 1 if steep else 1):
        peaks = _peaks(step, width)
        if peaks.max() <= share * span:
            continue
        limit = max(share * span, TYPICAL * float(np.median(peaks[peaks > 0])))
        for begin in np.flatnonzero(peaks > limit):
            spikes[begin : begin + width] = True
    if not span or not spikes.any():
        return
    row = int(np.argmax(np.where(spikes, np.abs(values - (low + high) / 2), -1)))
    what = f"{int(spikes.sum())} spikes, the largest {values[row]:.5g}"
    where = record.place(row, channel, column)
    if spikes.mean() > MOST:
        record.refuse(
            "spikes", f"{what}: {spikes.mean():.0%} of the samples", where, "repair the sensor"
        )
        return
    for begin, end in runs(spikes):
        around = [k for k in (begin - 1, end) if 0 <= k < len(values)]
        values[begin:end] = np.interp(np.arange(begin, end), around, values[around])
    record.fixed("spikes", what, where, "replaced by their neighbours")


def _peaks(step: np.ndarray, width: int) -> np.ndarray:
    """Height of the peak or trough of ``width`` samples that begins at each sample, or 0.

    The height is the smaller of its two flanks; ``step`` holds the differences of samples.
    """
    rise, fall = step[:-width], -step[width:]
    heights = np.zeros(len(step) + 1)
    np.minimum(np.abs(rise), np.abs(fall), out=heights[1:-width])
    heights[1:-width][rise * fall < 0] = 0.0
    return heights
