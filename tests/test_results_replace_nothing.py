"""No result ever replaces what it was made of."""

import os
import shutil
import subprocess
import sys
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parent.parent


def run(folder, script, *words):
    return subprocess.run(
        [sys.executable, ROOT / "scripts" / script, *words],
        cwd=folder, capture_output=True, text=True, timeout=120, check=False,
    )  # fmt: skip


@pytest.fixture
def folder(tmp_path):
    shutil.copy(ROOT / "ident" / "logs" / "youbot_fit.csv", tmp_path / "own.csv")
    shutil.copy(ROOT / "youbot_env" / "models" / "identified.yaml", tmp_path / "m.yaml")
    os.symlink("own.csv", tmp_path / "link.csv")
    (tmp_path / "index.html").write_text("time,x\n")
    return tmp_path


@pytest.mark.parametrize(
    "words",
    [
        ("identify.py", "own.csv", "--out", "own.csv"),
        ("identify.py", "own.csv", "--out", "link.csv"),
        ("identify.py", "*wn.csv", "--json=own.csv"),
        ("identify.py", "own.csv", "--test", "link.csv", "--out", "own.csv"),
        ("identify.py", "own.csv", "--model", "m.yaml", "--json", "m.yaml"),
        ("compare.py", "own.csv", "--json", "own.csv"),
        ("compare.py", "index.html", "--report", "."),
        ("diagnose.py", "own.csv", "--json", "own.csv"),
        ("improve.py", "own.csv", "--out", "own.csv"),
        ("convert.py", "own.csv", "--out", "own.csv"),
        ("calibrate_kinematics.py", "own.csv", "--out", "own.csv"),
    ],
    ids=lambda words: " ".join(words),
)
def test_an_output_is_never_an_input(folder, words):
    before = {path.name: path.read_bytes() for path in folder.iterdir()}
    done = run(folder, *words)
    assert done.returncode == 2, done.stderr
    assert "never replaces" in done.stderr
    assert {path.name: path.read_bytes() for path in folder.iterdir()} == before


@pytest.mark.parametrize(
    "words",
    [
        ("identify.py", "own", "--out", "logs/own.csv"),
        ("identify.py", "--force", "own", "--out", "logs/own.csv"),
        ("identify.py", "logs/own.csv", "--model", "m", "--out", "models/m.yaml"),
        ("identify.py", "--force", "own", "--model=m", "--out", "models/m.yaml"),
    ],
    ids=lambda words: " ".join(words),
)
def test_what_is_given_by_its_name_is_an_input(folder, words):
    for file, place in (("own.csv", "logs"), ("m.yaml", "models")):
        (folder / place).mkdir()
        shutil.copy(folder / file, folder / place / file)
    before = [path.read_bytes() for path in sorted(folder.glob("*/*"))]
    done = run(folder, *words)
    assert done.returncode == 2, done.stderr
    assert "never replaces" in done.stderr
    assert [path.read_bytes() for path in sorted(folder.glob("*/*"))] == before


def test_a_device_is_refused(folder):
    done = run(folder, "identify.py", "own.csv", "--json", "/dev/null")
    assert done.returncode == 2
    assert "device" in done.stderr


def test_a_fault_of_the_program_has_its_own_status(folder):
    (folder / "faulty.py").write_text(
        "from youbot_cli import console\n"
        "def command(word: str = 'a') -> None:\n"
        "    'Fail.'\n"
        "    raise KeyError(word)\n"
        "console.run(command, '')\n"
    )
    done = subprocess.run(
        [sys.executable, "faulty.py"], cwd=folder, capture_output=True, text=True, check=False
    )
    assert done.returncode == 3
    assert "KeyError: 'a'" in done.stderr
    assert "please send us" in done.stderr
