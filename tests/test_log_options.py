"""Options and logs that a user gives a command: the same for all, and many at once."""

import importlib
import inspect
import json
import sys
from dataclasses import replace
from pathlib import Path

import pytest
from foreign_logs import make, write_duty

from ident.doctor import LogError
from ident.doctor.finding import Finding
from ident.log import YOUBOT_TABLE, Log
from ident.remembered import remember
from youbot_env.model_file import load_model
from youbot_env.platform import mecanum, youbot

READERS = ("identify", "diagnose", "improve", "compare", "calibrate_kinematics", "convert")
OPTIONS = {"mapping", "kt", "gear", "platform", "lever", "recording", "accept"}


@pytest.fixture
def given(monkeypatch, tmp_path):
    monkeypatch.chdir(tmp_path)
    from youbot_cli import log_options

    return log_options


@pytest.fixture
def run(given, monkeypatch, capsys):
    """Call a script by name; gives status, what it printed, and its errors."""

    def call(name, *words):
        from youbot_cli import console

        module = importlib.import_module(f"youbot_cli.{name}")
        monkeypatch.setattr(sys, "argv", [f"{name}.py", *map(str, words)])
        with pytest.raises(SystemExit) as end:
            console.run(module.main, "", given.SEVERAL)
        shown = capsys.readouterr()
        return end.value.code or 0, shown.out, shown.err

    return call


def parameters(name):
    return inspect.signature(importlib.import_module(f"youbot_cli.{name}").main).parameters


@pytest.mark.parametrize("name", READERS)
def test_every_command_has_the_same_options(given, name):
    assert set(parameters(name)) >= OPTIONS


@pytest.mark.parametrize("name", READERS[:-1])
def test_every_command_that_judges_takes_logs_to_judge_by(given, name):
    assert {"logs", "test"} <= set(parameters(name))


def test_patterns_folders_and_files(given, tmp_path):
    good = make(300)
    for name in ("b", "a"):
        (tmp_path / "runs").mkdir(exist_ok=True)
        good.save(tmp_path / "runs" / f"{name}.csv")
    (tmp_path / "runs" / "notes.md").write_text("nothing")
    both = [Path("runs/a.csv"), Path("runs/b.csv")]
    assert given.find_logs(["runs"]) == both
    assert given.find_logs(["runs/*.csv"]) == both
    assert given.find_logs(["runs/b.csv", "runs/a*"]) == both[::-1]
    for word in ("runs/*.bag", "nothing.csv"):
        with pytest.raises(ValueError, match="no log"):
            given.find_logs([word])


def test_a_bad_log_among_good_ones_is_told_and_left_out(given, tmp_path, capsys):
    for number in (1, 2):
        make(300 + number).save(tmp_path / f"{number}.csv")
    (tmp_path / "bad.csv").write_text("time,a\n0,1\n")
    model = load_model("nominal")
    logs, tests = given.LogOptions().read(model, ["1.csv", "bad.csv"], ["2.csv"])
    assert [log.name for log in (*logs, *tests)] == ["1", "2"]
    assert "left out: bad.csv cannot be used" in capsys.readouterr().err
    for words in (["bad.csv"], ["bad.csv", "bad.csv"]):
        with pytest.raises(ValueError, match=r"bad\.csv cannot be used"):
            given.LogOptions().read(model, words)
    with pytest.raises(ValueError, match="same record"):
        given.LogOptions().read(model, ["1.csv"], ["1.csv"])


def test_logs_of_one_name_stay_apart(given, tmp_path):
    for number in (1, 2):
        (tmp_path / f"{number}").mkdir()
        make(300 + number).save(tmp_path / f"{number}" / "run.csv")
    logs, _ = given.LogOptions().read(load_model("nominal"), ["1/run.csv", "2/run.csv"])
    assert [log.name for log in logs] == ["run (1)", "run (2)"]
    assert len(given.digests(logs)) == 2


def test_platform_and_lever_reach_the_log(given, tmp_path):
    make(300).save(tmp_path / "log.csv")
    model = load_model("nominal")

    def read(**options):
        (log,), _ = given.LogOptions(**options).read(model, ["log.csv"])
        assert given.used_model(model, [log]).platform == log.platform
        return log.platform

    assert read() == youbot()
    line = read(platform="R=0.0475 r=0.014 l=0.15 h=0.2355")
    assert line.geometry == youbot().geometry
    scaled = read(lever=0.3)
    assert scaled.lever == pytest.approx(0.3)
    assert scaled.wheels[0].x / scaled.wheels[0].y == pytest.approx(0.2355 / 0.15)
    with pytest.raises(ValueError, match="--lever -1"):
        read(lever=-1.0)
    own = replace(model, platform=mecanum("own", 0.1, 0.1, 0.05, 0.01, 1.0))
    (log,), _ = given.LogOptions().read(own, ["log.csv"])
    assert log.platform.name == "own"


