"""The command that compares controllers."""

import json
import sys
from dataclasses import replace
from pathlib import Path

import pytest

from controllers.evaluation.motions import Motion
from controllers.evaluation.subjects import (
    INFORMED,
    MODELS,
)
from youbot_env.model import Model
from youbot_env.model_file import save_model
from youbot_env.parameters import Parameters
from youbot_env.platform import omni3

SCRIPTS = Path(__file__).resolve().parent.parent / "scripts"


SHORT = Motion("eight", 2.0, length=1.5)


@pytest.fixture
def command(monkeypatch, tmp_path, capsys):
    """Call the script in this process, in an empty folder; gives status and what it printed."""
    monkeypatch.chdir(tmp_path)
    from youbot_cli import console, evaluate

    def call(*arguments):
        monkeypatch.setattr(sys, "argv", [str(SCRIPTS / "evaluate.py"), *map(str, arguments)])
        with pytest.raises(SystemExit) as end:
            console.run(evaluate.evaluate, "", ("--controller", "--frequency"))
        return end.value.code, capsys.readouterr()

    return call


def test_three_omni_wheels_are_compared_from_their_own_data_sheet(command, monkeypatch):
    from youbot_cli import evaluate

    monkeypatch.setattr(evaluate, "LOG_SECONDS", 12.0)
    sheet = Parameters(m0=12.0, I0=0.35, I1=2e-3, a_x=0.01, a_y=0.0, mu1=0.02, mu2=1e-3)
    save_model(Model(omni3(0.2), sheet, name="three"), Path("three.yaml"))
    status, said = command(
        "--model", "three.yaml", "--controller", "kinematic", "computed_torque", "lqr", "mpc",
        "--plant", "analytic", "--reference", "eight", "--frequency", "2", "--robots", "2",
        "--effect", "wheel_coulomb_friction=0.05", "--steps", "0", "--no-wrong", "--jobs", "1",
        "--json", "out.json", "--report", "page",
    )  # fmt: skip
    assert status == 0, said.err
    result = json.loads(Path("out.json").read_text())
    assert result["setup"]["platform"] == omni3(0.2).name
    error = {
        (row["controller"], row["model"]): row["position"]["value"] for row in result["errors"]
    }
    kinematic = next(value for (name, _), value in error.items() if name == "kinematic")
    for name in ("computed_torque", "lqr", "mpc"):
        assert error[name, INFORMED] < 0.5 * kinematic
    assert Path("page/index.html").is_file()


def test_the_command_compares_and_writes_page_and_json(command, monkeypatch):
    from youbot_cli import evaluate, evaluate_figures

    monkeypatch.setattr(evaluate, "LOG_SECONDS", 12.0)
    monkeypatch.setattr(evaluate_figures, "FILMED", replace(SHORT, length=0.4))
    status, said = command(
        "--controller", "kinematic", "computed_torque", "--plant", "analytic", "--reference",
        "eight", "--frequency", "0.5", "2", "--robots", "2", "--effect",
        "wheel_coulomb_friction=0.2", "--steps", "50", "--no-wrong", "--jobs", "1", "--seed", "1",
        "--json", "out.json", "--report", "page",
    )  # fmt: skip
    assert status == 0, said.err
    assert "targets are met" in said.out
    result = json.loads(Path("out.json").read_text())
    assert len(result["errors"]) == 2 * (1 + len(MODELS))
    row = result["errors"][0]
    assert row["position"]["ci95"][0] <= row["position"]["value"] <= row["position"]["ci95"][1]
    met = {c["claim"]: c["met"] for c in result["claims"]}
    assert met[f"computed_torque, {INFORMED}: position below kinematic"]
    assert result["provenance"]["seed"] == 1
    assert result["mpc"]["endurance"]["steps"] == 50
    html = Path("page/index.html").read_text()
    assert html.count("data:image/png") == 1
    assert html.count("data:image/gif") == 1
    assert Path("page/analytic.gif").read_bytes()[:4] == b"GIF8"


@pytest.mark.parametrize(
    ("options", "words"),
    [
        (("--controller", "kinematics"), "did you mean 'kinematic'"),
        (("--reference", "spiral"), "--reference spiral: choose from eight"),
        (("--plant", "moon"), "--plant moon: choose from analytic"),
        (("--frequency", "90"), "--frequency 90: give 0.05 to 10 rad/s"),
        (("--effect", "wheel_slipp"), "wheel_slip"),
        (("--report", "file/page"), "no folder"),
    ],
)
def test_bad_input_is_told_before_anything_runs(command, options, words):
    Path("file").touch()
    status, said = command(*options, "--json", "out.json")
    assert status == 2
    assert words in said.err.replace("\n", " ")
    assert not Path("out.json").exists()
