"""Adaptive computed torque: the seven parameters are estimated while driving."""

from __future__ import annotations

import math
from dataclasses import dataclass

import casadi as ca
import numpy as np

from controllers import computed_torque
from controllers.columns import Columns
from controllers.computed_torque import ComputedTorque
from controllers.estimator import OPS, Estimator
from youbot_env import dynamics
from youbot_env.dynamics import Theta
from youbot_env.model import Model
from youbot_env.plant import ModelStructure

SIZE = len(Theta._fields)
# Standard deviation of the filtered forces that the model does not explain, N, N, N m.
FORCE_NOISE = (2.0, 2.0, 0.8)
# Estimates stay within these factors of the model's values, and the centre of mass within 0.15 m.
FACTORS, LARGEST_OFFSET = (0.2, 5.0), 0.15


@dataclass(frozen=True, kw_only=True)
class Settings(computed_torque.Settings):
    """Settings of the adaptive controller.

    Attributes:
        filter_rate: corner of the filter in front of the regression, rad/s.
        forgetting_time: after this time a measurement counts e times less, s.
        uncertainty: relative standard deviation of the model's values.
        offset_uncertainty: standard deviation of its centre of mass, m.
        disturbance_time: no observer of disturbances by default.  Both would explain the same
            force, and a mass that slow motions have driven too high leaves too little phase for
            two loops: with an unknown delay of 15 ms robots were lost.
    """

    filter_rate: float = 10.0
    forgetting_time: float = 20.0
    uncertainty: float = 0.5
    offset_uncertainty: float = 0.03
    disturbance_time: float = math.inf

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require_positive("filter_rate", "forgetting_time", "uncertainty", "offset_uncertainty")


