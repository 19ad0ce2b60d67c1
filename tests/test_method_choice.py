"""Where the drive is a voltage, the method that predicts what is kept out is used, and said."""

from dataclasses import replace

import numpy as np
import pytest
from shared_data import shared

from ident.identification import FREE_RUN, identify
from ident.log import Log
from ident.method_choice import CLEAR, MethodChoice, choose_method
from ident.pooling import joined
from ident.recording import find_recordings
from youbot_env.model_file import load_model
from youbot_env.references import SmoothRandom
from youbot_env.simulation import Sensors, record_closed_loop

PAPER, NOMINAL = load_model("paper"), load_model("nominal")
KNOWN = {"drive_hold": {"kind": 0.0}, "drive_offset": {"d": 0.0}}
PER_VOLT, BACK_EMF = 0.6, 0.4  # N m/V, V s/rad


def record(seed, seconds=12.0, name="log"):
    times = np.arange(round(seconds * 50)) / 50
    channels = record_closed_loop(PAPER, SmoothRandom(0.35, 1.5), times, Sensors(), seed=seed)
    channels.pop("reference", None)
    return Log(f"{name}{seed}", PAPER.platform, **channels, recording=KNOWN)


def in_volts(log):
    volts = log.wheel_torque / PER_VOLT + BACK_EMF * log.wheel_velocity
    return replace(log, wheel_torque=None, wheel_voltage=volts)


def rows_of(log):
    return list(map(tuple, log.wheel_velocity.tolist()))


@pytest.mark.parametrize("logs", [1, 3, 6])
def test_every_part_is_kept_out_once_and_never_fitted_then(logs):
    runs = [record(k) for k in range(logs)]
    given = [joined(runs)] if logs == 6 else runs
    seen = []

    def spy(train):
        seen.append({row for r in train for row in rows_of(r.log)})
        return PAPER

    choice = choose_method(find_recordings(given, PAPER), {"spy": spy})
    assert ("whole runs" in choice.parts) == (logs == 6)
    assert len(seen) == 4
    kept_out = [sum(row not in fitted for fitted in seen) for log in runs for row in rows_of(log)]
    assert set(kept_out) == {1}


def test_the_better_prediction_is_chosen():
    records = find_recordings([record(1)], PAPER)
    found = choose_method(records, {"wrong": lambda _: NOMINAL, "right": lambda _: PAPER})
    assert found.best == "right"
    assert found.errors["right"] < 0.1 < found.errors["wrong"]
    assert "right" in str(found)
    assert "4 blocks of time" in str(found)

    def fails(train):
        raise ValueError("no parameter leaves a trace")

    found = choose_method(records, {"fails": fails, "right": lambda _: PAPER})
    assert found.best == "right"
    assert "fails without bound" in str(found)
    close = MethodChoice({"usual": 0.5, "other": 0.5 * (1 - 0.5 * CLEAR)}, "4 blocks")
    assert close.best == "usual"


def test_of_voltages_a_method_is_chosen_and_said(script, tmp_path):
    path = in_volts(record(1, 24.0)).save(tmp_path / "volts.csv")
    status, out, errors = script("identify.py", path, "--out", "m.yaml")
    assert status == 0, errors
    text = " ".join(out.split())
    assert "kept out in turn: least squares" in text
    model = load_model(tmp_path / "m.yaml")
    assert "kept out in turn" in model.provenance["method_chosen"]
    used = model.provenance["method_chosen"].partition(",")[0]
    assert f"Parameters, by {used}" in text


def test_of_torques_the_method_is_the_usual_one():
    found = identify(record(1), NOMINAL)
    assert found.choice is None
    assert found.as_dict()["fit"]["kept_out"] is None
    assert found.method != FREE_RUN


@pytest.mark.long
def test_the_choice_predicts_other_runs_of_a_real_robot_better():
    folder, line = shared("ftc-mecanum"), "R=0.048 r=0.012 l=0.14 h=0.14"
    logs = [Log.load(path, line) for path in sorted((folder / "r1").glob("*.csv"))]
    kept = [Log.load(folder / name, line) for name in ("red_field_deposit.csv", "square.csv")]
    chosen = identify(logs, test=kept)
    assert chosen.method == chosen.choice.best == FREE_RUN
    assert chosen.test_run.nrmse < 0.95 * identify(logs, test=kept, method="ls").test_run.nrmse
