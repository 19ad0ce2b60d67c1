"""A single environment can be copied and pickled at any step, and goes on bit by bit."""

import copy
import pickle

import gymnasium as gym
import numpy as np
import pytest

import youbot_env
from youbot_env.envs.randomization import Independent
from youbot_env.model_file import load_model
from youbot_env.simulation import Sensors

gym.register_envs(youbot_env)

COPIES = {"deepcopy": copy.deepcopy, "pickle": lambda env: pickle.loads(pickle.dumps(env))}
EFFECTS = {"actuator_delay": 0.013, "wheel_coulomb_friction": 0.1, "actuator_lag": None}
SETTINGS = {
    "effects": {"model": load_model("paper").with_effects(EFFECTS), "sensors": Sensors()},
    "velocity": {"action_level": "velocity", "reference": "multisine"},
    "drawn robots": {"randomization": Independent({"m0": ("scale", 0.8, 1.2)})},
}


def go_on(env, actions):
    """Everything that the environment says from now on, over the end of an episode."""
    said = []
    for action in actions:
        observation, reward, lost, late, info = env.step(action)
        said.append(np.concatenate([observation, [reward, lost, late], info["pose"]]))
    observation, _ = env.reset()
    said += [observation, env.step(actions[0])[0]]
    return np.concatenate(said)


@pytest.mark.parametrize("how", COPIES)
@pytest.mark.parametrize("name", [*SETTINGS, "rollers"])
def test_a_copy_goes_on_bit_by_bit(name, how):
    if name == "rollers":
        pytest.importorskip("mujoco")
        env = gym.make("YouBotRollers-v0", sensors=Sensors())
    else:
        env = gym.make("YouBot-v0", **SETTINGS[name])
    rng = np.random.default_rng(0)
    env.reset(seed=3)
    for action in rng.uniform(-1, 1, (70, *env.action_space.shape)).astype(np.float32):
        env.step(action)
    actions = rng.uniform(-1, 1, (70, *env.action_space.shape)).astype(np.float32)
    other = COPIES[how](env)
    alone = go_on(other, actions)
    again = COPIES[how](env)  # the original was not touched by its copy
    np.testing.assert_array_equal(go_on(env, actions), alone)
    np.testing.assert_array_equal(go_on(again, actions), alone)


def test_a_copy_before_the_first_episode():
    env = gym.make("YouBot-v0")
    other = copy.deepcopy(env)
    np.testing.assert_array_equal(env.reset(seed=1)[0], other.reset(seed=1)[0])


def test_a_copy_draws_a_picture_of_its_own():
    env = gym.make("YouBot-v0", render_mode="rgb_array")
    env.reset(seed=0)
    first = env.render()
    other = pickle.loads(pickle.dumps(env))
    np.testing.assert_array_equal(other.render(), first)
    other.close()
    assert env.render().shape == first.shape
