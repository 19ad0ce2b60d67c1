"""The measurement model: how the rows of a log came to be from what happened.

A row is a reading of several instruments.  Each of them may stand for an instant or for the time
since the last row, be late against the others, pass a filter, sit askew.  The laws are effects of
the link ``sensor``; each has two directions,

    record:   what happened (dense channels)  ->  what the instruments put into rows
    restore:  rows  ->  what happened, as far as they tell

and this file holds what both work on.  The drive input is a function of time between its rows, so
``restore`` changes it as a function (``DriveInput``) and only at the end are means over the rows'
intervals taken from it, which is what a simulation with held torques needs.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from youbot_env.platform import Platform

HELD, SAMPLED, AVERAGED = "held", "sampled", "averaged"
HOLDS = (HELD, SAMPLED, AVERAGED)


@dataclass(frozen=True, eq=False)
class DriveInput:
    """The drive input as a function of time.

    Attributes:
        time: (N,) s, of the rows.
        rows: (N, n) torques, N m, or voltages, V.
        hold: what a row stands for: ``held`` from its time to the next row, ``sampled`` at its
            time, or ``averaged`` over the time since the row before.
        offset: time by which the rows are late, s.
        lag: time constant of a first-order filter that they passed, s.
    """

    time: np.ndarray
    rows: np.ndarray
    hold: str = HELD
    offset: float = 0.0
    lag: float = 0.0

    @property
    def plain(self) -> bool:
        """Whether rows are held torques on the clock of the log already."""
        return self.hold == HELD and self.offset == 0.0 and self.lag == 0.0

    def means(self) -> np.ndarray:
        """(N, n) means of the input over each row's interval, from its time to the next row's.

        Held through its interval a mean carries the impulse that the robot felt.  The last row has
        no interval and repeats the one before.  Beyond the first and the last row their value is
        taken to last.
        """
        if self.plain:
            return self.rows
        ahead = self.time + self.offset
        inside = np.clip(ahead, self.time[0], self.time[-1])
        impulse, value = self._functions()
        total = impulse(inside) + (ahead - inside)[:, None] * value(inside)
        if self.lag:
            total = total + self.lag * value(inside)
        means = np.diff(total, axis=0) / np.diff(self.time)[:, None]
        return np.concatenate([means, means[-1:]])

    def _functions(self) -> tuple[Callable, Callable]:
        """The integral of the rows over time, N m s, and the rows as a function of it."""
        from scipy.interpolate import CubicSpline

        step = np.diff(self.time)[:, None]
        if self.hold == SAMPLED:
            value = CubicSpline(self.time, self.rows, axis=0)
            return value.antiderivative(), value
        mean = self.rows[:-1] if self.hold == HELD else self.rows[1:]
        known = np.concatenate([np.zeros((1, self.rows.shape[1])), np.cumsum(mean * step, axis=0)])
        if self.hold == AVERAGED:
            # Impulses at the rows are known exactly; a spline through them keeps them.
            impulse = CubicSpline(self.time, known, axis=0)
            return impulse, impulse.derivative()

        def ramp(t: np.ndarray) -> np.ndarray:
            return np.stack([np.interp(t, self.time, column) for column in known.T], axis=1)

        def staircase(t: np.ndarray) -> np.ndarray:
            at = np.clip(np.searchsorted(self.time, t, side="right") - 1, 0, len(self.time) - 1)
            return self.rows[at]

        return ramp, staircase


@dataclass(frozen=True, eq=False)
class Rows:
    """Channels that sensor effects restore, rows of one contiguous piece of a log.

    Attributes:
        platform: wheel table.
        time: (N,) s.
        drive: the drive input.
        wheel_velocity: (N, n) rad/s, or None.
        body_velocity: (N, 3) m/s, m/s, rad/s, or None.
    """

    platform: Platform
    time: np.ndarray
    drive: DriveInput
    wheel_velocity: np.ndarray | None = None
    body_velocity: np.ndarray | None = None

    def changed(self, **channels: Any) -> Rows:
        """A copy with other channels."""
        return replace(self, **channels)

    def with_drive(self, **changes: Any) -> Rows:
        """A copy whose drive input stands for something else."""
        return replace(self, drive=replace(self.drive, **changes))


@dataclass(eq=False)
class Dense:
    """What happened, in steps far shorter than rows, on its way through the instruments.

    Attributes:
        platform: wheel table.
        channels: (K, ...) arrays by the names of a log; ``time`` is uniform, s.
        hold: what the rows of the drive input will stand for.
    """

    platform: Platform
    channels: dict[str, np.ndarray] = field(default_factory=dict)
    hold: str = SAMPLED

    @property
    def step(self) -> float:
        """Time between samples, s."""
        time = self.channels["time"]
        return float((time[-1] - time[0]) / (len(time) - 1))

    def late(self, name: str, offset: float) -> None:
        """Make a channel show what was ``offset`` seconds ago (or will be, where negative)."""
        time, values = self.channels["time"], self.channels[name]
        flat = values.reshape(len(values), -1)
        shown = np.stack([np.interp(time - offset, time, column) for column in flat.T], axis=1)
        self.channels[name] = shown.reshape(values.shape)

    def filtered(self, name: str, time_constant: float) -> None:
        """Pass a channel through a first-order filter that starts settled."""
        from scipy.signal import lfilter

        values = self.channels[name]
        keep = np.exp(-self.step / time_constant)
        start = keep * values[:1]
        self.channels[name] = lfilter([1.0 - keep], [1.0, -keep], values, axis=0, zi=start)[0]


def instruments(
    effects: Iterable, platform: Platform
) -> Callable[[dict[str, np.ndarray]], dict[str, np.ndarray]] | None:
    """What the sensor effects among active effects do to dense channels; None without any.

    The channels are those that ``simulation.rows.pick_rows`` takes.  A sensor of the body velocity
    is there where an effect speaks of it.
    """
    active = [one for one in effects if one.effect.link == "sensor"]
    active.sort(key=lambda one: one.effect.order)
    if not active:
        return None

    def through(channels: dict[str, np.ndarray]) -> dict[str, np.ndarray]:
        dense = Dense(platform, dict(channels))
        if any(one.effect.channel == "body_velocity" for one in active):
            dense.channels["body_velocity"] = channels["velocity"]
        for one in active:
            one.effect.record(one.effect.arrange(one.values, platform), dense)
        return dense.channels

    return through


def slope(time: np.ndarray, values: np.ndarray, span: float) -> np.ndarray:
    """(N, k) derivative of sampled values (N, k) from straight lines over about ``span``, s.

    A difference of neighbours would make noise of it; a line over the time in which the signal is
    straight keeps the derivative and averages the noise.
    """
    half = max(1, round(0.5 * span / np.median(np.diff(time))))
    half = min(half, (len(time) - 1) // 2)
    padded_time = _extended(time[:, None], half)[:, 0]
    padded = _extended(values, half)
    window = np.lib.stride_tricks.sliding_window_view
    t = window(padded_time, 2 * half + 1)
    t = t - t.mean(axis=1, keepdims=True)
    v = window(padded, 2 * half + 1, axis=0)
    return np.einsum("nl,nkl->nk", t, v) / np.sum(t * t, axis=1)[:, None]


def _extended(values: np.ndarray, half: int) -> np.ndarray:
    """Values with ``half`` more at either end, mirrored through the end points."""
    if not half:
        return values
    before = 2 * values[:1] - values[half:0:-1]
    after = 2 * values[-1:] - values[-2 : -half - 2 : -1]
    return np.concatenate([before, values, after])
