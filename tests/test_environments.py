"""Environments: Gymnasium's own checks, the vector environment equals the single one, bad input."""

import warnings

import gymnasium as gym
import numpy as np
import pytest
from gymnasium.utils.env_checker import check_env
from gymnasium.vector import AutoresetMode

import youbot_env
from youbot_env.envs.randomization import Independent, Posterior
from youbot_env.model_file import load_model
from youbot_env.parameters import ImpossibleParameters
from youbot_env.references import Circle, Multisine
from youbot_env.simulation import Sensors

gym.register_envs(youbot_env)

SPREAD = Independent({"m0": ("scale", 0.8, 1.2), "mu1": ("uniform", 0.05, 0.2)})
CASES = {
    "default": {},
    "velocity level": {"action_level": "velocity"},
    "random reference": {"reference": Multisine(speed=(0.1, 0.5), frequency=(0.3, 2.0))},
    "drawn circle": {"reference": Circle(speed=(0.1, 0.5), random_phase=True)},
    "noise": {"sensors": Sensors()},
    "randomized": {"randomization": SPREAD, "reveal_parameters": True},
    "effects": {
        "model": load_model("paper").with_effects(
            {"actuator_delay": 0.013, "actuator_lag": 0.03, "wheel_coulomb_friction": 0.2}
        ),
        "randomization": Independent({"actuator_delay.d": ("uniform", 0.0, 0.05)}),
    },
    "ends with its reference": {
        "reference": "calibration",
        "reference_options": {"seconds": 0.6},
    },
}


@pytest.mark.parametrize("env_id", ["YouBot-v0", "YouBotRollers-v0"])
@pytest.mark.parametrize("level", ["torque", "velocity"])
def test_check_env_with_warnings_as_errors(env_id, level):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        check_env(gym.make(env_id, action_level=level, render_mode="rgb_array").unwrapped)


@pytest.mark.parametrize("mode", list(AutoresetMode))
@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("compiled", [True, False])
def test_vector_environment_is_the_single_one_step_by_step(case, mode, compiled):
    copies, steps, seed = 3, 90, 11
    arguments = {**CASES[case], "max_episode_steps": 37}
    native = gym.make_vec(
        "YouBot-v0", copies, vectorization_mode="vector_entry_point", autoreset_mode=mode,
        compiled=compiled, **arguments,
    )  # fmt: skip
    single = gym.make_vec(
        "YouBot-v0", copies, vectorization_mode="sync", vector_kwargs={"autoreset_mode": mode},
        **arguments,
    )  # fmt: skip
    assert native.metadata["autoreset_mode"] is mode
    assert native.observation_space == single.observation_space
    assert native.action_space == single.action_space
    ours, theirs = native.reset(seed=seed), single.reset(seed=seed)
    _same(ours, theirs)
    rng, ends = np.random.default_rng(1), 0
    for _ in range(steps):
        actions = rng.uniform(-1, 1, native.action_space.shape).astype(np.float32)
        ours, theirs = native.step(actions), single.step(actions)
        _same(ours, theirs)
        done = ours[2] | ours[3]
        ends += done.sum()
        if mode is AutoresetMode.DISABLED and done.any():
            options = {"reset_mask": done}
            _same(native.reset(options=dict(options)), single.reset(options=dict(options)))
    assert ends > 0


def _same(ours, theirs):
    *values, info = ours
    *expected, expected_info = theirs
    for a, b in zip(values, expected, strict=True):
        np.testing.assert_allclose(np.asarray(a, float), np.asarray(b, float), atol=1e-6)
    _same_info(info, expected_info)


def _same_info(info, expected):
    assert set(expected) <= set(info)
    for name, value in expected.items():
        if name.startswith("_"):
            np.testing.assert_array_equal(info[name], value)
        elif isinstance(value, dict):
            _same_info(info[name], value)
        else:
            mask = expected[f"_{name}"]
            for a, b in zip(info[name][mask], value[mask], strict=True):
                np.testing.assert_allclose(np.asarray(a, float), np.asarray(b, float), atol=1e-6)


def test_equal_seeds_give_equal_episodes_and_unequal_ones_do_not():
    env = gym.make("YouBot-v0", sensors=Sensors(), randomization=SPREAD)
    first, again, other = (env.reset(seed=s)[0] for s in (5, 5, 6))
    np.testing.assert_array_equal(first, again)
    assert not np.array_equal(first, other)


def test_reward_is_bounded_and_best_on_the_reference():
    env = gym.make("YouBot-v0").unwrapped
    _, _ = env.reset(seed=0, options={"offset": (0, 0, 0), "follow": True})
    _, reward, terminated, truncated, _ = env.step(np.zeros(4, np.float32))
    assert 0.99 < reward <= 1.0
    assert not terminated
    assert not truncated
    env.reset(seed=0, options={"offset": (0.3, 0.2, 0.5)})
    assert 0.0 <= env.step(np.ones(4, np.float32))[1] < 0.2


