"""Work on a Dask cluster of two workers, of which one is killed: the same results."""

import os
import signal
import time

import pytest

from ident.workers import spread

distributed = pytest.importorskip("distributed")


def square(number):
    time.sleep(0.05)
    return number * number


def die_at_first(number, mark):
    """Kill the own worker while it holds results of others, unless it happened before."""
    if number == 7 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number * number


def die(number):
    if number == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def fail(number):
    raise ValueError(f"no answer to {number}")


def process(number):
    time.sleep(0.2)
    return os.getpid()


def once(mark):
    with mark.open("a") as stream:
        stream.write(f"{os.getpid()}\n")


def names(count):
    return [f"piece {k}" for k in range(count)]


@pytest.fixture(scope="module")
def machines():
    with distributed.LocalCluster(
        n_workers=2, threads_per_worker=2, processes=True, dashboard_address=None
    ) as there:
        yield there.scheduler_address


@pytest.fixture
def cluster(machines):
    with distributed.Client(machines, set_as_default=False) as client:
        client.wait_for_workers(2, timeout=60)  # one may have been killed before
    return machines


def test_workers_share_the_calls_and_are_prepared_once(cluster, tmp_path):
    mark = tmp_path / "prepared"
    calls = [(process, (k,)) for k in range(8)]
    found = dict(spread(calls, names(8), 1, (once, (mark,)), cluster))
    assert sorted(found) == list(range(8))
    assert len(set(found.values())) == 2
    assert os.getpid() not in found.values()
    assert sorted(mark.read_text().split()) == sorted(map(str, set(found.values())))


def test_the_work_of_a_killed_worker_is_done_again(cluster, tmp_path):
    mark = tmp_path / "killed"
    calls = [(die_at_first, (k, mark)) for k in range(12)]
    found = dict(spread(calls, names(12), 1, cluster=cluster))
    assert mark.exists()
    assert found == {k: k * k for k in range(12)}


def test_a_worker_killed_from_outside_loses_nothing(cluster):
    found, pids = {}, None
    with distributed.Client(cluster, set_as_default=False) as client:
        pids = list(client.run(os.getpid).values())
    for number, result in spread([(square, (k,)) for k in range(40)], names(40), 1,
                                 cluster=cluster):  # fmt: skip
        found[number] = result
        if len(found) == 5:
            os.kill(pids[0], signal.SIGKILL)
    assert found == {k: k * k for k in range(40)}


def test_a_piece_that_kills_every_worker_is_named(cluster):
    # A scheduler allows three failures unless it is told otherwise.
    with pytest.raises(ChildProcessError, match=r"^piece 1: its process was killed 4 times"):
        list(spread([(die, (k,)) for k in range(3)], names(3), 1, cluster=cluster))


def test_an_error_in_a_piece_is_raised(cluster):
    with pytest.raises(ValueError, match="no answer to"):
        list(spread([(fail, (k,)) for k in range(2)], names(2), 1, cluster=cluster))


def test_no_cluster_is_bad_input(monkeypatch):
    monkeypatch.setattr("ident.workers.PATIENCE", 1)
    with pytest.raises(ValueError, match=r"no cluster at 'tcp://127.0.0.1:9'; start one"):
        list(spread([(square, (1,))], names(1), 1, cluster="tcp://127.0.0.1:9"))


def test_workers_with_other_code_are_refused(cluster, monkeypatch):
    from ident.benchmark import store

    monkeypatch.setattr(store, "fingerprint", lambda files: "other")
    with pytest.raises(ValueError, match=r"2 of 2 workers .* have another code"):
        list(spread([(square, (1,))], names(1), 1, cluster=cluster))


def test_pieces_of_a_command_are_kept_as_they_are_finished(cluster, tmp_path):
    from youbot_cli.parallel import Parallel, Piece
    from youbot_cli.pieces import Pieces

    def run(address):
        parallel = Parallel(1, Pieces(tmp_path / "pieces", {}), None, address)
        return parallel.run("work", [Piece(f"piece {k}", square, (k,)) for k in range(6)])

    assert run(cluster) == [k * k for k in range(6)]
    assert run("tcp://nowhere:1") == [k * k for k in range(6)]  # nothing is left to do


def test_a_benchmark_on_a_cluster_is_that_of_one_process(cluster, tmp_path):
    from ident.benchmark.cases import QUICK_PLAN
    from ident.benchmark.runner import run
    from ident.benchmark.store import Store

    tasks = [("asked", case) for case in QUICK_PLAN.cases(0)[:2]]
    methods = {"asked": answered}
    records = [
        run(tasks, Store(tmp_path / f"{k}.jsonl", "test"), 1, None, True, methods, where)
        for k, where in enumerate((None, cluster))
    ]
    for one, other in zip(*(sorted(r, key=lambda r: r["case"]) for r in records), strict=True):
        assert {**one, "seconds": 0} == {**other, "seconds": 0}
    assert len(records[0]) == 2


def answered(fit, verify, seed):
    return {"verdict": "cannot_say", "seed": seed, "sum": float(fit.command.sum())}
