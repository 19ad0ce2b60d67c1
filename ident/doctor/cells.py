"""Missing values: short ones are interpolated, long ones cut the log, too many refuse it."""

from __future__ import annotations

import numpy as np

from ident.doctor.record import Record, runs

SHORT_RUN = 3  # samples in a row that may be interpolated
MOST_MISSING = 0.2  # fraction of a channel
OPTIONAL = ("reference", "pose", "battery_voltage", "wheel_position")
LONGEST_HOLD = 0.5  # s, how far a slower sensor (motion capture) may be interpolated


def check_cells(record: Record) -> None:
    """Repair or refuse missing values of every channel."""
    cut = np.zeros(len(record.time), bool)
    for channel in list(record.channels):
        values = record.channels[channel]
        values[~np.isfinite(values)] = np.nan
        for column in range(values.shape[1]):
            cut |= _column(record, channel, column)
            if channel not in record.channels:
                break
    if cut.any():
        stretches = runs(cut)
        record.fixed(
            "cells",
            f"{int(cut.sum())} samples in {len(stretches)} stretches have no value",
            record.place(stretches[0][0]),
            "cut out; the log is split there",
        )
        record.drop(cut, split=True)
    if len(record.time) < 2:
        record.refuse("cells", "nothing is left", "file", "record again", final=True)


def _column(record: Record, channel: str, column: int) -> np.ndarray:
    """Repair one column; return the samples to cut out."""
    values = record.channels[channel][:, column]
    none = np.zeros(len(values), bool)
    missing = np.isnan(values)
    if not missing.any():
        return none
    stretches = runs(missing)
    count, where = int(missing.sum()), record.place(stretches[0][0], channel, column)
    what = f"{count} missing values, {max(e - b for b, e in stretches)} in a row at most"
    # Stretches that reach the first or last sample would be extrapolated: cut them.
    inner = [(b, e) for b, e in stretches if b > 0 and e < len(values)]
    if channel in OPTIONAL:
        longest = LONGEST_HOLD / max(record.dt, 1e-9)
        if missing.all() or any(e - b > longest for b, e in inner):
            record.warn("cells", what, where, f"{channel} is left out")
            del record.channels[channel]
            return none
        _fill(values, missing)
        record.fixed("cells", what, where, "interpolated")
        return none
    much = f"{what}: {count / len(values):.0%} of the column"
    if count > MOST_MISSING * len(values) and record.refuse(
        "cells", much, where, "record again, or mend it", final=bool(missing.all())
    ):
        return none
    cut = missing.copy()
    for begin, end in inner:
        if end - begin <= SHORT_RUN:
            cut[begin:end] = False
    if (missing & ~cut).any():
        _fill(values, missing & ~cut)
        record.fixed("cells", what, where, f"up to {SHORT_RUN} in a row interpolated")
    return cut


def _fill(values: np.ndarray, missing: np.ndarray) -> None:
    good = np.flatnonzero(~np.isnan(values))
    values[missing] = np.interp(np.flatnonzero(missing), good, values[good])
