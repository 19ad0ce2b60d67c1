"""Reinforcement learning: ends of episodes, training, worlds and commands."""

import io
import json
import math
from dataclasses import replace
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import youbot_env
from controllers import make
from controllers.rl_features import NAMES
from controllers.rl_policy import Policy
from youbot_env.model_file import load_model

pytest.importorskip("stable_baselines3")
import torch
from small_policies import LAYOUT, native, policy, tiny

from controllers.training.learn import Run
from controllers.training.trial import Trial, drive
from controllers.training.vec_env import StableVecEnv
from controllers.training.worlds import WIDE, make_world

gym.register_envs(youbot_env)

ROOT = Path(__file__).parents[1]
PAPER, NOMINAL = load_model("paper"), load_model("nominal")


@pytest.mark.parametrize("push", [0.0, 1.0], ids=["time is up", "reference lost"])
def test_an_end_shows_the_last_observation_and_whether_time_was_the_reason(push):
    steps = 150 if push else 5
    envs = StableVecEnv(native(2, steps))
    envs.seed(7)
    seen = envs.reset()
    alone = gym.make("YouBot-v0", max_episode_steps=steps, **LAYOUT)
    first, _ = alone.reset(seed=7)
    np.testing.assert_allclose(seen[0], first, atol=1e-5)
    action, ended = np.full((2, 4), push, np.float32), False
    while not ended:
        seen, reward, done, infos = envs.step(action)
        last, earned, lost, late, _ = alone.step(action[0])
        assert reward[0] == pytest.approx(earned, abs=1e-5)
        assert done[0] == (lost or late)
        ended = done[0]
        assert ("terminal_observation" in infos[0]) == ended
    assert lost == (push == 1.0)
    np.testing.assert_allclose(infos[0]["terminal_observation"], last, atol=1e-4)
    assert infos[0]["TimeLimit.truncated"] == (late and not lost)
    # The observation that came along is the first of the next episode: at rest, as drawn.
    again, _ = alone.reset()
    np.testing.assert_allclose(seen[0], again, atol=1e-5)


def test_next_step_resets_would_teach_nonsense_and_are_refused():
    with pytest.raises(ValueError, match=r"NEXT_STEP.*SameStep"):
        StableVecEnv(native(autoreset_mode="NextStep"))


@pytest.mark.parametrize("name", ["ppo", "residual", "kinematic"])
def test_evaluate_policy_runs_on_the_native_environment(name):
    from stable_baselines3.common.evaluation import evaluate_policy

    chosen = {"ppo": policy(share=0.0), "residual": "zero"}
    settings = {"policy": chosen[name]} if name in chosen else {}
    controller = make(name, PAPER, **settings)
    envs = StableVecEnv(native(2, 30, **controller.env_kwargs))
    rewards, lengths = evaluate_policy(
        controller, envs, n_eval_episodes=4, return_episode_rewards=True, warn=False
    )
    assert lengths == [30] * 4
    assert all(0 < reward <= 30 for reward in rewards)


def test_ppo_learns():
    recipe = replace(tiny("ppo", 30_000), copies=64, episode=200, layers=(32, 32))
    run = Run(recipe, "nominal", NOMINAL, looks=6)
    run.learn()
    assert run.curve[-1].reward > run.curve[0].reward + 0.03


@pytest.mark.parametrize("algorithm", ["ppo", "sac"])
def test_a_run_goes_on_where_it_stopped(algorithm, tmp_path):
    first = Run(tiny(algorithm, 400), "nominal", NOMINAL, 1, tmp_path, looks=2)
    first.learn()
    second = Run(tiny(algorithm, 800), "nominal", NOMINAL, 1, tmp_path, looks=2)
    second.resume()
    features = np.random.default_rng(0).normal(size=(9, len(NAMES)))
    np.testing.assert_array_equal(second.policy()(features), first.policy()(features))
    assert second.curve == first.curve
    if algorithm == "sac":
        assert second.algorithm.replay_buffer.size() == first.algorithm.replay_buffer.size()
        np.testing.assert_array_equal(
            second.algorithm.replay_buffer.rewards, first.algorithm.replay_buffer.rewards
        )
    second.learn()
    assert second.curve[-1].steps >= 800
    assert not np.array_equal(second.policy()(features), first.policy()(features))
    other = Run(tiny(algorithm), "nominal", NOMINAL, 2, tmp_path)
    with pytest.raises(ValueError, match="run with another seed"):
        other.resume()


def test_equal_seeds_learn_the_same():
    features = np.random.default_rng(0).normal(size=(9, len(NAMES)))
    answers = []
    for seed in (0, 0, 1):
        run = Run(tiny("ppo", 200), "wide", NOMINAL, seed, looks=1)
        run.learn()
        answers.append(run.policy()(features))
    np.testing.assert_array_equal(answers[0], answers[1])
    assert not np.array_equal(answers[0], answers[2])


