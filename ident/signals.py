"""What was measured, as the components that the physics reads."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache

import casadi as ca
import numpy as np

from ident.dead_reckoning import dead_reckoning, wheel_angles
from ident.filters import delayed_hold
from ident.log import Log
from youbot_env.backend import FLOAT, NUMPY, casadi_ops
from youbot_env.compiled import Hidden
from youbot_env.dynamics import factorize, solve
from youbot_env.effects.base import Signals
from youbot_env.model import Model
from youbot_env.plant import BoundModel, ModelStructure

# Long enough for lags and bristles to follow what is held, s.
RELAXED = 10.0


@dataclass(frozen=True)
class Measured:
    """One contiguous piece of a log seen through a model.

    Attributes:
        time: (N,) s.
        robot: the model's structure with its values.
        signals: what laws read, arrays (N,) as components.
        delivered: n torques on the shafts (N,), N m, held between samples, after the drive's gain,
            offset, limit, delay and lag.
        piece, model, origin: what this was made of.
    """

    time: np.ndarray
    robot: BoundModel
    signals: Signals
    delivered: tuple
    piece: Log
    model: Model
    origin: float

    def with_values(self, values: np.ndarray) -> Measured:
        """Look at the same piece with other values of the model's parameters."""
        return measure(self.piece, self.model, values, self.origin)

    def interval_wrenches(self) -> tuple[tuple, tuple]:
        """Generalized forces at the beginning and end of each interval, components (N-1,).

        The torque of an interval is held through it while velocities run on; a law of both is
        evaluated with the same torque at either end.
        """
        structure = ModelStructure.of(self.model)
        rest = structure.rest().internal
        states = _followed(self.robot, structure, self.signals)[1] if structure.bristled else None
        torque = tuple(np.asarray(m)[:-1] for m in self.delivered)
        ends = []
        for rows in (slice(None, -1), slice(1, None)):
            s = _rows(self.signals, rows)
            s.command = tuple(np.asarray(m)[:-1] for m in self.signals.command)
            inner = rest if states is None else structure.parted(states[rows].T)
            ends.append(self.robot.wrench(torque, s, inner, NUMPY))
        return ends[0], ends[1]


def measure(
    piece: Log, model: Model, values=None, origin: float = 0.0, motion: tuple | None = None
) -> Measured:
    """Look at one contiguous piece through a model.

    Args:
        piece: a log without gaps, with wheel torques.
        model: platform, effects and values.
        values: other values in the order of ``model.names()``.
        origin: time at which the clock of the effects starts, s (the start of the log).
        motion: what ``observed_motion`` returns, where it is known already.
    """
    structure = ModelStructure.of(model)
    robot = structure.bind(np.asarray(model.values() if values is None else values, float).tolist())
    torque = delayed_hold(piece.command, piece.time, robot.delay())
    command = tuple(np.ascontiguousarray(torque.T))
    v, pose, angle, geometry = motion or observed_motion(piece, robot, origin)
    signals = robot.signals(piece.time - origin, v, pose, angle, command, NUMPY, geometry)
    delivered = _deliver(robot, structure, signals)
    return Measured(piece.time, robot, signals, delivered, piece, model, origin)


def observed_motion(piece: Log, robot: BoundModel, origin: float) -> tuple:
    """Body velocities, poses and wheel angles of a piece by components, and Jacobians.

    The Jacobians are None where no effect changes them, the others empty where nobody reads them.
    """
    v = tuple(np.ascontiguousarray(piece.velocity().T))
    # Integrals that nobody reads are not worth their time.
    angle = tuple(wheel_angles(piece).T) if robot.reads_wheel_angle else ()
    pose = ()
    if robot.reads_pose:
        pose = tuple((dead_reckoning(piece) if piece.pose is None else piece.pose).T)
    if not robot.acting("kinematics"):
        return v, pose, angle, None
    geometry = robot.signals(piece.time - origin, v, pose, angle, (), NUMPY).geometry
    if piece.body_velocity is None:
        v = body_velocity(geometry, tuple(piece.wheel_velocity.T))
    return v, pose, angle, geometry


def body_velocity(geometry, wheel_velocity: tuple) -> tuple:
    """Least-squares body velocities of measured wheel speeds, by components."""
    return solve(factorize(geometry.wheel_metric), geometry.wrench(wheel_velocity))


def delivered_torques(
    log: Log, model: Model, values=None, motions: list[tuple] | None = None
) -> np.ndarray:
    """(N, n) torques on the shafts, held between samples, after the drive of a model.

    ``motions`` are those of the log's pieces, where they are known already.
    """
    acts = {hook for active in model.effects for hook in ("drive", "delay")
            if active.effect.acts(hook)}  # fmt: skip
    if not acts:
        return log.command
    parts, pieces = [], log.pieces()
    for piece, motion in zip(pieces, motions or [None] * len(pieces), strict=True):
        seen = measure(piece, model, values, log.time[0], motion)
        parts.append(np.stack([np.broadcast_to(m, len(piece.time)) for m in seen.delivered], 1))
    return np.concatenate(parts)


