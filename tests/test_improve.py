"""The loop: the error falls step by step, the model file works, refusals are told."""

import json
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

from ident.diagnosis.refit import refit
from ident.diagnosis.splits import divide
from ident.improvement import base_quantities
from ident.log import Log
from youbot_env.model_file import load_model
from youbot_env.references import SmoothRandom, calibration_sequence, make_reference
from youbot_env.simulation import Sensors, record_closed_loop
from youbot_env.simulation.sensors import IDEAL

ROOT = Path(__file__).resolve().parent.parent
HIDDEN = {"wheel_coulomb_friction": 0.15, "floor_slope": {"sx": 0.012, "sy": -0.008}}


@pytest.fixture(scope="module")
def logs():
    robot, found = load_model("paper").with_effects(HIDDEN), []
    motions = ((calibration_sequence(seconds=80.0), 80.0), (SmoothRandom(0.35, 1.5), 40.0))
    for seed, (motion, seconds) in enumerate(motions):
        times = np.arange(seconds * 100) / 100
        channels = record_closed_loop(robot, motion, times, Sensors(), seed=seed)
        found.append(Log(f"log{seed}", robot.platform, **channels))
    return found


@pytest.fixture(scope="module")
def files(logs, tmp_path_factory):
    """What the script writes for the logs: the model and the JSON."""
    folder = tmp_path_factory.mktemp("improved")
    paths = [log.save(folder / f"{k}.csv") for k, log in zip("ab", logs, strict=True)]
    out, file = folder / "model.yaml", folder / "i.json"
    done = improve(str(paths[0]), "--test", str(paths[1]), "--out", str(out), "--json", str(file))
    assert done.returncode == 0, done.stderr
    return out, json.loads(file.read_text())


def improve(*options):
    """Run the script."""
    return subprocess.run(
        [sys.executable, "scripts/improve.py", *options],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip


def test_error_falls_at_every_step_and_the_base_returns(files):
    stages = files[1]["stages"]
    assert {stage["added"] for stage in stages} == {None, *HIDDEN}
    errors = [stage["free_run"]["nrmse"] for stage in stages]
    assert errors == sorted(errors, reverse=True)
    assert stages[0]["covered"] == 0.0
    assert stages[-1]["covered"] > 0.9
    truth = load_model("paper").parameters
    first, last = (
        np.hypot(*(stage["base"][n]["value"] - getattr(truth, n) for n in ("a_x", "a_y")))
        for stage in stages[:: len(stages) - 1]
    )
    assert last < 0.2 * first
    mu1 = [stage["base"]["mu1"] for stage in stages]
    assert abs(mu1[-1]["value"] - mu1[0]["value"]) > 5 * mu1[-1]["se"]


def test_without_turning_mass_and_wheel_inertia_stay_open():
    robot, motion = load_model("nominal"), make_reference("III", speed=0.4)
    channels = record_closed_loop(robot, motion, np.arange(3000) / 100, IDEAL, seed=0)
    log = Log("straight", robot.platform, **channels)
    parts = divide([log], [], robot)
    base = base_quantities(parts, refit(parts, robot, intervals=True)[0].model, 2.0, robot)
    found = {name for name, q in base.items() if q.se is not None}
    assert found == {"mu1", "mu2", "x1+x3"}
    truth = robot.parameters
    assert base["mu2"].value == pytest.approx(truth.mu2, rel=1e-6)


def test_the_model_drives(files):
    env = gym.make("YouBot-v0", model=str(files[0]))
    env.reset(seed=0)
    env.step(env.action_space.sample())


def test_a_log_that_is_too_short_is_refused_with_what_to_record(logs, tmp_path):
    short = logs[0].part(0.0, 8.0).save(tmp_path / "short.csv")
    refused = improve(str(short), "--out", str(tmp_path / "none.yaml"))
    assert refused.returncode == 1
    assert "20 s" in refused.stdout
    assert "youbot record" in refused.stderr
    assert not (tmp_path / "none.yaml").exists()
