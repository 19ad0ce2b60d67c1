"""Policies without torch or pickle: what they see, their files, what they refuse."""

import json
import pickle
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

from small_policies import LAYOUT, native, policy, tiny

from controllers.training.checkpoint import FILE
from controllers.training.export import write_onnx
from controllers.training.learn import Run
from controllers.training.lesson import Lesson, Reward
from controllers.training.trial import Trial, drive
from controllers.training.vec_env import StableVecEnv
from controllers.training.worlds import make_world

gym.register_envs(youbot_env)

ROOT = Path(__file__).parents[1]
PAPER, NOMINAL = load_model("paper"), load_model("nominal")


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
    for content in ((tmp_path / FILE).read_bytes(), bomb, b""):
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
        (lambda d: d["normalisation"].update(clip=float("nan")), "its clip = nan"),
        (lambda d: d["task"].update(torque_limit=float("nan")), "its torque_limit = nan"),
        (lambda d: d["task"].update(dt=-0.01), "its dt = -0.01"),
        (lambda d: d["network"].update(share=10**400), "too large"),
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


def test_a_policy_file_nested_without_end_is_no_policy(tmp_path):
    path = policy().save(tmp_path / "mine")
    path.write_text("[" * 100_000 + "]" * 100_000)
    with pytest.raises(PolicyFileError, match="not valid JSON"):
        Policy.load(path)


def test_a_policy_is_refused_where_it_was_not_trained_for():
    with pytest.raises(PolicyFileError, match=r"no policy 'nobody'.*youbot train"):
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
    model = load_model(shipped.training["model"])
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
        (ROOT / "controllers" / "policies" / f"{name}{e}").stat().st_size for e in (".json", ".npz")
    )
    assert size < 200_000
