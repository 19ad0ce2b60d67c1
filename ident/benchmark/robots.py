"""Robots drawn at random around the one of the paper."""

from __future__ import annotations

import numpy as np

from youbot_env.model import Model
from youbot_env.model_file import load_model
from youbot_env.parameters import Parameters

# Factors on the paper's values between which each parameter is drawn uniformly.
SPREAD = (0.6, 1.4)


def draw_robots(count: int, seed: int | np.random.SeedSequence) -> list[Model]:
    """Possible robots, each parameter drawn uniformly around the paper's."""
    rng, paper = np.random.default_rng(seed), load_model("paper")
    values, robots = np.array(list(paper.parameters.as_dict().values())), []
    while len(robots) < count:
        drawn = Parameters(*(values * rng.uniform(*SPREAD, len(values))).tolist())
        if not drawn.problems(paper.platform):
            robots.append(Model(paper.platform, drawn, name=f"robot {len(robots)}"))
    return robots
