"""Dense records: means in place of samples, no delay in between, the same answers."""

from dataclasses import replace

import numpy as np
import pytest

from ident import diagnose
from ident.decimate import decimated
from ident.free_run import free_run
from ident.log import Log
from youbot_env.model_file import load_model
from youbot_env.references import SmoothRandom, calibration_sequence
from youbot_env.simulation import IDEAL, Sensors, record_closed_loop

PAPER = load_model("paper")
STICKY = PAPER.with_effects({"wheel_coulomb_friction": 0.15})


def record(model, motion, seconds, sensors, rate=1000.0):
    times = 5.0 + np.arange(round(seconds * rate)) / rate
    channels = record_closed_loop(model, motion, times, sensors, seed=1)
    return Log("dense", model.platform, **channels)


@pytest.mark.parametrize("interval", [0.01, 0.004])
def test_means_follow_the_same_motion_without_delay(interval):
    dense = record(PAPER, SmoothRandom(0.3, 2.0), 12.0, IDEAL)
    log = decimated(dense, interval)
    assert log.dt == pytest.approx(interval)
    assert len(log.time) == 12.0 / interval
    assert log.wheel_torque.mean(axis=0) == pytest.approx(dense.wheel_torque.mean(axis=0), abs=2e-3)
    late = PAPER.with_effects({"actuator_delay": 0.5 * interval})
    assert free_run(log, PAPER).nrmse < 0.1 * free_run(log, late).nrmse


def test_records_that_are_not_dense_stay_as_they_are_and_gaps_stay_gaps():
    log = record(PAPER, SmoothRandom(0.3, 2.0), 4.0, Sensors())
    assert decimated(log, 1.4e-3) is log
    time = log.time + np.where(np.arange(4000) < 1995, 0.0, 3.0)
    found = decimated(replace(log, time=time, starts=(0, 1995)), 0.01)
    assert found.starts == (0, 199)
    assert len(found.time) == 199 + 200
    assert found.time[199] - found.time[198] > 3.0
    speed = np.interp(found.time[:199], log.time, log.wheel_velocity[:, 0])
    assert np.std(found.wheel_velocity[:199, 0] - speed) < 2 * Sensors().wheel_velocity


def test_a_dense_record_is_diagnosed_like_any_other():
    fit = record(STICKY, calibration_sequence(seconds=80.0), 80.0, Sensors())
    test = record(STICKY, SmoothRandom(0.35, 1.5), 40.0, Sensors())
    found = diagnose(fit, test=test)
    assert [step.best.identifier for step in found.named] == ["wheel_coulomb_friction"]
    size = found.named[0].sizes(found.model)["fc"]
    assert size.value == pytest.approx(0.15, rel=0.02)
    assert found.first.parts[0].log.dt == pytest.approx(0.02)
