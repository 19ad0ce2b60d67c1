"""The workbench without a browser: who is let in, what a session keeps, and its own process."""

import asyncio
import json
from pathlib import Path

import pytest

pytest.importorskip("nicegui", reason="the page needs NiceGUI: pip install -e '.[workbench]'")
pytest.importorskip("latex2mathml", reason="pip install -e '.[workbench]'")

from short_logs import record_two

from youbot_workbench.server import COOKIE, LOOPBACK, Guard, free_port, serve
from youbot_workbench.session import Session, Sessions
from youbot_workbench.views import SessionViews
from youbot_workbench.worker import Worker, WorkerEnded

EFFECT_FILE = """
from youbot_env.effects import Effect, Parameter


class Mine(Effect):
    identifier, title, link = "mine_of_the_test", "Mine", "shaft"
    equation = r"\\\\tau_i = -c\\\\,\\\\varphi_i"
    parameters = (Parameter("c", "N m", "size", 0.2, (0.0, 5.0), per_wheel=True),)
    regime = "always"

    def shaft(self, p, s, ops):
        return tuple(-c * ops.tanh(w) for c, w in zip(p.c, s.wheel_velocity))
"""


def ask(guard: Guard, headers: dict[str, str], query: str = "", kind: str = "http") -> list[dict]:
    """Send a request through the guard; returns what it sends back."""
    sent: list[dict] = []
    scope = {"type": kind, "path": "/", "query_string": query.encode(), "method": "GET",
             "headers": [(k.encode(), v.encode()) for k, v in headers.items()]}  # fmt: skip

    async def receive():
        return {"type": "http.request", "body": b""}

    async def send(message):
        sent.append(message)

    asyncio.run(guard(scope, receive, send))
    return sent


async def inner(scope, receive, send):
    await send({"type": "let in"})


@pytest.mark.parametrize("kind", ["http", "websocket"])
def test_other_machines_need_the_token(kind):
    guard = Guard(inner, "secret", ())
    refused = ask(guard, {"host": "robot:8040"}, kind=kind)
    assert refused[0].get("status") == 403 or refused[0]["type"] == "websocket.close"
    assert ask(guard, {"host": "robot:8040", "cookie": f"{COOKIE}=wrong"}, kind=kind) == refused
    known = {"host": "robot:8040", "cookie": f"{COOKIE}=secret"}
    assert ask(guard, known, kind=kind) == [{"type": "let in"}]


def test_the_token_in_the_address_becomes_a_cookie_that_scripts_cannot_read():
    sent = ask(Guard(inner, "secret", ()), {"host": "robot:8040"}, "token=secret")
    cookie = dict(sent[0]["headers"])[b"set-cookie"].decode()
    assert sent[0]["status"] == 307
    assert f"{COOKIE}=secret" in cookie
    assert "httponly" in cookie.lower()


def test_a_page_of_the_web_cannot_reach_a_local_server_by_another_name():
    guard = Guard(inner, "", LOOPBACK)
    assert ask(guard, {"host": "evil.example:8040"})[0]["status"] == 403
    assert ask(guard, {"host": "127.0.0.1:8040"}) == [{"type": "let in"}]
    assert ask(guard, {"host": "[::1]:8040"}) == [{"type": "let in"}]


def test_a_taken_port_is_refused_and_a_free_one_found():
    import socket

    port = free_port("127.0.0.1")
    with socket.socket() as other:
        other.bind(("127.0.0.1", port))
        other.listen()
        assert free_port("127.0.0.1") != port
        with pytest.raises(ValueError, match=f"--port {port} is taken"):
            serve(None, port=port, show=False)


def test_a_folder_without_a_session_is_refused(tmp_path):
    (tmp_path / "session.json").write_text("{not json")
    with pytest.raises(ValueError, match="holds no session"):
        Session.open(tmp_path, tmp_path / "into")


def test_saving_replaces_nothing(tmp_path):
    session = Session(tmp_path / "one")
    (tmp_path / "there").mkdir()
    (tmp_path / "there" / "notes.txt").write_text("mine")
    with pytest.raises(ValueError, match="not empty"):
        session.save(tmp_path / "there")
    assert [p.name for p in (tmp_path / "there").iterdir()] == ["notes.txt"]


def test_an_upload_replaces_none_of_the_same_name(tmp_path):
    session = Session(tmp_path)
    first = session.room_for("log.csv")
    first.write_text("first")
    second = session.room_for("log.csv")
    second.write_text("second")
    assert first.read_text() == "first"
    assert {p.name for p in (tmp_path / "logs").iterdir()} == {"log.csv", "log (2).csv"}


def test_a_saved_session_takes_its_logs_along(tmp_path):
    outside = tmp_path / "log.csv"
    outside.write_text("time\n0\n")
    session = Session(tmp_path / "one")
    session.settings |= {"logs": [str(outside)], "tests": ["youbot_test"]}
    session.take({"added": ["wheel_coulomb_friction"]})
    session.save(tmp_path / "saved")
    outside.unlink()
    opened = Sessions().open(tmp_path / "saved")
    (log,) = opened.settings["logs"]
    assert opened.settings["tests"] == ["youbot_test"]
    assert Path(log).read_text() == "time\n0\n"
    assert opened.added == ["wheel_coulomb_friction"]
    opened.worker.end()


def test_effects_of_a_user_are_tried(tmp_path):
    file = tmp_path / "mine.py"
    file.write_text(EFFECT_FILE)
    fit, test = record_two(tmp_path)
    session = Session(tmp_path / "session")
    session.settings |= {"logs": [str(fit)], "tests": [str(test)], "effects": str(file)}

    async def begin() -> None:
        await session.begin()
        session.cancel()
        await asyncio.sleep(0.5)  # the process is reaped while the loop still runs

    asyncio.run(begin())
    assert session.trouble == ""
    rows = {row["effect"]: row for row in session.views["which"]["rows"]}
    assert rows["mine_of_the_test"]["title"] == "Mine"
    assert rows["wheel_coulomb_friction"]["equation"].startswith("<div><math")


def test_a_call_that_is_cancelled_ends_at_once(tmp_path):
    async def stop() -> None:
        worker = Worker(tmp_path)
        settings = {"logs": ["youbot_fit"], "tests": [], "model": "nominal"}
        call = worker.call("start", {"settings": settings}, lambda w: worker.end(), lambda v: None)
        with pytest.raises(WorkerEnded):
            await asyncio.wait_for(call, 20)
        assert not worker.running

    asyncio.run(stop())


def test_findings_that_stop_a_log_are_told_with_their_remedy(tmp_path):
    bad = tmp_path / "bad.csv"
    bad.write_text("time,a,b\n0,1,x\n1,2,3\n")
    settings = {"logs": [str(bad)], "tests": [], "model": "nominal", "accept": []}
    check = SessionViews(tmp_path, lambda w: None, lambda v: None).check(settings)["check"]
    assert not check["usable"]
    errors = [f for f in check["logs"][0]["findings"] if f["severity"] == "error"]
    assert "no velocities" in errors[0]["what"]
    assert "wheel_velocity_fl" in errors[0]["remedy"]
    json.dumps(check)
