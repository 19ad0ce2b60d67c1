"""Records that are denser than a robot can move, with means in place of their samples."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ident.instruments import HOLD, OFFSET, lead_of
from ident.log import CHANNELS, Log
from youbot_env.measurement import HELD, HOLDS

# What drives the wheels is held from its sample on; everything else is seen at its sample.
INPUTS = ("wheel_torque", "wheel_voltage")
# Denser samples, s, tell nothing more of a robot of this size; to find out what is missing twice
# that is enough.
DENSE, SEARCHED = 0.01, 0.02


def decimated(log: Log, interval: float) -> Log:
    """The log with means over about ``interval``, s, where its samples are denser than that.

    What is seen, its time included, becomes the mean of a block of samples; the drive input the
    mean of what was held from the middle of one block to the middle of the next, so that no delay
    comes in between.
    """
    size = round(interval / log.dt)
    if size < 2:
        return log
    # The middle of an even block lies between two samples: half of either hold belongs to it.
    share = np.ones(size) if size % 2 else np.r_[0.5, np.ones(size - 1), 0.5]
    after = (size - 1) // 2 + np.arange(len(share))
    blocks, held, starts = [], [], []
    for start, stop in log.spans:
        if stop - start < size:
            continue
        first = np.arange(start, stop - size + 1, size)
        starts.append(sum(map(len, blocks)))
        blocks.append(first)
        # The last block holds to the end of its piece at most.
        held.append(np.minimum(first[:, None] + after, stop - 1))
    if not blocks:
        return log
    seen, held = np.concatenate(blocks)[:, None] + np.arange(size), np.concatenate(held)
    values = {name: getattr(log, name) for name in ("time", *CHANNELS)}
    if log.pose is not None:
        values["pose"] = np.column_stack([log.pose[:, :2], np.unwrap(log.pose[:, 2])])
    means = {
        name: np.einsum("k,nk...->n...", share / size, value[held])
        if name in INPUTS
        else value[seen].mean(axis=1)
        for name, value in values.items()
        if value is not None
    }
    # White noise has its slow part in common with rows that are farther apart and less noisy.
    noise = None if log.drive_noise is None else log.drive_noise / np.sqrt(size)
    return replace(log, **means, starts=tuple(starts), recording=_recording(log),
                   drive_noise=noise, speed_noise=None)  # fmt: skip


def _recording(log: Log) -> dict[str, dict[str, float]]:
    """What is stated about the recording, for means that act as held input does."""
    stated = dict(log.recording)
    if HOLD in stated or OFFSET in stated:
        hold = HOLDS[round(stated.get(HOLD, {"kind": 0.0})["kind"])]
        stated[HOLD] = {"kind": float(HOLDS.index(HELD))}
        if OFFSET in stated:
            stated[OFFSET] = {"d": stated[OFFSET]["d"] + lead_of(hold, log.dt)}
    return stated
