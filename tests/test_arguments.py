"""Arguments of a wrong type or without measure: the message names the argument, at once."""

import gymnasium as gym
import numpy as np
import pytest

import youbot_env
from controllers import make
from youbot_env.envs.randomization import Independent
from youbot_env.model_file import load_model
from youbot_env.simulation import AnalyticPlant, Sensors, WheelLoop

gym.register_envs(youbot_env)

PAPER = load_model("paper")
MAKE = {
    "single": lambda **arguments: gym.make("YouBot-v0", **arguments),
    "vector": lambda **arguments: gym.make_vec(
        "YouBot-v0", 2, vectorization_mode="vector_entry_point", **arguments
    ),
}
WRONG = [
    ("model", 3), ("model", None), ("reference", 3), ("reference_options", "x"),
    ("reference_options", {"speed": "fast"}), ("reference_options", {"speed": 1e300}),
    ("reference_options", {3: 1.0}), ("randomization", "wide"), ("reveal_parameters", "no"),
    ("sensors", True), ("wheel_loop", 3), ("dt", "a"), ("dt", 1e-300), ("dt", True),
    ("preview", 10**6), ("preview_stride", 10**9), ("torque_limit", 1e200), ("speed_limit", None),
]  # fmt: skip


@pytest.mark.parametrize(("name", "value"), WRONG, ids=lambda part: repr(part)[:30])
@pytest.mark.parametrize("kind", ["single", "vector"])
def test_arguments_of_environments(name, value, kind):
    named = "speed" if name == "reference_options" and "speed" in value else name
    with pytest.raises((TypeError, ValueError), match=rf"{named}\b.*; give"):
        MAKE[kind](**{name: value})


@pytest.mark.parametrize("count", [0, 2.5, 10**9])
def test_number_of_copies(count):
    with pytest.raises(ValueError, match=r"num_envs = .* to 1000000"):
        gym.make_vec("YouBot-v0", count, vectorization_mode="vector_entry_point")


@pytest.mark.parametrize("dt", ["x", None, 0, -1, float("nan"), 1e9])
def test_sample_time_of_plants(dt):
    with pytest.raises(ValueError, match=r"^dt = "):
        AnalyticPlant(PAPER, dt)
    pytest.importorskip("mujoco")
    from youbot_env.rollers import RollersPlant

    with pytest.raises(ValueError, match=r"^dt = "):
        RollersPlant(PAPER, dt)


def test_plants_take_models():
    with pytest.raises(TypeError, match="model = 'paper' is of type str; give a Model"):
        AnalyticPlant("paper")


@pytest.mark.parametrize(
    ("kind", "name", "value"),
    [
        (Sensors, "yaw", -1.0), (Sensors, "position", "x"), (WheelLoop, "limit", None),
        (WheelLoop, "leak", 0.0), (Independent, "spec", 3),
    ],
)  # fmt: skip
def test_arguments_of_parts(kind, name, value):
    with pytest.raises((TypeError, ValueError), match=f"^{name} = .*give"):
        kind(**{name: value})


@pytest.mark.parametrize("entry", [3, ("scale", "a", 1.0), ("scale", 0.0, np.nan), ("scale", 1.0)])
def test_a_randomization_that_cannot_be_drawn(entry):
    with pytest.raises(ValueError, match="randomization of m0"):
        Independent({"m0": entry})


@pytest.mark.parametrize(
    ("controller", "name", "value"),
    [
        ("computed_torque", "model", 3), ("computed_torque", "pose_time", "x"),
        ("adaptive", "disturbance_time", None), ("ppo", "policy", -1), ("mpc", "preview", 10**6),
        ("kinematic", "torque_limit", [4.0]),
    ],
)  # fmt: skip
def test_arguments_of_controllers(controller, name, value):
    arguments = {"model": PAPER} | {name: value}
    with pytest.raises((TypeError, ValueError), match=f"^{name} = .*give"):
        make(controller, **arguments)


def test_controllers_go_by_name():
    with pytest.raises(TypeError, match=r"^name = 3 .*'mpc'"):
        make(3, PAPER)


def test_weights_without_gains():
    with pytest.raises(ValueError, match="lqr has no gains"):
        make("lqr", PAPER, position=1e9)


def test_a_simulation_that_diverges_says_so():
    env = gym.make("YouBot-v0", torque_limit=1e4).unwrapped
    env.reset(seed=0)
    with pytest.raises(FloatingPointError, match="finite"):
        go_on(env, 3000)


def go_on(env, steps):
    """Drive on, whatever the end of the episode."""
    for _ in range(steps):
        env.step([1.0, -1.0, 1.0, 1.0])
