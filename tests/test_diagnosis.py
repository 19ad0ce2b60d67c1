"""Diagnosis: hidden effects are named, silence where nothing is hidden, refusal of weak records."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from shared_data import shared

from ident.diagnosis.verdict import diagnose
from ident.log import Log
from youbot_env.model_file import load_model
from youbot_env.references import SmoothRandom, calibration_sequence
from youbot_env.simulation import Sensors, record_closed_loop

ROOT = Path(__file__).resolve().parent.parent
PAPER, NOMINAL = load_model("paper"), load_model("nominal")


def record(model, reference, seconds, seed):
    times = np.arange(seconds * 100) / 100
    channels = record_closed_loop(model, reference, times, Sensors(), seed=seed)
    return Log(f"log{seed}", model.platform, **channels)


def pair(effects):
    model = PAPER.with_effects(effects)
    fit = record(model, calibration_sequence(seconds=60.0), 60.0, 1)
    return fit, record(model, SmoothRandom(0.35, 1.5), 40.0, 2)


def test_nothing_is_named_where_nothing_is_hidden():
    found = diagnose(*pair({}), NOMINAL)
    assert found.verdict == "nothing_missing"
    assert not found.steps


@pytest.mark.parametrize(
    ("effects", "size", "true"),
    [
        ({"wheel_coulomb_friction": 0.15}, "fc", 0.15),
        ({"floor_slope": {"sx": 0.012, "sy": -0.008}}, "sx", 0.012),
    ],
)
def test_a_hidden_effect_is_named_with_its_size(effects, size, true):
    found = diagnose(*pair(effects), NOMINAL)
    (identifier,) = effects
    assert found.verdict in ("named", "ambiguous")
    assert identifier in found.steps[0].group
    step = found.steps[0]
    assert step.drop > 0.2
    if step.best.identifier == identifier:
        assert step.best.sizes[size] == pytest.approx(true, rel=0.1)


def test_weak_records_are_refused_with_the_reason():
    fit, test = pair({})
    short = diagnose(fit.part(0.0, 10.0), test, NOMINAL)
    assert short.verdict == "cannot_say"
    assert "20 s" in short.reason
    still = replace(fit, wheel_velocity=0.001 * fit.wheel_velocity)
    assert "hardly moves" in diagnose(still, test, NOMINAL).reason
    clipped = replace(fit, wheel_torque=np.clip(fit.wheel_torque, -0.3, 0.3))
    assert "limit" in diagnose(clipped, test, NOMINAL).reason
    assert not diagnose(clipped, test, NOMINAL).steps


def test_robot_with_real_rollers_and_nothing_hidden():
    logs = [
        Log.load(shared("roller-robot", f"a-nothing-hidden.{k}.csv")) for k in ("train", "test")
    ]
    assert diagnose(*logs, NOMINAL).verdict == "nothing_missing"


def test_script_writes_the_contract_and_refuses_one_log(tmp_path):
    command = [sys.executable, "scripts/diagnose.py"]
    alone = subprocess.run(
        [*command, "logs/youbot_fit.csv"], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert alone.returncode == 2
    assert "--test" in alone.stderr
    logs = {}
    for name, log in zip(("fit", "test"), pair({}), strict=True):
        logs[name] = log.part(0.0, 15.0).save(tmp_path / f"{name}.csv")
    file = tmp_path / "d.json"
    done = subprocess.run(
        [*command, str(logs["fit"]), "--test", str(logs["test"]), "--json", str(file)],
        cwd=ROOT, capture_output=True, text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    result = json.loads(file.read_text())
    assert result["verdict"] == "cannot_say"
    assert result["named"] == []
