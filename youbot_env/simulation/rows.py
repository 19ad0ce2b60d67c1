"""How rows of a log come from loops that run faster than the log."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple

import numpy as np

# What a row shows of the torque: the command given at its instant, or the mean of the commands
# since the row before.
ROWS = ("sampled", "averaged")

Channels = dict[str, np.ndarray]
Instrument = Callable[[Channels], Channels]


class LoopInstants(NamedTuple):
    """When the wheel loops act, and at which of these instants a row is written.

    Attributes:
        time: (K,) instants, s.
        step: (K,) how long each command is held, s.
        row: (N,) place of each row among the instants.
    """

    time: np.ndarray
    step: np.ndarray
    row: np.ndarray

    @classmethod
    def of(cls, times: np.ndarray, loop_rate: float | None) -> LoopInstants:
        """Split each interval between rows into equal loop steps.

        Args:
            times: (N,) instants of the rows, s.
            loop_rate: rate of the loops, Hz; an interval takes the nearest whole number of steps.
                None: one step an interval.

        Raises:
            ValueError: loops slower than the rows.
        """
        gaps = np.diff(times)
        counts = np.ones(len(gaps), int)
        if loop_rate is not None:
            rate = 1.0 / float(np.mean(gaps))
            if not loop_rate > rate * (1 - 1e-6):
                raise ValueError(
                    f"loop_rate = {loop_rate:g} Hz is below the log's {rate:g} Hz; a log shows at "
                    "most every step of its loops"
                )
            counts = np.maximum(np.rint(gaps * loop_rate), 1).astype(int)
        row = np.append(0, np.cumsum(counts))
        step = np.repeat(gaps / counts, counts)
        place = np.arange(row[-1]) - np.repeat(row[:-1], counts)
        time = np.append(np.repeat(times[:-1], counts) + place * step, times[-1])
        return cls(time, np.append(step, step[-1]), row)


def pick_rows(
    dense: Channels, at: np.ndarray, row: str, instrument: Instrument | None = None
) -> Channels:
    """Rows of a log, before the noise that each row gets by itself.

    Args:
        dense: channels at the K loop instants: ``time`` (K,) s, ``wheel_velocity`` (K, n) rad/s as
            read, ``wheel_torque`` (K, n) N m as commanded, ``pose`` (K, 3) m, m, rad and
            ``velocity`` (K, 3) m/s, m/s, rad/s as they are, ``reference`` (K, 3).
        at: (N,) places of the rows.
        row: one of ``ROWS``.  An averaged row holds the mean over the interval before its instant;
            the first has none before it and shows the robot at rest, 0 N m.
        instrument: changes the dense channels first; returns them with the same K.

    Returns:
        The channels at the rows, without ``velocity``.

    Raises:
        ValueError: an unknown kind of row.
    """
    if row not in ROWS:
        raise ValueError(f"row = {row!r}; choose one of {', '.join(ROWS)}")
    if instrument is not None:
        dense = instrument(dense)
    shown = {name: values[at] for name, values in dense.items() if name != "velocity"}
    if row == "averaged":
        sums = np.add.reduceat(dense["wheel_torque"][: at[-1]], at[:-1])
        shown["wheel_torque"] = np.zeros_like(shown["wheel_torque"])
        shown["wheel_torque"][1:] = sums / np.diff(at)[:, None]
    return shown
