"""Where the robot is, what pushes it, and where it will be when the next command acts.

A controller sees pose error, velocity and heading, and wheel angles where encoders tell them.  What
else the laws of its model read (time, place, states of the drive, else wheel angles too) is carried
along here from one observation to the next.
The measured velocities smooth the measured pose; the force that the model does not explain is
observed as a disturbance; a delay of the model is bridged by simulating it with the commands that
are already on their way.
"""

from __future__ import annotations

import math
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from controllers.preview import preview_weights
from youbot_env.backend import casadi_ops
from youbot_env.compiled import advance_function
from youbot_env.dynamics import Theta, momentum
from youbot_env.envs.task import TrackingTask
from youbot_env.model import Model
from youbot_env.plant import ModelStructure
from youbot_env.simulation import choose_substeps
from youbot_env.stepping import pose_rate, rk4_step

OPS = casadi_ops()
# Pose and velocity come first in the flat state and are observed.
BODY = 6
THETA = len(Theta._fields)


class Situation(NamedTuple):
    """The instant at which the next command begins to act.

    Attributes:
        t: that time since the start of the episode, s.
        state: flat state of the model then (``ModelStructure.flatten``).
        wanted: pose of the reference then, world frame; its yaw is within pi of the robot's.
        twist: velocities of the reference then, in its own frame.
        disturbance: generalized forces on the body beyond those of the model, body frame.
        memory: memory for the next call, before ``remember``.
    """

    t: Any
    state: Any
    wanted: Any
    twist: Any
    disturbance: Any
    memory: Any


