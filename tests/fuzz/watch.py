"""Runs cases in a process of its own, so that one that hangs or dies is a result, not the end."""

from __future__ import annotations

import multiprocessing
import resource
import tempfile
from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

from fuzz.cases import Case, draw, judge
from fuzz.originals import originals

HANG = 10.0  # s
MOST_MEMORY = 1 << 30  # bytes that one case may take
# Beyond what the process holds with all its libraries; a case ends there before the machine does.
ROOM = 6 << 30
START = 120.0  # s, for imports and good files


def run(
    seed: int, indices: Sequence[int], serve: Callable | None = None, hang: float = HANG
) -> Iterator[Case]:
    """Run cases, in order.

    Args:
        seed: of the cases.
        indices: their numbers.
        serve: what the process does, as ``_serve``.
        hang: time after which a case is ended, s.
    """
    context, left = multiprocessing.get_context("spawn"), list(indices)
    while left:
        ours, theirs = context.Pipe()
        worker = context.Process(target=serve or _serve, args=(theirs, seed, left), daemon=True)
        worker.start()
        theirs.close()
        try:
            if not ours.poll(START) or ours.recv() != "ready":
                raise RuntimeError("the good files could not be made")
            while left:
                kind, spoiled = ours.recv()  # fails where the fuzz itself does
                outcome = "hang"
                try:
                    case = ours.recv() if ours.poll(hang) else None
                except EOFError:
                    case, outcome = None, "died"
                yield case or Case(left[0], kind, spoiled, outcome)
                left.pop(0)
                if case is None:
                    break
        finally:
            worker.kill()
            worker.join()


def _serve(pipe, seed: int, indices: Sequence[int]) -> None:
    with tempfile.TemporaryDirectory() as folder:
        good = originals(Path(folder))
        held = _status("VmSize")
        if held:
            resource.setrlimit(resource.RLIMIT_AS, (held + ROOM, resource.RLIM_INFINITY))
        pipe.send("ready")
        for index in indices:
            spoiled = draw(good, seed, index)
            pipe.send((spoiled.original.kind, spoiled.steps))
            before = _forget_peak()
            case = judge(spoiled, index, Path(folder))
            taken = _status("VmHWM") - before
            if taken > MOST_MEMORY:
                case = Case(index, case.kind, case.spoiled, "memory", f"{taken} bytes")
            pipe.send(case)


def _forget_peak() -> int:
    """Let the peak of memory begin anew; returns what is held now, bytes; 0 where unknown."""
    try:
        Path("/proc/self/clear_refs").write_text("5")
    except OSError:
        return 0
    return _status("VmRSS")


def _status(name: str) -> int:
    """A figure of this process in bytes; 0 on systems that do not tell."""
    try:
        lines = Path("/proc/self/status").read_text().splitlines()
    except OSError:
        return 0
    return next((1024 * int(line.split()[1]) for line in lines if line.startswith(name)), 0)
