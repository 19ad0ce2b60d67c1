"""The pages on controllers and log formats of one's own: their code runs and is known by name."""

import json
import re
import sys
from pathlib import Path

import pytest

import controllers
from controllers import Controller
from ident import Log, loaders
from ident.doctor.finding import LogError

DOCS = Path(__file__).resolve().parent.parent / "docs"


def blocks(page):
    return re.findall(r"```python\n(.*?)```", (DOCS / page).read_text("utf-8"), re.DOTALL)


@pytest.fixture
def folder(tmp_path, monkeypatch):
    """An empty working folder whose files can be imported."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(tmp_path)
    yield tmp_path
    for name in ("force_control", "json_lines"):
        sys.modules.pop(name, None)
    controllers.unregister("force")
    loaders.unregister("json_lines")


def test_a_controller_of_ones_own_drives(folder, capsys):
    law, use = blocks("add_a_controller.md")
    (folder / "force_control.py").write_text(law, encoding="utf-8")
    exec(compile(use, "use.py", "exec"), {})
    error = float(re.search(r"error (\d+) mm", capsys.readouterr().out)[1])
    assert error < 30.0
    assert "force" in controllers.controller_names()


def test_a_format_of_ones_own_is_read_checked_and_identified(folder, capsys):
    code, use = blocks("add_a_log_format.md")
    (folder / "json_lines.py").write_text(code, encoding="utf-8")
    source = Log.load("youbot_fit").part(0.0, 60.0)
    rows = zip(source.time, source.wheel_velocity, source.wheel_torque, strict=True)
    text = "\n".join(
        json.dumps({"ms": 1e3 * t, "speed": w.tolist(), "torque": m.tolist()}) for t, w, m in rows
    )
    (folder / "run.jsonl").write_text(text, encoding="utf-8")
    exec(compile(use, "use.py", "exec"), {})
    told = capsys.readouterr().out
    assert f"Log('run', {len(source.time)} samples" in told
    assert "Identification: run by" in told
    (folder / "run.jsonl").write_text(text[:-30], encoding="utf-8")
    with pytest.raises(LogError, match=r"run\.jsonl"):
        Log.load("run.jsonl")


def nameless(**parts):
    return type("Own", (Controller,), parts)


@pytest.mark.parametrize(
    ("controller", "error", "words"),
    [
        (3, TypeError, "controller = 3"),
        (nameless(), ValueError, "states no name"),
        (nameless(name="own"), ValueError, "override act"),
        (nameless(name="own", action_level="power"), ValueError, "'power'"),
        (nameless(name="lqr", act=lambda *_: None), ValueError, "exists already"),
    ],
)
def test_a_controller_that_states_too_little_is_refused(controller, error, words):
    with pytest.raises(error, match=words):
        controllers.register(controller)


@pytest.mark.parametrize(
    ("loader", "error", "words"),
    [
        (3, TypeError, "loader = 3"),
        (type("Own", (loaders.Loader,), {}), ValueError, "identifier"),
        (type("Own", (loaders.Loader,), {"identifier": "own", "title": "own"}), ValueError, "read"),
        (
            type("Own", (loaders.Loader,), {"identifier": "csv", "title": "mine",
                 "recognises": lambda *_: False, "read": lambda *_: None}),
            ValueError, "exists already",
        ),
    ],
)  # fmt: skip
def test_a_format_that_states_too_little_is_refused(loader, error, words):
    with pytest.raises(error, match=words):
        loaders.register(loader)