def test_worlds_draw_what_they_say():
    robot, wide = make_world("wide", NOMINAL)
    rng = np.random.default_rng(0)
    drawn = [
        dict(zip(robot.names(), wide.draw(robot, rng).values(), strict=True)) for _ in range(50)
    ]
    for name in ("mu1", "wheel_coulomb_friction.fc", "actuator_delay.d"):
        values = np.array([one[name] for one in drawn])
        assert WIDE[name][1] <= values.min() < values.max() <= WIDE[name][2]
    assert make_world("nominal", PAPER) == (PAPER, None)
    with pytest.raises(ValueError, match="'paper' has no covariance"):
        make_world("posterior", PAPER)


def test_trials_pair_by_seed():
    trial = Trial("multisine", robots=3, seconds=0.5, settle=0.1)
    one, two = (drive(make("kinematic", PAPER), trial, PAPER) for _ in range(2))
    np.testing.assert_array_equal(one.position, two.position)
    other = drive(make("kinematic", PAPER), replace(trial, seed=5), PAPER)
    assert not np.array_equal(one.position, other.position)


def test_the_command_trains_examines_and_writes(script, tmp_path):
    options = ("--steps", 8000, "--copies", 64, "--seeds", 3, "--seconds", 3)
    files = ("--out", "p.json", "--json", "o.json", "--report", "page", "--checkpoints", "ck")
    status, out, err = script("train.py", *options, *files)
    out = " ".join(out.split())
    assert status == 1, err
    assert "does not beat the kinematic controller" in out
    assert "train longer" in err
    record = json.loads((tmp_path / "o.json").read_text())
    assert record["steps"] >= 8000
    assert not record["beats_kinematic"]
    assert len(record["exam"]) == 3
    text = (tmp_path / "p.json").read_text() + (tmp_path / "o.json").read_text()
    assert str(tmp_path) not in text
    assert Policy.load(tmp_path / "p.json").training["recipe"]["copies"] == 64
    assert (tmp_path / "page" / "learning_curve.png").stat().st_size > 5000
    short = ("--seeds", 2, "--seconds", 3, "--json", "e.json", "--report", "policies")
    status, out, _ = script("evaluate_policies.py", "p.json", *short)
    assert status == 1
    told = json.loads((tmp_path / "e.json").read_text())
    hidden = [told["transfer"][k]["hidden_m"]["value"] for k in ("p", "kinematic, nominal")]
    assert hidden[0] > 2 * hidden[1]
    assert (tmp_path / "policies" / "index.html").exists()
    assert told["transfer"]["kinematic, nominal"]["lost"] == 0


@pytest.mark.parametrize(
    ("options", "message"),
    [
        (("--algorithm", "dqn"), "choose one of ppo, sac, residual"),
        (("--world", "real"), "choose one of nominal, wide, posterior"),
        (("--resume",), "needs --checkpoints"),
        (("--resume", "--checkpoints", "nowhere"), "no checkpoint"),
        (("--world", "posterior", "--model", "paper"), "no covariance"),
        (("--model", "nobody.yaml"), "no model file"),
        (("--json", "./same.json", "--out", "same.json"), "cannot both"),
    ],
)
def test_bad_input_ends_with_status_two_and_writes_nothing(script, tmp_path, options, message):
    status, _, err = script("train.py", "--steps", 100, *options)
    assert status == 2
    assert message in err
    assert list(tmp_path.iterdir()) == []


def cut(data):
    return data[: len(data) // 2]


def changed(place, change):
    """Change what stands at a place of a checkpoint."""

    def spoil(data):
        tree = torch.load(io.BytesIO(data), weights_only=True)
        parent = tree
        for key in place[:-1]:
            parent = parent[key]
        parent[place[-1]] = change(parent[place[-1]])
        stream = io.BytesIO()
        torch.save(tree, stream)
        return stream.getvalue()

    return spoil


@pytest.fixture(scope="module")
def started(tmp_path_factory):
    """A run, its checkpoint, and the content of that."""
    folder = tmp_path_factory.mktemp("run")
    run = Run(tiny("ppo"), "nominal", NOMINAL, checkpoints=folder)
    run.look()
    run.resume()
    file = folder / "checkpoint.pt"
    return run, file, file.read_bytes()


NET = ("learner", "policy", "action_net.weight")


@pytest.mark.parametrize(
    ("spoil", "what"),
    [
        (cut, "no checkpoint of this project"),
        (lambda data: b"", "no checkpoint of this project"),
        (changed(NET, lambda w: w[:, :1]), "does not fit this run"),
        (changed(NET, lambda w: {"a": w}), "does not fit this run"),
        (changed(NET, lambda w: w * math.nan), "not finite"),
        (changed(("scaling", "features_mean"), lambda m: m[:3]), "does not fit this run"),
        (changed(("scaling", "features_var"), lambda v: -v), "does not fit this run"),
        (changed(("scaling",), lambda s: {}), "does not fit this run"),
        (changed(("text",), lambda t: t.replace('"seconds"', '"null"')), "no checkpoint of this"),
        (changed(("text",), lambda t: t.replace('"seconds": ', '"seconds": -1')), "does not fit"),
    ],
)
def test_a_damaged_checkpoint_is_told(started, spoil, what):
    run, file, good = started
    file.write_bytes(spoil(good))
    with pytest.raises(ValueError, match=rf"checkpoint\.pt(.|\n)*{what}"):
        run.resume()
