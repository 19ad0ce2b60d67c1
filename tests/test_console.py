"""What all scripts share: exit statuses, JSON, effects that are given."""

import json
import os
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest

import youbot_env
from youbot_env.model_file import load_model

gym.register_envs(youbot_env)


@pytest.fixture
def console(monkeypatch):
    from youbot_cli import console

    return console


def test_effects_that_are_given(console):
    from youbot_cli.effect_options import parse_effects

    given = ["floor_slope", "torque_gain.e_fl=0.1", "torque_gain.e_rr=-.2", "actuator_delay=1e-2"]
    assert parse_effects(given) == {
        "floor_slope": None,
        "torque_gain": {"e_fl": 0.1, "e_rr": -0.2},
        "actuator_delay": {"d": 0.01},
    }
    assert parse_effects(None) == {}
    both = parse_effects(["wheel_coulomb_friction=0.1", "wheel_coulomb_friction.fc_fl=0.3"])
    values = load_model("paper").with_effects(both).effects[0].values
    assert values == {"fc_fl": 0.3, "fc_fr": 0.1, "fc_rl": 0.1, "fc_rr": 0.1}


def test_console_statuses(console, monkeypatch, capsys):
    monkeypatch.setattr(sys, "argv", ["x.py"])
    monkeypatch.delenv("YOUBOT_DEBUG", raising=False)

    def end(error):
        def command() -> None:
            """Do it."""
            if error:
                raise error

        with pytest.raises(SystemExit) as stop:
            console.run(command, "")
        return stop.value.code or 0, capsys.readouterr().err

    assert end(None) == (0, "")
    assert end(console.CheckFailed("worse than before")) == (1, "worse than before\n")
    assert end(FileNotFoundError(2, "No such file", "a.csv")) == (
        2, "error: [Errno 2] No such file: 'a.csv'\n"
    )  # fmt: skip
    status, said = end(ZeroDivisionError("ours"))  # an error of ours is no bad input
    assert status == 3
    assert "ZeroDivisionError: ours" in said
    assert "please send us" in said
    monkeypatch.setenv("YOUBOT_DEBUG", "1")
    with pytest.raises(ValueError, match="shown whole"):
        end(ValueError("shown whole"))


def test_console_json_holds_only_what_json_has(console, tmp_path):
    data = {"a": np.float64(np.nan), "b": np.arange(2), "c": (1, np.bool_(True)), 3: Path("p")}
    console.write_json(tmp_path / "j.json", data)
    text = (tmp_path / "j.json").read_text()
    assert json.loads(text) == {"a": None, "b": [0, 1], "c": [1, True], "3": "p"}
    with pytest.raises(TypeError):
        console.write_json(tmp_path / "j.json", {"a": object()})
    assert (tmp_path / "j.json").read_text() == text


LONG = "direction_dependent_friction"


@pytest.mark.parametrize("width", [40, 80, 200])
def test_names_and_numbers_of_a_table_are_never_cut(console, capsys, monkeypatch, width):
    monkeypatch.setattr(console.out, "_width", width)
    heads = ("effect", "p adjusted", "gain %", "size", "unit", "smallest seen", "power %")
    rows = [(LONG, "0.005", "-131.2", "forward=0.00908", "N m s", 0.0256, "100"),
            ("torque_gain", "0.018", "-45.3", "e_fr=0.0687", "", "0.104", "75")]  # fmt: skip
    console.table("On top of the base model, a title that is longer", heads, rows)
    text = capsys.readouterr().out
    assert "…" not in text
    assert text.splitlines()[0] == "On top of the base model, a title that is longer"
    for word in (LONG, "-131.2", "forward=0.00908", "0.0256", "e_fr=0.0687", "adjusted"):
        assert word in text
    lines = [line.rstrip() for line in text.splitlines()[1:]]
    if width == 200:
        assert "N m s" in text
        assert len(lines) == 3
    if width == 80:  # every word is whole, so that this table needs a little more
        assert max(map(len, lines)) < 90


def test_a_table_that_fits_is_no_wider_than_the_terminal(console, capsys, monkeypatch):
    monkeypatch.setattr(console.out, "_width", 60)
    console.table("t", ("", "value", "95 % interval of it", "unit"),
                  [("a name of several words", 1.0, "0.9 ... 1.1", "kg m^2")])  # fmt: skip
    lines = capsys.readouterr().out.splitlines()
    assert max(len(line.rstrip()) for line in lines) <= 60
    assert "a name of several words" in lines[-1]


def test_where_no_terminal_is_each_stage_is_a_line(console, capsys):
    with console.progress("comparing", 3, "steps") as show:
        show(1)
        show(3)
    with console.stages("reading") as tell:
        for what in ("fitting", "fitting", "adding wheel_slip", "fitting"):
            tell(what)
    shown = capsys.readouterr()
    assert shown.err.splitlines() == [
        "comparing ...", "reading ...", "fitting ...", "adding wheel_slip ...",
    ]  # fmt: skip
    assert shown.out == ""


def test_console_command_line_hides_where_things_are(console, monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    words = [
        "/opt/scripts/fit.py",
        str(tmp_path / "a b.csv"),
        "--out=/elsewhere/m.yaml",
        "--n",
        "3",
    ]
    monkeypatch.setattr(sys, "argv", words)
    assert console.command_line() == "python scripts/fit.py 'a b.csv' --out=m.yaml --n 3"


@pytest.mark.parametrize("encoding", ["ascii", "utf-8"])
def test_any_terminal_can_show_what_is_said(tmp_path, encoding):
    (tmp_path / "plain.py").write_text(
        "from youbot_cli import console\n"
        "def command() -> None:\n"
        "    'Show.'\n"
        "    with console.progress('d\\u00e9j\\u00e0', 2, '\\u03bcs') as show:\n"
        "        show(1)\n"
        "    console.out.print('\\u00b1 0.1', console.drawable('\u2588', '#'))\n"
        "console.run(command, '')\n"
    )
    # With FORCE_COLOR the bar is drawn though nothing is a terminal.
    env = os.environ | {"PYTHONIOENCODING": encoding, "FORCE_COLOR": "1"}
    done = subprocess.run(
        [sys.executable, tmp_path / "plain.py"], capture_output=True, env=env, check=False
    )
    assert done.returncode == 0, done.stderr
    assert "1/2" in done.stderr.decode(encoding)
    said = done.stdout.decode(encoding)
    assert ("\u00b1 0.1 \u2588" if encoding == "utf-8" else "? 0.1 #") in said


@pytest.mark.parametrize("name", ["identify.py", "record.py", "train.py"])
def test_help_says_that_a_file_of_effects_is_run(script, name):
    status, said, _ = script(name, "--help")
    assert status == 0
    assert "IT IS RUN" in " ".join(said.split())


def test_numbers_without_measure_are_refused_with_their_limit(script):
    for words in (("identify.py", "--posterior", 10**9), ("train.py", "--seeds", 10**9)):
        status, _, said = script(*words)
        assert status == 2
        assert "less than or equal to" in said or "<=" in said
