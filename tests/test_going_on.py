"""A run of improve that is killed goes on with what it had found, and ends the same to the bit."""

import json
import os
import re
import signal
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ident import drive_clock, output_error
from ident.kept import fingerprint, keeping
from ident.log import Log
from ident.output_error import refine
from youbot_env.model_file import load_model
from youbot_env.references import calibration_sequence
from youbot_env.simulation import Sensors, record_closed_loop

ROOT = Path(__file__).resolve().parent.parent
NOMINAL = load_model("nominal")
# Says on stderr how often something was really refined.
COUNTED = """
import runpy, sys
from ident import output_error
true = output_error._refine
def counted(*given):
    print("refined", file=sys.stderr, flush=True)
    return true(*given)
output_error._refine = counted
sys.argv = sys.argv[1:]
runpy.run_path(sys.argv[0], run_name="__main__")
"""


@pytest.fixture(scope="module")
def log():
    robot = load_model("paper").with_effects({"wheel_coulomb_friction": 0.15})
    times = np.arange(40 * 50) / 50
    motion = calibration_sequence(seconds=40.0)
    return Log("log", robot.platform, **record_closed_loop(robot, motion, times, Sensors(), seed=0))


class Shelf(dict):
    """A store in memory; what is kept goes through JSON."""

    find = dict.get

    def keep(self, name, value):
        self[name] = json.loads(json.dumps(value))


def improving(folder):
    """Start improve on log.csv in a folder."""
    script = ROOT / "scripts" / "improve.py"
    words = [
        sys.executable,
        "-c",
        COUNTED,
        script,
        "log.csv",
        "--out",
        "m.yaml",
        "--json",
        "r.json",
    ]
    paths = [str(ROOT), str(ROOT / "scripts"), os.environ.get("PYTHONPATH", "")]
    return subprocess.Popen(
        words, cwd=folder, text=True, stdout=subprocess.PIPE, stderr=subprocess.PIPE,
        env=os.environ | {"PYTHONPATH": os.pathsep.join(paths)},
    )  # fmt: skip


def undated(path):
    """A result without the date at which it was made."""
    return re.sub(r"date\W+\d{4}-\S+", "", path.read_text())


@pytest.mark.skipif(sys.platform == "win32", reason="POSIX signals")
def test_a_run_that_was_killed_goes_on_and_ends_the_same(log, tmp_path):
    straight, killed = tmp_path / "straight", tmp_path / "killed"
    for folder in (straight, killed):
        folder.mkdir()
        log.save(folder / "log.csv")
    run = improving(straight)
    shown, told = run.communicate(timeout=300)
    assert run.returncode == 0, told
    assert "going on" not in told
    every = told.count("refined")

    run = improving(killed)
    while "adding wheel_coulomb_friction" not in (line := run.stderr.readline()):
        assert line  # it ends before, else
    run.send_signal(signal.SIGKILL)
    run.wait(60)
    assert not (killed / "m.yaml").exists()
    pieces = sorted((killed / "r.pieces").glob("*.piece.json"))
    names = [json.loads(path.read_text())["key"]["piece"].split()[0] for path in pieces]
    first = names.count("refinement")
    assert first > 5
    assert "clocks" in names
    # One of them is damaged: it is told and made again, the others are not.
    path = pieces[names.index("refinement")]
    path.write_text(re.sub(r'"cost": \[', r"\g<0>1", path.read_text()))

    run = improving(killed)
    while "measuring errors" not in (line := run.stderr.readline()):
        assert line
        if "going on" in line:
            assert f"going on from {len(pieces) - 1} finished pieces in r.pieces" in line
            damaged = run.stderr.readline()
            assert damaged.startswith("1 finished piece in r.pieces damaged, or of other inputs")
            every -= first - 1
        every -= line.count("refined")
    run.send_signal(signal.SIGINT)
    said, told = run.communicate(timeout=60)
    assert (run.returncode, said) == (130, "")
    assert "stopped; what is finished is kept in r.pieces: the same command goes on" in told
    every -= told.count("refined")

    run = improving(killed)
    again, told = run.communicate(timeout=300)
    assert run.returncode == 0, told
    # Nothing was asked twice but what was under way when the run was stopped; the damaged one is
    # not asked again where the clocks rest on it, which were kept.
    assert told.count("refined") - every in (-1, 0, 1)
    assert again == shown
    for name in ("m.yaml", "r.json"):
        assert undated(killed / name) == undated(straight / name)
    assert sorted(path.name for path in killed.iterdir()) == ["log.csv", "m.yaml", "r.json"]


