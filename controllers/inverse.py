"""Inverse dynamics: the torque commands for a wanted acceleration, effects and drive included.

The equations are those of ``youbot_env``; here they are only solved for the torque.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import numpy as np

from youbot_env import dynamics
from youbot_env.backend import Ops, weighted_sum
from youbot_env.effects import Signals
from youbot_env.plant import BoundModel, State

# A law on the shaft that takes a share k of the torque leaves the error k^n after n rounds.
SHAFT_ROUNDS = 6
# One round is exact where the drive is linear in the command; a dead zone needs a few.
DRIVE_ROUNDS = 6
# After this time the drive counts as settled, s.
SETTLED = 1.0


def required_wrench(s: Signals, acceleration: tuple) -> tuple:
    """Generalized forces (N, N, N m) that give the body (V_X', V_Y', Omega') at signals s."""
    parts = (
        dynamics.momentum(s.geometry, s.theta, acceleration),
        dynamics.centripetal(s.theta, s.v),
        dynamics.friction(s.geometry, s.theta, s.v),
    )
    return tuple(sum(forces) for forces in zip(*parts, strict=True))


def without(disturbance: tuple, wrench: tuple) -> tuple:
    """Generalized forces that a disturbance leaves for the drive."""
    return tuple(w - d for w, d in zip(wrench, disturbance, strict=True))


def shaft_torque(robot: BoundModel, wrench: tuple, s: Signals, internal: tuple, ops: Ops) -> tuple:
    """Shaft torques (n,), N m, with which all forces on the body together are ``wrench``.

    The wrench is shared out by the pseudo-inverse of J', the smallest torques that give it; they
    hold nothing of the direction that moves nothing, (1, 1, -1, -1) on a mecanum platform.
    """
    rows = np.linalg.pinv(robot.platform.jacobian_array.T).tolist()
    torque = (0.0,) * len(rows)
    for _ in range(1 if robot.simple else SHAFT_ROUNDS):
        given = robot.wrench(torque, s, internal, ops)
        missing = tuple(w - g for w, g in zip(wrench, given, strict=True))
        torque = tuple(m + weighted_sum(row, missing) for m, row in zip(torque, rows, strict=True))
    return torque


def drive_command(
    robot: BoundModel, torque: tuple, s: Signals, internal: tuple, h, limit: float, ops: Ops
) -> tuple:
    """Commands (n,), N m, within the limit, with which the drive delivers ``torque`` after h s."""
    if not robot.acting("drive"):
        return tuple(clip(m, limit, ops) for m in torque)

    def missing(command: tuple) -> list:
        s.command = command
        given = robot.deliver(s, internal, h, ops)[0]
        return [g - m for g, m in zip(given, torque, strict=True)]

    # Each wheel by itself, between the limits, by regula falsi with the Illinois modification.
    low, high = (tuple(0.0 * m + end for m in torque) for end in (-limit, limit))
    most, least = missing(high), missing(low)
    ends = [_Bracket(*end) for end in zip(low, least, high, most, strict=True)]
    for _ in range(DRIVE_ROUNDS):
        trial = tuple(bracket.chord(limit, ops) for bracket in ends)
        pairs = zip(ends, trial, missing(trial), strict=True)
        ends = [bracket.narrowed(command, error, ops) for bracket, command, error in pairs]
    # Beyond what the drive can deliver the nearest limit is the answer.
    return tuple(
        ops.where(top < 0.0, limit, ops.where(bottom > 0.0, -limit, bracket.chord(limit, ops)))
        for bracket, top, bottom in zip(ends, most, least, strict=True)
    )


def feedforward(
    robot: BoundModel,
    state: State,
    v: tuple,
    acceleration: tuple,
    t,
    limit: float,
    ops: Ops,
    disturbance: tuple = (0.0, 0.0, 0.0),
) -> tuple:
    """Commands (n,), N m, that hold velocity v and (V_X', V_Y', Omega') once the drive has settled.

    Args:
        robot: model bound to its values.
        state: pose and wheel angles, where effects read them.
        v, acceleration: body velocity and its rates.
        t: time, s.
        limit: largest command, N m.
        ops: elementary functions.
        disturbance: generalized forces that act beyond those of the model, N, N, N m.
    """
    rest = (0.0,) * len(robot.platform.wheels)
    s = robot.signals(t, v, state.pose, state.wheel_angle, rest, ops)
    wrench = without(disturbance, required_wrench(s, acceleration))
    torque = shaft_torque(robot, wrench, s, state.internal, ops)
    return drive_command(robot, torque, s, state.internal, SETTLED, limit, ops)


class _Bracket(NamedTuple):
    """Two commands of one wheel and what they give too much, the newer one last."""

    old: Any
    old_error: Any
    new: Any
    new_error: Any

    def chord(self, limit: float, ops: Ops):
        """Command at which the line through both errors is zero; the newer one where it is flat."""
        rise = self.new_error - self.old_error
        flat = ops.abs(rise) < 1e-9
        run = ops.where(flat, 0.0, (self.new - self.old) / ops.where(flat, 1.0, rise))
        return clip(self.new - self.new_error * run, limit, ops)

    def narrowed(self, command, error, ops: Ops) -> _Bracket:
        """The bracket with a new command in place of the end on its side of the zero."""
        crossed = error * self.new_error < 0.0
        return _Bracket(
            ops.where(crossed, self.new, self.old),
            ops.where(crossed, self.new_error, 0.5 * self.old_error),
            command,
            error,
        )


def clip(value, limit: float, ops: Ops):
    """Limit a component to [-limit, limit]."""
    return ops.minimum(ops.maximum(value, -limit), limit)
