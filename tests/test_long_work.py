"""Long work: processes that are killed, runs that are stopped and go on, damaged pieces."""

import json
import os
import re
import signal
import subprocess
import sys
import time
from dataclasses import replace
from pathlib import Path

import pytest

from controllers.evaluation.subjects import draw_subjects
from ident.workers import TRIES, spread
from youbot_env.model_file import load_model

ROOT = Path(__file__).resolve().parent.parent


def square(number):
    return number * number


def die_at_first(number, mark):
    """Kill the own process, as a system short of memory does, unless it happened before."""
    if number == 2 and not mark.exists():
        mark.touch()
        os.kill(os.getpid(), signal.SIGKILL)
    return number * number


def die(number):
    if number == 1:
        os.kill(os.getpid(), signal.SIGKILL)
    return number


def fail(number):
    raise ValueError(f"no answer to {number}")


def names(count):
    return [f"piece {k}" for k in range(count)]


def test_the_work_of_a_killed_process_is_done_again(tmp_path):
    mark = tmp_path / "killed"
    found = dict(spread([(die_at_first, (k, mark)) for k in range(6)], names(6), 2))
    assert mark.exists()
    assert found == {k: k * k for k in range(6)}


def test_a_piece_that_kills_its_process_every_time_is_named():
    found = {}
    with pytest.raises(ChildProcessError, match=rf"^piece 1: .* killed {TRIES} times") as told:
        found.update(spread([(die, (k,)) for k in range(3)], names(3), 2))
    assert "run the same command again" in str(told.value)


def test_an_error_in_a_piece_is_not_taken_for_a_killed_process():
    for workers in (1, 2):
        with pytest.raises(ValueError, match="no answer to"):
            list(spread([(fail, (k,)) for k in range(2)], names(2), workers))


@pytest.fixture
def parallel(tmp_path):
    from youbot_cli import parallel
    from youbot_cli.pieces import Pieces

    def make(workers=1, **settings):
        return parallel.Parallel(workers, Pieces(tmp_path / "pieces", settings))

    return make


def work(call, count=4, *more):
    from youbot_cli.parallel import Piece

    return [Piece(f"number {k}", call, (k, *more)) for k in range(count)]


def test_finished_pieces_are_not_done_again_unless_something_differs(parallel, tmp_path):
    calls = []

    def counted(number):
        calls.append(number)
        if number == 2 and len(calls) == 3:
            raise KeyboardInterrupt
        return {"value": 0.1 + number}

    from youbot_cli import console

    with pytest.raises(console.Stopped, match="the same command goes on"), parallel(seed=1).pieces:
        parallel(seed=1).run("counting", work(counted))
    assert calls == [0, 1, 2]
    with parallel(seed=1).pieces:
        found = parallel(seed=1).run("counting", work(counted))
        assert found == [{"value": 0.1 + k} for k in range(4)]
        assert calls == [0, 1, 2, 2, 3]
        # A damaged file is as good as none.
        for path in (tmp_path / "pieces").iterdir():
            path.write_text(path.read_text()[:-3])
        calls.clear()
        parallel(seed=1).run("counting", work(counted, 2))
        assert calls == [0, 1]
        assert parallel(seed=2).run("counting", work(square)) == [0, 1, 4, 9]
    assert not (tmp_path / "pieces").exists()


def test_pieces_that_do_not_count_are_told(parallel, tmp_path, capsys):
    parallel(seed=1).run("squares", work(square, 3))
    path = next((tmp_path / "pieces").iterdir())
    path.write_text(re.sub(r'"value": ', r"\g<0>1", path.read_text()))  # another value, good JSON
    capsys.readouterr()
    with pytest.raises(ValueError, match="stop"), parallel(seed=1).pieces:
        raise ValueError("stop")
    told = capsys.readouterr().err
    assert "going on from 2 finished pieces in " in told
    assert "1 finished piece in " in told
    assert parallel(seed=1).run("squares", work(square, 3)) == [0, 1, 4]
    capsys.readouterr()
    with parallel(seed=2).pieces:
        told = capsys.readouterr().err
        assert "going on" not in told
        assert "3 finished pieces in " in told
        assert "of other inputs, options or code: made anew" in told


def test_results_are_the_same_kept_or_fresh(parallel):
    def pair(number):
        return (number, float("inf"))

    fresh = parallel().run("pairs", work(pair, 2))
    kept = parallel().run("pairs", work(pair, 2))
    assert fresh == kept == [[0, float("inf")], [1, float("inf")]]


def test_other_inputs_are_other_pieces(tmp_path):
    from youbot_cli.pieces import digest

    (tmp_path / "a.py").write_text("x = 1")
    (tmp_path / "b.py").write_text("x = 2")
    assert digest([None]) == []
    assert digest([tmp_path / "a.py"]) != digest([tmp_path / "b.py"])


