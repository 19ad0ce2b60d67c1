"""Tells samples that no robot can have moved to from those that it can, and stands in for them.

A law believes what it observes: a velocity that is a million times too large for one period goes
into the observed disturbance, the smoothed pose, the learned masses, and the robot is lost a second
later.  So every observation passes here first, before any controller sees it.  What the robot can
have done in one period follows from its mass and its torque limit, and from where it was; a sample
beyond that is replaced by where the last believed one leads to.  An ordinary sample passes as it
is, bit by bit.

A true jump, such as a collision, looks like a bad sample at first.  It is told apart by what
follows.  Velocities that follow from each other are believed after ``AGREEING`` of them if the pose
went their way; else the sensor lies, for however long.  Poses that velocities did not lead to are
believed once the drives, at their limit, could have brought the robot there.
"""

from __future__ import annotations

import math
from functools import lru_cache

import casadi as ca
import numpy as np

from controllers.columns import Columns
from youbot_env.backend import NUMPY, Ops, casadi_ops
from youbot_env.dynamics import Theta, momentum
from youbot_env.envs.task import TrackingTask
from youbot_env.model import Model
from youbot_env.references import rotate_to_body

OPS = casadi_ops()
# The change of velocity in a period that is possible: that of all drives at their limit, and of as
# much again from outside or from a mass that the model has twice too large.  Measured over seven
# controllers on both plants (eight, multisine at 4 rad/s, steps), nominal model: at most 0.056 m/s
# and 0.14 rad/s in 10 ms, noise included; the bounds are then 0.19 m/s and 0.73 rad/s.
DRIVES = 2.0
# Noise between two samples, ten standard deviations of the sensor: m/s, m/s, rad/s.
SPEED_NOISE = (0.05, 0.05, 0.1)
# Of a pose against the way reckoned from the velocities: m, m, rad.  Measured: 4.5 mm, 8.5 mrad.
POSE_NOISE = (0.03, 0.03, 0.06)
# A pose may be held as long, s, as that of a camera with 20 pictures a second.
HELD = 0.05
# A sample may be believed when it and so many before it follow from each other.
AGREEING = 6
# Share of the way that velocities claim which the pose must have gone, against that which was
# believed.  Noise of 1 mm is a sixth of what decides after six samples with 0.2 m/s too much.
WENT = 0.5
# Without samples a braking robot is taken to slow down with this time constant, s.
BRAKE_TIME = 0.2
# Entries of an observation that are measured: pose error, velocity, heading.
MEASURED = 8
# Share of what the pose says against a velocity that stands in, by which it is mended each period:
# within 0.1 s, and then noise of 1 mm is one of 0.014 m/s.
MENDED = 0.1
# Length of the memory before the last believed observation, and where the drift stands in it.
KEPT = 4 + MEASURED + 6
DRIFT = slice(4 + MEASURED, 4 + MEASURED + 3)


class Gate:
    """Follows one robot or many by what was believed of them.

    The memory holds: whether a velocity and a pose were ever believed; how many samples of each in
    turn followed from each other without being believed; the last sample as it was measured; how
    far the pose drifted from what the believed velocities lead to, m, m, rad, and how far it should
    have by those measured, since these are not believed or repeat themselves; the last believed
    observation.

    Args:
        model: its mass and the platform decide what the drives can do.
        task: layout of the observation, torque limit, period.

    Attributes:
        size: length of the memory.
        bounds: possible change of (V_X, V_Y, Omega) in one period, (3,), m/s, m/s, rad/s.
    """

    def __init__(self, model: Model, task: TrackingTask):
        self.bounds = speed_bounds(model, task)
        self._space = task.observation_space.high.astype(float)
        self._dt, self._one = task.dt, _compiled(task.dt)
        self._limits = np.concatenate([self.bounds, self._space[:6]])
        self.size = KEPT + len(self._space)

    def __call__(self, seen: np.ndarray, memory: np.ndarray, braking: np.ndarray):
        """Let samples pass or stand in for them.

        Args:
            seen: (robots, d); numbers that are not finite are never believed.
            memory: (robots, size); zeros at the start of an episode.
            braking: (robots, 1), 1 where the robot brakes for want of samples.

        Returns:
            Observations (robots, d) and the memory for the next call.
        """
        # The twists of the reference are not measured; they only have to be possible.
        ahead, possible = seen[:, MEASURED:], np.abs(seen[:, MEASURED:]) <= self._space[MEASURED:]
        if not possible.all():
            ahead = np.where(
                possible.all(axis=1, keepdims=True), ahead, memory[:, -ahead.shape[1] :]
            )
        kept = memory[:, : KEPT + MEASURED + 3]
        given = np.hstack([seen[:, :MEASURED], ahead[:, :3], kept, braking])
        if len(seen) == 1:
            believed, after = (part[None].copy() for part in self._one.one(given[0], self._limits))
        else:
            with np.errstate(invalid="ignore", over="ignore"):
                rows = np.broadcast_arrays(*judge(given.T, self._limits, self._dt, NUMPY))
            believed, after = np.split(np.stack(rows, axis=1), [MEASURED], axis=1)
        return np.hstack([believed, ahead]), np.hstack([after, ahead])

    @staticmethod
    def drift(memory: np.ndarray) -> np.ndarray:
        """How far the pose has drifted (robots, 3) since the velocities repeat, m, m, rad."""
        return memory[:, DRIFT]

    @staticmethod
    def known(memory: np.ndarray) -> np.ndarray:
        """Rows (robots, 1) of which a velocity and a pose were believed already."""
        return memory[:, :1] * memory[:, 1:2] > 0


