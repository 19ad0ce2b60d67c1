"""Starting the page: addresses, the token that other machines need, and the end."""

from __future__ import annotations

import secrets
import socket
from http.cookies import SimpleCookie
from pathlib import Path
from typing import Any
from urllib.parse import parse_qs

from nicegui import app, ui
from starlette.responses import PlainTextResponse, RedirectResponse

from youbot_workbench.page import Page, background
from youbot_workbench.session import Sessions

LOOPBACK = ("127.0.0.1", "::1", "localhost")
COOKIE = "youbot_workbench"
FIRST_PORT, PORTS = 8040, 20


class Guard:
    """Lets in whoever knows the token, and on loopback only who asks for this machine by name.

    The second keeps pages of the web from reaching a local server by a name of their own.

    Args:
        inner: the application.
        token: that requests must bring; empty on loopback.
        names: host names that requests may use; empty where any will do.
    """

    def __init__(self, inner, token: str, names: tuple[str, ...]):
        self.inner, self.token, self.names = inner, token, names

    async def __call__(self, scope, receive, send) -> None:
        """Pass a request on, or refuse it."""
        if scope["type"] not in ("http", "websocket"):
            await self.inner(scope, receive, send)
            return
        headers = {k.decode("latin1"): v.decode("latin1") for k, v in scope["headers"]}
        asked = parse_qs(scope.get("query_string", b"").decode("latin1")).get("token", [""])[0]
        cookies = SimpleCookie(headers.get("cookie", ""))
        known = cookies[COOKIE].value if COOKIE in cookies else ""
        host = headers.get("host", "").rsplit(":", 1)[0].strip("[]")
        if self.names and host not in self.names:
            await self._refuse(scope, receive, send, "open the address that the terminal shows")
        elif self.token and secrets.compare_digest(asked.encode(), self.token.encode()):
            response = RedirectResponse(scope["path"])
            response.set_cookie(COOKIE, self.token, httponly=True, samesite="strict")
            await (response if scope["type"] == "http" else self.inner)(scope, receive, send)
        elif self.token and not secrets.compare_digest(known.encode(), self.token.encode()):
            await self._refuse(scope, receive, send, "a token is needed: open the whole address "
                               "that the terminal shows")  # fmt: skip
        else:
            await self.inner(scope, receive, send)

    @staticmethod
    async def _refuse(scope, receive, send, words: str) -> None:
        if scope["type"] == "websocket":
            await send({"type": "websocket.close", "code": 1008})
            return
        await PlainTextResponse(words, status_code=403)(scope, receive, send)


def serve(
    settings: dict[str, Any] | None,
    host: str = "127.0.0.1",
    port: int | None = None,
    token: str | None = None,
    show: bool = True,
    folder: str | None = None,
    say=print,
) -> None:
    """Serve the page until it is stopped.

    Args:
        settings: with which sessions begin; None shows the ways to open a log.
        host: address to listen on; one that is not loopback needs a token.
        port: the first free one from ``FIRST_PORT`` on if left.
        token: made up where one is needed and none is given.
        show: open a browser.
        folder: of a saved session to open.
        say: told the address.

    Raises:
        ValueError: the port is taken, or the folder holds no session.
    """
    local = host in LOOPBACK
    token = "" if local else token or secrets.token_urlsafe(16)
    port = free_port(host) if port is None else port
    if taken(host, port):
        raise ValueError(f"--port {port} is taken; choose another one, or leave it out")
    sessions = Sessions()
    try:
        opened = None if folder is None else sessions.open(Path(folder))
    except ValueError:
        sessions.close()
        raise
    # The first session begins to read and fit while the browser starts.
    first = [opened or sessions.new(settings)]

    @ui.page("/")
    def home():
        session, first[0] = first[0], None
        if session is None:
            session = sessions.new(settings)
            background(session.begin())
        return RedirectResponse(f"/s/{session.name}")

    @ui.page("/new")
    def new():
        return RedirectResponse(f"/s/{sessions.new().name}")

    @ui.page("/s/{name}")
    def one(name: str):
        session = sessions.get(name)
        if session is None:
            return RedirectResponse("/")
        Page(session, sessions, local)
        return None

    app.add_middleware(Guard, token=token, names=LOOPBACK if local else ())
    app.on_startup(lambda: background(first[0].begin()))
    app.on_shutdown(sessions.close)
    app.timer(60.0, sessions.rest)
    query = f"?token={token}" if token else ""
    reached = socket.gethostname() if host in ("0.0.0.0", "::") else host
    shown = f"[{reached}]" if ":" in reached else reached
    address = f"http://{shown}:{port}/{query}"
    app.on_startup(lambda: say(address))
    ui.run(
        host=host, port=port, title="youBot workbench", reload=False, show=show and f"/{query}",
        show_welcome_message=False, favicon="🛞", uvicorn_logging_level="error",
    )  # fmt: skip


def taken(host: str, port: int) -> bool:
    """Whether something listens on a port already."""
    kind = socket.AF_INET6 if ":" in host else socket.AF_INET
    with socket.socket(kind, socket.SOCK_STREAM) as probe:
        probe.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        try:
            probe.bind((host, port))
        except OSError:
            return True
    return False


def free_port(host: str) -> int:
    """The first free port.

    Raises:
        ValueError: none of those tried is free, or the address is not of this machine.
    """
    for port in range(FIRST_PORT, FIRST_PORT + PORTS):
        if not taken(host, port):
            return port
    raise ValueError(
        f"--host {host}: no port of {FIRST_PORT} to {FIRST_PORT + PORTS - 1} can be used there; "
        "give an address of this machine, or another --port"
    )