def test_findings_to_accept_reach_the_doctor(given, tmp_path, monkeypatch):
    make(300).save(tmp_path / "log.csv")
    seen = {}
    load = Log.load
    monkeypatch.setattr(Log, "load", lambda *a, **k: (seen.update(k), load(*a, **k))[1])
    given.LogOptions(accept=["units", "clock"]).read(load_model("nominal"), ["log.csv"])
    assert seen["accept"] == ("units", "clock")


def test_compare_takes_what_identify_takes(run, tmp_path):
    text = make(600).save(tmp_path / "log.csv").read_text()
    (tmp_path / "log.csv").write_text(text.replace("wheel_velocity_rl", "back"))
    words = ["log.csv", "--model", "nominal", "--json", "out.json"]
    assert run("compare", *words)[0] == 2
    words += ["--map", "wheel_velocity_rl=back", "--platform", "R=0.0475 l=0.15 h=0.2355"]
    status, _, errors = run("compare", *words)
    assert status == 0, errors
    assert json.loads((tmp_path / "out.json").read_text())["log"] == "log"


@pytest.mark.parametrize("ending", ["csv", "parquet"])
def test_a_converted_log_needs_no_options(run, given, tmp_path, ending):
    good = make(1500, platform=mecanum("own", 0.1, 0.2, 0.05, 0.01, 1.0))
    text = good.save(tmp_path / "foreign.csv").read_text()
    text = text.replace("wheel_torque_", "wheel_current_")
    (tmp_path / "foreign.csv").write_text(text.replace("wheel_velocity_rl", "hinten [rad/s]"))
    words = ["foreign.csv", "--platform", "R=0.05 r=0.01 l=0.1 h=0.1", "--lever", 0.3, "--kt", 0.1]
    words += ["--gear", 10, "--map", "wheel_velocity_rl=hinten", "--recording", "drive_hold=held"]
    status, shown, errors = run("convert", *words, "--out", f"clean.{ending}")
    assert status == 0, errors
    assert f"clean.{ending}: Log('foreign'" in shown
    (log,), _ = given.LogOptions().read(load_model("nominal"), [f"clean.{ending}"])
    assert log.platform.lever == pytest.approx(0.3)
    assert log.recording == {"drive_hold": {"kind": 0.0}}
    for channel in ("time", "wheel_velocity", "reference", "pose"):
        assert getattr(log, channel) == pytest.approx(getattr(good, channel), abs=1e-12)
    assert log.wheel_torque == pytest.approx(good.wheel_torque, abs=1e-12)
    assert any("kt 0.1" in f.what and f.where.startswith("foreign.csv") for f in log.findings)
    # What an option says goes before what the file remembers.
    (log,), _ = given.LogOptions(lever=0.4).read(load_model("nominal"), [f"clean.{ending}"])
    assert log.platform.lever == pytest.approx(0.4)


def test_many_logs_are_converted_into_a_folder(run, tmp_path):
    for number in (1, 2):
        make(300 + number).save(tmp_path / f"{number}.csv")
    (tmp_path / "bad.csv").write_text("time,a\n0,1\n")
    status, _, errors = run("convert", "*.csv", "--out-dir", "clean", "--json", "said.json")
    assert status == 0
    assert "left out: bad.csv" in errors
    assert sorted(p.name for p in (tmp_path / "clean").iterdir()) == ["1.parquet", "2.parquet"]
    assert [one["log"] for one in json.loads((tmp_path / "said.json").read_text())["logs"]] == [
        "1.csv", "2.csv",
    ]  # fmt: skip
    assert Log.load(tmp_path / "clean" / "1.parquet").platform == youbot()
    for words in (["*.csv", "--out", "all.csv"], ["1.csv"], ["1.csv", "--out", "clean.xls"]):
        assert run("convert", *words)[0] == 2
    assert not (tmp_path / "all.csv").exists()