def internal_states(log: Log, model: Model, values=None) -> np.ndarray:
    """(N, S) states that a model's effects carry (torques of a lag, bristles) at each sample.

    They are followed through each contiguous piece along the measured motion, from what a long hold
    of its first row leaves.  ``values`` are others than the model's own.
    """
    structure = ModelStructure.of(model)
    size = sum(map(len, structure.rest().internal))
    if not size:
        return np.empty((len(log.time), 0))
    pieces = [measure(piece, model, values, log.time[0]) for piece in log.pieces()]
    return np.concatenate([_followed(p.robot, structure, p.signals)[1] for p in pieces])


def _deliver(robot: BoundModel, structure: ModelStructure, s: Signals) -> tuple:
    """Torques on the shafts; the drive's own states are followed through the record."""
    rest = structure.rest().internal
    carries = any(state for (_, effect, _), state in zip(robot.effects, rest, strict=True)
                  if effect.acts("drive"))  # fmt: skip
    if not carries:
        return robot.deliver(s, rest, 0.0, NUMPY)[0]
    return tuple(_followed(robot, structure, s)[0])


def _followed(
    robot: BoundModel, structure: ModelStructure, s: Signals
) -> tuple[np.ndarray, np.ndarray]:
    """Torques delivered in each interval (n, N), and the effects' states at its start (N, S)."""
    steps = np.append(np.diff(s.t), s.t[-1] - s.t[-2])
    along = _drive_function(structure.key, len(s.t), Hidden(structure))
    parts = [(*s.v, *s.wheel_angle), s.command, (np.asarray(s.t) + 0.0 * steps,), (steps,)]
    inputs = [np.array([np.broadcast_to(c, len(s.t)) for c in part]) for part in parts]
    values = np.array(robot.values)
    first = [float(np.ravel(c)[0]) for c in (*s.v, *s.wheel_angle)]
    held = tuple(float(np.ravel(c)[0]) for c in s.command)
    pose = tuple(float(np.ravel(c)[0]) for c in s.pose) or (0.0, 0.0, 0.0)
    beginning = robot.signals(float(s.t[0]), tuple(first[:3]), pose, tuple(first[3:]), held, FLOAT)
    start = robot.deliver(beginning, structure.rest().internal, RELAXED, FLOAT)[1]
    torque, after = along(np.array(sum(start, ())), *inputs[:2], values, *inputs[2:])
    states = np.concatenate([np.array(sum(start, ()))[None], np.asarray(after).T[:-1]])
    return np.asarray(torque), states


@lru_cache(maxsize=16)
def _drive_function(key: tuple, count: int, hidden: Hidden) -> ca.Function:
    """Torques delivered in each of ``count`` intervals, and the states after them.

    The torque half way through an interval stands for its mean.
    """
    structure, ops = hidden.structure, casadi_ops()
    wheels = len(structure.platform.wheels)
    angles = wheels if structure.track_wheels else 0
    rest = structure.rest().internal
    state = ca.SX.sym("state", sum(map(len, rest)))
    motion, command = ca.SX.sym("motion", 3 + angles), ca.SX.sym("command", wheels)
    values = ca.SX.sym("values", structure.value_count)
    clock, step = ca.SX.sym("clock"), ca.SX.sym("step")
    robot, moved = structure.bind(ca.vertsplit(values)), ca.vertsplit(motion)
    given, internal = iter(ca.vertsplit(state)), []
    for part in rest:
        internal.append(tuple(next(given) for _ in part))
    torque = tuple(ca.vertsplit(command))
    s = robot.signals(clock, tuple(moved[:3]), (0.0,) * 3, tuple(moved[3:]), torque, ops)
    delivered, _ = robot.deliver(s, tuple(internal), 0.5 * step, ops)
    _, after = robot.deliver(s, tuple(internal), step, ops)
    one = ca.Function(
        "drive",
        [state, motion, command, values, clock, step],
        [ca.vertcat(*sum(after, ())), ca.vertcat(*delivered)],
    ).mapaccum("drives", count)
    inputs = [ca.MX.sym(name, size, count) for name, size in
              (("motion", 3 + angles), ("command", wheels), ("clock", 1), ("step", 1))]  # fmt: skip
    flat, start = ca.MX.sym("values", structure.value_count), ca.MX.sym("start", state.numel())
    motion, command, clock, step = inputs
    after, shown = one(start, motion, command, ca.repmat(flat, 1, count), clock, step)
    return ca.Function("delivered", [start, motion, command, flat, clock, step], [shown, after])


def _rows(s: Signals, rows) -> Signals:
    """Signals at some samples, Jacobians and parameters that vary over time included."""

    def cut(component):
        return component[rows] if np.ndim(component) else component

    def pick(components: tuple) -> tuple:
        return tuple(pick(c) if isinstance(c, tuple) else cut(c) for c in components)

    geometry = type(s.geometry)(*(pick(part) for part in s.geometry))
    theta = type(s.theta)(*pick(s.theta))
    return Signals(
        s.platform, geometry, theta, cut(s.t), pick(s.v), pick(s.pose), pick(s.wheel_angle),
        pick(s.command),
    )  # fmt: skip
