"""Reinforcement learning: ends of episodes, rewards, policies without torch or pickle, training."""

import json
import pickle
import runpy
import subprocess
import sys
from dataclasses import replace
from importlib.util import find_spec
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import youbot_env
from controllers import make
from controllers.rl_features import NAMES, Features
from controllers.rl_policy import Policy, PolicyFileError, shipped_policies
from youbot_env.envs.task import TrackingTask
from youbot_env.model_file import load_model

pytest.importorskip("stable_baselines3")

from controllers.training.checkpoint import FILE
from controllers.training.export import write_onnx
from controllers.training.learn import Run
from controllers.training.lesson import Lesson, Reward
from controllers.training.recipe import RECIPES
from controllers.training.trial import Trial, drive
from controllers.training.vec_env import StableVecEnv
from controllers.training.worlds import WIDE, make_world

gym.register_envs(youbot_env)

ROOT = Path(__file__).parents[1]
SCRIPTS = ROOT / "scripts"
PAPER, NOMINAL = load_model("paper"), load_model("nominal")
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


@pytest.fixture
def script(tmp_path, monkeypatch, capsys):
    """Run a script in an empty folder; returns (exit status, stdout, stderr)."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(SCRIPTS)

    def call(name, *options):
        path = str(SCRIPTS / name)
        monkeypatch.setattr(sys, "argv", [path, *map(str, options)])
        with pytest.raises(SystemExit) as end:
            runpy.run_path(path, run_name="__main__")
        return end.value.code or 0, *capsys.readouterr()

    return call


# Ends of episodes


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


# What is seen and earned


def test_features_do_not_depend_on_the_heading_and_say_what_their_names_say():
    task = TrackingTask(PAPER.platform, **LAYOUT)
    features, seen = Features(task), np.zeros((2, task.observation_space.shape[0]), np.float32)
    seen[:, :6] = (0.01, -0.02, np.pi / 2, 0.1, 0.2, 0.3)
    seen[0, 6:8], seen[1, 6:8] = (1.0, 0.0), (0.6, 0.8)
    times = np.array(task.preview_times)
    twists = np.stack([0.3 + times, 0.4 * np.ones_like(times), 2.0 * times], axis=1)
    seen[:, 8:] = twists.ravel()
    got = features(seen)
    assert got.shape == (2, len(NAMES))
    np.testing.assert_array_equal(got[0], got[1])
    told = dict(zip(NAMES, got[0], strict=True))
    # The reference is turned a quarter to the left: what is ahead of it is to the robot's left.
    assert told["velocity of the reference left"] == pytest.approx(0.3, abs=1e-6)
    assert told["velocity of the reference ahead"] == pytest.approx(-0.4, abs=1e-6)
    assert told["velocity error left"] == pytest.approx(0.3 - 0.2, abs=1e-6)
    assert told["its change in 60 ms, left"] == pytest.approx(0.06, abs=1e-5)
    assert told["its change in 60 ms, yaw"] == pytest.approx(0.12, abs=1e-5)
    with pytest.raises(ValueError, match=r"preview = 5 .* 0\.05 s; .* 0\.08 s ahead"):
        Features(TrackingTask(PAPER.platform, preview=5, preview_stride=1))


def test_rewards_are_of_the_true_pose_before_the_reset():
    from youbot_env.simulation import Sensors

    reward = Reward(change=0.5)
    lesson = Lesson(StableVecEnv(native(2, 6, sensors=Sensors())), reward)
    lesson.venv.seed(3)
    lesson.reset()
    alone = gym.make("YouBot-v0", max_episode_steps=6, sensors=Sensors(), **LAYOUT)
    alone.reset(seed=3)
    rng, before = np.random.default_rng(0), None
    for step in range(6):
        actions = rng.uniform(-1, 1, (2, 4)).astype(np.float32)
        _, earned, done, infos = lesson.step(actions)
        *_, info = alone.step(actions[0])
        gap = info["pose"] - info["reference_pose"]
        d = gap[0] ** 2 + gap[1] ** 2 + (reward.arm * gap[2]) ** 2
        wanted = np.mean([1 / (1 + d / s**2) for s in reward.scales])
        if before is not None:
            wanted -= 0.5 * np.mean((actions[0] - before) ** 2)
        assert earned[0] == pytest.approx(wanted, abs=1e-4), step
        before = actions[0]
    assert done.all()
    assert infos[0]["terminal_observation"].shape == (len(NAMES),)
    zero, one = np.zeros(1), np.ones(1)
    best = reward((zero, zero, zero), np.zeros((1, 4)), zero)
    assert best == pytest.approx(1.0)
    assert reward((zero, zero, zero), np.zeros((1, 4)), one) == pytest.approx(1.0 - reward.lost)


def test_a_residual_of_zero_is_computed_torque_and_corrections_are_remembered():
    settings = {"preview": 20}
    residual = make("residual", PAPER, policy="zero", **settings)
    known = make("computed_torque", PAPER, **settings)
    seen = np.zeros((2, 71))
    seen[:, :3], seen[:, 6] = (0.01, 0.02, 0.03), 1.0
    (action, memory), (wanted, _) = (one.predict(seen, None) for one in (residual, known))
    np.testing.assert_allclose(action, wanted, atol=1e-6)
    start = np.repeat(residual.start()[None], 2, axis=0)
    correction = np.array([[0.1, 0, 0, -0.1], [2.0, 0, 0, 0]])
    action, memory = residual.corrected(seen, start, correction)
    np.testing.assert_allclose(action[0], wanted[0] + correction[0], atol=1e-6)
    assert action[1, 0] == pytest.approx(1.0)
    np.testing.assert_allclose(memory[:, residual.estimator.sent], 4.0 * action, atol=1e-6)


# Policies


@pytest.mark.parametrize("algorithm", ["ppo", "sac", "residual"])
def test_the_policy_in_numpy_is_the_one_that_learned(algorithm, tmp_path):
    run = Run(tiny(algorithm), "nominal", NOMINAL, looks=2)
    run.learn()
    learned = Policy.load(run.policy().save(tmp_path / "mine"))
    seen = np.random.default_rng(0).normal(size=(50, len(NAMES))).astype(np.float32)
    wanted, _ = run.algorithm.predict(run.env.normalize_obs(seen), deterministic=True)
    np.testing.assert_allclose(learned(seen), learned.share * np.clip(wanted, -1, 1), atol=1e-5)
    assert [look.steps for look in run.curve] == sorted({look.steps for look in run.curve})
    assert run.curve[-1].steps >= run.recipe.steps
    onnx_equals(learned, seen, tmp_path / "mine.onnx")


def onnx_equals(learned, seen, path):
    if not (find_spec("onnx") and find_spec("onnxruntime")):
        return
    import onnxruntime

    write_onnx(learned, path)
    session = onnxruntime.InferenceSession(path, providers=["CPUExecutionProvider"])
    (got,) = session.run(None, {"features": seen})
    np.testing.assert_allclose(got, learned(seen), atol=1e-5)


def test_a_policy_survives_its_files(tmp_path):
    mine = policy(training={"seed": 3})
    read = Policy.load(mine.save(tmp_path / "mine"))
    features = np.random.default_rng(1).normal(size=(5, len(NAMES)))
    np.testing.assert_array_equal(read(features), mine(features))
    assert read.training == {"seed": 3}
    assert sorted(p.name for p in tmp_path.iterdir()) == ["mine.json", "mine.npz"]


class Bomb:
    """Unpickling this writes a file."""

    def __init__(self, path):
        self.path = path

    def __reduce__(self):
        return (Path.touch, (self.path,))


def test_nothing_of_a_policy_or_a_checkpoint_is_ever_unpickled(tmp_path):
    import hashlib

    exploded, mine = tmp_path / "exploded", policy().save(tmp_path / "mine")
    weights = mine.with_suffix(".npz")
    bomb = pickle.dumps(Bomb(exploded))
    pickle.loads(bomb)
    assert exploded.exists(), "the bomb itself works"
    exploded.unlink()
    described = json.loads(mine.read_text())
    with np.load(weights) as archive:
        arrays = dict(archive)
    objects = tmp_path / "objects.npz"
    np.savez(objects, **(arrays | {"bias_0": np.array([Bomb(exploded)], dtype=object)}))
    for content in (bomb, objects.read_bytes()):
        weights.write_bytes(content)
        described["weights"]["sha256"] = hashlib.sha256(content).hexdigest()
        mine.write_text(json.dumps(described))
        with pytest.raises(PolicyFileError, match="holds no network"):
            Policy.load(mine)
    run = Run(tiny("ppo"), "nominal", NOMINAL, checkpoints=tmp_path)
    import torch

    torch.save({"text": "{}", "learner": Bomb(exploded)}, tmp_path / FILE)
    for content in ((tmp_path / FILE).read_bytes(), bomb):
        (tmp_path / FILE).write_bytes(content)
        with pytest.raises(ValueError, match="is no checkpoint"):
            run.resume()
    assert not exploded.exists()


@pytest.mark.parametrize(
    ("spoil", "message"),
    [
        (lambda d: d.update(kind="other"), "is no 'youbot policy 1'"),
        (lambda d: d.pop("task"), r"\['task'\] are missing"),
        (lambda d: d["weights"].update(sha256="0"), "SHA-256 differs"),
        (lambda d: d["normalisation"]["mean"].pop(), "normalisation has another length"),
        (lambda d: d["normalisation"].update(clip="much"), "much"),
        (lambda d: d["network"].update(activation="eval"), "activation 'eval' is none of"),
        (lambda d: d["network"].pop("share"), "'share' is missing"),
        (lambda d: d["network"].update(sizes=[1, 2]), "holds no network"),
    ],
)
def test_a_spoiled_policy_file_says_what_is_wrong(tmp_path, spoil, message):
    path = policy().save(tmp_path / "mine")
    data = json.loads(path.read_text())
    spoil(data)
    path.write_text(json.dumps(data))
    with pytest.raises(PolicyFileError, match=message):
        Policy.load(path)


def test_a_policy_is_refused_where_it_was_not_trained_for():
    with pytest.raises(PolicyFileError, match=r"no policy 'nobody'.*train\.py"):
        make("ppo", PAPER, policy="nobody")
    with pytest.raises(PolicyFileError, match=r"trained by 'ppo'; use make\('ppo'"):
        make("sac", PAPER, policy=policy())
    with pytest.raises(PolicyFileError, match=r"dt = 0\.01, here it is 0\.02"):
        make("ppo", PAPER, policy=policy(), dt=0.02)
    with pytest.raises(PolicyFileError, match="values that are not finite"):
        policy(biases=(np.full(6, np.nan), np.zeros(4)))
    from youbot_env.platform import omni3

    with pytest.raises(PolicyFileError, match="drives 4 wheels, platform 'omni3' has 3"):
        make("ppo", replace(PAPER, platform=omni3()), policy=policy())


def test_running_a_policy_needs_no_torch(tmp_path):
    path = policy().save(tmp_path / "mine")
    code = (
        "import sys; from controllers import make; import numpy as np;"
        f"c = make('ppo', 'paper', policy={str(path)!r});"
        "c.predict(np.zeros(c.task.observation_space.shape));"
        "assert not {'torch', 'stable_baselines3'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT)


@pytest.mark.parametrize("name", shipped_policies())
def test_shipped_policies_beat_the_kinematic_controller(name):
    shipped = Policy.load(name)
    model = load_model(ROOT / "models" / f"{shipped.training['model']}.yaml")
    robots = make_world(shipped.training["world"], model)
    trial = Trial(robots=6, seconds=3.0)
    ours = drive(make(shipped.algorithm, model, policy=name), trial, *robots)
    theirs = drive(make("kinematic", model), trial, *robots)
    assert 1.5 * ours.position.mean() < theirs.position.mean()
    assert ours.run.mean() < theirs.run.mean()
    assert shipped.training["beats_kinematic"]
    assert shipped.training["wall_seconds"] < 20 * 60
    assert "scripts/train.py" in shipped.training["provenance"]["command"]
    size = sum(
        (ROOT / "models" / "policies" / f"{name}{e}").stat().st_size for e in (".json", ".npz")
    )
    assert size < 200_000


# Training


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


# Commands


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
