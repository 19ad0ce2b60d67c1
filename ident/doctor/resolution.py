"""Coarse records: channels whose values stand on a few steps are imprecise, not stuck."""

from __future__ import annotations

import numpy as np

from ident.doctor.record import Record

OFTEN, MOSTLY = 5, 0.9  # times a value occurs, and share of rows that such values hold
FEWEST = 5  # such values: fewer are a switch
# Rounding to steps of d adds an error of d / sqrt(12) rms.  On a minute of smooth motion steps of
# 3 % of the rms change nothing; from 20 % on, intervals of the lumps widen by 40 % and more.
COARSE = 0.05
CHANNELS = ("wheel_velocity", "wheel_torque", "body_velocity")


def resolution(own: np.ndarray) -> float:
    """Size of the steps in which a column is recorded; 0 where most values occur only once.

    Args:
        own: (N,) values.
    """
    numbers, counts = np.unique(own, return_counts=True)
    often = counts >= OFTEN
    if often.sum() < FEWEST or counts[often].sum() < MOSTLY * len(own):
        return 0.0
    return float(np.median(np.diff(numbers[often])))


def check_resolution(record: Record) -> None:
    """Tell when a channel is recorded in steps that are coarse for what it shows."""
    for channel in CHANNELS:
        values = record.get(channel)
        if values is None:
            continue
        size = float(np.std(values, axis=0).max())
        steps = np.array([resolution(own) for own in values.T])
        coarse = np.flatnonzero(steps > COARSE * size)
        if size and len(coarse):
            step = float(np.median(steps[coarse]))
            record.warn(
                "resolution",
                f"recorded in steps of {step:.4g}, {step / size:.0%} of the rms",
                record.name(channel, coarse),
                "used as it is; record with more digits or a finer sensor, the rounding adds "
                f"{step / np.sqrt(12):.2g} rms of noise",
            )
