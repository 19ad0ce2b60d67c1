"""What happens to the robot of an episode, in components: its start, one period, what it sees.

The vector environment evaluates these functions on arrays, or on what is traced for machine code.
"""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NamedTuple

from youbot_env.backend import Ops
from youbot_env.envs.noise import KEYS, noise, noise_keys
from youbot_env.envs.options import EpisodeOptions
from youbot_env.envs.randomization import Randomization
from youbot_env.envs.settings import TrackingSettings
from youbot_env.envs.task import TrackingTask
from youbot_env.model import Model
from youbot_env.plant import BoundModel, ModelStructure, State
from youbot_env.references import Reference
from youbot_env.simulation import WheelLoop, choose_substeps
from youbot_env.simulation.analytic import history_length
from youbot_env.stepping import advance


class Look(NamedTuple):
    """What a robot sees, in components.

    Attributes:
        observation: without the reference's twists, 8 components, not clipped.
        reward: of the action.
        lost: whether the episode ends here.
    """

    observation: tuple
    reward: Any
    lost: Any


@dataclass(frozen=True)
class Law:
    """The parts of a tracking environment that do not change, and what they do.

    Attributes:
        model: the robot, or the one drawn around.
        structure: its platform and effects.
        task, reference, wheel_loop: see ``TrackingSettings``.
        noise_scale: standard deviations of the first six observations, or None.
        randomization: draws a robot for each episode, or None.
        substeps: Runge-Kutta steps of a period.
        history: torque commands that a delay needs.
    """

    model: Model
    structure: ModelStructure
    task: TrackingTask
    reference: Reference
    wheel_loop: WheelLoop
    noise_scale: tuple[float, ...] | None
    randomization: Randomization | None
    substeps: int
    history: int

    @classmethod
    def of(cls, settings: TrackingSettings) -> Law:
        """The law of an environment's arguments."""
        model, task = settings.robot, settings.task
        structure = ModelStructure.of(model)
        if settings.randomization is not None:
            acting = [effect for effect in structure.effects if effect.acts("delay")]
            longest = sum(effect.parameters[0].bounds[1] for effect in acting)
        else:
            longest = structure.bind(model.values()).delay()
        scale = None if settings.noise is None else tuple(settings.noise.tolist())
        return cls(
            model, structure, task, settings.followed, settings.loop, scale,
            settings.randomization,
            choose_substeps(model, task.dt), history_length(structure, longest, task.dt),
        )  # fmt: skip

    def with_substeps(self, count) -> Law:
        """The law with another number of Runge-Kutta steps, which may be an expression."""
        return replace(self, substeps=count)

    @property
    def wheels(self) -> int:
        """Number of wheels."""
        return len(self.task.platform.wheels)

    @property
    def draws(self) -> int:
        """How many numbers an episode takes beside those of its robot."""
        of_noise = 0 if self.noise_scale is None else KEYS
        return self.reference_draws + 3 + of_noise

    @property
    def reference_draws(self) -> int:
        """How many of them, the first ones, are those of the reference."""
        return 0 if self.reference.constant is not None else self.reference.draws or 0

    def start(
        self, followed, numbers, chosen: EpisodeOptions, ops: Ops
    ) -> tuple[list, State, tuple]:
        """The start of an episode.

        Args:
            followed: values of the reference, or None to make them of ``numbers``.
            numbers: ``draws`` components in [0, 1).
            chosen: what the user said.
            ops: elementary functions.

        Returns:
            ``(values of the reference, state, keys of the noise)``.
        """
        count = self.reference_draws
        if followed is None:
            followed = self.reference.drawn(iter(numbers[:count]), ops)
        first = self.reference.evaluate(followed, 0.0, ops)
        pose, velocity = chosen.start(first, chosen.offset_from(numbers[count : count + 3]), ops)
        state = self.structure.rest(pose, velocity)
        return followed, state, noise_keys(numbers[count + 3 :], ops)

    def torque(
        self, robot: BoundModel, state: State, before: tuple, action: tuple, integral: tuple, t,
        ops: Ops,
    ) -> tuple[tuple, tuple]:  # fmt: skip
        """Torques that an action commands, N m, and the integrals of the loops on board after it.

        ``before`` are the torques of the period before.
        """
        task = self.task
        if task.action_level == "torque":
            return tuple(task.torque_limit * a for a in action), integral
        limits = (task.speed_limit, task.speed_limit, task.yaw_rate_limit)
        twist = tuple(a * limit for a, limit in zip(action, limits, strict=True))
        s = robot.signals(t, state.velocity, state.pose, state.wheel_angle, before, ops)
        measured = robot.wheel_velocity(s, ops, state.internal)
        wanted = task.platform.geometry.wheel_velocity(twist)
        return self.wheel_loop.torque(wanted, measured, integral, task.dt, ops)

    def advance(self, robot: BoundModel, state: State, commands: tuple, t, ops: Ops) -> State:
        """One control period with the commands, newest first, as ``stepping.advance``."""
        return advance(robot, state, commands, self.task.dt, self.substeps, t, ops)

    def look(self, state: State, wanted: tuple, action: tuple, keys: tuple, step, ops: Ops) -> Look:
        """What a robot sees and earns when its reference has the pose ``wanted``.

        ``keys`` are those of the noise, ``step`` the number of the period, both uint32; not read
        where observations are exact.
        """
        heading = tuple(ops.coarse(part) for part in ops.cos_sin(state.pose[2]))
        error = self.task.error(state.pose, heading, wanted, ops)
        reward, lost = self.task.judge(error, action, ops)
        velocity = state.velocity
        if self.noise_scale is not None:
            added = noise(self.noise_scale, keys, step, ops)
            error = tuple(e + k for e, k in zip(error, added[:3], strict=True))
            velocity = tuple(v + k for v, k in zip(velocity, added[3:], strict=True))
        return Look(tuple(self.task.observe(error, velocity, heading, ())), reward, lost)
