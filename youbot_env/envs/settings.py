"""What single and vector environments are made from: the arguments they share, checked."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

import numpy as np

from youbot_env.arguments import check_kind, check_names
from youbot_env.envs.noise import noise_scale
from youbot_env.envs.randomization import Randomization
from youbot_env.envs.task import TrackingTask
from youbot_env.model import Model
from youbot_env.model_file import load_model
from youbot_env.references import Reference, make_reference
from youbot_env.simulation import Sensors, WheelLoop


@dataclass(frozen=True)
class TrackingSettings:
    """Arguments of the tracking environments.

    Attributes:
        model: the true robot: a model, a model file, or ``nominal`` or ``paper``.
        action_level: ``torque`` or ``velocity``.
        reference: a name (circle, eight, multisine, step, smooth_random, joystick, square, I,
            II, III, IV, calibration) or a ``Reference``.
        reference_options: arguments of a named reference, e.g. ``{"speed": (0.1, 0.5)}``.
        dt: control period, s; actions are held.
        preview: number of future reference twists in the observation.
        preview_stride: control periods between two of them.
        torque_limit: torque of action 1, N m.
        speed_limit, yaw_rate_limit: velocities of action 1 on the kinematic level, m/s and rad/s.
        randomization: draws the true robot of each episode around ``model``.
        reveal_parameters: put the drawn robot into ``info["true_parameters"]`` at reset.
        sensors: noise of the observation; None observes exactly.
        wheel_loop: gains of the loops on board (level ``velocity``).

    Raises:
        TypeError: an unknown argument, or one of a wrong type.
        ValueError: an argument that cannot be used; the message names value and remedy.
    """

    model: str | Model = "paper"
    action_level: str = "torque"
    reference: str | Reference = "circle"
    reference_options: dict[str, Any] | None = field(default=None, hash=False)
    dt: float = 0.01
    preview: int = 5
    preview_stride: int = 10
    torque_limit: float = 4.0
    speed_limit: float = 0.8
    yaw_rate_limit: float = 1.6
    randomization: Randomization | None = None
    reveal_parameters: bool = False
    sensors: Sensors | None = None
    wheel_loop: WheelLoop | None = None

    def __post_init__(self) -> None:
        if self.reference_options is not None:
            check_names("reference_options", self.reference_options, "a mapping of names")
        check_kind("reveal_parameters", self.reveal_parameters, (bool, np.bool_), "True or False")
        for name, kind in (
            ("randomization", Randomization), ("sensors", Sensors), ("wheel_loop", WheelLoop)
        ):  # fmt: skip
            wanted = f"a {kind.__name__} or None"
            check_kind(name, getattr(self, name), (kind, type(None)), wanted)

    @cached_property
    def robot(self) -> Model:
        """The true robot, loaded."""
        return load_model(self.model)

    @cached_property
    def task(self) -> TrackingTask:
        """The task, checked."""
        return TrackingTask(
            self.robot.platform,
            self.action_level,
            self.dt,
            self.preview,
            self.preview_stride,
            self.torque_limit,
            self.speed_limit,
            self.yaw_rate_limit,
        )

    @cached_property
    def followed(self) -> Reference:
        """The reference object."""
        return make_reference(self.reference, **(self.reference_options or {}))

    @cached_property
    def loop(self) -> WheelLoop:
        """Gains on board."""
        return self.wheel_loop or WheelLoop(limit=self.torque_limit)

    @cached_property
    def noise(self) -> np.ndarray | None:
        """Standard deviations (6,) of the observation's noise, or None."""
        return noise_scale(self.sensors, self.robot.platform) if self.sensors else None