def test_a_damaged_memory_is_told(tmp_path):
    text = make(300).save(tmp_path / "log.csv").read_text()
    (tmp_path / "log.csv").write_text('# platform: {"name": "x"}\n' + text)
    with pytest.raises(LogError, match=r"platform: .*cannot be read"):
        Log.load(tmp_path / "log.csv")


def test_the_youbots_table_is_doubted_once_a_command(given, tmp_path):
    for number in (1, 2):
        good = make(600 + number)
        write_duty(tmp_path / f"{number}.csv", good, 12.0 + 0 * good.time)
    logs, tests = given.LogOptions().read(load_model("nominal"), ["1.csv"], ["2.csv"])
    doubts = [sum(f.what == YOUBOT_TABLE for f in log.findings) for log in (*logs, *tests)]
    assert doubts == [1, 0]
    logs, _ = given.LogOptions(lever=0.4).read(load_model("nominal"), ["*.csv"])
    assert not any(f.what == YOUBOT_TABLE for log in logs for f in log.findings)


def test_logs_of_two_robots_are_refused(given, tmp_path):
    for number, platform in enumerate(("youbot", "R=0.05 l=0.1 h=0.1")):
        log = Log.load(make(300 + number).save(tmp_path / f"{number}.csv"), platform)
        log.save(tmp_path / f"{number}.parquet", remember(log, "by hand"))
    with pytest.raises(ValueError, match=r"1\.parquet is of platform 'mecanum', log 0"):
        given.LogOptions().read(load_model("nominal"), ["*.parquet"])
    logs, _ = given.LogOptions(platform="youbot").read(load_model("nominal"), ["*.parquet"])
    assert len(logs) == 2


def test_models_of_the_youbots_table_follow_the_logs(given, tmp_path):
    log = Log.load(make(300).save(tmp_path / "log.csv"), "R=0.05 l=0.1 h=0.1")
    own = replace(load_model("nominal"), platform=mecanum("own", 0.2, 0.1, 0.05, 0.01, 1.0))
    shipped = [load_model("nominal"), load_model("identified")]
    models = given.LogOptions().used_models([*shipped, own], [log])
    assert [m.platform.name for m in models] == ["mecanum", "mecanum", "own"]
    models = given.LogOptions(platform="given").used_models([own], [log])
    assert models[0].platform == log.platform


def test_short_logs_that_together_hold_enough_are_not_told_to_be_short(given):
    log = Log.load("youbot_fit")
    short = Finding("warning", "the log lasts only 12 s", "file", "record longer", "short")
    parts = [replace(log.part(t, t + 12.0), findings=(short,)) for t in (0.0, 15.0)]
    assert given.long_together(parts[:1]) == parts[:1]
    assert not any(part.findings for part in given.long_together(parts))


def test_logs_along_one_axis_each_are_not_told_that_another_is_still(given):
    log = Log.load("youbot_fit")

    def resting(*axes):
        found = [Finding("warning", f"hardly any {axis} motion: 1 mm/s", "whole log", "-", "rest")
                 for axis in axes]  # fmt: skip
        return replace(log, findings=(*found, Finding("warning", "slow", "file", "-", "rest")))

    def left(*logs):
        return [[f.what.partition(":")[0] for f in one.findings] for one in
                given.moving_together(list(logs))]  # fmt: skip

    assert left(resting("yaw", "sideways"), resting("yaw", "forward")) == [
        ["hardly any yaw motion", "slow"]] * 2  # fmt: skip
    assert left(resting("yaw")) == [["hardly any yaw motion", "slow"]]


def test_what_many_logs_share_is_said_once(given):
    """Seventy logs with ten findings each, in their own numbers, are seven hundred lines."""
    from ident.report.findings import finding_lines

    log = Log.load("youbot_fit")

    def logs(count):
        made = []
        for number in range(count):
            steps = Finding("warning", f"recorded in steps of 0.0{number}1, {number}% of the rms",
                            f"column {number}", "use finer", "resolution")  # fmt: skip
            jumps = Finding("fixed", f"{number + 2} gaps in time: split", "time", "-", "clock")
            made.append(replace(log, name=f"log{number}", findings=(steps, jumps)))
        return made

    many, few = finding_lines(logs(30)), finding_lines(logs(3))
    assert len(many) == 2
    assert many[0].startswith("log0, log1, log2, log3 and 26 more: warning: column 0: recorded in")
    assert "numbers or columns of their own" in many[0]
    assert len(few) == 6