def test_losing_the_reference_terminates_and_the_time_limit_truncates():
    env = gym.make("YouBot-v0", max_episode_steps=50)
    env.reset(seed=0, options={"offset": (0.999, 0, 0), "velocity": (0.9, 0, 0)})
    assert env.step(np.zeros(4, np.float32))[2]
    env.reset(seed=0)
    ends = [env.step(np.zeros(4, np.float32))[2:4] for _ in range(50)]
    assert ends[-1] == (False, True)
    assert not any(truncated for _, truncated in ends[:-1])


def test_observation_means_what_the_docstring_says():
    env = gym.make("YouBot-v0", reference="circle", preview=3, preview_stride=5).unwrapped
    observation, info = env.reset(seed=3, options={"offset": (0.02, -0.03, 0.2)})
    np.testing.assert_allclose(observation[2], -0.2, atol=1e-6)
    gap = info["reference_pose"] - info["pose"]
    c, s = np.cos(info["pose"][2]), np.sin(info["pose"][2])
    np.testing.assert_allclose(
        observation[:2], [c * gap[0] + s * gap[1], c * gap[1] - s * gap[0]], atol=1e-6
    )
    np.testing.assert_allclose(observation[8:].reshape(4, 3), [[0.3, 0.0, 0.5]] * 4, atol=1e-6)


def test_kinematic_level_follows_its_command():
    env = gym.make("YouBot-v0", action_level="velocity").unwrapped
    env.reset(seed=0, options={"offset": (0, 0, 0)})
    for _ in range(150):
        observation = env.step(np.array([0.25, 0.125, 0.25], np.float32))[0]
    np.testing.assert_allclose(observation[3:6], [0.2, 0.1, 0.4], atol=0.01)


def test_true_parameters_are_shown_only_when_asked_for():
    hidden = gym.make("YouBot-v0", randomization=SPREAD)
    assert "true_parameters" not in hidden.reset(seed=0)[1]
    shown = gym.make("YouBot-v0", randomization=SPREAD, reveal_parameters=True)
    drawn = [shown.reset(seed=s)[1]["true_parameters"]["m0"] for s in range(4)]
    assert len(set(drawn)) == 4
    assert all(0.8 * 35.3 <= m0 <= 1.2 * 35.3 for m0 in drawn)


def test_posterior_draws_have_the_covariance_of_the_model():
    from dataclasses import replace

    model = load_model("paper")
    scale = 0.01 * np.abs(model.values())
    covariance = np.diag(scale**2)
    covariance[0, 1] = covariance[1, 0] = 0.9 * scale[0] * scale[1]
    model = replace(model, covariance=covariance.tolist())
    rng = np.random.default_rng(0)
    drawn = np.array([Posterior().draw(model, rng).values() for _ in range(3000)])
    np.testing.assert_allclose(np.cov(drawn.T)[:2, :2], covariance[:2, :2], rtol=0.1)


def test_bad_requests_name_the_value_and_the_remedy():
    env = gym.make("YouBot-v0").unwrapped
    env.reset(seed=0)
    with pytest.raises(ValueError, match=r"shape \(3,\).*\(4,\)"):
        env.step(np.zeros(3))
    with pytest.raises(ValueError, match=r"action\[1\] = nan"):
        env.step(np.array([0, np.nan, 0, 0]))
    with pytest.raises(TypeError, match="colour"):
        gym.make("YouBot-v0", colour="red")
    with pytest.raises(ValueError, match="'speedy'"):
        gym.make("YouBot-v0", action_level="speedy")
    with pytest.raises(ValueError, match="colour"):
        env.reset(options={"colour": "red"})
    with pytest.raises(ValueError, match="offset"):
        env.reset(options={"offset": (1, 2)})
    negative = gym.make("YouBot-v0", randomization=Independent({"m0": ("uniform", -1.0, -1.0)}))
    with pytest.raises(ImpossibleParameters, match="m0 = -1"):
        negative.reset(seed=0)
    vector = gym.make_vec("YouBot-v0", 2, vectorization_mode="vector_entry_point")
    vector.reset(seed=0)
    with pytest.raises(ValueError, match=r"actions\[1, 2\] = inf"):
        vector.step(np.array([[0, 0, 0, 0], [0, 0, np.inf, 0]]))


def test_actions_beyond_one_are_clipped():
    env = gym.make("YouBot-v0").unwrapped
    env.reset(seed=0)
    np.testing.assert_allclose(env.step(np.full(4, 5.0))[4]["torque"], 4.0)


def test_stepping_before_reset_says_so():
    with pytest.raises(gym.error.ResetNeeded):
        gym.make("YouBot-v0").unwrapped.step(np.zeros(4))
