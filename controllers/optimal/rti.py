"""Real-time iteration: one Gauss-Newton step a control period."""

from __future__ import annotations

import casadi as ca
import numpy as np

from controllers.columns import Columns
from controllers.optimal.problem import (
    BODY,
    excess,
    reference_step,
    split_weights,
    stage,
    stage_feedforward,
)
from controllers.optimal.solution import Request, Solution
from youbot_env.plant import ModelStructure


def linear_stage(structure: ModelStructure) -> ca.Function:
    """Trace one linearised step.

    Returns:
        ``F(pose, first, last, delayed first, delayed last, extras, deviation, next deviation,
        command deviation, t, h, values, limit)
        -> (A, B, c, reference command, next pose, next extras)``
        with pose and twists of the reference at both ends (see ``Request``), extras the part of
        the flat state beyond pose and velocity, and ``dx+ = A dx + B step + c`` for changes of the
        trajectory given by the deviations.
    """
    size, wheels = _sizes(structure)
    pose, first, last, delayed0, delayed1 = (
        ca.SX.sym(name, 3) for name in ("p", "v", "v1", "w", "w1")
    )
    extras, now, then = (
        ca.SX.sym(name, n) for name, n in (("e", size - BODY), ("d", BODY), ("d1", BODY))
    )
    bend, t, h, limit = ca.SX.sym("du", wheels), *(ca.SX.sym(name) for name in "thm")
    values = ca.SX.sym("values", structure.value_count)
    on_path = ca.vertcat(pose, first, extras)
    wanted = stage_feedforward(structure, values, on_path, delayed0, delayed1, t, h, limit)
    next_pose = reference_step(pose, first, last, h)
    x, v, u = ca.SX.sym("x", size), ca.SX.sym("v", 3), ca.SX.sym("u", wheels)
    step = stage(structure, values, x, v, u, t, h)
    residual, after = step
    rx, rv, ru = (ca.jacobian(residual, part) for part in (x, v, u))
    ax, av, au = (ca.jacobian(after, part) for part in (x, v, u))
    inverse = -ca.inv_minor(rv)
    a, b, c = inverse @ rx, inverse @ ru, inverse @ residual
    # The end state counts against the trajectory's own; extras are simulated along it.
    end = ca.vertcat(next_pose, last) + then
    gap = ca.vertcat(after[:BODY] - end, ca.SX.zeros(size - BODY))
    outputs = [ax + av @ a, au + av @ b, gap + av @ c, after[BODY:]]
    at = ca.vertcat(on_path + ca.vertcat(now, ca.SX.zeros(size - BODY)), last + then[3:])
    at = ca.vertcat(at, ca.fmax(ca.fmin(wanted + bend, limit), -limit))
    outputs = ca.substitute(outputs, [ca.vertcat(x, v, u)], [at])
    a, b, c, next_extras = ca.cse(outputs)
    inputs = [pose, first, last, delayed0, delayed1, extras, now, then, bend, t, h, values, limit]
    # A and B keep their structural zeros: the sweep below then costs half as much.
    outputs = [a, b, ca.densify(c), wanted, next_pose, ca.densify(next_extras)]
    return ca.Function("stage", inputs, outputs)


def sweep_step(a_pattern: ca.Sparsity, b_pattern: ca.Sparsity) -> ca.Function:
    """Trace one step of the Riccati recursion for matrices of given structure.

    Returns:
        ``F(P, p, A, B, c, q, g, r, s) -> (P, p, K, k)`` for the cost
        ``dx' diag(q) dx / 2 + g' dx + r |step|^2 / 2 + s' step`` and the law
        ``step = K dx + k``; of P the lower triangle goes in and out.
    """
    size, wheels = b_pattern.shape
    half, p1 = ca.SX.sym("P", ca.Sparsity.lower(size)), ca.SX.sym("p", size)
    p2 = ca.tril2symm(half)
    a, b, c = ca.SX.sym("A", a_pattern), ca.SX.sym("B", b_pattern), ca.SX.sym("c", size)
    q, g = ca.SX.sym("q", size), ca.SX.sym("g", size)
    r, s = ca.SX.sym("r"), ca.SX.sym("s", wheels)
    pa, slope = p2 @ a, p2 @ c + p1
    cross = b.T @ pa
    curvature = b.T @ (p2 @ b) + r * ca.SX.eye(wheels)
    gains = -ca.ldl_solve(ca.horzcat(cross, b.T @ slope + s), *ca.ldl(curvature))
    k2, k1 = gains[:, :size], gains[:, size]
    cost = ca.tril(ca.diag(q) + a.T @ pa + cross.T @ k2)
    lean = g + a.T @ slope + cross.T @ k1
    outputs = [ca.densify(part) for part in (lean, k2, k1)]
    return ca.Function("sweep", [half, p1, a, b, c, q, g, r, s], [cost, *outputs])


