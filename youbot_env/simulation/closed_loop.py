"""A whole record of one robot under its wheel-speed loops in a few compiled calls.

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
from youbot_env.plant import ModelStructure
from youbot_env.references import Reference
from youbot_env.references.eased import EASE_IN, Eased
from youbot_env.simulation.analytic import STEP_FRACTION, choose_substeps, history_length
from youbot_env.simulation.rows import Instrument, LoopInstants, pick_rows
from youbot_env.simulation.sensors import Sensors
from youbot_env.simulation.wheel_loop import WheelLoop

# Loop steps of one compiled call: building it takes the longer the more there are, and a call
# costs as much as a hundred steps.
CHUNK = 1000


def record_closed_loop(
    model: Model,
    reference: Reference,
    times: np.ndarray,
    sensors: Sensors,
    loop: WheelLoop | None = None,
    seed: int | None = None,
    fraction: float = STEP_FRACTION,
    loop_rate: float | None = None,
    row: str = "sampled",
    instrument: Instrument | None = None,
    ease: float = EASE_IN,
) -> dict[str, np.ndarray]:
    """Drive a robot along a reference and record what its sensors show.

    Args:
        model: the true robot.
        reference: the commanded motion; it begins, eased in from rest, with the first row.
        times: (N,) times of the rows, s, uniform or jittered.
        sensors: noise of the record; the loops see the noisy wheel speeds.
        loop: gains on board.
        seed: of the reference and of all noise.
        fraction: of the fastest time constant, the largest step.
        loop_rate: rate of the loops, Hz; each interval between rows takes the nearest whole number
            of equal loop steps.  None: one, so that the torque of a row is held until the next.
        row: ``sampled`` or ``averaged`` torque, see ``rows.pick_rows``.
        instrument: changes the channels at the loop instants before rows are picked, see there.
        ease: how long the reference takes to come up to speed, s.

    Returns:
        Channels of a log: ``time`` (N,) s, ``wheel_velocity`` (N, n) rad/s, ``wheel_torque`` (N, n)
        N m, ``pose`` (N, 3) m, m, rad, ``reference`` (N, 3) m/s, m/s, rad/s.
    """
    model.check()
    structure, times = ModelStructure.of(model), np.asarray(times, float)
    at = LoopInstants.of(times, loop_rate)
    draws, noise = (np.random.default_rng(c) for c in np.random.SeedSequence(seed).spawn(2))
    eased, clock = Eased(of=reference, seconds=ease), at.time - times[0]
    motion = eased.evaluate(eased.draw(draws).tolist(), clock, NUMPY)
    twist = np.array(np.broadcast_arrays(*motion.twist(NUMPY), clock)[:3])
    error = sensors.wheel_velocity * noise.normal(size=(len(structure.platform.wheels), len(clock)))
    delay = structure.bind(model.values()).delay()
    substeps = choose_substeps(model, float(at.step.max()), fraction)
    history = history_length(structure, delay, float(at.step.min()))
    function = _loop_function(
        structure.key, substeps, history, loop or WheelLoop(), Hidden(structure)
    )
    start = tuple(float(np.ravel(component)[0]) for component in motion.pose)
    state = np.zeros(function.size1_in(0))
    rest = structure.flatten(structure.rest(start))
    state[: len(rest)] = rest
    grain, values = sensors.wheel_velocity_step or 1e-12, np.array(model.values())
    parts = []
    for first in range(0, len(clock), CHUNK):
        # The last call is filled up with instants after the record, which nobody reads.
        part = np.minimum(np.arange(first, first + CHUNK), len(clock) - 1)
        state, *shown = function(
            state, twist[:, part], error[:, part], grain, values, clock[None, part],
            at.step[None, part],
        )  # fmt: skip
        parts.append(np.vstack([channel.full() for channel in shown]))
    plant, speed, torque = np.split(
        np.hstack(parts)[:, : len(clock)].T, (6, 6 + len(error)), axis=1
    )
    dense = {
        "time": at.time,
        "wheel_velocity": speed,
        "wheel_torque": torque,
        "pose": plant[:, :3],
        "velocity": plant[:, 3:],
        "reference": twist.T,
    }
    rows = pick_rows(dense, at.row, row, instrument)
    rows["wheel_torque"] = sensors.read_wheel_torque(rows["wheel_torque"], noise)
    rows["pose"] = sensors.read_pose(rows["pose"], noise)
    return rows


@lru_cache(maxsize=16)
def _loop_function(
    key: tuple, substeps: int, history: int, loop: WheelLoop, hidden: Hidden
) -> ca.Function:
    """Sample the sensors, close the loops, advance the plant, ``CHUNK`` times."""
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
        [ca.cse(following), plant[:6], speed, ca.vertcat(*command)],
    )
    along = one.mapaccum("samples", CHUNK)
    inputs = [ca.MX.sym("carried", carried.numel()), ca.MX.sym("twist", 3, CHUNK),
              ca.MX.sym("error", wheels, CHUNK), ca.MX.sym("grain"),
              ca.MX.sym("values", structure.value_count), ca.MX.sym("time", 1, CHUNK),
              ca.MX.sym("dt", 1, CHUNK)]  # fmt: skip
    carried, twist, error, grain, values, time, dt = inputs
    following, *shown = along(
        carried, twist, error, ca.repmat(grain, 1, CHUNK), ca.repmat(values, 1, CHUNK), time, dt
    )
    return ca.Function("record", inputs, [following[:, -1], *shown])
