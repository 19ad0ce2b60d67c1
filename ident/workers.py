"""Calls spread over processes, of which some may be killed: the work of those is done again."""

from __future__ import annotations

import signal
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, wait
from concurrent.futures.process import BrokenProcessPool
from typing import Any

from joblib.externals.loky import ProcessPoolExecutor

# Times that a call is tried while its process is killed; a system short of memory may have room
# again once the call runs alone.
TRIES = 3
# One thread a process: the calls are the parallelism.
SINGLE = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "POLARS_MAX_THREADS")


def spread(
    calls: Sequence[tuple[Callable, tuple]],
    names: Sequence[str],
    workers: int,
    prepare: tuple[Callable, tuple] | None = None,
) -> Iterator[tuple[int, Any]]:
    """Yield (number of the call, its result) in the order in which they are ready.

    When a process is killed, the calls that ran then are tried again, each alone, and the others
    go on after them.  When the caller stops early, by Ctrl-C or an exception, the processes are
    stopped at once.

    Args:
        calls: functions with their arguments; with several workers they must be importable.
        names: of the calls, for messages.
        workers: processes at most; 1 makes the calls in this process.
        prepare: a call that each process makes first.

    Raises:
        ChildProcessError: the process of one call was killed ``TRIES`` times; names it.
    """
    if workers == 1:
        yield from ((number, call(*given)) for number, (call, given) in enumerate(calls))
        return
    left, suspects, killed = deque(range(len(calls))), deque(), Counter()
    while left or suspects:
        queue = deque([suspects.popleft()]) if suspects else left
        running = yield from _run(calls, queue, min(workers, len(queue)), prepare)
        for number in running:
            killed[number] += 1
            if killed[number] >= TRIES:
                raise ChildProcessError(
                    f"{names[number]}: its process was killed {TRIES} times, the last times while "
                    "it ran alone, perhaps for want of memory; what is finished is kept: leave it "
                    "out, or make memory free and run the same command again"
                )
            suspects.append(number)


def _run(calls, queue: deque, workers: int, prepare) -> Iterator[tuple[int, Any]]:
    """Empty the queue with one pool; returns the numbers that ran when a process was killed."""
    pool = ProcessPoolExecutor(
        workers, initializer=_begin, initargs=(prepare,), env=dict.fromkeys(SINGLE, "1")
    )
    running: dict = {}
    try:
        while queue or running:
            # No more than can run: those that are under way are those that a kill may have hit.
            while queue and len(running) < workers:
                number = queue.popleft()
                running[number] = None
                call, given = calls[number]
                running[number] = pool.submit(call, *given)
            done, _ = wait(running.values(), return_when=FIRST_COMPLETED)
            ready = [number for number, future in running.items() if future in done]
            for number in ready:
                if not isinstance(running[number].exception(), BrokenProcessPool):
                    yield number, running.pop(number).result()
            if any(number in running for number in ready):
                return list(running)
    except BrokenProcessPool:  # found out while submitting
        return list(running)
    finally:
        pool.shutdown(wait=True, kill_workers=True)
    return []


def _begin(prepare: tuple[Callable, tuple] | None) -> None:
    """Ctrl-C is for the process that hands out the work; it stops the others."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if prepare is not None:
        call, given = prepare
        call(*given)
