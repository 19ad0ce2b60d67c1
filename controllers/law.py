"""Controllers whose law is one compiled function of observation, memory and model values."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Any, NamedTuple

import casadi as ca
import numpy as np

from controllers.base import Controller, Settings
from controllers.columns import Columns
from controllers.estimator import OPS, Estimator, Situation
from controllers.preview import preview_weights
from youbot_env.arguments import check_kind
from youbot_env.model import Model
from youbot_env.plant import BoundModel, ModelStructure, State
from youbot_env.references import rotate_to_body


class Tracking(NamedTuple):
    """What a law works with, in components; vectors in the frame of the robot.

    Attributes:
        t: middle of the control period in which the command acts, s.
        state: state of the model when that period begins.
        error: pose error then (ahead, left, yaw), m, m, rad.
        velocity_error: velocity of the reference less that of the robot.
        velocity: of the robot in the middle of the period.
        wanted_velocity: of the reference then.
        wanted_acceleration: second derivative of the reference pose then, turned from the world
            into the frame of the robot, m/s^2, m/s^2, rad/s^2.
        twist, twist_rate: of the reference then, in its own frame.
        disturbance: generalized forces beyond those of the model, N, N, N m.
    """

    t: Any
    state: State
    error: tuple
    velocity_error: tuple
    velocity: tuple
    wanted_velocity: tuple
    wanted_acceleration: tuple
    twist: tuple
    twist_rate: tuple
    disturbance: tuple


@dataclass(frozen=True, kw_only=True)
class LawSettings(Settings):
    """Settings of preview and state estimation that a law needs.

    Attributes:
        preview: the default of 20 periods sees across every delay that ``actuator_delay`` allows.
        pose_time: time over which measured velocities smooth the measured pose, s; 0 takes each
            pose as it is.  Motion capture scatters by a millimetre, which is as much as a tenth
            of a second of velocity error; velocities that are wrong by 5 % (wheels that slip) cost
            5 % of the way driven in this time.
        disturbance_time: time in which a force that the model does not explain is learned and
            then compensated, s; infinity leaves it to the feedback.  At the default an unknown
            delay of 50 ms is still borne; at 0.05 s one of 30 ms is not.
    """

    preview: int = 20
    pose_time: float = 0.2
    disturbance_time: float = 0.1

    def __post_init__(self) -> None:
        for name in ("pose_time", "disturbance_time"):
            value = getattr(self, name)
            check_kind(name, value, (int, float), "a time in s")
        if not 0 <= self.pose_time < math.inf:
            raise ValueError(f"pose_time = {self.pose_time!r}; give s, or 0 for none")
        if not self.disturbance_time > 0:
            raise ValueError(
                f"disturbance_time = {self.disturbance_time!r}; give s, or math.inf for none"
            )


class LawController(Controller):
    """Base of the controllers that compute torques in closed form.

    The law is traced once for each set of effects; values of the model, identified or nominal, are
    inputs of the compiled function.

    Attributes:
        estimator: what it knows beyond the observation.
        law: ``F(seen, yaw, memory, values, weights, *extra) -> (action, memory)``.
    """

    settings: LawSettings

    def __init__(self, model: Model, settings: Settings):
        self._laws: dict[tuple, Columns] = {}
        super().__init__(model, settings)

    def set_model(self, model: Model) -> None:
        """See the base class; compiles when the effects are new to this controller."""
        period = self.task.dt * self.task.preview_stride
        delay = ModelStructure.of(model).bind(model.values()).delay()
        needed = max(2, math.ceil((delay + self.task.dt) / period - 1e-9))
        if self.task.preview < needed:
            raise ValueError(
                f"preview = {self.task.preview} with {period:g} s between twists; controller "
                f"{self.name!r} needs at least {needed} to know the acceleration of the reference "
                f"after the model's delay of {delay:g} s"
            )
        super().set_model(model)
        self.estimator = Estimator(
            model, self.task, self.settings.pose_time, self.settings.disturbance_time
        )
        if self.estimator.key not in self._laws:
            self._laws[self.estimator.key] = Columns(self._trace())
        self._columns = self._laws[self.estimator.key]
        self._weights = np.concatenate([self.estimator.weights(model), self._middle(model)])
        self._values, self._start = np.array(model.values()), np.zeros(self.estimator.size)

    @property
    def law(self) -> ca.Function:
        """The compiled law."""
        return self._columns.function

    def start(self) -> np.ndarray:
        """See the base class."""
        return self._start

    def act(self, seen: np.ndarray, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See the base class."""
        return self.evaluate(seen, memory, self._values[None])

    def turned(self, memory: np.ndarray, angle: np.ndarray) -> np.ndarray:
        """See the base class."""
        return self.estimator.tell(memory, angle) if self.uses_wheel_angle else memory

    @property
    def uses_wheel_angle(self) -> bool:
        """See the base class."""
        return self.estimator.structure.track_wheels

    def resent(self, memory: np.ndarray, action: np.ndarray) -> np.ndarray:
        """See the base class."""
        memory, newest = memory.copy(), self.estimator.sent.start
        memory[:, newest : newest + action.shape[1]] = self.task.torque_limit * action
        return memory

    def evaluate(self, seen, memory, values, *extra) -> tuple[np.ndarray, np.ndarray]:
        """Call the law; every input has one row a robot, or one row that all share."""
        yaw = np.arctan2(seen[:, 7:8], seen[:, 6:7])
        many = self._columns.many(seen, yaw, memory, values, self._weights[None], *extra)
        action, memory = many
        return action, memory

    def _middle(self, model: Model) -> np.ndarray:
        """Preview weights of twist and twist rate in the middle of the period to come."""
        task = self.task
        middle = [self.estimator.structure.bind(model.values()).delay() + task.dt / 2]
        parts = (preview_weights(task, middle), preview_weights(task, middle, 1))
        return np.concatenate(parts).ravel()

    def _trace(self) -> ca.Function:
        inputs, now, tracking, robot = self.situate()
        extra = self.extra_inputs()
        command = ca.vertcat(*self.command(tracking, robot, extra))
        after = self.estimator.remember(now.memory, command)
        joined = ca.cse(ca.vertcat(command / self.task.torque_limit, after))
        outputs = ca.vertsplit(joined, [0, len(self.task.platform.wheels), joined.numel()])
        return ca.Function("law", [*inputs, *extra], outputs)

    def situate(self) -> tuple[list, Situation, Tracking, BoundModel]:
        """Make symbols of the law's inputs and what follows from them."""
        task, count, estimate = self.task, self.task.preview + 1, self.estimator.build()
        seen, yaw, memory, values = symbols = estimate.sx_in()[:4]
        guide = self.estimator.guide
        weights = ca.SX.sym("weights", guide + 2 * count)
        now = Situation(*estimate(seen, yaw, memory, values, weights[:guide]))
        twists, middle = ca.reshape(seen[8:], 3, count), weights[guide:]
        ahead = ca.mtimes(twists, ca.reshape(middle, count, 2))
        state = self.estimator.structure.unflatten(ca.vertsplit(now.state))
        present, twist, rate = (
            tuple(ca.vertsplit(part)) for part in (now.twist, ahead[:, 0], ahead[:, 1])
        )
        wanted = tuple(ca.vertsplit(now.wanted))
        push = tuple(ca.vertsplit(now.disturbance))
        tracking = track(now.t + task.dt / 2, state, wanted, present, twist, rate, push, task)
        robot = self.estimator.structure.bind(ca.vertsplit(values))
        return [*symbols, weights], now, tracking, robot

    def extra_inputs(self) -> list:
        """Symbols of further inputs of the law, such as gains."""
        return []

    def command(self, tracking: Tracking, robot: BoundModel, extra: list) -> tuple:
        """Return torque commands (n,), N m, within the limit; subclasses implement it."""
        raise NotImplementedError


def track(t, state: State, wanted, present, twist, rate, push, task) -> Tracking:
    """Turn reference and state into what a law works with.

    Args:
        t: middle of the period, s.
        state: state of the model at its beginning.
        wanted, present: pose (world) and twist of the reference at its beginning.
        twist, rate: twist of the reference and its rate in the middle.
        push: disturbance.
        task: defines the pose error.
    """
    error = task.error(state.pose, OPS.cos_sin(state.pose[2]), wanted, OPS)
    # The turn from the frame of the reference into that of the robot is minus the yaw error.
    turn = (OPS.cos(error[2]), -OPS.sin(error[2]))
    vx, vy, omega = twist
    second = (rate[0] - omega * vy, rate[1] + omega * vx, rate[2])
    difference = _minus(rotate_to_body(present, turn), state.velocity)
    velocity = rotate_to_body(twist, turn)
    return Tracking(
        t, state, error, difference, _minus(velocity, difference), velocity,
        rotate_to_body(second, turn), twist, rate, push,
    )  # fmt: skip


def _minus(a: tuple, b: tuple) -> tuple:
    return tuple(x - y for x, y in zip(a, b, strict=True))
