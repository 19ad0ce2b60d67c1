"""Kinds of moments between which the error is divided: axes, wheels, speeds, places and so on."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from ident.comparison.moments import Moments
from ident.regression import AXES
from youbot_env.effects.roller_ripple import PITCH

QUARTERS = ("first", "second", "third", "last")
HEADINGS = ("0", "90", "180", "270")
# A speed below this share of its rms counts as standstill.
STANDSTILL = 0.1
# After a wheel has changed its direction, s.
AFTER_REVERSAL = 0.3
# What depends on the roller repeats with it; a roller is divided by six.
ROLLERS, SIXTHS = round(2 * np.pi / PITCH), 6


@dataclass(frozen=True)
class Slice:
    """Part of the squared error.

    Attributes:
        name: in words, e.g. ``low speed``.
        kind: what it is a value of: axis, wheel, speed, reversal, direction, heading, wheel angle,
            place, time or torque.
        mask: (N,) rows that belong to it; None where it is a component at all times.
        axis, wheel: the component, where it is the error of one axis or wheel only.
    """

    name: str
    kind: str
    mask: np.ndarray | None
    axis: int | None = None
    wheel: int | None = None


def slices(m: Moments) -> Iterator[Slice]:
    """All parts that a log allows."""
    for k, axis in enumerate(AXES):
        yield Slice(f"axis {axis}", "axis", None, axis=k)
    for name, kind, mask in _of_the_body(m):
        yield Slice(name, kind, mask)
    for k, wheel in enumerate(m.platform.wheel_names):
        yield Slice(f"wheel {wheel}", "wheel", None, wheel=k)
        for name, kind, mask in _of_a_wheel(m, k):
            yield Slice(f"wheel {wheel} {name}", kind, mask, wheel=k)


def _of_the_body(m: Moments):
    vx, vy, turning = m.velocity.T
    yield from _thirds("speed", "speed", m.speed)
    slow = STANDSTILL * np.sqrt(np.mean(m.wheel_speed**2))
    yield "a wheel near standstill", "reversal", np.any(np.abs(m.wheel_speed) < slow, axis=1)
    yield "forward", "direction", vx > np.abs(vy)
    yield "backward", "direction", -vx > np.abs(vy)
    yield "to the left", "direction", vy > np.abs(vx)
    yield "to the right", "direction", -vy > np.abs(vx)
    yield "turning left", "direction", turning > 0.3 * np.abs(turning).max()
    yield "turning right", "direction", -turning > 0.3 * np.abs(turning).max()
    yield from _thirds(m.drive, "torque", np.linalg.norm(m.command, axis=1))
    if not m.of_runs:
        part = np.arange(len(m.time)) * len(QUARTERS) // len(m.time)
        for k, name in enumerate(QUARTERS):
            yield f"{name} quarter of the time", "time", part == k
    if m.pose is not None:
        heading = np.mod(np.round(m.pose[:, 2] / (np.pi / 2)), 4)
        for k, name in enumerate(HEADINGS):
            yield f"heading near {name} deg", "heading", heading == k
        away = np.linalg.norm(m.pose[:, :2] - np.median(m.pose[:, :2], axis=0), axis=1)
        near, far = np.quantile(away, [1 / 3, 2 / 3])
        yield "near the middle", "place", away <= near
        yield "far from the middle", "place", away > far
        for axis, place in zip("xy", m.pose.T, strict=False):
            yield from _thirds(axis, "place", place)


def _of_a_wheel(m: Moments, k: int):
    speed, drive = m.wheel_speed[:, k], m.command[:, k]
    slow = STANDSTILL * np.sqrt(np.mean(speed**2))
    yield "near standstill", "reversal", np.abs(speed) < slow
    yield "just reversed", "reversal", _recently(np.sign(speed), m.time, AFTER_REVERSAL)
    yield "turning forward", "direction", speed > slow
    yield "turning backward", "direction", speed < -slow
    yield from _thirds("speed", "speed", np.abs(speed))
    yield from _thirds(m.drive, "torque", np.abs(drive))
    yield "braking", "torque", drive * speed < 0
    if m.wheel_angle is not None:
        sixth = np.floor(np.mod(m.wheel_angle[:, k], PITCH) / PITCH * SIXTHS)
        width = 360 // (ROLLERS * SIXTHS)
        for part in range(SIXTHS):
            name = f"at roller phase {part * width}-{(part + 1) * width} deg"
            yield name, "wheel angle", sixth == part


def _thirds(name: str, kind: str, values: np.ndarray):
    low, high = np.quantile(values, [1 / 3, 2 / 3])
    yield f"low {name}", kind, values <= low
    yield f"high {name}", kind, values > high


def _recently(sign: np.ndarray, time: np.ndarray, span: float) -> np.ndarray:
    """Rows at most ``span`` seconds after a change of sign."""
    changes = np.flatnonzero(np.diff(sign)) + 1
    if not len(changes):
        return np.zeros(len(sign), bool)
    last = np.searchsorted(changes, np.arange(len(sign)), side="right") - 1
    return (last >= 0) & (time - time[changes[np.maximum(last, 0)]] <= span)
