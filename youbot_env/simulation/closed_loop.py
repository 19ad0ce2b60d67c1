"""A whole record of one robot under its wheel-speed loops in one compiled call.

What ``recording.record_motion`` does sample by sample in Python, for the analytic plant only: a log
of 112 s takes some hundredths of a second, which makes statistics over thousands possible.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from youbot_env.backend import NUMPY, casadi_ops
from youbot_env.compiled import Hidden, advance_function
from youbot_env.model import Model
from youbot_env.plant import Structure
from youbot_env.references import Reference
from youbot_env.simulation.analytic import STEP_FRACTION, choose_substeps, history_length
from youbot_env.simulation.sensors import Sensors
from youbot_env.simulation.wheel_loop import WheelLoop


def record_closed_loop(
    model: Model,
    reference: Reference,
    times: np.ndarray,
    sensors: Sensors,
    loop: WheelLoop | None = None,
    seed: int | None = None,
    fraction: float = STEP_FRACTION,
) -> dict[str, np.ndarray]:
    """Drive a robot along a reference and record what its sensors show.

    Args:
        model: the true robot.
        reference: the commanded motion.
        times: (N,) sample times, s, uniform or jittered; torques are held between them.
        sensors: noise of the record; the loops see the noisy wheel speeds.
        loop: gains on board.
        seed: of the reference and of all noise.
        fraction: of the fastest time constant, the largest step.

    Returns:
        Channels of a log: ``time`` (N,) s, ``wheel_velocity`` (N, n) rad/s, ``wheel_torque`` (N, n)
        N m, ``pose`` (N, 3) m, m, rad, ``reference`` (N, 3) m/s, m/s, rad/s.
    """
    model.check()
    structure, loop, times = Structure.of(model), loop or WheelLoop(), np.asarray(times, float)
    wheels, count = len(structure.platform.wheels), len(times)
    draws, noise = (np.random.default_rng(c) for c in np.random.SeedSequence(seed).spawn(2))
    motion = reference.evaluate(reference.draw(draws).tolist(), times, NUMPY)
    twist = np.array(np.broadcast_arrays(*motion.twist(NUMPY), times)[:3])
    steps = np.diff(times, append=2 * times[-1] - times[-2])
    delay = structure.bind(model.values()).delay()
    substeps = choose_substeps(model, float(steps.max()), fraction)
    history = history_length(structure, delay, float(steps.min()))
    function = _record_function(structure.key, substeps, history, loop, count, Hidden(structure))
    start = tuple(float(np.ravel(component)[0]) for component in motion.pose)
    error = sensors.wheel_velocity * noise.normal(size=(wheels, count))
    grain = sensors.wheel_velocity_step or 1e-12
    rest = np.array(structure.flatten(structure.rest(start)))
    clock, values = times[None] - times[0], np.array(model.values())
    shown = function(rest, twist, error, grain, values, clock, steps[None])
    plant, speed, torque = (np.asarray(part).T for part in shown)
    return {
        "time": times,
        "wheel_velocity": speed,
        "wheel_torque": sensors.read_wheel_torque(torque, noise),
        "pose": sensors.read_pose(plant[:, :3], noise),
        "reference": twist.T,
    }


@lru_cache(maxsize=16)
def _record_function(
    key: tuple, substeps: int, history: int, loop: WheelLoop, count: int, hidden: Hidden
) -> ca.Function:
    """Sample the sensors, close the loops, advance the plant, ``count`` times."""
    structure, ops = hidden.structure, casadi_ops()
    wheels = len(structure.platform.wheels)
    size = structure.state_size
    plant, integral = ca.SX.sym("plant", size), ca.SX.sym("integral", wheels)
    past = ca.SX.sym("past", wheels, history)
    twist, error, grain = ca.SX.sym("twist", 3), ca.SX.sym("error", wheels), ca.SX.sym("grain")
    values = ca.SX.sym("values", structure.value_count)
    time, dt = ca.SX.sym("time"), ca.SX.sym("dt")
    state = structure.unflatten(ca.vertsplit(plant))
    robot = structure.bind(ca.vertsplit(values))
    last = tuple(ca.vertsplit(past[:, 0]))
    s = robot.signals(time, state.velocity, state.pose, state.wheel_angle, last, ops)
    exact = ca.vertcat(*robot.wheel_velocity(s, ops, state.internal))
    speed = ca.floor((exact + error) / grain + 0.5) * grain
    command, kept = loop.torque(
        structure.platform.geometry.wheel_velocity(tuple(ca.vertsplit(twist))),
        tuple(ca.vertsplit(speed)), tuple(ca.vertsplit(integral)), dt, ops,
    )  # fmt: skip
    commands = ca.horzcat(ca.vertcat(*command), past[:, : history - 1])
    advance = advance_function(structure, substeps, history)
    after = advance(plant, commands, values, time, dt)
    carried = ca.vertcat(plant, integral, ca.vec(past))
    following = ca.vertcat(after, *kept, ca.vec(commands))
    one = ca.Function(
        "sample",
        [carried, twist, error, grain, values, time, dt],
        [ca.cse(following), plant, speed, ca.vertcat(*command)],
    )
    along = one.mapaccum("samples", count)
    start = ca.MX.sym("start", size)
    inputs = [ca.MX.sym("twist", 3, count), ca.MX.sym("error", wheels, count), ca.MX.sym("grain"),
              ca.MX.sym("values", structure.value_count), ca.MX.sym("time", 1, count),
              ca.MX.sym("dt", 1, count)]  # fmt: skip
    carried = ca.vertcat(start, ca.DM.zeros(wheels * (1 + history)))
    twist, error, grain, values, time, dt = inputs
    _, *shown = along(
        carried, twist, error, ca.repmat(grain, 1, count), ca.repmat(values, 1, count), time, dt
    )
    return ca.Function("record", [start, *inputs], shown)
