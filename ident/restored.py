"""A log as the physics reads it: the instruments undone, and what laws read but no column holds."""

from __future__ import annotations

from dataclasses import replace
from typing import Any

import numpy as np

from ident.dead_reckoning import bridged, dead_reckoning, wheel_angles
from ident.instruments import FILTER
from ident.log import Log
from ident.memo import part_of
from ident.noise import speed_variance, white_variance
from youbot_env.dynamics import Theta
from youbot_env.effects import Effect, get_effect
from youbot_env.measurement import DriveInput, Rows
from youbot_env.model import Model

INSTRUMENTS = ("restore",)


def restored(log: Log, model: Model, values=None) -> Log:
    """The log with what a model's sensor effects did to it undone.

    Args:
        log: as it was recorded; what it states about that goes before what the model says.
        model: its sensor effects say how; the others say what has to be known besides.
        values: other values in the order of ``model.names()``.

    Returns:
        A log whose drive input is a mean over each row's interval, to be held through it.  A pose
        is there, and wheel angles where the model's laws read them, integrated from the speeds
        where nothing better was logged: what a law reads is known at the start of every window.
    """
    values = model.values() if values is None else values
    angle = any(active.effect.needs_wheel_angle for active in model.effects)
    key = ("restored", part_of(model, values, INSTRUMENTS), angle)
    return log.memo.of(key, lambda: _restored(log, model, values, angle))


def unknown_pose(log: Log) -> bool:
    """Tell whether the heading is unknown in a part of a log, so that no law may read it."""
    return log.pose is None and not bridged(log)


def unknown_wheel_angle(log: Log) -> bool:
    """Tell whether the wheels' angles are unknown in a part of a log."""
    return not bridged(log)


def _restored(log: Log, model: Model, values, angle: bool) -> Log:
    instruments = _instruments(log, model, values)
    if instruments:
        parts = [_undone(piece, instruments) for piece in log.pieces()]
        # A mean over an interval between two rows holds the slow part of their noise and hides it.
        noise = log.drive_noise
        if noise is None:
            noise = np.sqrt(white_variance(log, log.command))
        known = FILTER in log.recording and log.wheel_velocity is not None
        speeds = np.sqrt(speed_variance(log)) if known else log.speed_noise
        log = replace(log, recording={}, drive_noise=noise, speed_noise=speeds, **{
            name: np.concatenate([getattr(part, name) for part in parts])
            for name in ("wheel_velocity", "body_velocity", f"wheel_{log.drive}")
            if getattr(log, name) is not None
        })  # fmt: skip
    # A pose that is not known any more is none; laws that mind are not tried there.
    if log.pose is None and bridged(log):
        log = replace(log, pose=dead_reckoning(log))
    if angle and log.wheel_angle is None:
        log = replace(log, wheel_angle=wheel_angles(log))
    return log


def _instruments(log: Log, model: Model, values) -> list[tuple[Effect, Any]]:
    """Sensor effects with their parameters, the last one that acted first."""
    known, at = {}, len(Theta._fields)
    for active in model.effects:
        if active.effect.acts("restore"):
            chosen = values[at : at + len(active.values)]
            known[active.identifier] = dict(zip(active.values, map(float, chosen), strict=True))
        at += len(active.values)
    known |= log.recording
    found = [(effect := get_effect(name), effect.arrange(sizes, log.platform))
             for name, sizes in known.items()]  # fmt: skip
    return sorted(found, key=lambda one: -one[0].order)


def _undone(piece: Log, instruments: list) -> Log:
    rows = Rows(
        piece.platform,
        piece.time,
        DriveInput(piece.time, piece.command),
        piece.wheel_velocity,
        piece.body_velocity,
    )
    for effect, p in instruments:
        rows = effect.restore(p, rows)
    return replace(
        piece,
        wheel_velocity=rows.wheel_velocity,
        body_velocity=rows.body_velocity,
        **{f"wheel_{piece.drive}": rows.drive.means()},
    )