class Adaptive(ComputedTorque):
    """Computed torque with the parameters of a recursive estimator.

    Filtered regression: with F = a / (p + a) the equations of motion read

        (a m - a F m + F h) theta = F w,

    m and h the momentum and the velocity forces at unit parameters, w the generalized forces of the
    commands and of the model's effects.  Recursive least squares starts from the model's values
    with their uncertainty and forgets exponentially toward them, so that what a motion does not
    excite returns to the model and nothing winds up.  Effects keep the values of the model, and so
    do the masses in the observer of disturbances.  A constant force that the model lacks distorts
    the estimate: it passes for friction.
    """

    name = "adaptive"
    Settings = Settings
    settings: Settings

    def __init__(self, model: Model, settings: Settings):
        self._regressions: dict[tuple, Columns] = {}
        super().__init__(model, settings)

    def set_model(self, model: Model) -> None:
        """See the base class."""
        super().set_model(model)
        structure = self.estimator.structure
        if structure.key not in self._regressions:
            self._regressions[structure.key] = Columns(regression(structure))
        self._regression = self._regressions[structure.key]
        theta = np.array(model.values()[:SIZE])
        mass, offset = theta[0], self.settings.offset_uncertainty
        spread = self.settings.uncertainty * np.abs(theta)
        spread[3:5] = mass * offset
        # A parameter that the model holds to be zero may still be a little different.
        self._prior = np.diag(1.0 / np.maximum(spread, 1e-4) ** 2)
        self._low, self._high = theta * FACTORS[0], theta * FACTORS[1]
        self._low[3:5], self._high[3:5] = -mass * LARGEST_OFFSET, mass * LARGEST_OFFSET
        self._mix = _mix(self.estimator, model)
        base = self.estimator.size
        self._filters = slice(base, base + 3 * SIZE + 3)
        self._sums = slice(self._filters.stop, self._filters.stop + SIZE * (SIZE + 1))
        self._start = np.zeros(self._sums.stop)

    def estimate(self, memory: np.ndarray) -> np.ndarray:
        """Parameters (robots, 7) in the order of ``Theta``, from the memory of ``predict``."""
        sums = np.atleast_2d(memory)[:, self._sums].reshape(-1, SIZE, SIZE + 1)
        change = np.linalg.solve(self._prior + sums[:, :, :SIZE], sums[:, :, SIZE:])
        return np.clip(self._values[:SIZE] + change[:, :, 0], self._low, self._high)

    def act(self, seen: np.ndarray, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See the base class."""
        learned = self._learn(seen, memory)
        effects = np.broadcast_to(self._values[SIZE:], (len(seen), len(self._values) - SIZE))
        values = np.hstack([self.estimate(learned), effects])
        action, after = self.evaluate(seen, memory[:, : self.estimator.size], values)
        return action, np.hstack([after, learned[:, self._filters.start :]])

    def _learn(self, seen: np.ndarray, memory: np.ndarray) -> np.ndarray:
        """Memory with filters and sums brought up to this observation."""
        estimator, a, dt = self.estimator, self.settings.filter_rate, self.settings.dt
        count, sent = memory[:, :1], memory[:, estimator.sent]
        commands = np.einsum("k,rkw->rw", self._mix, sent.reshape(len(seen), len(self._mix), -1))
        t = (count - 1.0) * dt
        before, now, momentum, wrench = self._regression.many(
            memory[:, estimator.state], seen[:, 3:6], commands, self._values[None], t,
            np.array([[dt]]), np.array([[a]]),
        )  # fmt: skip
        # First-order hold for what follows the velocity, zero-order hold for the forces.
        keep = math.exp(-a * dt)
        mean = (1.0 - keep) / (a * dt)
        filters = memory[:, self._filters]
        regressor = keep * filters[:, :-3] + (mean - keep) * before + (1.0 - mean) * now
        force = keep * filters[:, -3:] + (1.0 - keep) * wrench
        first = count < 0.5
        regressor = np.where(first, -a * momentum, regressor)
        force = np.where(first, 0.0, force)
        x = (a * momentum + regressor).reshape(-1, SIZE, 3).transpose(0, 2, 1)
        error = force - x @ self._values[:SIZE]
        scaled = x / np.array(FORCE_NOISE)[:, None] ** 2
        news = scaled.transpose(0, 2, 1) @ np.concatenate([x, error[:, :, None]], axis=2)
        sums = memory[:, self._sums] * math.exp(-dt / self.settings.forgetting_time)
        learned = memory.copy()
        learned[:, self._filters] = np.hstack([regressor, force])
        learned[:, self._sums] = sums + news.reshape(len(seen), -1)
        return learned


def regression(structure: ModelStructure) -> ca.Function:
    """Trace the terms of the regression over one control period.

    Returns:
        ``F(before, v, command, values, t, dt, a) -> (u before, u now, momentum now, wrench)`` with
        the flat state at the beginning, the velocity at the end and the command between; u is
        ``h - a m``, each of the first three 3 x 7 by columns.
    """
    size = structure.state_size
    before, v = ca.SX.sym("before", size), ca.SX.sym("v", 3)
    command = ca.SX.sym("command", len(structure.platform.wheels))
    values = ca.SX.sym("values", structure.value_count)
    t, dt, a = ca.SX.sym("t"), ca.SX.sym("dt"), ca.SX.sym("a")
    robot, state = structure.bind(ca.vertsplit(values)), structure.unflatten(ca.vertsplit(before))
    given = tuple(ca.vertsplit(command))

    def terms(velocity: tuple) -> tuple:
        s = robot.signals(t, velocity, state.pose, state.wheel_angle, given, OPS)
        momenta, forces = [], []
        for k in range(SIZE):
            unit = Theta(*(float(k == j) for j in range(SIZE)))
            momenta += dynamics.momentum(s.geometry, unit, velocity)
            quadratic = dynamics.centripetal(unit, velocity)
            viscous = dynamics.friction(s.geometry, unit, velocity)
            forces += [q + f for q, f in zip(quadratic, viscous, strict=True)]
        torque, internal = robot.deliver(s, state.internal, dt / 2, OPS)
        wrench = robot.wrench(torque, s, internal, OPS)
        return ca.vertcat(*momenta), ca.vertcat(*forces), ca.vertcat(*wrench)

    m0, h0, w0 = terms(state.velocity)
    m1, h1, w1 = terms(tuple(ca.vertsplit(v)))
    outputs = [h0 - a * m0, h1 - a * m1, m1, (w0 + w1) / 2]
    inputs = [before, v, command, values, t, dt, a]
    return ca.Function("regression", inputs, [ca.densify(part) for part in outputs])


def _mix(estimator: Estimator, model: Model) -> np.ndarray:
    """Shares of the remembered commands in what the drive was given over the last period."""
    size = len(estimator.task.platform.wheels)
    shares = np.zeros((estimator.sent.stop - estimator.sent.start) // size)
    periods = estimator.structure.bind(model.values()).delay() / estimator.task.dt
    whole = math.floor(periods)
    shares[whole] = 1.0 - (periods - whole)
    if periods > whole:
        shares[whole + 1] = periods - whole
    return shares
