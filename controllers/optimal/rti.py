"""Real-time iteration: one Gauss-Newton step a control period."""

from __future__ import annotations

import casadi as ca
import numpy as np

from controllers.columns import Columns
from controllers.optimal.linearised import newton_step
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
    """

    def __init__(self, structure: Structure, steps: int):
        self._newton = Columns(newton_step(structure, steps))
        self._steps, self._wheels = steps, len(structure.platform.wheels)
        self._size = len(structure.flatten(structure.rest()))
        count = steps * self._wheels
        pattern = {"h": ca.Sparsity.dense(count, count), "a": ca.Sparsity(0, count)}
        self._program = Columns(ca.conic("program", "daqp", pattern, {"error_on_fail": False}))

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
        steps, size, wheels = self._steps, self._size, self._wheels
        a = linear[0].reshape(steps, size, size).transpose(0, 2, 1)
        b = linear[1].reshape(steps, wheels, size).transpose(0, 2, 1)
        c, q, g = (part.reshape(-1, size) for part in linear[2:])
        start = np.zeros(size)
        planned = np.concatenate([request.pose, request.twists[0]]) + request.deviations[0]
        start[:BODY] = request.state[:BODY] - planned
        # Change of the state as a function of the changes of all commands, step by step.
        maps, free = np.zeros((steps + 1, size, steps * wheels)), np.empty((steps + 1, size))
        free[0] = start
        for k in range(steps):
            upto = (k + 1) * wheels
            np.matmul(a[k], maps[k, :, :upto], out=maps[k + 1, :, :upto])
            maps[k + 1, :, k * wheels : upto] += b[k]
            free[k + 1] = a[k] @ free[k] + c[k]
        stacked = maps[:, :BODY].reshape(-1, steps * wheels)
        command_weight, limit = request.weights[BODY], request.weights[-1]
        bends = request.bends.ravel()
        hessian = stacked.T @ (q[:, :BODY].reshape(-1, 1) * stacked)
        hessian.flat[:: steps * wheels + 1] += command_weight
        slope = stacked.T @ (q * free + g)[:, :BODY].ravel() + command_weight * bends
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
        states = free + maps @ change
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
