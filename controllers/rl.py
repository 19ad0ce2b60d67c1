"""Trained policies as controllers: PPO and SAC straight to wheel torques, in plain NumPy."""

from __future__ import annotations

import os
from dataclasses import dataclass

import numpy as np

from controllers import base
from controllers.rl_features import Features
from controllers.rl_policy import Policy, PolicyFileError
from youbot_env.arguments import check_kind
from youbot_env.envs.task import TrackingTask
from youbot_env.model import Model


@dataclass(frozen=True, kw_only=True)
class Settings(base.Settings):
    """Settings of a trained policy.

    Attributes:
        policy: path of a policy file, name of a shipped one, or a policy; None for the shipped one
            that bears the name of the controller.
        preview: the default reaches what policies look at.
    """

    policy: str | os.PathLike | Policy | None = None
    preview: int = 8


class PolicyController(base.Controller):
    """Base of controllers that are a network from observation to wheel torques.

    Knowledge of the robot is in the weights: the model only says which platform it is.

    Attributes:
        policy: the network.
    """

    uses_model = False
    Settings = Settings

    def __init__(self, model: Model, settings: Settings):
        super().__init__(model, settings)
        chosen = self.name if settings.policy is None else settings.policy
        self.policy = load_policy(chosen, self.name, self.task)
        self._features = Features(self.task)

    def act(self, seen: np.ndarray, memory: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """See the base class."""
        return self.policy(self._features(seen)), memory


class Ppo(PolicyController):
    """Policy learned by proximal policy optimisation (``youbot train``)."""

    name = "ppo"


class Sac(PolicyController):
    """Policy learned by soft actor-critic (``youbot train --algorithm sac``)."""

    name = "sac"


def load_policy(source: str | os.PathLike | Policy, algorithm: str, task: TrackingTask) -> Policy:
    """Read a policy and check that it was trained for this use.

    Raises:
        TypeError: no policy at all.
        PolicyFileError: unusable file, or a policy of another algorithm, period, torque limit or
            number of wheels.
    """
    check_kind("policy", source, (str, os.PathLike, Policy), "a file, a name or a Policy")
    policy = source if isinstance(source, Policy) else Policy.load(source)
    source = "of your own" if policy is source else str(source)
    if policy.algorithm != algorithm:
        raise PolicyFileError(
            f"policy {source!r} was trained by {policy.algorithm!r}; use make("
            f"{policy.algorithm!r}, ...)"
        )
    for name, trained in policy.task.items():
        if not np.isclose(getattr(task, name), trained):
            raise PolicyFileError(
                f"policy {source!r} was trained with {name} = {trained:g}, here it is "
                f"{getattr(task, name):g}; set {name} = {trained:g} or train another"
            )
    if policy.sizes[-1] != len(task.platform.wheels):
        raise PolicyFileError(
            f"policy {source!r} drives {policy.sizes[-1]} wheels, platform "
            f"{task.platform.name!r} has {len(task.platform.wheels)}; train one for it"
        )
    return policy