def speed_bounds(model: Model, task: TrackingTask) -> np.ndarray:
    """Possible change of (V_X, V_Y, Omega) in one control period, (3,), m/s, m/s, rad/s."""
    platform = model.platform
    wrench = task.torque_limit * np.abs(platform.jacobian_array).sum(axis=0)
    return DRIVES * task.dt * wrench / inertia(model).diagonal() + SPEED_NOISE


def inertia(model: Model) -> np.ndarray:
    """(3, 3) generalized momentum of unit velocities, kg, kg m and kg m^2."""
    theta = Theta(*model.values()[: len(Theta._fields)])
    units = [tuple(float(k == j) for j in range(3)) for k in range(3)]
    return np.array([momentum(model.platform.geometry, theta, unit) for unit in units])


@lru_cache(maxsize=32)
def _compiled(dt: float) -> Columns:
    """``judge`` of one robot."""
    given, limits = ca.SX.sym("given", 2 * MEASURED + 6 + KEPT + 1), ca.SX.sym("limits", 9)
    parts = judge(ca.vertsplit(given), ca.vertsplit(limits), dt, OPS)
    outputs = [ca.densify(ca.vertcat(*rows)) for rows in (parts[:MEASURED], parts[MEASURED:])]
    return Columns(ca.Function("gate", [given, limits], outputs))


def judge(given, limits, dt: float, ops: Ops) -> tuple:
    """Decide on one sample.

    Args:
        given: by components, the sample (8), the twist of the reference (3), the memory up to the
            last believed sample and twist (18 + 8 + 3), whether the robot brakes.
        limits: ``Gate.bounds`` (3), then those of pose error and velocity of a first sample (6).
        dt: control period, s.
        ops: elementary functions.

    Returns:
        The believed sample (8), then the memory up to the last believed sample (18 + 8).
    """
    given, bounds, space = list(given), limits[:3], limits[3:]
    seen, twist, known, streak, raw, drift, claim, last, before = (
        [given.pop(0) for _ in range(count)]
        for count in (MEASURED, 3, 2, 2, MEASURED, 3, 3, MEASURED, 3)
    )
    braking = given[0]
    finite = [ops.where(ops.abs(value) < math.inf, value, 0.0) for value in seen]
    # Velocity.
    sane = _inside(seen[3:6], space[3:6], ops)
    near, follows = (_inside(_minus(seen[3:6], v[3:6]), bounds, ops) for v in (last, raw))
    fitting = sane * ops.where(known[0], near, True)
    fast = _streak(fitting, sane * follows, streak[0], ops)
    # The robot does as its reference does, as far as it can, or brakes.
    turn = (ops.cos(last[2]), -ops.sin(last[2]))
    change = _within(rotate_to_body(tuple(_minus(twist, before)), turn), bounds, ops)
    slower = math.exp(-dt / BRAKE_TIME)
    held = [
        ops.where(braking, old * slower, old + more)
        for old, more in zip(last[3:6], change, strict=True)
    ]
    velocity = [ops.where(fitting, v, old) for v, old in zip(seen[3:6], held, strict=True)]
    # Pose: reckoned from the velocities before and now.
    allowed = [
        noise + dt * bound + HELD * ops.abs(v)
        for noise, bound, v in zip(POSE_NOISE, bounds, velocity, strict=True)
    ]
    allowed.append(allowed[2])
    expected = _reckoned(last, last[3:6], before, velocity, twist, dt, ops)
    again = _reckoned(raw, last[3:6], before, velocity, twist, dt, ops)
    miss, step = _apart(seen, expected, ops), _apart(seen, again, ops)
    start = _inside(seen[:3], space[:3], ops) * _inside(seen[6:8], (2.0, 2.0), ops)
    near = ops.where(known[1], _inside(miss, allowed, ops), start)
    still = _streak(near, _inside(step, allowed, ops), streak[1], ops)
    # What the drives can reach in the time that passed.
    rates = [
        (bound - noise) / (DRIVES * dt) for bound, noise in zip(bounds, SPEED_NOISE, strict=True)
    ]
    reach = [a + 0.5 * rate * (dt * still) ** 2 for a, rate in zip(allowed, rates, strict=False)]
    reach.append(reach[2])
    certain = ops.where(near, True, (still >= AGREEING) * _inside(miss, reach, ops))
    pose = [
        ops.where(certain, a, b) for a, b in zip((*seen[:3], *seen[6:8]), expected, strict=True)
    ]
    # Whether the pose has gone the way of velocities that are not believed.
    same = _inside(_minus(seen[3:6], raw[3:6]), (0.0, 0.0, 0.0), ops)
    going = ops.where(fitting, same, fast > 1.0)
    drift, claim = (
        [ops.where(going, a, 0.0) + ops.where(kind, b, 0.0) for a, b in zip(old, new, strict=True)]
        for old, new, kind in (
            (drift, miss[:3], near * known[1]),
            (claim, [dt * v for v in _minus(velocity, finite[3:6])], sane),
        )
    )
    went, claimed = (
        sum(a * b / noise**2 for a, b, noise in zip(claim, other, POSE_NOISE, strict=True))
        for other in (drift, claim)
    )
    sure = ops.where(fitting, True, (fast >= AGREEING) * (went >= WENT * claimed))
    velocity = [ops.where(sure, v, old) for v, old in zip(seen[3:6], held, strict=True)]
    fast, still = ops.where(sure, 0.0, fast), ops.where(certain, 0.0, still)
    # What the next sample is compared with goes half way where this one was at the edge: else a
    # bad one that just passed would shut out the good ones after it.
    moved = _within(_minus(velocity, last[3:6]), bounds, ops)
    mended = [ops.where(near * known[1], MENDED / dt * error, 0.0) for error in miss[:3]]
    anchor = [
        ops.where(known[0] * fitting, old + part, ops.where(sure, v, v - more))
        for v, old, part, more in zip(velocity, last[3:6], moved, mended, strict=True)
    ]
    ahead, left, yaw, turned = _within(miss, allowed, ops)
    pulled = [expected[0] + ahead, expected[1] + left, expected[2] + yaw]
    pulled += _swung(expected[3:], turned, ops)
    place = [ops.where(known[1] * near, a, b) for a, b in zip(pulled, pose, strict=True)]
    flags = [ops.where(a, 1.0, b) for a, b in zip((sure, certain), known, strict=True)]
    believed = (*pose[:3], *velocity, *pose[3:])
    kept = (*flags, fast, still, *finite, *drift, *claim)
    return (*believed, *kept, *place[:3], *anchor, *place[3:])