class Estimator:
    """Follows one robot by its observations and its model.

    The world is the one in which the reference starts at the origin; the heading is observed.
    Wheel angles and states of effects start at zero, as they do in the plants.  Wheel angles that
    no encoder tells are reckoned from the velocities; on real rollers they were 0.47 rad off after
    6 s of a circle, nearly half the pitch of a roller, which turns the ripple of a model upside
    down.

    The memory holds: observations so far; pose of the reference and its world velocity;
    disturbance; flat state of the model at the last observation; commands sent, newest first; where
    the model reads wheel angles, those that encoders tell now, and 1 if they do.

    Pose: each observation pulls the pose that follows from the last one and the velocities
    measured since, by the share that forgets old poses with the time constant ``pose_time``.
    Disturbance: the momentum that one period of the model leaves unexplained, over that period,
    through a first-order filter with the time constant ``disturbance_time``.  It rests on the
    commands that were sent after clipping, so nothing winds up at the torque limit.

    Args:
        model: gives the structure; its values decide how fine and how far back to simulate.
        task: layout of the observation.
        pose_time: s; 0 takes every pose as it is measured.
        disturbance_time: s; infinity observes no disturbance.

    Attributes:
        structure: platform and effects.
        size: length of the memory.
        state: slice of the memory with the flat state at the last observation.
        sent: slice of the memory with the commands sent, N m, newest first.
        encoders: slice of the memory with the wheel angles told, rad, and whether they are; empty
            where no effect reads them.
        guide: length of ``weights``.
    """

    head = 10

    def __init__(
        self,
        model: Model,
        task: TrackingTask,
        pose_time: float = 0.0,
        disturbance_time: float = math.inf,
    ):
        self.structure, self.task = ModelStructure.of(model), task
        self._pose_share = 1.0 - math.exp(-task.dt / pose_time) if pose_time else 1.0
        self._push_share = 1.0 - math.exp(-task.dt / disturbance_time)
        self.substeps = choose_substeps(model, task.dt)
        self._flat = self.structure.state_size
        self.delayed = any(effect.acts("delay") for effect in self.structure.effects)
        delay = self.structure.bind(model.values()).delay()
        self._history = math.ceil(delay / task.dt) + 2 if self.delayed else 1
        wheels = len(task.platform.wheels)
        self.state = slice(self.head, self.head + self._flat)
        self.sent = slice(self.state.stop, self.state.stop + self._history * wheels)
        told = wheels + 1 if self.structure.track_wheels else 0
        self.encoders = slice(self.sent.stop, self.sent.stop + told)
        self.size = self.encoders.stop
        self.guide = 2 * (task.preview + 1) + THETA

    @property
    def key(self) -> tuple:
        """What two estimators must share to be the same code."""
        return self.structure.key, self.substeps, self._history

    def weights(self, model: Model) -> np.ndarray:
        """Numbers (guide,) that ``build``'s function takes besides the values of the model.

        Preview weights 2 (preview + 1) with which it sees across the delay, and the seven
        parameters whose masses turn velocity into force.  They stay those of the model where a
        controller learns its values: an observer with a mass too large is unstable.
        """
        delay = self.structure.bind(model.values()).delay()
        ahead = preview_weights(self.task, [delay / 2, delay]).ravel()
        return np.concatenate([ahead, model.values()[:THETA]])

    def build(self) -> ca.Function:
        """Trace ``F(seen, yaw, memory, values, weights) -> Situation`` of one robot."""
        task, count = self.task, self.task.preview + 1
        seen = ca.SX.sym("seen", task.observation_space.shape[0])
        yaw, memory = ca.SX.sym("yaw"), ca.SX.sym("memory", self.size)
        values = ca.SX.sym("values", self.structure.value_count)
        weights = ca.SX.sym("weights", self.guide)
        twists = ca.reshape(seen[8:], 3, count)
        t, first = memory[0] * task.dt, memory[0] < 0.5
        # The first observations are averaged, later ones forget the older.
        share = ca.fmax(self._pose_share, 1.0 / (memory[0] + 1.0))
        before, sent = memory[self.state], memory[self.sent]
        commands = ca.reshape(sent, len(task.platform.wheels), self._history)
        # The reference: heading reckoned from its twists, pulled by the measured one; then place.
        expected = memory[3] + (task.dt / 2) * (memory[6] + twists[2, 0])
        heading = yaw + _wrapped(expected - yaw + share * _wrapped(yaw + seen[2] - expected))
        rate = ca.vertcat(*pose_rate(ca.vertsplit(twists[:, 0]), heading, OPS))
        place = ca.if_else(first, 0.0, memory[1:3] + (task.dt / 2) * (memory[4:6] + rate[:2]))
        # The robot: place reckoned from its velocities, pulled by the measured one.
        gap = ca.vertcat(*pose_rate(ca.vertsplit(seen[:3]), yaw, OPS)[:2])
        speeds = _world(before[3:6], before[2]) + _world(seen[3:6], yaw)
        reckoned = before[:2] + (task.dt / 2) * speeds
        state = ca.vertcat(reckoned + share * (place - gap - reckoned), yaw, seen[3:6])
        # What the model expected of the period that is over, and what it missed.
        advance = advance_function(self.structure, self.substeps, self._history)
        carried = advance(before, commands, values, t - task.dt, task.dt)
        rest, told = ca.if_else(first, 0.0, carried[BODY:]), memory[self.encoders]
        if self.structure.track_wheels:
            wheels = len(task.platform.wheels)
            angle = ca.if_else(told[wheels], told[:wheels], rest[:wheels])
            rest = ca.vertcat(angle, rest[wheels:])
        if self._flat > BODY:
            state = ca.vertcat(state, rest)
        masses, missed = Theta(*ca.vertsplit(weights[-THETA:])), seen[3:6] - carried[3:6]
        geometry = self.structure.platform.geometry
        push = ca.vertcat(*momentum(geometry, masses, tuple(ca.vertsplit(missed)))) / task.dt
        disturbance = memory[7:10] + self._push_share * (push - memory[7:10])
        disturbance = ca.if_else(first, 0.0, disturbance)
        after = ca.vertcat(
            memory[0] + 1.0, place, heading, rate, disturbance, state, sent, 0 * told
        )
        wanted, twist = ca.vertcat(place, heading), twists[:, 0]
        if self.delayed:
            delay = self.structure.bind(ca.vertsplit(values)).delay()
            ahead = ca.mtimes(twists, ca.reshape(weights[: 2 * count], count, 2))
            state = self._simulate(state, commands, values, t, delay)
            wanted, twist = _move(wanted, twist, ahead[:, 0], ahead[:, 1], delay), ahead[:, 1]
            t = t + delay
        outputs = Situation(t, state, wanted, twist, disturbance, after)
        return ca.Function("estimate", [seen, yaw, memory, values, weights], list(outputs))

    def remember(self, memory, command):
        """Complete ``Situation.memory`` by the command that was chosen, N m; on columns."""
        sent, size = self.sent, len(self.task.platform.wheels)
        kept = memory[sent.start : sent.stop - size]
        parts = (memory[: sent.start], command, kept, memory[sent.stop : self.size])
        return np.concatenate(parts) if isinstance(memory, np.ndarray) else ca.vertcat(*parts)

    def tell(self, memory: np.ndarray, angle: np.ndarray) -> np.ndarray:
        """The memory (robots, size or more) with wheel angles (robots, n), rad, of encoders."""
        finite = np.isfinite(angle).all(axis=1, keepdims=True)
        memory = memory.copy()
        memory[:, self.encoders] = np.where(finite, np.hstack([angle, finite]), 0.0)
        return memory

    def _simulate(self, state, commands, values, t, delay):
        """Bridge the delay: the k-th newest command acts until ``delay - k dt`` from now."""
        step = self._step_function()
        for age in range(self._history - 1, -1, -1):
            duration = ca.fmin(ca.fmax(delay - age * self.task.dt, 0.0), self.task.dt)
            for _ in range(self.substeps):
                state = step(state, commands[:, age], values, t, duration / self.substeps)
                t = t + duration / self.substeps
        return state

    def _step_function(self) -> ca.Function:
        state, values = ca.SX.sym("state", self._flat), ca.SX.sym("v", self.structure.value_count)
        command = ca.SX.sym("command", len(self.task.platform.wheels))
        t, h = ca.SX.sym("t"), ca.SX.sym("h")
        robot = self.structure.bind(ca.vertsplit(values))
        start = self.structure.unflatten(ca.vertsplit(state))
        after = rk4_step(robot, start, tuple(ca.vertsplit(command)), h, t, OPS)
        result = ca.cse(ca.vertcat(*self.structure.flatten(after)))
        return ca.Function("step", [state, command, values, t, h], [result])


def _world(velocity, yaw):
    """World velocity (2,) of a body velocity at a heading."""
    return ca.vertcat(*pose_rate(ca.vertsplit(velocity), yaw, OPS)[:2])


def _wrapped(angle):
    """The angle within pi of zero."""
    return angle - 2 * math.pi * ca.floor(angle / (2 * math.pi) + 0.5)


def _move(pose, first, middle, last, duration):
    """Pose of the reference after ``duration`` s by Simpson's rule on three twists."""
    half = pose[2] + (duration / 4) * (first[2] + middle[2])
    end = pose[2] + (duration / 6) * (first[2] + 4 * middle[2] + last[2])
    rates = [
        ca.vertcat(*pose_rate(ca.vertsplit(twist), yaw, OPS))
        for twist, yaw in ((first, pose[2]), (middle, half), (last, end))
    ]
    return pose + (duration / 6) * (rates[0] + 4 * rates[1] + rates[2])
