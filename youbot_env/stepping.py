"""One time step of the plant: Runge-Kutta with held torques, pure delays handled exactly."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

from youbot_env import dynamics
from youbot_env.backend import Ops
from youbot_env.plant import BoundModel, State


def pose_rate(v: tuple, yaw, ops: Ops) -> tuple:
    """World velocities (x', y', yaw') of body velocities v at heading yaw."""
    c, s = ops.cos_sin(yaw)
    return v[0] * c - v[1] * s, v[0] * s + v[1] * c, v[2]


def rk4_step(robot: BoundModel, state: State, command: tuple, h, t, ops: Ops) -> State:
    """One Runge-Kutta step of length h with the command held.

    Slopes are evaluated at ``ops.coarse`` of the state and added to the state itself, so a batch
    may use single precision for the slopes without its rounding piling up in the state.  Time and
    effects' own states, which do not pile up, are coarse themselves.

    Effects' own states move by their exact held-input solution (``Effect.evolve``), so a lag
    faster than the step neither blows up nor needs a stiff solver.
    """
    size = len(state.wheel_angle)
    begin = (*state.pose, *state.velocity, *state.wheel_angle)
    start, t = tuple([ops.coarse(q) for q in begin]), ops.coarse(t)
    memory = tuple([tuple([ops.coarse(z) for z in part]) for part in state.internal])
    # Where nobody reads position or wheel angles their values between start and end are not needed.
    moving = (robot.reads_pose,) * 2 + (True,) * 4 + (robot.reads_wheel_angle,) * size
    # Each is there where it is used: inertia and wrench of a simple robot, the origin of others.
    inertia: Any = robot.inertia
    fixed: Any = robot.geometry.wrench(command) if robot.simple else None
    origin: Any = None
    if not robot.simple:
        origin = robot.signals(t, start[3:6], start[:3], start[6:], command, ops)

    def rates(flat: Any, elapsed) -> tuple[tuple, tuple]:
        v = flat[3:6]
        if robot.simple:
            change = dynamics.acceleration(inertia, v, fixed)
            speeds = robot.geometry.wheel_velocity(v) if size else ()
            return (*pose_rate(v, flat[2], ops), *change, *speeds), memory
        torque, internal = robot.deliver(origin, memory, elapsed, ops)
        s = robot.signals(t + elapsed, v, flat[:3], flat[6:], command, ops)
        change = robot.acceleration(robot.wrench(torque, s, internal, ops), s)
        speeds = robot.wheel_velocity(s, ops) if size else ()
        return (*pose_rate(v, flat[2], ops), *change, *speeds), internal

    def shifted(step, slope: tuple) -> list:
        pairs = zip(start, slope, moving, strict=True)
        return [q + step * k if used else q for q, k, used in pairs]

    half = h / 2
    k1, _ = rates(start, 0.0 * h)
    k2, _ = rates(shifted(half, k1), half)
    k3, _ = rates(shifted(half, k2), half)
    k4, internal = rates(shifted(h, k3), h)
    slopes, sixth = zip(begin, k1, k2, k3, k4, strict=True), h / 6
    end = tuple([q + sixth * (a + 2 * (b + c) + d) for q, a, b, c, d in slopes])
    return State(end[:3], end[3:6], end[6:], internal)


def advance(
    robot: BoundModel,
    state: State,
    commands: tuple,
    dt: float,
    substeps: int,
    t,
    ops: Ops,
    step: Callable[..., State] = rk4_step,
) -> State:
    """Advance by dt with torque commands that are held between samples.

    Args:
        robot: bound structure.
        state: state at time t.
        commands: the command given at t, then older ones, newest first; a delay needs
            ``ceil(delay / dt) + 1`` of them (the oldest stands for all before it).
        dt: sample time, s.
        substeps: Runge-Kutta steps a phase.
        t: time, s.
        ops: elementary functions.
        step: takes one step, as ``rk4_step`` does.

    A pure delay switches the delivered command inside the interval; the interval is split there,
    which keeps the step exact for any delay.
    """
    if not robot.acting("delay"):
        phases = [(commands[0], dt)]
    else:
        delay = robot.delay()
        whole = ops.floor(delay / dt)
        part = delay - whole * dt
        phases = [
            (_select(commands, whole + 1, ops), part),
            (_select(commands, whole, ops), dt - part),
        ]
    for command, duration in phases:
        h = duration / substeps

        def once(carry: tuple, command=command, h=h) -> tuple:
            state, t = carry
            return step(robot, state, command, h, t, ops), t + h

        state, t = ops.iterate(substeps, once, (state, t))
    return state


def _select(commands: tuple, index, ops: Ops) -> tuple:
    chosen = commands[-1]
    for place in range(len(commands) - 2, -1, -1):
        chosen = tuple(
            ops.where(index <= place, new, old)
            for new, old in zip(commands[place], chosen, strict=True)
        )
    return chosen