def newton_step(structure: ModelStructure, steps: int) -> ca.Function:
    """Trace one step of Gauss-Newton on the problem without torque limits.

    Returns:
        ``F(*Request) -> (deviations, du, reference commands, A, B, c, q, g)`` with transposed
        matrices, one column a step: the improved deviations and du, then the linear problem
        about those of the request.
    """
    size, wheels = _sizes(structure)
    state, pose = ca.MX.sym("state", size), ca.MX.sym("pose", 3)
    twists, delayed = ca.MX.sym("twists", 3, steps + 1), ca.MX.sym("delayed", 3, steps + 1)
    deviations = ca.MX.sym("deviations", BODY, steps + 1)
    du, t, h = ca.MX.sym("du", wheels, steps), ca.MX.sym("t"), ca.MX.sym("h")
    values, weights = ca.MX.sym("values", structure.value_count), ca.MX.sym("weights", BODY + 6)
    of = split_weights(weights)
    one, padding = linear_stage(structure), size - BODY
    back = sweep_step(one.sparsity_out(0), one.sparsity_out(1))
    extras, path, linear = state[BODY:], pose, []
    for k in range(steps):
        *parts, path, extras = one(
            path, twists[:, k], twists[:, k + 1], delayed[:, k], delayed[:, k + 1], extras,
            deviations[:, k], deviations[:, k + 1], du[:, k], t + k * h, h, values, of.torque,
        )  # fmt: skip
        linear.append(parts)
    velocities = twists + deviations[3:, :]
    over = excess(velocities, twists, ca.repmat(of.speed, 1, steps + 1))
    zeros = ca.MX.zeros(padding, steps + 1)
    hot = ca.vertcat(ca.MX.zeros(3, steps + 1), of.soft * (over > 0), zeros)
    push = ca.vertcat(ca.MX.zeros(3, steps + 1), of.soft * over * ca.sign(velocities), zeros)
    plain = ca.repmat(ca.vertcat(of.state, ca.MX.zeros(padding)), 1, steps + 1)
    q, g = plain + hot, plain * ca.vertcat(deviations, zeros) + push
    cost, lean, gains = ca.tril(ca.diag(q[:, steps])), g[:, steps], []
    for k in range(steps - 1, -1, -1):
        a, b, c, _ = linear[k]
        cost, lean, k2, k1 = back(
            cost, lean, a, b, c, q[:, k], g[:, k], of.command, of.command * du[:, k]
        )
        gains.insert(0, (k2, k1))
    x = ca.vertcat(state[:BODY] - ca.vertcat(pose, twists[:, 0]) - deviations[:, 0], zeros[:, 0])
    improved, bent = [deviations[:, 0] + x[:BODY]], []
    for k, ((a, b, c, _), (k2, k1)) in enumerate(zip(linear, gains, strict=True)):
        u = k2 @ x + k1
        x = a @ x + b @ u + c
        bent.append(du[:, k] + u)
        improved.append(deviations[:, k + 1] + x[:BODY])
    columns = [ca.densify(ca.horzcat(*parts)) for parts in zip(*linear, strict=True)]
    outputs = [ca.horzcat(*improved), ca.horzcat(*bent), columns[3], *columns[:3], q, g]
    inputs = [state, pose, twists, delayed, t, h, values, weights, deviations, du]
    return ca.Function("newton", inputs, outputs)


def response(size: int, wheels: int, steps: int) -> ca.Function:
    """Trace the response of the linear problem to all commands.

    Returns:
        ``F(A, B, c, dx) -> (free, maps)`` with the matrices side by side and the initial change:
        for each step the change (size,) without commands, (size, steps), and its derivative with
        respect to all commands (size, steps n), below one another.
    """
    a, b = ca.MX.sym("A", size, size * steps), ca.MX.sym("B", size, wheels * steps)
    c, start = ca.MX.sym("c", size, steps), ca.MX.sym("dx", size)
    x, slopes, free, maps = start, ca.MX(size, 0), [], []
    for k in range(steps):
        one = a[:, k * size : (k + 1) * size]
        x = one @ x + c[:, k]
        slopes = ca.horzcat(one @ slopes, b[:, k * wheels : (k + 1) * wheels])
        free.append(x)
        maps.append(ca.horzcat(slopes, ca.MX.zeros(size, wheels * (steps - k - 1))))
    outputs = [ca.horzcat(*free), ca.vertcat(*maps)]
    return ca.Function("response", [a, b, c, start], outputs)


def _sizes(structure: ModelStructure) -> tuple[int, int]:
    return structure.state_size, len(structure.platform.wheels)


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

    def __init__(self, structure: ModelStructure, steps: int, iterations: int = 200):
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
        deviations, du, weights = request.deviations, request.du, request.weights
        results = self._newton.one(*(np.ravel(part) for part in request))
        improved, bent, wanted, *linear = results
        limit = weights[-1]
        if not np.isfinite(bent.sum() + improved.sum()):
            return self._answer(False, "not finite", deviations, du, wanted)
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
        du = request.du.ravel()
        hessian = (maps * q) @ maps.T
        hessian.flat[:: len(hessian) + 1] += command_weight
        slope = maps @ (q * free + g) + command_weight * du
        low, high = -limit - wanted - du, limit - wanted - du
        change = self._minimise(hessian, slope, low, high)
        gradient = hessian @ change + slope
        scaled = gradient / hessian.diagonal()
        # At the minimum a step down the gradient is undone by the limits.
        error = np.abs(change - np.clip(change - scaled, low, high)).max()
        if not error < ACCURACY:
            return self._answer(False, f"inexact ({error:.1e} N m)", request.deviations, du, wanted)
        states = np.concatenate([start, free + change @ maps]).reshape(-1, self._size)
        improved = request.deviations + states[:, :BODY]
        return self._answer(True, "solved at a limit", improved, du + change, wanted)

    def _minimise(self, hessian, slope, low, high) -> np.ndarray:
        program = self._program
        arguments = dict.fromkeys(program.function.name_in(), 0.0)
        arguments |= {"h": hessian.ravel(), "g": slope, "lbx": low, "ubx": high}
        return program.one(*arguments.values())[0].copy()

    def _answer(self, solved: bool, status: str, deviations, du, wanted) -> Solution:
        shape = (self._steps, self._wheels)
        return Solution(
            solved, status, 1, deviations.reshape(-1, BODY).copy(), du.reshape(shape).copy(),
            wanted.reshape(shape).copy(),
        )  # fmt: skip
