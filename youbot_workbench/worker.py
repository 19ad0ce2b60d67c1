"""The process behind a session: calls of ``Views`` as lines of JSON, one at a time.

``python -m youbot_workbench.worker FOLDER`` serves them; ``Worker`` is the other end.  Lines are
text, so nothing that a session's folder holds can run code.
"""

from __future__ import annotations

import asyncio
import json
import os
import sys
import traceback
from collections.abc import Callable
from pathlib import Path
from typing import Any

# Longest line, bytes: figures of long logs.
LINE = 256 * 2**20
SINGLE = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS")


class WorkerError(Exception):
    """What a call was refused for, in words for people."""


class WorkerEnded(Exception):
    """The process has ended before it answered."""


class Worker:
    """One process; calls are awaited one after the other.

    Args:
        folder: of the session.
    """

    def __init__(self, folder: Path):
        self.folder = folder
        self._process: asyncio.subprocess.Process | None = None

    @property
    def running(self) -> bool:
        """Whether there is a process that knows what was done before."""
        return self._process is not None and self._process.returncode is None

    async def begin(self) -> None:
        """Start the process, which takes seconds to import what it needs."""
        self._process = await asyncio.create_subprocess_exec(
            sys.executable, "-m", "youbot_workbench.worker", str(self.folder),
            stdin=asyncio.subprocess.PIPE, stdout=asyncio.subprocess.PIPE, limit=LINE,
            env=os.environ | dict.fromkeys(SINGLE, "1"),
        )  # fmt: skip

    async def call(
        self,
        name: str,
        arguments: dict[str, Any],
        tell: Callable[[str], None],
        push: Callable[[dict], None],
    ) -> dict[str, Any]:
        """Call a method of ``Views``.

        Args:
            name: of the method.
            arguments: by name.
            tell: called with what is being done.
            push: called with views that are there before the end.

        Raises:
            WorkerError: the call was refused; says why.
            WorkerEnded: the process ended, by ``end`` or for want of memory.
        """
        if not self.running:
            await self.begin()
        process = self._process
        assert process is not None
        assert process.stdin is not None
        assert process.stdout is not None
        line = json.dumps({"call": name, "arguments": arguments}) + "\n"
        try:
            process.stdin.write(line.encode())
            await process.stdin.drain()
        except (BrokenPipeError, ConnectionResetError):
            raise WorkerEnded from None
        while True:
            answer = await process.stdout.readline()
            if not answer:
                await process.wait()
                raise WorkerEnded
            said = json.loads(answer)
            if "tell" in said:
                tell(said["tell"])
            elif "push" in said:
                push(said["push"])
            elif "error" in said:
                raise WorkerError(said["error"])
            else:
                return said["done"]

    def end(self) -> None:
        """End the process at once; the next call starts another one."""
        if self.running:
            self._process.kill()
        self._process = None


def serve(folder: Path) -> None:
    """Answer calls from standard input until it ends."""
    out = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # what a library prints is no answer

    def say(**what: Any) -> None:
        out.write(json.dumps(what) + "\n")
        out.flush()

    from youbot_workbench.views import SessionViews

    views = SessionViews(folder, lambda what: say(tell=what), lambda changed: say(push=changed))
    for line in sys.stdin:
        asked = json.loads(line)
        try:
            if asked["call"].startswith("_"):
                raise ValueError(f"no call {asked['call']!r}")
            say(done=getattr(views, asked["call"])(**asked["arguments"]))
        except (ValueError, OSError, ImportError, FloatingPointError) as error:
            if os.environ.get("YOUBOT_DEBUG"):
                traceback.print_exc()
            say(error=str(error))
        except Exception as error:
            traceback.print_exc()
            say(error=f"a fault of ours, not of your files ({type(error).__name__}: {error}); "
                "the terminal shows where")  # fmt: skip


if __name__ == "__main__":
    serve(Path(sys.argv[1]))
