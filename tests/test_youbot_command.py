"""The one command ``youbot``, and what it has in common with the scripts."""

import importlib
import subprocess
import sys
from pathlib import Path

import pytest

from youbot_cli import COMMANDS, __main__, console, origins, split_command
from youbot_env.model_file import find_model, load_model, save_model

ROOT = Path(__file__).resolve().parent.parent


@pytest.fixture
def youbot(monkeypatch, tmp_path, capsys):
    """Call ``youbot`` in this process, in an empty folder; gives status and what it printed."""
    monkeypatch.chdir(tmp_path)

    def call(*words):
        monkeypatch.setattr(sys, "argv", ["youbot", *map(str, words)])
        try:
            __main__.main()
            status = 0
        except SystemExit as end:
            status = end.code or 0
        return status, *capsys.readouterr()

    return call


def test_every_script_is_a_command_and_starts_it():
    assert sorted(COMMANDS.values()) == sorted(path.stem for path in (ROOT / "scripts").iterdir())
    for words, name in COMMANDS.items():
        module = importlib.import_module(f"youbot_cli.{name}")
        assert __main__.line(words) == module.__doc__.partition("\n")[0]
        text = (ROOT / "scripts" / f"{name}.py").read_text()
        assert f"from youbot_cli.{name} import start" in text
        assert f"``youbot {words}``" in text


def test_help_lists_the_commands_and_imports_nothing_else(youbot):
    _, shown, _ = youbot("--help")
    assert [line.split("  ")[1] for line in shown.splitlines()[2:]] == list(COMMANDS)
    code = (
        "import sys; sys.argv = ['youbot']; from youbot_cli.__main__ import main; main(); "
        "assert not {'numpy', 'typer', 'rich', 'gymnasium', 'youbot_env'} & set(sys.modules)"
    )
    subprocess.run([sys.executable, "-c", code], check=True, cwd=ROOT, capture_output=True)
    status, shown, _ = youbot("benchmark")
    assert status == 0
    assert "benchmark speed" in shown
    assert "identify " not in shown


@pytest.mark.parametrize(
    ("words", "told"),
    [
        (["indentify"], "did you mean 'identify'?"),
        (["calibrate_kinematics"], "did you mean 'calibrate'?"),
        (["benchmark", "sped"], "did you mean 'benchmark speed'?"),
        (["--model", "paper"], "no command '--model'"),
    ],
)
def test_no_such_command_is_bad_input(youbot, words, told):
    status, shown, said = youbot(*words)
    assert (status, shown) == (2, "")
    assert told in said


def test_words_name_the_command_in_help_and_results(youbot, tmp_path):
    status, shown, _ = youbot("benchmark", "speed", "--help")
    assert status == 0
    assert shown.startswith("Usage: youbot benchmark speed")
    assert split_command(["benchmark", "speed", "-h"]) == ("benchmark speed", ["-h"])
    assert split_command(["benchmark"]) == ("", ["benchmark"])
    assert youbot("record", "--seconds", 0.5, "--out", "a.csv")[0] == 0
    line = (tmp_path / "a.csv").read_text().splitlines()[0]
    assert line.startswith("# youbot record --plant analytic")
    assert origins.origin(tmp_path / "a.csv").command == line.removeprefix("# ")


def test_script_and_command_are_one_origin(tmp_path):
    log = tmp_path / "a.csv"
    log.write_text("# python scripts/calibrate_kinematics.py a b\n")
    origins.check_replaceable([log], "youbot calibrate a b")
    for other in ("youbot calibrate a", "youbot convert a b", "youbot calibrates a b"):
        with pytest.raises(ValueError, match="was written by"):
            origins.check_replaceable([log], other)
    log.write_text("# youbot rides again\n")
    with pytest.raises(ValueError, match="does not say what wrote it"):
        origins.check_replaceable([log], "youbot convert a b")


def test_what_the_user_made_goes_before_what_is_shipped(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    names = ("identified", "identified.yaml", "models/identified", "models/identified.yaml")
    shipped = ROOT / "youbot_env" / "models" / "identified.yaml"
    assert {find_model(name) for name in names} == {shipped}
    save_model(load_model("paper"), "models/identified.yaml")
    assert {find_model(name) for name in names} == {Path("models/identified.yaml")}
    assert load_model("identified").name == "paper"
    with pytest.raises(ValueError, match="no model file 'other/identified'"):
        load_model("other/identified")


@pytest.mark.parametrize("words", [["--model", "identified"], ["--model=models/identified"]])
def test_a_result_does_not_replace_what_a_name_means(youbot, tmp_path, words):
    save_model(load_model("paper"), tmp_path / "models" / "identified.yaml")
    before = (tmp_path / "models" / "identified.yaml").read_bytes()
    status, _, said = youbot("identify", "youbot_test", "--force", *words)
    assert status == 2
    assert "never replaces what it was made of" in said
    assert (tmp_path / "models" / "identified.yaml").read_bytes() == before


def test_the_commit_is_that_of_the_project_alone(monkeypatch):
    if (ROOT / ".git").exists():
        head = subprocess.run(
            ["git", "rev-parse", "HEAD"], cwd=ROOT, capture_output=True, text=True, check=True
        )
        assert console.provenance()["git_commit"] == head.stdout.strip()
    # An installed package may lie inside the repository of its user.
    monkeypatch.setattr(console, "ROOT", ROOT / "docs")
    assert console.provenance()["git_commit"] is None