SLOW = """
import os, signal, sys, time
from pathlib import Path

def slow(number, mark):
    if number == 1 and not Path(mark).exists():
        Path(mark).touch()
        os.kill(os.getpid(), signal.SIGKILL)
    time.sleep(0.2)
    return number / 3

def command():
    from youbot_cli.parallel import Parallel, Piece
    from youbot_cli.pieces import Pieces
    with Pieces(Path("out.pieces"), {"seed": 0}) as pieces:
        work = [Piece(f"number {k}", slow, (k, "killed")) for k in range(8)]
        print(Parallel(2, pieces).run("waiting", work))

if __name__ == "__main__":
    from youbot_cli import console
    console.run(command, "")
"""


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
def test_a_run_with_a_killed_process_and_ctrl_c_goes_on_and_ends_the_same(tmp_path):
    (tmp_path / "slow.py").write_text(SLOW)
    paths = [str(ROOT), os.environ.get("PYTHONPATH", "")]

    def start():
        return subprocess.Popen(
            [sys.executable, "slow.py"], cwd=tmp_path, text=True, stdout=subprocess.PIPE,
            stderr=subprocess.PIPE, env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)},
        )  # fmt: skip

    run, pieces = start(), tmp_path / "out.pieces"
    end = time.monotonic() + 60
    while not ((tmp_path / "killed").exists() and len(list(pieces.glob("*.json"))) >= 2):
        assert run.poll() is None
        assert time.monotonic() < end
        time.sleep(0.02)
    run.send_signal(signal.SIGINT)
    said, told = run.communicate(timeout=60)
    assert (run.returncode, said) == (130, "")
    assert "stopped; what is finished is kept in out.pieces: the same command" in told
    assert "Traceback" not in told
    assert 2 <= len(list(pieces.glob("*.json"))) < 8
    again = start()
    said, told = again.communicate(timeout=60)
    assert again.returncode == 0
    assert re.fullmatch(r"going on from \d finished pieces in out.pieces\nwaiting ...\n", told)
    assert said.strip() == str([k / 3 for k in range(8)])
    assert not pieces.exists()


def known(subject, seconds, nominal=None):
    """A subject as its owner would know it from a perfect log, in no time."""
    beliefs = dict.fromkeys(("identified", "identified + effects"), subject.truth)
    return replace(
        subject, beliefs={"nominal": load_model("nominal")} | beliefs, half_widths={"m0": 0.3}
    )


def test_models_of_a_robot_are_kept_to_the_last_bit():
    from youbot_cli.evaluate_robots import pack, unpack

    effects = {"wheel_coulomb_friction": 0.2, "actuator_delay": 0.0151, "actuator_lag": 0.0203}
    (robot,) = draw_subjects("analytic", 1, load_model("paper"), effects, 0)
    before = known(robot, 0.0)
    after = unpack(robot, json.loads(json.dumps(pack(before))))
    assert after.half_widths == before.half_widths
    for name, model in before.beliefs.items():
        assert after.beliefs[name].names() == model.names()
        assert after.beliefs[name].values() == model.values()


def test_a_comparison_that_was_stopped_goes_on_and_ends_the_same(tmp_path, monkeypatch, capsys):
    from controllers.evaluation import claims, run, solver_check
    from youbot_cli import console, evaluate, evaluate_robots

    options = [
        "--controller", "kinematic", "ppo", "--plant", "analytic", "--reference", "eight",
        "--frequency", "3", "--robots", "1", "--steps", "20", "--jobs", "1", "--no-wrong",
    ]  # fmt: skip
    monkeypatch.setattr(evaluate_robots, "calibrated", known)
    monkeypatch.setattr(solver_check, "EXACT_MOTIONS", ())
    monkeypatch.setattr(claims, "solver_claims", lambda *runs: [])
    true_runs, calls = run.run_all, []

    def call(name, stop):
        monkeypatch.setattr(sys, "argv", ["evaluate.py", *options, "--json", name])

        def runs(*given):
            calls.append(given[1:3])
            if len(calls) == stop:
                raise KeyboardInterrupt
            return true_runs(*given)

        monkeypatch.setattr(run, "run_all", runs)
        with pytest.raises(SystemExit) as end:
            console.run(evaluate.evaluate, "", ("--controller",))
        return end.value.code

    monkeypatch.chdir(tmp_path)
    assert call("a.json", 2) == 130
    assert "a.pieces: the same command goes on" in capsys.readouterr().err
    assert not Path("a.json").exists()
    assert call("a.json", 0) == 0
    assert len(calls) == 2 + 1  # one of two was finished
    assert call("b.json", 0) == 0
    assert len(calls) == 3 + 2
    went_on, straight = (json.loads(Path(name).read_text()) for name in ("a.json", "b.json"))
    assert went_on["setup"] == straight["setup"]
    # Times of computation differ from run to run.
    plain = [[{k: v for k, v in row.items() if "solve" not in k} for row in one["errors"]]
             for one in (went_on, straight)]  # fmt: skip
    assert plain[0] == plain[1]
    assert not list(Path().glob("*.pieces"))
