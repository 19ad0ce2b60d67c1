"""Drive a figure of eight: what a controller gains from a model that was identified."""

import gymnasium as gym
import numpy as np

import youbot_env  # noqa: F401  (makes YouBot-v0 known)
from controllers import make
from youbot_env.model_file import load_model

# The robot in the environment; a controller only knows the model that it is given.
truth = load_model("identified").with_effects({"wheel_coulomb_friction": {"fc": 0.05}})
for believed in ("nominal", "identified", truth):
    controller = make("computed_torque", believed)
    env = gym.make("YouBot-v0", model=truth, reference="eight", **controller.env_kwargs)
    observation, info = env.reset(seed=0)
    errors = []
    for _ in range(1000):
        action, _ = controller.predict(observation)
        observation, reward, terminated, truncated, info = env.step(action)
        errors.append(np.hypot(*(info["pose"] - info["reference_pose"])[:2]))
        if terminated or truncated:
            break
    env.close()
    error = 1e3 * np.sqrt(np.mean(np.square(errors[200:])))
    name = "truth" if believed is truth else believed
    print(f"{name:>10}: position error {error:6.2f} mm rms after the first 2 s")
