"""Residual learning: computed torque knows the model, a policy learns what is left."""

from __future__ import annotations

import os
from dataclasses import dataclass

import casadi as ca
import numpy as np

from controllers import computed_torque
from controllers.estimator import OPS
from controllers.inverse import clip
from controllers.law import Tracking
from controllers.rl import load_policy
from controllers.rl_features import Features
from controllers.rl_policy import Policy
from youbot_env.model import Model
from youbot_env.plant import BoundModel


@dataclass(frozen=True, kw_only=True)
class Settings(computed_torque.Settings):
    """Settings of residual control.

    Attributes:
        policy: path of a policy file, name of a shipped one, or a policy; None for the shipped
            ``residual``, ``"zero"`` for none: computed torque alone, where training starts.
    """

    policy: str | os.PathLike | Policy | None = None


class Residual(computed_torque.ComputedTorque):
    """Computed torque plus a correction that a policy has learned.

    The correction enters the compiled law before the torque limit, so the estimator of computed
    torque knows the torques that were really commanded.

    Attributes:
        policy: the network, or None.
    """

    name = "residual"
    Settings = Settings

    def __init__(self, model: Model, settings: Settings):
        super().__init__(model, settings)
        chosen = self.name if settings.policy is None else settings.policy
        self.policy = None if chosen == "zero" else load_policy(chosen, self.name, self.task)
        self._features = Features(self.task)

    def extra_inputs(self) -> list:
        """See the base class: the correction, N m."""
        return [ca.SX.sym("correction", len(self.task.platform.wheels))]

    def command(self, tracking: Tracking, robot: BoundModel, extra: list) -> tuple:
        """See the base class."""
        known, limit = super().command(tracking, robot, []), self.task.torque_limit
        learned = ca.vertsplit(extra[0])
        return tuple(clip(a + b, limit, OPS) for a, b in zip(known, learned, strict=True))

    def act(self, seen: np.ndarray, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See the base class."""
        if self.policy is None:
            correction = np.zeros((1, len(self.task.platform.wheels)))
        else:
            correction = self.policy(self._features(seen))
        return self.corrected(seen, memory, correction)

    def corrected(self, seen, memory, correction) -> tuple[np.ndarray, np.ndarray]:
        """Act with a given correction (robots, n), in units of the torque limit."""
        return self.evaluate(seen, memory, self._values[None], self.task.torque_limit * correction)
