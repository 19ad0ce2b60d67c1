"""Linear-quadratic regulator, gain-scheduled along the reference."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import casadi as ca
import numpy as np
from scipy.interpolate import RegularGridInterpolator

from controllers.computed_torque import commands_for, wrench_for
from controllers.estimator import OPS
from controllers.law import LawController, LawSettings, Tracking
from youbot_env.backend import weighted_sum
from youbot_env.model import Model
from youbot_env.plant import BoundModel, ModelStructure
from youbot_env.references import rotate_to_body

# Nodes of the grid of reference velocities (V_X, V_Y, Omega).
NODES = (3, 3, 5)


@dataclass(frozen=True, kw_only=True)
class Settings(LawSettings):
    """Settings of the regulator: errors and torques that weigh the same (Bryson's rule).

    Attributes:
        position, yaw: pose errors, m and rad.
        velocity, yaw_rate: velocity errors, m/s and rad/s.
        torque: torque of one wheel, N m.
        schedule_speed, schedule_yaw_rate: largest reference velocities that have gains of their
            own; faster ones use the gains at these, m/s and rad/s.
    """

    position: float = 0.01
    yaw: float = 0.02
    velocity: float = 0.1
    yaw_rate: float = 0.2
    torque: float = 0.6
    schedule_speed: float = 0.8
    schedule_yaw_rate: float = 3.2

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require_positive("position", "yaw", "velocity", "yaw_rate", "torque")
        self.require_positive("schedule_speed", "schedule_yaw_rate")


class LQR(LawController):
    """Torques of the reference plus linear feedback on pose and velocity errors.

    The feedforward is the inverse dynamics of the model along the reference, its effects included.
    The feedback is the discrete regulator of the error dynamics linearised at the velocity of the
    reference: computed by python-control on a grid of (V_X, V_Y, Omega), interpolated between.
    Forces that the model lacks are observed and compensated as in computed torque.
    Forces of effects are fed forward and not linearised: dry friction has a slope at rest that is
    gone a few millimetres per second away from it.
    """

    name = "lqr"
    Settings = Settings
    settings: Settings

    def set_model(self, model: Model) -> None:
        """See the base class; computes the gains anew."""
        super().set_model(model)
        self._gains = self._schedule(model)

    def gain(self, twist: np.ndarray) -> np.ndarray:
        """Gains for reference twists (robots, 3): N m per (m, m, rad, m/s, m/s, rad/s).

        Returns:
            (robots, n, 6), for errors (reference less robot).
        """
        limits = [axis[-1] for axis in self._gains.grid]
        return self._gains(np.clip(twist, -np.array(limits), limits))

    def act(self, seen: np.ndarray, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See the base class."""
        gains = self.gain(seen[:, 8:11]).reshape(len(seen), -1)
        return self.evaluate(seen, memory, self._values[None], gains)

    def extra_inputs(self) -> list:
        """Gains, row by row."""
        return [ca.SX.sym("gains", 6 * len(self.task.platform.wheels))]

    def command(self, tracking: Tracking, robot: BoundModel, extra: list) -> tuple:
        """See the base class."""
        errors = (*tracking.error, *tracking.velocity_error)
        rows = [ca.vertsplit(row) for row in ca.vertsplit(extra[0], 6)]
        feedback = robot.geometry.wrench(tuple(weighted_sum(row, errors) for row in rows))
        forward = wrench_for(
            tracking.wanted_acceleration, tracking.wanted_velocity, tracking, robot
        )
        wrench = tuple(a + b for a, b in zip(forward, feedback, strict=True))
        return commands_for(wrench, tracking, robot, self.task)

    def _schedule(self, model: Model) -> RegularGridInterpolator:
        import control

        s, dt = self.settings, self.settings.dt
        weights = np.array([s.position, s.position, s.yaw, s.velocity, s.velocity, s.yaw_rate])
        wheels = len(model.platform.wheels)
        q, r = np.diag(weights**-2.0), np.eye(wheels) / s.torque**2
        slopes = error_dynamics(self.estimator.structure)
        limits = (s.schedule_speed, s.schedule_speed, s.schedule_yaw_rate)
        axes = [np.linspace(-limit, limit, n) for limit, n in zip(limits, NODES, strict=True)]
        gains = np.empty((*NODES, wheels, 6))
        for place in itertools.product(*map(range, NODES)):
            twist = [axis[k] for axis, k in zip(axes, place, strict=True)]
            a, b = (np.asarray(m) for m in slopes(twist, model.values()))
            held = control.ss(a, b, np.eye(6), np.zeros((6, wheels))).sample(dt)
            # Errors count as reference less robot, so a torque against them is positive.
            try:
                gains[place] = -control.dlqr(held.A, held.B, q, r)[0]
            except (ValueError, np.linalg.LinAlgError, control.ControlArgument) as error:
                raise ValueError(
                    f"lqr has no gains at the twist {np.round(twist, 3).tolist()} for the weights "
                    f"{weights.tolist()} and torque = {s.torque:g} ({error}); give weights and "
                    "speeds nearer to the defaults"
                ) from error
        return RegularGridInterpolator(axes, gains)


def error_dynamics(structure: ModelStructure) -> ca.Function:
    """Trace ``F(twist, values) -> (A, B)`` of the errors at a steady reference twist.

    Errors are those of ``Tracking``: pose error and velocity error, in the frame of the robot.
    """
    robot_values = ca.SX.sym("values", structure.value_count)
    twist, errors = ca.SX.sym("twist", 3), ca.SX.sym("errors", 6)
    torque = ca.SX.sym("torque", len(structure.platform.wheels))
    robot, rest = structure.bind(ca.vertsplit(robot_values)), structure.rest()
    ahead, left, yaw, *rates = ca.vertsplit(errors)
    omega_wanted = twist[2]
    wanted = rotate_to_body(tuple(ca.vertsplit(twist)), (OPS.cos(yaw), -OPS.sin(yaw)))
    v = tuple(a - b for a, b in zip(wanted, rates, strict=True))
    given = tuple(ca.vertsplit(torque))
    s = robot.signals(0.0, v, rest.pose, rest.wheel_angle, given, OPS)
    change = robot.acceleration(s.geometry.wrench(given), s)
    turn = omega_wanted - v[2]
    slope = ca.vertcat(
        rates[0] + v[2] * left,
        rates[1] - v[2] * ahead,
        rates[2],
        -turn * wanted[1] - change[0],
        turn * wanted[0] - change[1],
        -change[2],
    )
    a, b = ca.jacobian(slope, errors), ca.jacobian(slope, torque)
    zero = ca.SX.zeros(errors.numel() + torque.numel())
    at = [ca.substitute(m, ca.vertcat(errors, torque), zero) for m in (a, b)]
    return ca.Function("errors", [twist, robot_values], at)
