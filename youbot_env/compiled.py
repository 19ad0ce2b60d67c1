"""The plant's time step as one CasADi function, for single simulations and for derivatives.

The function is traced from ``stepping.advance``; nothing of the physics is repeated here.  Called
through raw buffers it costs about a microsecond, which makes it the fast way to simulate one robot.
"""

from __future__ import annotations

from functools import lru_cache

import casadi as ca
import numpy as np

from youbot_env.backend import casadi_ops
from youbot_env.plant import BoundModel, ModelStructure, State
from youbot_env.stepping import advance, rk4_step


def advance_function(structure: ModelStructure, substeps: int = 1, history: int = 1) -> ca.Function:
    """Build (or find) the CasADi function of one sample interval.

    Args:
        structure: platform and effects.
        substeps: Runge-Kutta steps an interval.
        history: how many torque commands it takes, newest first.

    Returns:
        ``F(state, commands, values, t, dt) -> state`` with ``state`` as ``ModelStructure.flatten``
        orders it, ``commands`` an (n, history) matrix in N m, ``values`` as ``Model.names()``,
        time ``t`` and sample time ``dt`` in s.
    """
    return _build(structure.key, substeps, history, Hidden(structure))


class Hidden:
    """Carries the structure past the cache, whose key is ``ModelStructure.key`` alone."""

    def __init__(self, structure: ModelStructure):
        self.structure = structure

    def __eq__(self, other) -> bool:
        return isinstance(other, Hidden)

    def __hash__(self) -> int:
        return 0


@lru_cache(maxsize=128)
def _build(key: tuple, substeps: int, history: int, hidden: Hidden) -> ca.Function:
    structure, ops = hidden.structure, casadi_ops()
    state, time, dt = ca.SX.sym("state", structure.state_size), ca.SX.sym("t"), ca.SX.sym("dt")
    commands = ca.SX.sym("commands", len(structure.platform.wheels), history)
    values = ca.SX.sym("values", structure.value_count)
    past = tuple(tuple(ca.vertsplit(commands[:, k])) for k in range(history))
    traced = _traced_step(key, hidden)

    def step(robot: BoundModel, state: State, command: tuple, h, t, ops) -> State:
        now = ca.vertcat(*structure.flatten(state))
        return structure.unflatten(ca.vertsplit(traced(now, ca.vertcat(*command), values, t, h)))

    after = advance(
        structure.bind(ca.vertsplit(values)),
        structure.unflatten(ca.vertsplit(state)),
        past,
        dt,
        substeps,
        time,
        ops,
        step,
    )
    # Without subexpressions in common SX would evaluate the four Runge-Kutta stages' shared parts
    # again and again.
    result = ca.cse(ca.vertcat(*structure.flatten(after)))
    return ca.Function(
        "advance",
        [state, commands, values, time, dt],
        [result],
        ["state", "commands", "values", "t", "dt"],
        ["next"],
    )


@lru_cache(maxsize=128)
def _traced_step(key: tuple, hidden: Hidden) -> ca.Function:
    """One Runge-Kutta step, traced once however often a sample interval takes it."""
    structure = hidden.structure
    state, time, h = ca.SX.sym("state", structure.state_size), ca.SX.sym("t"), ca.SX.sym("h")
    command = ca.SX.sym("command", len(structure.platform.wheels))
    values = ca.SX.sym("values", structure.value_count)
    robot, now = structure.bind(ca.vertsplit(values)), structure.unflatten(ca.vertsplit(state))
    after = rk4_step(robot, now, tuple(ca.vertsplit(command)), h, time, casadi_ops())
    result = ca.vertcat(*structure.flatten(after))
    return ca.Function("step", [state, command, values, time, h], [result])


class InPlace:
    """Calls a CasADi function on arrays that stay where they are; copies and pickles go on equally.

    A buffer of CasADi holds addresses: a copy gets its own, of its own arrays.
    """

    def _connect(self, function: ca.Function, inputs: tuple, outputs: tuple) -> None:
        self._function = function  # the buffer does not keep it alive
        self._inputs, self._outputs = inputs, outputs
        self._buffer, self._call = function.buffer()
        for index, array in enumerate(inputs):
            self._buffer.set_arg(index, memoryview(array))
        for index, array in enumerate(outputs):
            self._buffer.set_res(index, memoryview(array))

    def __getstate__(self) -> dict:
        return {k: v for k, v in self.__dict__.items() if k not in ("_buffer", "_call")}

    def __setstate__(self, state: dict) -> None:
        self.__dict__.update(state)
        self._connect(self._function, self._inputs, self._outputs)


class Stepper(InPlace):
    """Calls an advance function in place, without copies.

    Attributes:
        state: flat state, overwritten by every ``step``.
        commands: (history, n) torque commands, N m, newest first; written by the caller.
        values: flat values; written by the caller.
    """

    def __init__(self, structure: ModelStructure, dt: float, substeps: int = 1, history: int = 1):
        function = advance_function(structure, substeps, history)
        self.dt = dt
        self.state = np.array(structure.flatten(structure.rest()), float)
        self.commands = np.zeros((history, len(structure.platform.wheels)))
        self.values = np.zeros(structure.value_count)
        self._time, self._next = np.zeros(1), np.zeros_like(self.state)
        self._dt = np.array([dt])
        inputs = (self.state, self.commands, self.values, self._time, self._dt)
        self._connect(function, inputs, (self._next,))

    def step(self, t: float = 0.0) -> np.ndarray:
        """Advance ``state`` by dt from time t, s, and return it."""
        self._time[0] = t
        self._call()
        self.state[:] = self._next
        return self.state
