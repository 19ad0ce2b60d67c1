"""What is installed from a wheel works in an empty folder, far from the project."""

import json
import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent
PACKAGES = ("youbot_env", "ident", "controllers", "youbot_cli")
# All that comes with the packages, by name; run where nothing else lies.
PROBE = """
import importlib, json, sys
import gymnasium as gym
from controllers import controller_names, make
from controllers.rl_policy import POLICIES, Policy
from ident.log import BUNDLED, Log
from youbot_env import __version__
from youbot_env.model_file import MODELS, load_model
from youbot_env.references import MOTIONS, load_motion, make_reference

made = [name for name, spec in gym.registry.items() if "youbot_env" in str(spec.entry_point)]
for name in made:
    env = gym.make(name, model="identified", reference="chirp")
    env.reset(seed=0)
    env.step(env.action_space.sample())
    env.close()
print(json.dumps({
    "version": __version__,
    "files": {name: importlib.import_module(name).__file__ for name in sys.argv[1:]},
    "environments": made,
    "models": [load_model(name).name for name in MODELS.names()],
    "motions": [make_reference(name) == load_motion(f"models/motions/{name}.yaml")
                for name in MOTIONS.names()],
    "policies": {name: Policy.load(name).algorithm for name in POLICIES.names()},
    "logs": {name: [len(Log.load(way).time) for way in (name, f"{name}.csv", f"logs/{name}.csv")]
             for name in BUNDLED.names()},
}))
"""


@pytest.fixture(scope="module")
def place(tmp_path_factory):
    """Folder in which the wheel was unpacked; the wheel is built of a copy of the tree."""
    folder = tmp_path_factory.mktemp("wheel")
    for name in (*PACKAGES, "pyproject.toml", "README.md", "LICENSE"):
        copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy
        (folder / "tree").mkdir(exist_ok=True)
        copy(ROOT / name, folder / "tree" / name)
    pip = [sys.executable, "-m", "pip", "--disable-pip-version-check", "--no-input", "-q"]
    offline = ["--no-deps", "--no-index"]
    build = [*pip, "wheel", *offline, "--no-build-isolation", "-w", folder, folder / "tree"]
    subprocess.run(build, check=True, capture_output=True, text=True)
    (wheel,) = folder.glob("*.whl")
    install = [*pip, "install", *offline, "--target", folder / "installed", wheel]
    subprocess.run(install, check=True, capture_output=True, text=True)
    return folder / "installed"


@pytest.fixture
def run(place, tmp_path):
    """Run Python with the installed packages alone, in an empty folder; returns its output."""

    def call(*words):
        env = os.environ | {"PYTHONPATH": str(place)}
        done = subprocess.run(
            [sys.executable, "-P", *map(str, words)],
            cwd=tmp_path, env=env, capture_output=True, text=True, check=False,
        )  # fmt: skip
        assert done.returncode == 0, done.stderr
        return done.stdout

    return call


@pytest.fixture
def youbot(run, place):
    (command,) = (place / "bin").glob("youbot*")
    return lambda *words: run(command, *words)


def names(folder, ending):
    return sorted(path.stem for path in (ROOT / folder).glob(f"*{ending}"))


def test_everything_is_there_by_name(run, place, tmp_path):
    pytest.importorskip("mujoco")
    found = json.loads(run("-c", PROBE, *PACKAGES))
    for name, file in found["files"].items():
        assert Path(file).parent == place / name
        assert (place / name / "py.typed").exists()
    assert sorted(found["environments"]) == ["YouBot-v0", "YouBotRollers-v0"]
    assert found["models"] == names("youbot_env/models", ".yaml")
    assert found["motions"] == [True] * len(names("youbot_env/motions", ".yaml"))
    assert list(found["policies"]) == names("controllers/policies", ".json")
    assert found["logs"] == {"youbot_fit": [11200] * 3, "youbot_test": [4800] * 3}
    assert f'version = "{found["version"]}"' in (ROOT / "pyproject.toml").read_text()
    assert not list(tmp_path.iterdir())


def test_no_file_of_the_packages_is_left_behind(place):
    for name in PACKAGES:
        there = {p.relative_to(ROOT) for p in (ROOT / name).rglob("*") if p.is_file()}
        missing = [p for p in there if "__pycache__" not in p.parts and not (place / p).exists()]
        assert not missing


def test_commands_record_identify_and_compare(youbot, tmp_path):
    assert "  identify " in youbot("--help")
    youbot("record", "--motion", "chirp", "--seconds", 3, "--out", "log.csv")
    assert (tmp_path / "log.csv").read_text().startswith("# youbot record --plant analytic")
    youbot("identify", "youbot_test", "--method", "ls")
    assert (tmp_path / "models" / "identified.yaml").exists()
    shown = youbot("compare", "logs/youbot_test.csv", "--json", "found.json", "--report", "page")
    assert shown.startswith("identified predicts youbot_test best")
    found = json.loads((tmp_path / "found.json").read_text())
    assert [model["model"] for model in found["models"]] == ["nominal", "identified"]
    assert found["provenance"]["git_commit"] is None
    assert found["provenance"]["command"].startswith("youbot compare logs/youbot_test.csv")
    page = (tmp_path / "page" / "index.html").read_text(encoding="utf-8")
    assert "color-scheme: light dark" in page  # of the style that comes with the package
    assert "const data = " in page  # of the player
