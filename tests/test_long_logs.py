"""Long records: what is looked at of them, that it is said, and that memory stays bounded."""

import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest

from ident import Log, diagnose, identify
from ident.dead_reckoning import bridged, wheel_angles
from ident.diagnosis import score_table
from ident.diagnosis.diagnose import SETTINGS
from ident.doctor import LogError
from ident.excerpt import excerpt, excerpts, load_excerpt, recorded
from ident.loaders import long_files
from ident.pooling import joined

ROOT = Path(__file__).resolve().parent.parent
COLUMNS = ("wheel_velocity", "wheel_torque", "pose")


@pytest.fixture(scope="module")
def whole():
    return Log.load("youbot_fit")


@pytest.fixture(scope="module")
def file_folder(tmp_path_factory, whole):
    """A log as CSV, with a comment among its rows, and as Parquet."""
    folder = tmp_path_factory.mktemp("long")
    frame = pl.read_csv(whole.save(folder / "whole.csv"))
    frame.write_parquet(folder / "log.parquet")
    lines = frame.write_csv().splitlines()
    lines[5000:5000] = ["# a word in between"]
    (folder / "log.csv").write_text("# by hand\n" + "\n".join(lines) + "\n")
    return folder


def gaps(log):
    return [f.message for f in log.findings if "gaps in time" in f.what]


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_of_a_long_file_the_stretches_in_which_most_happens_are_read(
    file_folder, ending, monkeypatch
):
    monkeypatch.setattr(long_files, "STRETCH", 500)
    file = file_folder / f"log.{ending}"
    everything = Log.load(file)
    log = Log.load(file, most_rows=3000)
    assert 2900 <= len(log.time) <= 3000
    rows = np.searchsorted(everything.time, log.time)
    for channel in ("time", *COLUMNS):
        assert np.array_equal(getattr(log, channel), getattr(everything, channel)[rows])
    # From all of the time.
    assert np.histogram(log.time, 3, (0, 112))[0].min() >= 500
    # What was left out is a break that nobody complains of.
    assert log.starts == (0, *(np.flatnonzero(np.diff(rows) > 1) + 1).tolist())
    assert len(log.starts) > 3
    assert not gaps(log)
    told = [f for f in log.findings if f.name == "excerpt"]
    assert told[0].what.startswith(("11200 rows", "11201 rows"))  # with the comment
    assert len(told) == 1


def test_of_files_that_are_not_long_everything_is_read(file_folder):
    for ending in ("csv", "parquet"):
        log = Log.load(file_folder / f"log.{ending}", most_rows=11_202)
        assert len(log.time) == 11_200
        assert not [f for f in log.findings if f.name == "excerpt"]


