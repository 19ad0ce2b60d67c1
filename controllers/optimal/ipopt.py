"""IPOPT on the tracking problem: the reference that faster solvers are tested against."""

from __future__ import annotations

import casadi as ca
import numpy as np

from controllers.optimal.problem import (
    BODY,
    excess,
    reference_step,
    split_weights,
    step_functions,
)
from controllers.optimal.solution import Request, Solution
from youbot_env.plant import ModelStructure


class Ipopt:
    """Solves the nonlinear problem to convergence.

    Unknown of each step are the deviation of pose and velocity at its end, the rest of the flat
    state there, and the command deviation.

    Args:
        structure: platform and effects.
        steps: length of the horizon.
        iterations: after which IPOPT gives up.
    """

    def __init__(self, structure: ModelStructure, steps: int, iterations: int = 200):
        self._steps, self._wheels = steps, len(structure.platform.wheels)
        self._size = structure.state_size
        problem, self._commands = transcribe(structure, steps)
        quiet = {"print_level": 0, "sb": "yes", "tol": 1e-7, "max_iter": iterations}
        options = {"print_time": False, "error_on_fail": False, "ipopt": quiet}
        self._solver = ca.nlpsol("tracking", "ipopt", problem, options)

    def solve(self, request: Request) -> Solution:
        """See ``Solver``."""
        state, pose, twists, delayed, t, h, values, weights, deviations, du = request
        paths = (state, pose, twists.ravel(), delayed.ravel())
        parameters = np.concatenate([*paths, np.ravel(t), [h], values, weights])
        rest = np.tile(state[BODY:], (self._steps, 1))
        guess = np.hstack([deviations[1:], rest, du]).ravel()
        limit = weights[-1]
        answer = self._solver(x0=guess, p=parameters, lbg=self._low(-limit), ubg=self._low(limit))
        stats = self._solver.stats()
        x = np.asarray(answer["x"]).reshape(self._steps, -1)
        wanted = np.asarray(self._commands(x.ravel(), parameters)).T
        first = state[:BODY] - np.concatenate([pose, twists[0]])
        return Solution(
            bool(stats["success"]),
            stats["return_status"],
            int(stats["iter_count"]),
            np.vstack([first, x[:, :BODY]]),
            x[:, self._size :],
            wanted,
        )

    def _low(self, limit: float) -> np.ndarray:
        """Bounds of all constraints: gaps of the dynamics are zero, commands limited."""
        one = np.concatenate([np.zeros(self._size), np.full(self._wheels, limit)])
        return np.tile(one, self._steps)


def transcribe(structure: ModelStructure, steps: int) -> tuple[dict, ca.Function]:
    """Write the problem by multiple shooting.

    Returns:
        ``(problem, commands)``: for ``casadi.nlpsol``, and ``F(x, p)`` giving the commands along
        the reference (n, steps) with the rest of the state as in x.
    """
    size, wheels = structure.state_size, len(structure.platform.wheels)
    start, path = ca.SX.sym("start", size), ca.SX.sym("pose", 3)
    twists, delayed = ca.SX.sym("twists", 3, steps + 1), ca.SX.sym("delayed", 3, steps + 1)
    t, h = ca.SX.sym("t"), ca.SX.sym("h")
    values = ca.SX.sym("values", structure.value_count)
    weights = ca.SX.sym("weights", BODY + 6)
    parameters = ca.veccat(start, path, twists, delayed, t, h, values, weights)
    unknown = ca.SX.sym("x", size + wheels, steps)
    of, (one, need) = split_weights(weights), step_functions(structure)
    before, cost, constraints, wanted = start, 0.0, [], []
    for k in range(steps):
        first, last, now = twists[:, k], twists[:, k + 1], t + k * h
        deviation, rest, bend = ca.vertsplit(unknown[:, k], [0, BODY, size, size + wheels])
        on_path = ca.vertcat(path, first, before[BODY:])
        command = need(values, on_path, delayed[:, k], delayed[:, k + 1], now, h, of.torque)
        wanted.append(command)
        path = reference_step(path, first, last, h)
        after = ca.vertcat(ca.vertcat(path, last) + deviation, rest)
        residual, reached = one(values, before, after[3:BODY], command + bend, now, h)
        gap = reached - after
        constraints += [gap[:3], residual, gap[BODY:], command + bend]
        over = excess(after[3:BODY], last, of.speed)
        cost += ca.dot(of.state, deviation**2) / 2 + of.soft * ca.sumsqr(over) / 2
        cost += of.command * ca.sumsqr(bend) / 2
        before = after
    x = ca.vec(unknown)
    problem = {"x": x, "p": parameters, "f": cost, "g": ca.vertcat(*constraints)}
    return problem, ca.Function("commands", [x, parameters], [ca.horzcat(*wanted)])