def _streak(near, follows, streak, ops: Ops):
    """How many samples in turn follow from each other, where this one is not near."""
    return ops.where(near, 0.0, ops.where(follows, streak + 1.0, 1.0))


def _reckoned(pose, speeds, twist, velocity, new_twist, dt: float, ops: Ops) -> list:
    """Pose error, cosine and sine of the heading that follow from those before, trapezoidal."""
    rates = zip(_rate(pose, speeds, twist, ops), _rate(pose, velocity, new_twist, ops), strict=True)
    error = [e + (dt / 2) * (a + b) for e, (a, b) in zip(pose[:3], rates, strict=True)]
    return error + _swung(pose[6:8], (dt / 2) * (speeds[2] + velocity[2]), ops)


def _rate(pose, velocity, twist, ops: Ops) -> list:
    """Rate of the pose error (ahead, left, yaw) seen from the moving robot."""
    # The turn from the frame of the reference into that of the robot is minus the yaw error.
    turned = rotate_to_body(tuple(twist), (ops.cos(pose[2]), -ops.sin(pose[2])))
    ahead, left, yaw = _minus(turned, velocity)
    return [ahead + velocity[2] * pose[1], left - velocity[2] * pose[0], yaw]


def _apart(seen, expected, ops: Ops) -> list:
    """What a measured pose has more than the expected one: ahead, left, yaw error, heading."""
    (c, s), (c0, s0) = seen[6:8], expected[3:]
    # The sine stands for small angles; at a right angle and beyond nothing fits.
    heading = ops.where(c * c0 + s * s0 > 0.0, s * c0 - c * s0, 2.0)
    gap = seen[2] - expected[2]
    turns = ops.floor(gap / (2 * math.pi) + 0.5)
    return [seen[0] - expected[0], seen[1] - expected[1], gap - 2 * math.pi * turns, heading]


def _swung(heading, angle, ops: Ops) -> list:
    """Cosine and sine of a heading turned by an angle."""
    (c, s), turn = heading, (ops.cos(angle), ops.sin(angle))
    return [c * turn[0] - s * turn[1], s * turn[0] + c * turn[1]]


def _minus(a, b) -> list:
    return [x - y for x, y in zip(a, b, strict=True)]


def _inside(values, limits, ops: Ops):
    """Whether every value is within plus or minus its limit."""
    result = True
    for value, limit in zip(values, limits, strict=True):
        result = result * (ops.abs(value) <= limit)
    return result


def _within(values, limits, ops: Ops) -> list:
    """Values limited to half of their limits."""
    return [
        ops.minimum(ops.maximum(value, -limit / 2), limit / 2)
        for value, limit in zip(values, limits, strict=True)
    ]
