"""Dependences that no effect of the library stands for: forces on generic functions of a signal.

They compete with the library.  Where one of them explains a log far better than every effect, what
is missing lies outside the library, and the signal is the first thing to tell.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from ident.diagnosis.settings import SETTINGS
from ident.log import Log
from ident.sensitivity import Linearised

Wrenches = list[np.ndarray]


@dataclass(frozen=True)
class Dependence:
    """Forces on functions of one signal.

    Attributes:
        signal: what they depend on, in words.
        make: from a simulated log to wrenches (3, W L) on the body.
        local: whether it holds in one log only.
    """

    signal: str
    make: Callable[[Linearised], Wrenches]
    local: bool = False


def dependences(logs: list[Log]) -> list[Dependence]:
    """All dependences that logs like these can show."""
    found = [
        Dependence("forward speed", lambda sim: _powers(sim, 0)),
        Dependence("sideways speed", lambda sim: _powers(sim, 1)),
        Dependence("yaw rate", lambda sim: _powers(sim, 2)),
        Dependence("wheel speed", _wheel_powers),
        Dependence("history of the direction", _memories),
    ]
    # Without acceleration the torque is what friction is: a function of it explains anything.
    if all(log.window is None for log in logs):
        found.append(Dependence("torque", _torque_powers))
    if all(log.pose is not None for log in logs):
        corner = np.min([log.pose[:, :2].min(axis=0) for log in logs], axis=0)
        side = np.max([log.pose[:, :2].max(axis=0) for log in logs], axis=0) - corner
        found.append(Dependence("heading", _heading))
        found.append(
            Dependence("place", lambda sim: _place(sim, corner, np.maximum(side, 1e-3)), True)
        )
    if not any(log.runs for log in logs):  # runs have no common time
        shortest = min(log.duration for log in logs)
        for tone in np.geomspace(
            max(SETTINGS.slowest_tone, 2 / shortest), SETTINGS.fastest_tone, SETTINGS.tones
        ):
            found.append(Dependence("time", lambda sim, tone=tone: _periodic(sim, tone), True))
        longest = max(log.duration for log in logs)
        found.append(Dependence("time", lambda sim: _drift(sim, longest), True))
    for order in (1, 2):
        found.append(Dependence("wheel angle", lambda sim, order=order: _angle(sim, order)))
    return found


def _on_axis(axis: int, value: np.ndarray) -> np.ndarray:
    wrench = np.zeros((3, len(value)))
    wrench[axis] = value
    return wrench


def _twist(sim: Linearised) -> np.ndarray:
    return np.array([np.broadcast_to(c, sim.time.size) for c in sim.signals.v])


def _powers(sim: Linearised, axis: int) -> Wrenches:
    v = _twist(sim)[axis]
    return [_on_axis(axis, np.abs(v) * v), _on_axis(axis, v**3)]


def _on_wheels(sim: Linearised, torque: np.ndarray) -> np.ndarray:
    """Wrench (3, W L) of shaft torques (n, W L)."""
    return sim.log.platform.jacobian_array.T @ torque


def _wheel_speed(sim: Linearised) -> np.ndarray:
    return sim.log.platform.jacobian_array @ _twist(sim)


def _command(sim: Linearised) -> np.ndarray:
    return np.array(sim.signals.command)


def _wheel_powers(sim: Linearised) -> Wrenches:
    w = _wheel_speed(sim)
    return [_on_wheels(sim, np.abs(w) * w), _on_wheels(sim, w**3)]


def _torque_powers(sim: Linearised) -> Wrenches:
    u = _command(sim)
    return [_on_wheels(sim, np.abs(u) * u), _on_wheels(sim, u**3)]


def _memories(sim: Linearised) -> Wrenches:
    """Dry friction that follows a reversal late."""
    windows, length = sim.shape
    sign = np.tanh(_wheel_speed(sim) / SETTINGS.dry_speed).reshape(-1, windows, length)
    steps = sim.windows.step.reshape(windows, length)
    wrenches = []
    for memory in SETTINGS.dry_memories:
        late, now = np.empty_like(sign), sign[:, :, 0]
        for k in range(length):
            now = now + (1.0 - np.exp(-steps[:, k] / memory)) * (sign[:, :, k] - now)
            late[:, :, k] = now
        wrenches.append(_on_wheels(sim, (sign - late).reshape(len(sign), -1)))
    return wrenches


def _heading(sim: Linearised) -> Wrenches:
    """Constant pull and viscous friction that differ between directions of the world."""
    yaw, v = np.broadcast_to(sim.signals.pose[2], sim.time.size), _twist(sim)
    wrenches = []
    for c, s in ((np.cos(yaw), np.sin(yaw)), (np.cos(2 * yaw), np.sin(2 * yaw))):
        wrenches += [
            np.array([c * v[0], c * v[1], 0 * c]),
            np.array([s * v[0], s * v[1], 0 * c]),
            np.array([-s * v[1], -s * v[0], 0 * c]),
            np.array([c * v[1], c * v[0], 0 * c]),
        ]
    return wrenches


def _place(sim: Linearised, corner: np.ndarray, side: np.ndarray) -> Wrenches:
    """Viscous and dry friction of the wheels that differ over the floor."""
    x, y = (np.broadcast_to(p, sim.time.size) for p in sim.signals.pose[:2])
    w = _wheel_speed(sim)
    wrenches = []
    for i in range(SETTINGS.map_squares):
        for j in range(SETTINGS.map_squares):
            a = (x - corner[0]) / side[0] * SETTINGS.map_squares - i - 0.5
            b = (y - corner[1]) / side[1] * SETTINGS.map_squares - j - 0.5
            here = np.exp(-(a**2) - b**2)
            wrenches += [
                _on_wheels(sim, here * w),
                _on_wheels(sim, here * np.tanh(w / SETTINGS.dry_speed)),
            ]
    return wrenches


def _periodic(sim: Linearised, tone: float) -> Wrenches:
    phase = 2 * np.pi * tone * sim.time.ravel()
    return [_on_axis(axis, f(phase)) for axis in range(3) for f in (np.cos, np.sin)]


def _drift(sim: Linearised, longest: float) -> Wrenches:
    """A force that wanders over the log: hat functions of time on every axis."""
    at = sim.time.ravel() / longest * (SETTINGS.drift_knots - 1)
    hats = [np.maximum(0.0, 1.0 - np.abs(at - knot)) for knot in range(SETTINGS.drift_knots)]
    return [_on_axis(axis, hat) for axis in range(3) for hat in hats]


def _angle(sim: Linearised, order: int) -> Wrenches:
    """Torque of single wheels that repeats with each turn."""
    angle = sim.wheel_angle
    count, wrenches = len(angle), []
    for wheel in range(count):
        for f in (np.cos, np.sin):
            torque = np.zeros_like(angle)
            torque[wheel] = f(order * angle[wheel])
            wrenches.append(_on_wheels(sim, torque))
    return wrenches
