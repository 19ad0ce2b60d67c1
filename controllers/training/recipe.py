"""How each algorithm is set up: every number of a training run, in one place."""

from __future__ import annotations

from dataclasses import asdict, dataclass, field
from typing import Any

from controllers.training.lesson import Reward


@dataclass(frozen=True, kw_only=True)
class Recipe:
    """A training run without its robots.

    Attributes:
        algorithm: name of the controller that the policy is for.
        steps: control periods of all copies together.
        copies: environments side by side.
        episode: control periods of an episode.
        noise: whether observations carry the noise of the sensors.
        layers: widths of the hidden layers.
        activation: of them.
        rate: first learning rate; it falls linearly to a fiftieth.
        gamma: discount; 0.95 looks a fifth of a second ahead, as long as the robot takes to answer.
        log_std: first logarithm of the standard deviation of actions.
        share: factor on the actions.
        reward: what is earned.
        extra: further arguments of the algorithm of Stable-Baselines3.
    """

    algorithm: str
    steps: int
    copies: int
    episode: int = 400
    noise: bool = True
    layers: tuple[int, ...] = (64, 64)
    activation: str = "tanh"
    rate: float = 1e-3
    gamma: float = 0.95
    log_std: float = -1.0
    share: float = 1.0
    reward: Reward = field(default_factory=Reward)
    extra: dict[str, Any] = field(default_factory=dict)

    def as_dict(self) -> dict[str, Any]:
        """What a record keeps."""
        return asdict(self)


_PPO = {
    "n_steps": 64, "batch_size": 2048, "n_epochs": 5, "gae_lambda": 0.9, "ent_coef": 0.0,
}  # fmt: skip
RECIPES = {
    "ppo": Recipe(algorithm="ppo", steps=4_000_000, copies=128, extra=_PPO),
    "residual": Recipe(
        algorithm="residual", steps=2_000_000, copies=128, log_std=-1.5, share=0.25, extra=_PPO
    ),
    "sac": Recipe(
        algorithm="sac",
        steps=1_600_000,
        copies=64,
        activation="relu",
        extra={
            "batch_size": 256, "buffer_size": 400_000, "learning_starts": 6_400, "train_freq": 1,
            "gradient_steps": 4, "tau": 0.01, "ent_coef": "auto_0.05", "target_entropy": -8.0,
        },
    ),
}  # fmt: skip
