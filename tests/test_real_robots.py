"""Logs of real robots, straight from their files, short runs as one data set."""

import re
from pathlib import Path

import numpy as np
import pytest
import yaml
from shared_data import shared

from ident.improvement import improve
from ident.log import Log
from ident.regression import build_regression
from youbot_env.model_file import load_model

GUIDE = Path(__file__).resolve().parent.parent / "docs" / "add_a_platform.md"
GEAR, KT = 16, 0.0514  # motor turns a wheel turn, N m/A


@pytest.fixture(scope="module")
def platform(tmp_path_factory):
    """The platform file of the guide, as a user would copy it."""
    text = re.search(r"```yaml\n(# robotino.yaml\n.*?)```", GUIDE.read_text("utf-8"), re.S).group(1)
    path = tmp_path_factory.mktemp("platform") / "robotino.yaml"
    path.write_text(text, encoding="utf-8")
    assert yaml.safe_load(text)["log"]["gear"] == GEAR
    return path


def speed_of(path):
    """Set speed of a run, m/s."""
    row = path.read_text("utf-8").splitlines()[10].split(";")
    return float(np.hypot(float(row[1]), float(row[2])))


def current_error(log, model):
    """(3,) mean current that a model leaves unexplained in the steady part of a run, A."""
    rows = build_regression(log, model)
    values = dict(zip(model.names(), model.values(), strict=True))
    left = rows.residual(np.array([values[name] for name in rows.names]))
    wrench = left / (rows.lever, rows.lever, 1.0)
    steady = (rows.time > log.time[0] + 2.0) & (rows.time < log.time[-1] - 1.0)
    torque = wrench[steady].mean(axis=0) @ np.linalg.pinv(log.platform.jacobian_array)
    return torque / KT / GEAR


def test_friction_of_a_robot_with_three_omni_wheels_is_named_from_short_straight_runs(platform):
    paths = sorted(shared("robotino", "green").glob("*.csv"))[::2]
    fast = [speed_of(path) > 0.25 for path in paths]
    logs = [Log.load(path, str(platform)) for path in paths]
    fitted = [log for log, f in zip(logs, fast, strict=True) if not f]
    kept = [log for log, f in zip(logs, fast, strict=True) if f]
    assert len(fitted) > 2 * len(kept) - 6 > 10
    assert not [f for log in logs for f in log.findings if f.severity == "error"]
    start = load_model("nominal")
    found = improve(fitted, start, kept)
    named = {step.best.identifier for step in found.found.named}
    assert "body_dry_friction" in named
    assert named <= {"body_dry_friction", "wheel_coulomb_friction", "roller_coulomb_friction",
                     "rolling_resistance"}  # fmt: skip
    error = np.sqrt(np.mean([current_error(log, found.model) ** 2 for log in kept]))
    current = np.sqrt(np.mean(np.concatenate([log.wheel_torque for log in kept]) ** 2)) / KT / GEAR
    assert error < 0.12 < 0.5 < current
    assert all(found.stages[-1].base[name].ci95 is None for name in ("m0", "I0", "I1"))


def test_all_logs_of_a_real_mecanum_robot_load_without_a_wrong_finding():
    folder = shared("ftc-mecanum")
    paths = [folder / "red_field_deposit.csv", folder / "square.csv", *(folder / "r1").glob("*")]
    assert len(paths) == 10
    for path in paths:
        log = Log.load(path)
        assert log.pose is not None
        assert {finding.name for finding in log.findings} <= {
            "platform",
            "short",
            "spikes",
            "battery",
        }


@pytest.mark.long
def test_dry_friction_of_rollers_is_found_though_nothing_explains_the_yaw():
    """One axis is mended: neither alone nor by its linear trace does the effect pass."""
    folder, line = shared("ftc-mecanum"), "R=0.048 r=0.012 l=0.14 h=0.14"
    logs = [Log.load(path, line) for path in sorted((folder / "r1").glob("*.csv"))]
    kept = Log.load(folder / "red_field_deposit.csv", line)
    found = improve(logs, load_model("nominal"), kept)
    added = [stage.added for stage in found.stages]
    assert {"actuator_delay", "roller_coulomb_friction"} <= set(added)
    assert found.stages[-1].axes[1] < 0.6 * found.stages[0].axes[1]
    # What is left is not claimed to be explained.
    assert found.found.verdict == "outside_library"
    assert found.found.named == ()
