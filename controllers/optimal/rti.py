"""Real-time iteration: one Gauss-Newton step a control period."""

from __future__ import annotations

import casadi as ca
import numpy as np

from controllers.columns import Columns
from controllers.optimal.linearised import newton_step, response
from controllers.optimal.problem import BODY
from controllers.optimal.solution import Request, Solution
from youbot_env.plant import Structure

# The first-order conditions of a quadratic program must hold this well, N m.
ACCURACY = 1e-4


class RealTimeIteration:
    """Improves the trajectory of the last period by one step.

    Where no torque limit is active the step is a Riccati recursion; else the quadratic program is
    condensed to the torques and solved by DAQP, an active-set method whose answer is checked.

    Args:
        structure: platform and effects.
        steps: length of the horizon.
        iterations: changes of the active set after which DAQP gives up.
    """

    def __init__(self, structure: Structure, steps: int, iterations: int = 200):
        self._newton = Columns(newton_step(structure, steps))
        self._steps, self._wheels = steps, len(structure.platform.wheels)
        self._size = structure.state_size
        self._response = Columns(response(self._size, self._wheels, steps))
        count = steps * self._wheels
        pattern = {"h": ca.Sparsity.dense(count, count), "a": ca.Sparsity(0, count)}
        options = {"error_on_fail": False, "daqp": {"iter_limit": iterations}}
        self._program = Columns(ca.conic("program", "daqp", pattern, options))

    def solve(self, request: Request) -> Solution:
        """See ``Solver``."""
        deviations, bends, weights = request.deviations, request.bends, request.weights
        results = self._newton.one(*(np.ravel(part) for part in request))
        improved, bent, wanted, *linear = results
        limit = weights[-1]
        if not np.isfinite(bent.sum() + improved.sum()):
            return self._answer(False, "not finite", deviations, bends, wanted)
        if np.abs(wanted + bent).max() <= limit:
            return self._answer(True, "solved", improved, bent, wanted)
        return self._limited(request, wanted, linear)

    def _limited(self, request: Request, wanted: np.ndarray, linear: list) -> Solution:
        """Solve the quadratic program with the torque limits."""
        *matrices, q, g = linear
        planned = np.concatenate([request.pose, request.twists[0]]) + request.deviations[0]
        start = np.zeros(self._size)
        start[:BODY] = request.state[:BODY] - planned
        free, maps = self._response.one(*matrices, start)
        # The first state is given; its cost does not depend on the commands.
        q, g = q[self._size :], g[self._size :]
        maps = maps.reshape(-1, len(free))
        command_weight, limit = request.weights[BODY], request.weights[-1]
        bends = request.bends.ravel()
        hessian = (maps * q) @ maps.T
        hessian.flat[:: len(hessian) + 1] += command_weight
        slope = maps @ (q * free + g) + command_weight * bends
        low, high = -limit - wanted - bends, limit - wanted - bends
        change = self._minimise(hessian, slope, low, high)
        gradient = hessian @ change + slope
        scaled = gradient / hessian.diagonal()
        # At the minimum a step down the gradient is undone by the limits.
        error = np.abs(change - np.clip(change - scaled, low, high)).max()
        if not error < ACCURACY:
            return self._answer(
                False, f"inexact ({error:.1e} N m)", request.deviations, bends, wanted
            )
        states = np.concatenate([start, free + change @ maps]).reshape(-1, self._size)
        improved = request.deviations + states[:, :BODY]
        return self._answer(True, "solved at a limit", improved, bends + change, wanted)

    def _minimise(self, hessian, slope, low, high) -> np.ndarray:
        program = self._program
        arguments = dict.fromkeys(program.function.name_in(), 0.0)
        arguments |= {"h": hessian.ravel(), "g": slope, "lbx": low, "ubx": high}
        return program.one(*arguments.values())[0].copy()

    def _answer(self, solved: bool, status: str, deviations, bends, wanted) -> Solution:
        shape = (self._steps, self._wheels)
        return Solution(
            solved, status, 1, deviations.reshape(-1, BODY).copy(), bends.reshape(shape).copy(),
            wanted.reshape(shape).copy(),
        )  # fmt: skip
