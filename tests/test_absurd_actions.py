"""Actions that no controller should send, to one robot and to many, and robots without numbers."""

import gymnasium as gym
import numpy as np
import pytest

import youbot_env

gym.register_envs(youbot_env)

ABSURD = {
    "has type <U1": ["1", "0", "0", "0"],
    "has type complex128": [1j, 0, 0, 0],
    "has type object": [None, 0, 0, 0],
    "has type object; give real": [10**400, 0, 0, 0],
    "has type datetime64": np.array(["2020"] * 4, "M8[Y]"),
    "has no shape": [[1.0], 0, 0, 0],
    r"has shape \(3,\).*takes \(4,\)": [0.0] * 3,
    r"has shape \(\)": None,
    r"\[1\] = nan": [0, np.nan, 0, 0],
    r"\[0\] = inf": [np.inf] * 4,
}


@pytest.fixture
def one():
    env = gym.make("YouBot-v0").unwrapped
    env.reset(seed=0)
    return env


@pytest.fixture
def many():
    env = gym.make_vec("YouBot-v0", 2, vectorization_mode="vector_entry_point")
    env.reset(seed=0)
    return env


@pytest.mark.parametrize("words", ABSURD)
def test_what_is_no_action_is_refused_and_changes_nothing(words, one, many):
    action, still = ABSURD[words], np.zeros(4)
    with pytest.raises(ValueError, match=words):
        one.step(action)
    plural = words.replace("has", "have")
    if not words.startswith((r"has shape", r"\[")):
        with pytest.raises(ValueError, match=plural):
            many.step([action, action])
    fresh = gym.make("YouBot-v0").unwrapped
    fresh.reset(seed=0)
    np.testing.assert_array_equal(one.step(still)[0], fresh.step(still)[0])


def test_the_place_of_a_bad_number_is_named_among_many(many):
    actions = np.zeros((2, 4))
    actions[1, 2] = np.nan
    with pytest.raises(ValueError, match=r"actions\[1, 2\] = nan"):
        many.step(actions)


@pytest.mark.parametrize("huge", [1e200, 3e38, 2**63 - 1])
def test_huge_finite_actions_are_full_actions(huge, one, many):
    expected = one.step(np.ones(4))[0]
    one.reset(seed=0)
    np.testing.assert_array_equal(one.step([huge] * 4)[0], expected)
    full = many.step(np.ones((2, 4)))[0]
    many.reset(seed=0)
    np.testing.assert_array_equal(many.step([[huge] * 4] * 2)[0], full)


def test_a_simulation_without_numbers_says_so(many):
    many.reset(seed=0)
    for component in many.unwrapped._state.velocity:
        component[1] = np.inf
    with np.errstate(all="ignore"), pytest.raises(FloatingPointError, match=r"copy 1; use"):
        many.step(np.zeros((2, 4), np.float32))
