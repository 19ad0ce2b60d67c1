"""Findings of the doctor stand in text, page and JSON of every command that reads logs."""

from __future__ import annotations

import json

import numpy as np
import pytest
import yaml
from spoiled_logs import good_frame, put, scale, text_of

from ident.log import Log
from ident.pooling import joined
from youbot_env.model_file import load_model
from youbot_env.references import make_reference
from youbot_env.simulation import Sensors, record_closed_loop

COMMANDS = {
    "identify.py": ("--out", "m.yaml", "--report", "page"),
    "diagnose.py": ("--report", "page"),
    "improve.py": ("--out", "m.yaml", "--report", "page"),
    "compare.py": ("--model", "nominal", "--report", "page"),
    "convert.py": ("--out", "clean.parquet"),
}


@pytest.fixture
def bent(tmp_path):
    """A log whose pose turns 1.65 times as far as its wheels say."""
    path = tmp_path / "bent.csv"
    path.write_text(text_of(scale(1.65, "yaw")(good_frame())))
    return path


@pytest.mark.parametrize("command", COMMANDS)
def test_findings_are_told(script, tmp_path, bent, command):
    _, out, _ = script(command, bent, "--json", "result.json", *COMMANDS[command])
    said = "turns as with a lever l + h of 0.23"
    assert said in " ".join(out.split())
    found = json.loads((tmp_path / "result.json").read_text())
    told = found["logs"][0]["findings"] if command == "convert.py" else found["findings"]
    assert [(f["log"], f["name"], f["geometry"]) for f in told] == [("bent", "lever", True)]
    if "--report" in COMMANDS[command]:
        page = (tmp_path / "page" / "index.html").read_text()
        assert said in page
        assert "bent: warning" in page


def test_findings_are_told_with_a_calibration(script, tmp_path):
    path = tmp_path / "jumps.csv"
    path.write_text(text_of(put("x", slice(1500, None), lambda x: x + 0.3)(good_frame())))
    _, out, _ = script("calibrate_kinematics.py", path, "--json", "result.json")
    assert "jumps: fixed: line 1502: the pose jumps" in " ".join(out.split())
    (found,) = json.loads((tmp_path / "result.json").read_text())["findings"]
    assert found["name"] == "pose_jumps"


@pytest.mark.parametrize("command", ["diagnose.py", "improve.py"])
def test_findings_of_the_geometry_end_in_cannot_say(script, bent, command):
    _, out, _ = script(command, bent)
    assert "cannot say" in out
    assert "--accept lever" in " ".join(out.split())


def test_what_was_accepted_stands_in_the_history(script, tmp_path, bent):
    status, out, _ = script(
        "identify.py", bent, "--accept", "lever", "--out", "m.yaml", "--json", "result.json"
    )
    assert status == 0
    assert "accepted: pose turns" in " ".join(out.split())
    history = {"bent.csv": ["lever"]}
    assert yaml.safe_load((tmp_path / "m.yaml").read_text())["provenance"]["accepted"] == history
    result = json.loads((tmp_path / "result.json").read_text())
    assert result["provenance"]["accepted"] == history


def test_unknown_finding_is_refused_with_the_names(script, bent):
    status, _, err = script("identify.py", bent, "--accept", "levr", "--out", "m.yaml")
    assert status == 2
    assert "did you mean 'lever'" in err


def test_a_converted_log_remembers_what_bends_its_geometry(script, tmp_path, bent):
    script("convert.py", bent, "--out", "clean.parquet")
    assert any(finding.geometry for finding in Log.load(tmp_path / "clean.parquet").findings)


def test_joined_logs_keep_what_was_accepted(bent):
    log = Log.load(bent, accept=("lever",))
    assert joined([log, log]).accepted == ("lever",)


def test_what_the_motion_does_not_excite_is_told_with_the_motion_to_record(script, tmp_path):
    robot, times = load_model("nominal"), np.arange(2500) / 100
    motion = make_reference("III", speed=0.3)
    channels = record_closed_loop(robot, motion, times, Sensors(), seed=0)
    path = Log("straight", robot.platform, **channels).save(tmp_path / "straight.csv")
    _, out, _ = script("diagnose.py", path, "--json", "result.json", "--report", "page")
    reason = "the robot hardly turns; record a spin on the spot"
    untried = json.loads((tmp_path / "result.json").read_text())["untried"]
    assert untried["yaw_scrub_friction"] == reason
    assert reason in " ".join(out.split())
    assert reason in (tmp_path / "page" / "index.html").read_text()
