"""Policies and lessons that are small enough to learn within a test."""

from dataclasses import replace

import gymnasium as gym
import numpy as np

import youbot_env
from controllers.rl_features import NAMES
from controllers.rl_policy import Policy
from controllers.training.recipe import RECIPES

gym.register_envs(youbot_env)

LAYOUT = {"preview": 8, "preview_stride": 1}


def native(copies=3, steps=5, **options):
    options = {"autoreset_mode": "SameStep", **LAYOUT, **options}
    return gym.make_vec(
        "YouBot-v0", copies, vectorization_mode="vector_entry_point", max_episode_steps=steps,
        **options,
    )  # fmt: skip


def tiny(algorithm, steps=600, **changes):
    extra = {
        "ppo": {"n_steps": 32, "batch_size": 64, "n_epochs": 2},
        "sac": {"learning_starts": 50, "batch_size": 32, "buffer_size": 500, "gradient_steps": 1},
    }["sac" if algorithm == "sac" else "ppo"]
    recipe = RECIPES[algorithm]
    changes = {"copies": 4, "episode": 40, "layers": (8, 8), **changes}
    return replace(recipe, steps=steps, extra=recipe.extra | extra, **changes)


def policy(seed=0, **changes):
    rng, sizes = np.random.default_rng(seed), (len(NAMES), 6, 4)
    pairs = list(zip(sizes[1:], sizes[:-1], strict=True))
    entries = {
        "algorithm": "ppo",
        "weights": tuple(rng.normal(size=pair).astype(np.float32) for pair in pairs),
        "biases": tuple(rng.normal(size=pair[0]).astype(np.float32) for pair in pairs),
        "mean": rng.normal(size=sizes[0]),
        "deviation": rng.uniform(0.5, 2.0, sizes[0]),
        "clip": 10.0,
        "activation": "tanh",
        "squash": False,
        "share": 0.5,
        "task": {"dt": 0.01, "torque_limit": 4.0},
    }
    return Policy(**(entries | changes))
