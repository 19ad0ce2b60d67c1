"""What a session remembers: its logs, its choices and what is drawn of them, in one folder."""

from __future__ import annotations

import asyncio
import json
import os
import secrets
import shutil
import tempfile
import time
from collections import Counter
from pathlib import Path
from typing import Any

from youbot_workbench.worker import Worker, WorkerEnded, WorkerError

STATE = "session.json"
# Calls that only read or record; a fresh process need not know the chain for them.
ALONE = ("check", "start", "hidden")
# Jobs shorter than this, s, show no progress.
QUICK = 0.4
# A process whose page is closed ends after this time, s; what it knew is kept in the folder.
IDLE = 900.0
LARGEST = 200 * 2**20  # bytes of an upload
ENDINGS = (".csv", ".tsv", ".txt", ".parquet", ".bag", ".mcap", ".db3")


class Session:
    """One user at one set of logs.

    Attributes:
        name: in the address of the page.
        folder: everything lies there.
        settings: logs, tests, model, mapping, platform, accepted findings, seed.
        views: what is drawn, by panel.
        version: how often each view has changed; pages redraw what has.
        doing: what is being done, or empty; ``since`` when it began, ``job`` its name.
        trouble: what went wrong last, or empty.
    """

    def __init__(self, folder: Path, name: str | None = None):
        self.name = name or secrets.token_urlsafe(9)
        self.folder = folder
        (folder / "logs").mkdir(parents=True, exist_ok=True)
        self.settings: dict[str, Any] = {
            "logs": [], "tests": [], "model": "nominal", "mapping": [], "platform": None,
            "accept": [], "seed": 0, "effects": None, "hidden": None,
        }  # fmt: skip
        self.views: dict[str, Any] = {}
        self.version: Counter[str] = Counter()
        self.doing, self.job, self.since, self.trouble = "", "", 0.0, ""
        self.worker, self.seen = Worker(folder), time.monotonic()
        self._turn = asyncio.Lock()
        self._attempt: dict[str, Any] | None = None
        self._answering = self._stopped = False

    @property
    def busy(self) -> bool:
        """Whether work is under way that takes more than a moment."""
        return bool(self.job) and time.monotonic() - self.since > QUICK

    async def do(self, name: str, **arguments: Any) -> bool:
        """Call the views and take in the views it answers with; tells whether that succeeded."""
        async with self._turn:
            self.job, self.since, self.doing = name, time.monotonic(), "starting"
            self.trouble, self._stopped = "", False
            self.version["job"] += 1
            try:
                fresh = not self.worker.running
                if fresh and name not in ALONE and self.settings["logs"]:
                    # A new process has to be told what the one before it knew; nothing changes.
                    told = {"settings": self.settings, "added": self.added}
                    await self.worker.call("start", told, self._tell, lambda views: None)
                self.take(await self._call(name, **arguments))
                return True
            except WorkerError as error:
                self.trouble = str(error)
            except WorkerEnded:
                self.trouble = "" if self._stopped else (
                    "the process that computes has ended, perhaps for want of memory; what was "
                    "done before is kept: try again, or open shorter logs"
                )  # fmt: skip
            finally:
                self.job, self.doing = "", ""
                self.version["job"] += 1
                self.keep()
            return False

    async def begin(self) -> None:
        """Fit the base model to the logs, if there are any, and try every effect."""
        if not self.settings["logs"] or self.views.get("bar"):
            return
        if await self.do("start", settings=self.settings) and self.views.get("bar"):
            await self.do("which")

    async def _call(self, name: str, **arguments: Any) -> dict[str, Any]:
        return await self.worker.call(name, arguments, self._tell, self.take)

    def _tell(self, what: str) -> None:
        self.doing = what.replace("_", " ")
        self.version["job"] += 1

    def take(self, views: dict[str, Any]) -> None:
        """Take in views; pages redraw them."""
        self.views |= views
        self.version.update(views.keys())

    @property
    def added(self) -> list[str]:
        """Effects in the model, in the order in which they were added."""
        return self.views.get("added") or []

    def cancel(self) -> None:
        """Stop what is being done; everything that was finished stays."""
        self._stopped = True
        self.worker.end()

    async def attempt(self, values: dict[str, float], log: int | None) -> None:
        """Simulate values tried by hand; of a burst of moves only the last is answered."""
        self._attempt = {"values": values, "log": log}
        if self._answering:
            return
        self._answering = True
        try:
            while self._attempt is not None:
                asked, self._attempt = self._attempt, None
                await self.do("attempt", **asked)
        finally:
            self._answering = False

    def room_for(self, name: str) -> Path:
        """A new place in the folder for a file that is uploaded; none is replaced."""
        place, number = self.folder / "logs" / name, 1
        while place.exists():
            number += 1
            place = place.with_name(f"{Path(name).stem} ({number}){Path(name).suffix}")
        return place

    # The folder

    def keep(self) -> None:
        """Write the state into the folder, whole or not at all."""
        state = {"settings": self._relative(), "views": self.views}
        draft = self.folder / f"{STATE}.part"
        draft.write_text(json.dumps(state), encoding="utf-8")
        os.replace(draft, self.folder / STATE)

    def _relative(self) -> dict[str, Any]:
        """Settings in which files of the folder are named from there, so that it can be moved."""

        def short(path: str) -> str:
            inside = Path(path).is_relative_to(self.folder)
            return str(Path(path).relative_to(self.folder)) if inside else path

        roles = {role: [short(p) for p in self.settings[role]] for role in ("logs", "tests")}
        return self.settings | roles

    def save(self, folder: Path) -> None:
        """Copy the session into a new or empty folder, with the logs that lie elsewhere.

        Raises:
            ValueError: the folder holds something.
        """
        if folder.exists() and (not folder.is_dir() or any(folder.iterdir())):
            raise ValueError(f"{folder} is not empty; a session never replaces what is there")
        self.keep()
        shutil.copytree(self.folder, folder, dirs_exist_ok=True)
        state = json.loads((folder / STATE).read_text(encoding="utf-8"))
        for role in ("logs", "tests"):
            files = []
            for source in state["settings"][role]:
                path = Path(source)
                if path.is_absolute() and path.is_file():
                    shutil.copy2(path, folder / "logs" / path.name)
                    source = f"logs/{path.name}"
                files.append(source)
            state["settings"][role] = files
        (folder / STATE).write_text(json.dumps(state), encoding="utf-8")

    @classmethod
    def open(cls, folder: Path, into: Path) -> Session:
        """A session that was saved; the saved folder itself stays as it is.

        Raises:
            ValueError: the folder holds no session.
        """
        try:
            state = json.loads((folder / STATE).read_text(encoding="utf-8"))
            settings, views = dict(state["settings"]), dict(state["views"])
        except (OSError, ValueError, KeyError, TypeError) as error:
            raise ValueError(f"{folder} holds no session of the workbench ({error})") from None
        shutil.copytree(folder, into, dirs_exist_ok=True)
        session = cls(into)
        for role in ("logs", "tests"):
            settings[role] = [
                str(into / p) if (into / p).is_file() else p for p in settings.get(role, [])
            ]
        session.settings |= settings
        session.take(views)
        return session


class Sessions:
    """All sessions of a server; each has a folder of its own."""

    def __init__(self):
        self.folder = Path(tempfile.mkdtemp(prefix="youbot-workbench-"))
        self._known: dict[str, Session] = {}

    def new(self, settings: dict[str, Any] | None = None) -> Session:
        """A session that begins with some settings."""
        name = secrets.token_urlsafe(9)
        session = self._known[name] = Session(self.folder / name, name)
        session.settings |= settings or {}
        return session

    def get(self, name: str) -> Session | None:
        """The session of a name."""
        return self._known.get(name)

    def open(self, folder: Path) -> Session:
        """A session that was saved to a folder."""
        name = secrets.token_urlsafe(9)
        session = Session.open(folder, self.folder / name)
        session.name = name
        self._known[name] = session
        return session

    def rest(self) -> None:
        """End processes of sessions that nobody has looked at for a while."""
        for session in self._known.values():
            if not session.job and time.monotonic() - session.seen > IDLE:
                session.worker.end()

    def close(self) -> None:
        """End all processes and remove the folders."""
        for session in self._known.values():
            session.cancel()
        shutil.rmtree(self.folder, ignore_errors=True)
