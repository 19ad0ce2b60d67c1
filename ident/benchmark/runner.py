"""Run cases, many at once, none twice; a case that fails is kept with its traceback."""

from __future__ import annotations

import time
import traceback
from collections.abc import Callable, Iterable
from typing import Any

import numpy as np

from ident.benchmark.cases import Case, Recorded, record_case, record_experiment
from ident.benchmark.hidden import kin
from ident.benchmark.methods import METHODS
from ident.benchmark.store import Store
from ident.diagnosis.splits import choosing_until
from ident.free_run import free_run
from ident.workers import spread
from youbot_env.effects import left_out

Task = tuple[str, Case]
Method = Callable[..., dict[str, Any]]


def run(
    tasks: Iterable[Task],
    store: Store,
    jobs: int = 1,
    progress: Callable[[int], None] | None = None,
    resume: bool = True,
    methods: dict[str, Method] = METHODS,
    cluster: str | None = None,
) -> list[dict[str, Any]]:
    """Answer every task and return the records, those finished before included.

    Args:
        tasks: (name of the method, case).
        store: where finished cases are kept.
        jobs: processes; 1 runs everything in this one.
        progress: called with the number of tasks done.
        resume: whether results of an earlier run of the same code count.
        methods: functions by name; with several jobs they must be importable.
        cluster: address of a Dask scheduler, see ``ident.workers.spread``.

    Raises:
        ChildProcessError: the process of one case was killed again and again; what is finished
            is kept.
    """
    tasks = list(tasks)
    known = store.finished() if resume else {}
    records = [known[m, c.id] for m, c in tasks if (m, c.id) in known]
    left = [(m, c) for m, c in tasks if (m, c.id) not in known]
    tell = progress or (lambda done: None)
    tell(len(records))
    for record in _answers(left, jobs, methods, cluster):
        records.append(store.add(record))
        tell(len(records))
    return records


def _answers(
    tasks: list[Task], jobs: int, methods: dict[str, Method], cluster: str | None
) -> Iterable[dict[str, Any]]:
    calls = [(examine, (*task, methods)) for task in tasks]
    names = [f"{case.id} ({method})" for method, case in tasks]
    return (record for _, record in spread(calls, names, jobs, None, cluster))


def examine(method: str, case: Case, methods: dict[str, Method] = METHODS) -> dict[str, Any]:
    """Record a case and ask a method about it.

    Returns:
        What ``Store`` keeps: ``method``, ``case``, ``part``, ``hidden``, ``size``, ``truth``
        (parameters of the hidden effects), ``share`` of the torque, ``conditions``, ``oracle``
        (free-run error of the true model on the verifying log, or None), ``answer``, ``seconds``
        of the answer alone, ``followed``, the answer with the experiment that an ambiguous one
        asked for (else None), and ``error``, the traceback where something failed.
    """
    kept: dict[str, Any] = {
        "method": method, "case": case.id, "part": case.part, "hidden": list(case.hidden),
        "size": case.size, "error": None, "answer": None, "followed": None,
    }  # fmt: skip
    try:
        recorded = record_case(case)
        kept |= _facts(recorded)
        seed = int(case.children(6)[5].generate_state(1)[0])
        start = time.perf_counter()
        verify = recorded.verify if recorded.conditions.second else None
        with left_out(*kin(case.hidden)):
            answer = methods[method](recorded.fit, verify, seed)
        kept |= {"seconds": time.perf_counter() - start, "answer": answer}
        experiment = answer.get("experiment")
        if answer["verdict"] == "ambiguous" and experiment and recorded.exact:
            more = record_experiment(case, recorded, experiment["motion"])
            with left_out(*kin(case.hidden)):
                kept["followed"] = methods[method]([recorded.fit, more], verify, seed)
    except Exception:  # whatever it is, it belongs to this case and not to the run
        kept["error"] = traceback.format_exc()
    return plain(kept)


def _facts(recorded: Recorded) -> dict[str, Any]:
    oracle = None
    if recorded.exact:
        # On the part of the record that the answer's errors are of.
        verify = recorded.verify
        kept = verify.part(choosing_until(verify), verify.time[-1])
        oracle = free_run(kept, recorded.measured).nrmse
    return {
        "truth": {active.identifier: active.values for active in recorded.truth.effects},
        "share": recorded.share,
        "conditions": recorded.conditions.as_dict(),
        "oracle": oracle,
    }


def plain(value: Any) -> Any:
    """The value in types that JSON has; numbers that are not finite become null."""
    if isinstance(value, dict):
        return {str(key): plain(item) for key, item in value.items()}
    if isinstance(value, list | tuple):
        return [plain(item) for item in value]
    if isinstance(value, np.ndarray | np.generic):
        return plain(value.tolist())
    return None if isinstance(value, float) and not np.isfinite(value) else value
