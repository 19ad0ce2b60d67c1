"""Model-predictive control: torques over the next second, chosen anew every control period."""

from __future__ import annotations

import math
import time
from collections import Counter, deque
from dataclasses import dataclass
from typing import NamedTuple

import casadi as ca
import numpy as np

from controllers import computed_torque
from controllers.computed_torque import ComputedTorque
from controllers.estimator import OPS
from controllers.inverse import feedforward
from controllers.law import Tracking
from controllers.optimal.ipopt import Ipopt
from controllers.optimal.problem import BODY
from controllers.optimal.rti import RealTimeIteration
from controllers.optimal.solution import Request, Solution, Solver
from controllers.preview import preview_weights
from youbot_env.model import Model
from youbot_env.plant import BoundModel, ModelStructure

SOLVERS = {"rti": RealTimeIteration, "ipopt": Ipopt}
# Solvers by name, effects, horizon and iterations; building one takes a second.
_BUILT: dict[tuple, Solver] = {}
# Solves that ``MPC.solves`` remembers one by one.
REMEMBERED = 100_000


@dataclass(frozen=True, kw_only=True)
class Settings(computed_torque.Settings):
    """Settings of predictive control.

    The horizon is ``preview`` steps of ``preview_stride`` control periods: 20 of 50 ms.

    Attributes:
        solver: ``rti`` (fast) or ``ipopt`` (to convergence; tens of milliseconds).
        position, yaw, velocity, yaw_rate, torque: deviations from the reference and from its
            torques that weigh the same, m, rad, m/s, rad/s, N m.
        soft_speed, soft_yaw_rate: soft limits of V_X, of V_Y and of Omega, m/s and rad/s; a
            reference that is faster moves them along.
        soft_violation: violation of a soft limit that weighs as much as ``position``, m/s.
        iteration_limit: iterations of ``ipopt``, or of the active set in one step of ``rti``; a
            solve that needs more has failed.  Measured: 12 of ``ipopt``; between 40 and 80 of
            ``rti`` where every torque of the horizon is at its limit, below 12 where a third is.
        time_limit: s of wall time, for a real robot: a later solution is not used.  None, the
            default, looks at no clock, so that equal observations give equal actions.
        bandwidth, damping: of computed torque, which takes over when a solve fails.
    """

    preview: int = 20
    preview_stride: int = 5
    solver: str = "rti"
    position: float = 0.01
    yaw: float = 0.02
    velocity: float = 0.1
    yaw_rate: float = 0.2
    torque: float = 0.6
    soft_speed: float = 0.8
    soft_yaw_rate: float = 1.6
    soft_violation: float = 0.003
    iteration_limit: int = 200
    time_limit: float | None = None

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require_positive("position", "yaw", "velocity", "yaw_rate", "torque")
        self.require_positive("soft_speed", "soft_yaw_rate", "soft_violation")
        if self.time_limit is not None:
            self.require_positive("time_limit")
        if not (isinstance(self.iteration_limit, int) and self.iteration_limit >= 1):
            raise ValueError(
                f"iteration_limit = {self.iteration_limit!r}; give a whole number of at least 1"
            )
        if self.solver not in SOLVERS:
            raise ValueError(f"solver = {self.solver!r}; choose one of {sorted(SOLVERS)}")


class Solve(NamedTuple):
    """Record of one solve.

    Attributes:
        status: the solver's word; ``late`` where it took longer than ``time_limit``.
        iterations: of the nonlinear solver.
        seconds: wall time.
        fallback: whether computed torque took over.
    """

    status: str
    iterations: int
    seconds: float
    fallback: bool