@pytest.mark.parametrize("intervals", [False, True])
def test_a_refinement_that_was_kept_is_the_same_to_the_bit(log, monkeypatch, intervals):
    shelf, start = Shelf(), NOMINAL.with_effects({"wheel_coulomb_friction": 0.1})
    logs = [log, replace(log.part(0.0, 20.0), name="other")]
    with keeping(shelf):
        fresh = refine(logs, [start, NOMINAL.with_effects({"wheel_coulomb_friction": 0.3})],
                       intervals=intervals, iterations=3)  # fmt: skip
        monkeypatch.setattr(output_error, "_refine", None)
        known = refine(logs, [start, NOMINAL.with_effects({"wheel_coulomb_friction": 0.3})],
                       intervals=intervals, iterations=3)  # fmt: skip
    assert len(shelf) == 1
    assert known.models == fresh.models
    assert (known.covariance is None) == (not intervals)
    np.testing.assert_array_equal(known.covariance, fresh.covariance)
    assert (known.windows, known.cost, known.converged) == (
        fresh.windows,
        fresh.cost,
        fresh.converged,
    )
    for one, other in zip(known.simulations, fresh.simulations, strict=True):
        assert one.model == other.model
        np.testing.assert_array_equal(one.states, other.states)
        np.testing.assert_array_equal(one.residual, other.residual)


def test_another_input_is_another_question(log, monkeypatch):
    """One digit of one sample, of one start value, of one option."""
    shelf, asked = Shelf(), []
    true = output_error._refine
    monkeypatch.setattr(output_error, "_refine", lambda *given: asked.append(0) or true(*given))
    speeds = log.wheel_velocity.copy()
    speeds[100, 2] = np.nextafter(speeds[100, 2], 9.0)
    heavier = NOMINAL.with_values([np.nextafter(NOMINAL.values()[0], 99.0), *NOMINAL.values()[1:]])
    plain = {"intervals": False, "iterations": 1}
    with keeping(shelf):
        for given in (log, replace(log, wheel_velocity=speeds)):
            refine([given], NOMINAL, **plain)
        refine([log], heavier, **plain)
        refine([log], NOMINAL, tolerance=2e-6, **plain)
        assert len(asked) == len(shelf) == 4
        refine([log], NOMINAL, **plain)
        assert len(asked) == 4
    refine([log], NOMINAL, **plain)  # nothing is kept outside
    assert len(asked) == 5
    assert len(shelf) == 4


def test_clocks_are_kept(log, monkeypatch):
    shelf = Shelf()
    with keeping(shelf):
        fresh = drive_clock.leads([log], NOMINAL)
        monkeypatch.setattr(drive_clock, "_leads", None)
        assert drive_clock.leads([log], NOMINAL) == fresh


def test_fingerprints_tell_values_apart():
    models = [NOMINAL, load_model("paper")]
    models += [NOMINAL.with_effects({name: None}) for name in ("floor_slope", "actuator_lag")]
    values = [
        *models, None, "", "1", 1, 1.0, True, 0.0, -0.0, float("nan"), [], [1], [[1]], [1, [1]], {},
        {"a": 1}, {"a": 1.0}, np.array([1.0]), np.array([[1.0]]), np.array([1]),
    ]  # fmt: skip
    assert len({fingerprint(value) for value in values}) == len(values)
    assert fingerprint((1, np.float64(2.0))) == fingerprint([1, 2.0])
    with pytest.raises(TypeError, match="set has no fingerprint"):
        fingerprint({1})