def test_messages_name_the_lines_of_the_file(file_folder, monkeypatch, tmp_path):
    monkeypatch.setattr(long_files, "STRETCH", 500)
    log = Log.load(file_folder / "log.csv", most_rows=3000)
    lines = (file_folder / "log.csv").read_text().splitlines()
    middle = log.time[len(log.time) // 2]
    bad = next(k for k, line in enumerate(lines) if line.startswith(f"{middle},"))
    cells = lines[bad].split(",")
    lines[bad] = ",".join([cells[0], "nothing", *cells[2:]])
    spoiled = tmp_path / "spoiled.csv"
    spoiled.write_text("\n".join(lines) + "\n")
    with pytest.raises(LogError, match=f"line {bad + 1}, column {COLUMNS[0]}_fl: 'nothing'"):
        Log.load(spoiled, most_rows=3000)


def test_neither_units_nor_gross_errors_decide_where_most_happens():
    rng = np.random.default_rng(0)
    values = 1e-3 * rng.normal(size=(10, 400, 6))
    values[7] += np.sin(np.arange(400) / 20)[:, None] * [1e-2, 1e-2, 1e-2, 1e-2, 300.0, 1e-2]
    values[3, 100, 4] = 1e9
    assert np.argmax(long_files.liveliness(values.var(axis=1))) == 7
    assert long_files.livelier(values.var(axis=1), np.full(10, 400), 800)[-1] == 7


def test_a_robot_that_stands_half_of_the_time_shows_as_much(whole):
    rng = np.random.default_rng(0)
    later = replace(
        whole,
        wheel_velocity=1e-3 * rng.normal(size=whole.wheel_velocity.shape),
        wheel_torque=1e-2 * rng.normal(size=whole.wheel_torque.shape),
    )
    log = excerpt(joined([whole, later]), 40.0)
    assert recorded(log) > 20.0
    assert log.run_names == [whole.name]


def test_a_record_is_cut_where_least_happens(whole, monkeypatch):
    monkeypatch.setattr("ident.excerpt.SETTINGS", replace(SETTINGS, excerpt_seconds=5.0))
    assert excerpt(whole, 112.1) is whole
    log = excerpt(whole, 60.0)
    assert 40.0 < recorded(log) <= 60.0
    rows = np.searchsorted(whole.time, log.time)
    assert np.array_equal(whole.time[rows], log.time)
    # Roller phases and headings hold through what was left out.
    assert len(log.starts) > 1
    assert bridged(log)
    assert np.array_equal(log.wheel_angle, wheel_angles(whole)[rows])
    assert "112 s" in log.findings[-1].what


def test_of_many_runs_some_are_left_out(whole):
    runs = [replace(whole.part(t, t + 7.0), name=f"run{k}") for k, t in enumerate(range(0, 105, 7))]
    log = excerpt(joined(runs), 50.0)
    assert recorded(log) <= 50.0 + 0.1
    assert [begin for _, begin in log.runs] == [log.time[start] for start in log.starts]
    assert set(log.run_names) < {run.name for run in runs}
    assert not bridged(log)


def test_several_logs_share_what_is_looked_at(whole, monkeypatch):
    monkeypatch.setattr("ident.excerpt.SETTINGS", replace(SETTINGS, most_seconds=80.0))
    other = Log.load("youbot_test")
    short = other.part(0.0, 10.0)
    (first, second), (kept,) = excerpts([whole, other], [short])
    assert 60.0 < recorded(first) + recorded(second) + recorded(kept) <= 80.0
    assert recorded(first) < recorded(whole)
    assert recorded(second) < recorded(other)
    assert recorded(kept) == recorded(short)


def test_a_diagnosis_of_a_long_log_says_what_it_used(whole, monkeypatch):
    monkeypatch.setattr("ident.excerpt.SETTINGS", replace(SETTINGS, most_seconds=64.0))
    found = diagnose(whole)
    assert "of the 112 s of youbot_fit the " in found.reason
    assert "wheel_coulomb_friction" in [step.best.identifier for step in found.named]
    assert found.as_dict()["reason"] == found.reason


def test_files_are_cut_before_they_are_identified(whole, tmp_path, monkeypatch):
    whole_file = whole.save(tmp_path / "whole.csv")
    monkeypatch.setattr("ident.excerpt.SETTINGS", replace(SETTINGS, longest_seconds=64.0))
    file = str(whole_file)
    log = load_excerpt(file)
    assert recorded(log) <= 64.0
    assert identify(file, "nominal").model.values() == identify(log, "nominal").model.values()


def test_groups_of_traces_do_not_change_the_table(whole, monkeypatch):
    short = whole.part(0.0, 40.0)
    before = diagnose(short)
    monkeypatch.setattr(score_table, "SETTINGS", replace(SETTINGS, most_bytes=1 << 19))
    after = diagnose(short)
    assert before.verdict == after.verdict
    gains = [[m.gain for m in found.minimum_detectable] for found in (before, after)]
    assert gains[0] == pytest.approx(gains[1], abs=1e-9)


@pytest.mark.long
@pytest.mark.parametrize("command", ["identify", "diagnose"])
def test_an_hour_takes_less_than_a_gigabyte(tmp_path, whole, command):
    frame = pl.read_csv(whole.save(tmp_path / "once.csv"))
    file = tmp_path / "hour.csv"
    with file.open("wb") as stream:
        for number in range(33):
            later = frame.with_columns(pl.col("time") + 113.0 * number)
            stream.write(later.write_csv(include_header=number == 0).encode())
    words = [command, file, "--report", tmp_path / "report", "--json", tmp_path / "r.json"]
    if command == "identify":
        words += ["--out", tmp_path / "m.yaml"]
    code = (
        "import resource, contextlib; from youbot_cli.__main__ import main\n"
        "with contextlib.suppress(SystemExit): main()\n"
        "print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)"
    )
    done = subprocess.run([sys.executable, "-c", code, *map(str, words)], check=True, cwd=ROOT,
                          capture_output=True, text=True)  # fmt: skip
    assert (tmp_path / "r.json").exists()
    assert int(done.stdout.split()[-1]) < 1_000_000  # kB
