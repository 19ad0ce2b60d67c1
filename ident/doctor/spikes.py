"""Gross errors of single samples: a moving mass does not jump there and back."""

from __future__ import annotations

import numpy as np

from ident.doctor.record import Record, runs

# Channel: share of its range by which one or two samples may stand out.  Torques may do so
# at low sample rates.
SHARES = {"wheel_velocity": 0.2, "body_velocity": 0.5, "wheel_torque": 1.5, "pose": 0.15}
STEEPER = 3.0  # times the steps of a motion (85 % are smaller): a crest is no steeper
TYPICAL = 30.0  # times the typical height of a peak, which noise makes
# Of the range of the channel's busiest column (yaw at the radius of the wheels): that of a column
# that hardly moves is its noise.
LEAST = 0.25
FAR = 3.0  # ranges outside of where the signal lives: wrong however long it lasts
MOST, FEW = 0.02, 5  # fraction of samples and number of them, both beyond which it is refused
WIDEST = 2  # samples of a spike
ABOVE_CIRCLE = 7.0  # rad: a wider range of headings is in degrees, or does not leap


def check_spikes(record: Record) -> None:
    """Replace samples that stand far out of their neighbourhood."""
    for channel, share in SHARES.items():
        values = record.get(channel)
        if values is None or len(values) < 20:
            continue
        mended = values.copy()
        if (
            channel == "pose"
        ):  # a heading that leaps from one end of its circle to the other is none
            circle = 2 * np.pi if np.ptp(values[:, 2]) < ABOVE_CIRCLE else 360.0
            mended[:, 2] = np.unwrap(values[:, 2], period=circle)
        whole = mended.copy()
        sizes = np.array([1.0, 1.0, record.platform.reach]) if values.shape[1] == 3 else 1.0
        limits = np.percentile(whole[:: max(1, len(whole) // 20000)], [1, 99], axis=0)
        spans = np.ptp(limits, axis=0)
        least = LEAST * float(np.max(spans * sizes)) / (sizes * np.ones(values.shape[1]))
        for column in range(values.shape[1]):
            low, high = limits[:, column]
            span = max(float(spans[column]), float(least[column]))
            _column(record, channel, column, mended[:, column], share, (low, high, span))
        if np.any(mended != whole):
            record.set(channel, mended)


def _column(
    record: Record,
    channel: str,
    column: int,
    values: np.ndarray,
    share: float,
    lives: tuple[float, float, float],
) -> None:
    """Mend the (N,) values of a column in place; ``lives`` is where it lives: low, high, range."""
    low, high, span = lives
    spikes = (values < low - FAR * span) | (values > high + FAR * span)
    step = np.diff(values)
    steep = max(step.max(), -step.min()) > share * span > 0
    for width in range(1, WIDEST + 1 if steep else 1):
        peaks = _peaks(step, width)
        if peaks.max() <= share * span:
            continue
        limit = max(
            share * span,
            TYPICAL * float(np.median(peaks[peaks > 0])),
            STEEPER * float(np.percentile(np.abs(step), 85)),
        )
        for begin in np.flatnonzero(peaks > limit):
            spikes[begin : begin + width] = True
    if not span or not spikes.any():
        return
    row = int(np.argmax(np.where(spikes, np.abs(values - (low + high) / 2), -1)))
    what = f"{int(spikes.sum())} spikes, the largest {values[row]:.5g}"
    where = record.place(row, channel, column)
    if spikes.mean() > MOST and spikes.sum() > FEW:
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
