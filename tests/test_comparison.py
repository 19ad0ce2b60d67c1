"""Comparison: the true model is best, and the error is found where it was put."""

import json
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from ident.comparison import compare
from ident.log import Log
from youbot_env.model_file import load_model
from youbot_env.references import calibration_sequence
from youbot_env.simulation import Sensors, record_closed_loop

ROOT = Path(__file__).resolve().parent.parent
PAPER = load_model("paper")


def record(model, seconds=60.0, seed=1):
    channels = record_closed_loop(
        model, calibration_sequence(seconds=seconds), np.arange(seconds * 100) / 100, Sensors(),
        seed=seed,
    )  # fmt: skip
    return Log("log", model.platform, **channels)


def test_the_true_model_is_best_by_both_errors():
    log = record(PAPER)
    true, nominal = compare(log, [PAPER, load_model("nominal")])
    assert true.run.nrmse < 0.05 * nominal.run.nrmse
    assert true.equation[3] < 0.2 * nominal.equation[3]


def test_error_is_found_where_it_was_put():
    changed = PAPER.with_effects({"payload_change": {"dm": 8.0, "dI": 0.5, "t0": 45.0}})
    (found,) = compare(record(changed), [PAPER])
    names = [regime.name for regime in found.where]
    last = found.where[names.index("last quarter of the time")]
    assert last.excess > 1.5
    quarters = [regime for regime in found.where if regime.name.endswith("quarter of the time")]
    assert last is quarters[0]


def test_shares_of_the_axes_add_up():
    (found,) = compare(record(PAPER), [load_model("nominal")])
    axes = [r.share_of_error for r in found.where if r.name.startswith("axis")]
    assert sum(axes) == pytest.approx(1.0)


def test_script_writes_the_contract(tmp_path):
    file = tmp_path / "c.json"
    command = [sys.executable, "scripts/compare.py", "--model", "nominal", "--model", "paper"]
    done = subprocess.run(
        [*command, "--json", str(file)], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    result = json.loads(file.read_text())
    assert [m["model"] for m in result["models"]] == ["nominal", "paper"]
    for entry in result["models"]:
        assert set(entry["free_run"]) == {"vx", "vy", "yaw_rate", "nrmse"}
        assert set(entry["equation"]) == {"x", "y", "yaw", "nrmse"}
        assert entry["where"]
    bad = subprocess.run([*command, "none.csv"], cwd=ROOT, capture_output=True, check=False)
    assert bad.returncode == 2