class MPC(ComputedTorque):
    """Least-squares tracking over a horizon with hard torque limits.

    The plan starts from the pose, velocity and drive states at the moment at which the next command
    acts (``Estimator``) and follows the previewed twists.  Its commands are those that the model
    needs along the reference plus a deviation, constant over each step of the horizon; the one
    applied is the model's need in the middle of the coming control period plus the first
    deviation, so that the length of a step costs no accuracy on the reference.  Forces that the
    model lacks are observed and compensated beside the plan, which does not know of them.

    Values of the model are inputs of one solver for each set of effects: ``set_model`` with other
    values builds nothing.  The last solution, moved on by one period, is where the next solve
    starts; it is dropped after a failed or late one.  Then computed torque takes over for that
    period, and ``solves`` and ``counts`` tell of it.

    Attributes:
        solver: what solves the problem, shared by all controllers with the same effects.
        solves: records of the last solves, newest last.
        counts: how often each status occurred, and ``fallback``, since the controller was made.
    """

    name = "mpc"
    Settings = Settings
    settings: Settings

    def __init__(self, model: Model, settings: Settings):
        self.solves: deque[Solve] = deque(maxlen=REMEMBERED)
        self.counts: Counter[str] = Counter()
        super().__init__(model, settings)

    def set_model(self, model: Model) -> None:
        """See the base class; builds a solver when the effects are new."""
        super().set_model(model)
        s, task, structure = self.settings, self.task, self.estimator.structure
        self.solver: Solver = shared_solver(s.solver, structure, task.preview, s.iteration_limit)
        robot, nodes = structure.bind(model.values()), np.array(task.preview_times)
        # Where the drive lags it is commanded for the reference of so much later.
        lags = [
            e.time_constant(p) for _, e, p in robot.acting("drive") if e.state_size(task.platform)
        ]
        delay, lead = robot.delay(), robot.delay() + sum(lags)
        self._nodes = preview_weights(task, np.concatenate([nodes + delay, nodes + lead]))
        middle = [lead + task.dt / 2]
        self._needs = np.vstack([preview_weights(task, middle, k) for k in (0, 1)])
        scales = np.array([s.position, s.position, s.yaw, s.velocity, s.velocity, s.yaw_rate])
        limits = [s.soft_speed, s.soft_speed, s.soft_yaw_rate, s.torque_limit]
        self._cost = np.array([*scales**-2.0, s.torque**-2.0, s.soft_violation**-2.0, *limits])
        wheels, own = len(task.platform.wheels), self.estimator.size
        self._plan = slice(own, own + BODY * (task.preview + 1))
        self._du = slice(self._plan.stop, self._plan.stop + wheels * task.preview)
        self._start = np.zeros(self._du.stop)
        self._allowed = math.inf if s.time_limit is None else s.time_limit

    def act(self, seen: np.ndarray, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See the base class; robots are solved for one after the other."""
        rows = [self._decide(*row) for row in zip(seen, memory, strict=True)]
        actions, memories = (np.array(part) for part in zip(*rows, strict=True))
        return actions, memories

    def command(self, tracking: Tracking, robot: BoundModel, extra: list) -> tuple:
        """Commands of computed torque, then those the model needs on the reference itself."""
        rest = tracking.state._replace(velocity=tracking.wanted_velocity)
        twist, rate = (tuple(ca.vertsplit(part)) for part in extra)
        limit, push = self.task.torque_limit, tracking.disturbance
        u_ff = feedforward(robot, rest, twist, rate, tracking.t, limit, OPS, push)
        return (*super().command(tracking, robot, extra), *u_ff)

    def extra_inputs(self) -> list:
        """Twist and twist rate for which the drive is commanded."""
        return [ca.SX.sym("twist", 3), ca.SX.sym("rate", 3)]

    def _trace(self) -> ca.Function:
        (inputs, now, tracking, robot), extra = self.situate(), self.extra_inputs()
        commands = ca.vertcat(*self.command(tracking, robot, extra))
        parts = ca.vertsplit(commands, len(self.task.platform.wheels))
        return ca.Function("prepare", [*inputs, *extra], [*now, *parts], {"cse": True})

    def _decide(self, seen: np.ndarray, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Return action and memory of one robot."""
        began, task, estimator = time.perf_counter(), self.task, self.estimator
        previewed = seen[8:].reshape(-1, 3)
        yaw, known = np.arctan2(seen[7], seen[6]), memory[: estimator.size]
        t, state, wanted, _, _, kept, safe, u_ff = self._columns.one(
            seen, yaw, known, self._values, self._weights, *(self._needs @ previewed)
        )
        twists, delayed = np.split(self._nodes @ previewed, 2)
        plan = memory[self._plan].reshape(-1, BODY)
        du = memory[self._du].reshape(task.preview, -1)
        step = task.preview_stride * task.dt
        solution = self.solver.solve(
            Request(state, wanted, twists, delayed, t, step, self._values, self._cost, plan, du)  # ty: ignore[invalid-argument-type]
        )
        usable = self._record(solution, time.perf_counter() - began)
        command = u_ff + solution.du[0] if usable else safe
        command = np.clip(command, -task.torque_limit, task.torque_limit)
        after = np.zeros(len(memory))
        after[: estimator.size] = estimator.remember(kept, command)
        if usable:
            after[self._plan] = _moved_on(solution.deviations, task.preview_stride).ravel()
            after[self._du] = _moved_on(solution.du, task.preview_stride).ravel()
        return command / task.torque_limit, after

    def _record(self, solution: Solution, seconds: float) -> bool:
        """Note a solve; tell whether it may be used."""
        late = seconds > self._allowed
        status = "late" if solution.solved and late else solution.status
        usable = solution.solved and not late
        self.solves.append(Solve(status, solution.iterations, seconds, not usable))
        self.counts.update([status, *([] if usable else ["fallback"])])
        return usable


def _moved_on(rows: np.ndarray, stride: int) -> np.ndarray:
    """Values one control period later, where a row stands for ``stride`` of them."""
    return np.vstack([rows[:-1] + np.diff(rows, axis=0) / stride, rows[-1:]])


def shared_solver(name: str, structure: ModelStructure, steps: int, iterations: int) -> Solver:
    """Build (or find) the solver for a set of effects, a horizon and a limit of iterations."""
    key = (name, structure.key, steps, iterations)
    if key not in _BUILT:
        _BUILT[key] = SOLVERS[name](structure, steps, iterations)
    return _BUILT[key]
