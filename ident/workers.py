"""Calls spread over processes, of which some may be killed: the work of those is done again.

The processes are those of this machine, or the workers of a Dask cluster.
"""

from __future__ import annotations

import signal
import threading
from collections import Counter, deque
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import FIRST_COMPLETED, wait
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager
from typing import Any

from joblib.externals.loky import ProcessPoolExecutor

# Times that a call is tried while its process is killed; a system short of memory may have room
# again once the call runs alone.
TRIES = 3
# Time to wait for an answer of a cluster, s.
PATIENCE = 10
# One thread a process: the calls are the parallelism.
SINGLE = ("OMP_NUM_THREADS", "OPENBLAS_NUM_THREADS", "MKL_NUM_THREADS", "POLARS_MAX_THREADS")


def spread(
    calls: Sequence[tuple[Callable, tuple]],
    names: Sequence[str],
    workers: int,
    prepare: tuple[Callable, tuple] | None = None,
    cluster: str | None = None,
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
        cluster: address of a Dask scheduler, ``tcp://HOST:8786``, whose workers make the calls in
            place of processes of this machine.

    Raises:
        ChildProcessError: the process of one call was killed ``TRIES`` times, or as often as the
            cluster allows; names it.
        ImportError, ValueError: no Dask, no cluster there, or one with other code.
    """
    if cluster is not None and calls:
        yield from _on_cluster(calls, names, prepare, cluster)
        return
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
                raise _killed(names[number], TRIES, ", the last times while it ran alone")
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
                with _interrupts_wait():
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


@contextmanager
def _interrupts_wait() -> Iterator[None]:
    """Ctrl-C waits for the end: a process that is just being started would not be stopped."""
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    seen: list = []
    before = signal.signal(signal.SIGINT, lambda *given: seen.append(given))
    try:
        yield
    finally:
        signal.signal(signal.SIGINT, before)
    if seen and callable(before):
        before(*seen[0])


def _begin(prepare: tuple[Callable, tuple] | None) -> None:
    """Ctrl-C is for the process that hands out the work; it stops the others."""
    signal.signal(signal.SIGINT, signal.SIG_IGN)
    if prepare is not None:
        call, given = prepare
        call(*given)


def _killed(name: str, tries: int, how: str = "") -> ChildProcessError:
    return ChildProcessError(
        f"{name}: its process was killed {tries} times{how}, perhaps for want of memory; what is "
        "finished is kept: leave it out, or make memory free and run the same command again"
    )


def _on_cluster(calls, names, prepare, address: str) -> Iterator[tuple[int, Any]]:
    """Make the calls on the workers of a Dask cluster; it gives those of a lost one to another."""
    try:
        from distributed import Client, KilledWorker, as_completed
    except ImportError as error:
        remedy = "this needs Dask: python -m pip install 'youbot-workbench[cluster]'"
        raise ImportError(remedy) from error
    try:
        client = Client(address, timeout=PATIENCE, set_as_default=False)
    except (OSError, TimeoutError, ValueError) as error:
        raise ValueError(
            f"no cluster at {address!r}; start one: dask scheduler, and dask worker {address} on "
            "each machine"
        ) from error
    futures: dict = {}
    try:
        _check_code(client, address)
        # Each by its number: equal calls are made as often as they are asked for.
        for number, (call, given) in enumerate(calls):
            future = client.submit(_make, prepare, call, given, pure=False)
            futures[future] = number
        ready = as_completed(list(futures), loop=client.loop, raise_errors=False)
        for future in ready:
            number = futures[future]
            try:
                result = future.result()
            except KilledWorker as error:
                raise _killed(names[number], error.allowed_failures + 1) from error
            yield number, result
            del futures[future]  # the cluster may forget it
            future.release()
    finally:
        client.cancel(list(futures), force=True)
        client.close()


def _check_code(client, address: str) -> None:
    """Refuse workers of which none is there, or whose code is not that of this machine."""
    from ident.benchmark.store import code_version

    try:
        client.wait_for_workers(1, timeout=PATIENCE)
        found = client.run(code_version)
    except TimeoutError as error:
        raise ValueError(
            f"cluster {address!r} has no workers; start some: dask worker {address}"
        ) from error
    except ImportError as error:
        raise ValueError(
            f"workers of {address!r} do not have this workbench ({error}); install it there"
        ) from error
    other = [worker for worker, version in found.items() if version != code_version()]
    if other:
        raise ValueError(
            f"{len(other)} of {len(found)} workers of {address!r} have another code than this "
            f"machine ({', '.join(sorted(other)[:3])}); install the same version there"
        )


# A worker with several threads makes one call at a time: some change what all threads see.
_ALONE = threading.Lock()
_PREPARED: set[str] = set()


def _make(prepare: tuple[Callable, tuple] | None, call: Callable, given: tuple) -> Any:
    """Make a call in a worker, which is prepared before its first one."""
    from threadpoolctl import threadpool_limits

    with _ALONE, threadpool_limits(1):
        if prepare is not None and repr(prepare[1]) not in _PREPARED:
            prepare[0](*prepare[1])
            _PREPARED.add(repr(prepare[1]))
        return call(*given)
