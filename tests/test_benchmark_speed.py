"""The benchmark of speed: what it compares with, and what it calls slower."""

import pytest

from youbot_cli import benchmark_speed, console


def row(ratio, copies=16):
    return {"case": "0 effects", "copies": copies, "ratio": ratio}


def test_a_ratio_that_fell_by_more_than_allowed_fails_the_check():
    benchmark_speed.compare([row(0.71), row(0.1, copies=1)], [row(1.0)])
    with pytest.raises(console.CheckFailed, match=r"0 effects, 16 copies: 0\.69 after 1"):
        benchmark_speed.compare([row(0.69)], [row(1.0)])


class Counter:
    num_envs = 4

    def __init__(self):
        self.given = []

    def step(self, action):
        self.given.append(action)
        return None, None, None, None, None


def test_a_turn_gives_prepared_actions_in_turn_and_asks_for_none():
    env = Counter()
    assert benchmark_speed.turn(env, ["a", "b"], 5) > 0
    assert env.given == ["a", "b", "a", "b", "a"]
