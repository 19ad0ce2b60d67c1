"""The tracking problem over a horizon, once, for every solver.

Unknown are deviations from the reference and from the torques that the model needs along it; with
none of either, the discretised equations hold exactly on the reference:

    min  sum_k |x_k - x_ref_k|^2_Q + |u_k - u_ref_k|^2_R + soft limits of the speed
    s.t. implicit midpoint rule of the model,  |u_k| <= torque limit.

The midpoint rule is stable however steep a friction law is, and needs the model once a step.
"""

from __future__ import annotations

from typing import Any, NamedTuple

import casadi as ca

from controllers.estimator import OPS
from controllers.inverse import feedforward
from youbot_env.plant import BoundModel, ModelStructure, State
from youbot_env.stepping import pose_rate

# Pose and velocity come first in the flat state.
BODY = 6


class Weights(NamedTuple):
    """Run-time inputs of the cost and the limits.

    Attributes:
        state: weights of (x, y, yaw, V_X, V_Y, Omega) deviations, (6,).
        command: weight of a torque deviation squared, 1/(N m)^2.
        soft: weight of a speed beyond its limit squared.
        speed: limits of (V_X, V_Y, Omega), (3,).
        torque: limit, N m.
    """

    state: Any
    command: Any
    soft: Any
    speed: Any
    torque: Any


class Stage(NamedTuple):
    """One step of the discretised model.

    Attributes:
        residual: velocity that is missing at the end, (3,).
        after: flat state at the end, with the velocity that was put in.
    """

    residual: Any
    after: Any


def stage(structure: ModelStructure, values, before, velocity, command, t, h) -> Stage:
    """Evaluate one step from flat state ``before`` to ``velocity`` at its end; all symbols."""
    robot = structure.bind(ca.vertsplit(values))
    start, torques = structure.unflatten(ca.vertsplit(before)), tuple(ca.vertsplit(command))
    end = tuple(ca.vertsplit(velocity))
    v = tuple((a + b) / 2 for a, b in zip(start.velocity, end, strict=True))
    middle, rate = _halfway(robot, start, v, h)
    s = robot.signals(t + h / 2, v, middle.pose, middle.wheel_angle, torques, OPS)
    _, internal = robot.deliver(s, start.internal, h, OPS)
    delivered, halfway = robot.deliver(s, start.internal, h / 2, OPS)
    change = robot.acceleration(robot.wrench(delivered, s, halfway, OPS), s)
    speeds = robot.wheel_velocity(s, OPS) if start.wheel_angle else ()
    after = State(
        tuple(q + h * p for q, p in zip(start.pose, rate, strict=True)),
        end,
        tuple(q + h * p for q, p in zip(start.wheel_angle, speeds, strict=True)),
        internal,
    )
    residual = [a + h * c - b for a, b, c in zip(start.velocity, end, change, strict=True)]
    return Stage(ca.vertcat(*residual), ca.vertcat(*structure.flatten(after)))


def _halfway(robot: BoundModel, state: State, v: tuple, h) -> tuple[State, tuple]:
    """State with pose and wheel angles half a step on at velocity v, and the pose's rate there."""
    rate = pose_rate(v, state.pose[2] + (h / 2) * v[2], OPS)
    pose = tuple(q + (h / 2) * p for q, p in zip(state.pose, rate, strict=True))
    spin = robot.geometry.wheel_velocity(v) if state.wheel_angle else ()
    wheels = tuple(q + (h / 2) * p for q, p in zip(state.wheel_angle, spin, strict=True))
    return state._replace(pose=pose, wheel_angle=wheels), rate


def step_functions(structure: ModelStructure) -> tuple[ca.Function, ca.Function]:
    """Trace ``stage`` and ``stage_feedforward`` once, to be called for every step.

    Returns:
        ``F(values, before, velocity, command, t, h) -> Stage`` and
        ``F(values, before, first, last, t, h, limit) -> commands``.
    """
    size, wheels = structure.state_size, len(structure.platform.wheels)
    values, before = ca.SX.sym("values", structure.value_count), ca.SX.sym("before", size)
    first, last = ca.SX.sym("first", 3), ca.SX.sym("last", 3)
    command, t, h, limit = ca.SX.sym("u", wheels), *(ca.SX.sym(name) for name in "thm")
    step = stage(structure, values, before, last, command, t, h)
    u_ff = stage_feedforward(structure, values, before, first, last, t, h, limit)
    return (
        ca.Function("stage", [values, before, last, command, t, h], list(step)),
        ca.Function("need", [values, before, first, last, t, h, limit], [u_ff]),
    )


def reference_step(pose, first, last, h):
    """Pose of the reference one step on, by the rule of ``stage``; poses and twists (3,)."""
    v = tuple(ca.vertsplit((first + last) / 2))
    return pose + h * ca.vertcat(*pose_rate(v, pose[2] + (h / 2) * v[2], OPS))


def stage_feedforward(structure: ModelStructure, values, before, first, last, t, h, limit):
    """Commands (n,) of the reference over one step; flat state for effects that read it."""
    robot = structure.bind(ca.vertsplit(values))
    v = tuple(ca.vertsplit((first + last) / 2))
    rates = tuple(ca.vertsplit((last - first) / h))
    state, _ = _halfway(robot, structure.unflatten(ca.vertsplit(before)), v, h)
    return ca.vertcat(*feedforward(robot, state, v, rates, t + h / 2, limit, OPS))


def excess(velocity, twist, limits):
    """Speed beyond its limit, (3,); a reference that is faster itself moves the limit along."""
    return ca.fmax(ca.fabs(velocity) - ca.fmax(limits, ca.fabs(twist)), 0.0)


def split_weights(weights) -> Weights:
    """Name the parts of one vector of weights (12,)."""
    return Weights(*ca.vertsplit(weights, [0, BODY, BODY + 1, BODY + 2, BODY + 5, BODY + 6]))
