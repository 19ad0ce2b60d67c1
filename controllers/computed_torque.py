"""Computed torque: the model turns a wanted acceleration into torques."""

from __future__ import annotations

from dataclasses import dataclass

from controllers.estimator import OPS
from controllers.inverse import drive_command, required_wrench, shaft_torque, without
from controllers.law import LawController, LawSettings, Tracking
from youbot_env.envs.task import TrackingTask
from youbot_env.plant import BoundModel


@dataclass(frozen=True, kw_only=True)
class Settings(LawSettings):
    """Settings of computed torque.

    Attributes:
        bandwidth: natural frequency of the error, rad/s.
        damping: damping ratio of the error.
    """

    bandwidth: float = 8.0
    damping: float = 1.0

    def __post_init__(self) -> None:
        super().__post_init__()
        self.require_positive("bandwidth", "damping")


class ComputedTorque(LawController):
    """Inverse dynamics of the model around feedback on pose and velocity.

    With e the pose error in the world, the commanded acceleration is that of the reference plus
    ``2 d w e' + w^2 e``; with a perfect model the error then obeys ``e'' + 2 d w e' + w^2 e = 0``.
    Reference velocity and acceleration are those in the middle of the coming control period,
    interpolated from the previewed twists.  Mass, centripetal terms and viscous friction use the
    velocity measured, effects of the model that of the reference: dry friction compensated at the
    measured velocity would chatter around zero.  What the drive makes of a command (gain, offset,
    dead zone, lag) is inverted, its delay bridged by simulation.  Forces that the model lacks are
    observed (``Estimator``) and compensated, which takes the place of integral action.
    """

    name = "computed_torque"
    Settings = Settings
    settings: Settings

    def command(self, tracking: Tracking, robot: BoundModel, extra: list) -> tuple:
        """See the base class."""
        w, d = self.settings.bandwidth, self.settings.damping
        acceleration = tuple(
            a + 2 * d * w * rate + w * w * error
            for a, rate, error in zip(
                tracking.wanted_acceleration, tracking.velocity_error, tracking.error, strict=True
            )
        )
        wrench = wrench_for(acceleration, tracking.velocity, tracking, robot)
        return commands_for(wrench, tracking, robot, self.task)


def wrench_for(
    acceleration: tuple, velocity: tuple, tracking: Tracking, robot: BoundModel
) -> tuple:
    """Generalized forces at a velocity for the second derivative of the pose in body axes."""
    s = _signals(velocity, tracking, robot)
    vx, vy, omega = velocity
    rates = (acceleration[0] + omega * vy, acceleration[1] - omega * vx, acceleration[2])
    return required_wrench(s, rates)


def commands_for(wrench: tuple, tracking: Tracking, robot: BoundModel, task: TrackingTask) -> tuple:
    """Torque commands (n,), N m, for generalized forces, with effects at the reference velocity.

    What the disturbance already pushes is taken off.
    """
    wrench = without(tracking.disturbance, wrench)
    s, internal = _signals(tracking.wanted_velocity, tracking, robot), tracking.state.internal
    torque = shaft_torque(robot, wrench, s, internal, OPS)
    return drive_command(robot, torque, s, internal, task.dt, task.torque_limit, OPS)


def _signals(velocity: tuple, tracking: Tracking, robot: BoundModel):
    state, rest = tracking.state, (0.0,) * len(robot.platform.wheels)
    return robot.signals(tracking.t, velocity, state.pose, state.wheel_angle, rest, OPS)
