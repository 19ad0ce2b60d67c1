"""256 robots at once, each with a mass and friction of its own, under one controller."""

import time

import gymnasium as gym
import numpy as np

import youbot_env  # noqa: F401  (makes YouBot-v0 known)
from controllers import make
from youbot_env.envs.randomization import Independent

ROBOTS, STEPS = 256, 200
spread = Independent({"m0": ("scale", 0.8, 1.2), "mu1": ("scale", 0.5, 2.0)})
controller = make("computed_torque", "paper")
envs = gym.make_vec(
    "YouBot-v0",
    num_envs=ROBOTS,
    vectorization_mode="vector_entry_point",
    model="paper",
    randomization=spread,
    **controller.env_kwargs,
)
observations, _ = envs.reset(seed=0)
start = time.perf_counter()
for _ in range(STEPS):
    actions, _ = controller.predict(observations)
    observations, rewards, terminated, truncated, infos = envs.step(actions)
rate = ROBOTS * STEPS / (time.perf_counter() - start)
envs.close()

errors = 1e3 * np.hypot(observations[:, 0], observations[:, 1])
print(f"{rate:,.0f} robot steps a second, controller included")
low, middle, high = np.quantile(errors, [0.05, 0.5, 0.95])
print(f"position error at the end: {middle:.1f} mm, 5 to 95 % of robots {low:.1f} to {high:.1f} mm")
