"""Values that go with the robot and values that belong to a record."""

import numpy as np
import pytest

from ident.dead_reckoning import bridged, dead_reckoning
from ident.log import Log
from ident.output_error import refine
from ident.restored import restored, unknown_pose
from ident.scopes import Scopes
from ident.signals import internal_states
from youbot_env.effects import effect_names, get_effect
from youbot_env.model_file import load_model
from youbot_env.references import SmoothRandom
from youbot_env.simulation import IDEAL, Sensors, record_closed_loop

PAPER = load_model("paper")


def record(model, seconds=24.0, seed=1, sensors=IDEAL):
    times = np.arange(round(seconds * 100)) / 100
    motion = SmoothRandom(0.4, 1.5)
    channels = record_closed_loop(model, motion, times, sensors, seed=seed)
    return Log(f"log{seed}", model.platform, **channels)


def test_what_belongs_to_a_record():
    of_record = {name for name in effect_names() if get_effect(name).scope() == "record"}
    assert of_record >= {
        "floor_slope", "cable_tether", "payload_change", "battery_sag", "friction_warmup",
        "drive_offset", "gyro_bias",
    }  # fmt: skip
    assert not of_record & {"wheel_coulomb_friction", "torque_gain", "actuator_delay"}


def test_values_of_several_records_make_one_vector_and_come_apart_again():
    model = PAPER.with_effects({"floor_slope": {"sx": 0.01, "sy": 0.02}, "quadratic_drag": 3.0})
    own = {"floor_slope.sx": -0.03, "floor_slope.sy": 0.04}
    named = dict(zip(model.names(), model.values(), strict=True)) | own
    scopes = Scopes.of(model, 2)
    assert scopes.size == len(model.names()) + 2
    values = scopes.join([model, model.with_values(named.values())])
    first, second = scopes.split(values, model)
    assert first.values() == model.values()
    told = dict(zip(second.names(), second.values(), strict=True))
    assert (told["floor_slope.sx"], told["floor_slope.sy"]) == (-0.03, 0.04)
    assert told["quadratic_drag.c"] == 3.0


def test_logs_share_the_robot_and_keep_their_floors():
    slopes = ({"sx": 0.01, "sy": -0.02}, {"sx": -0.015, "sy": 0.005})
    logs = [
        record(PAPER.with_effects({"floor_slope": slope}), seed=k, sensors=Sensors())
        for k, slope in enumerate(slopes)
    ]
    start = load_model("nominal").with_effects({"floor_slope": {"sx": 0.0, "sy": 0.0}})
    found = refine(logs, start)
    for model, slope in zip(found.models, slopes, strict=True):
        told = dict(zip(model.names(), model.values(), strict=True))
        assert told["floor_slope.sx"] == pytest.approx(slope["sx"], abs=1e-3)
        assert told["floor_slope.sy"] == pytest.approx(slope["sy"], abs=1e-3)
        assert told["m0"] == found.models[0].values()[0]
        assert told["mu1"] == pytest.approx(PAPER.parameters.mu1, rel=0.02)
    assert found.covariance.shape == (len(start.names()) + 2,) * 2
    errors = np.sqrt(np.diag(found.covariance))[-2:]
    assert np.all((errors > 0) & (errors < 2e-3))


def test_dead_reckoning_goes_on_through_gaps_that_are_short_or_still():
    log = record(PAPER)
    exact = log.pose - log.pose[0]
    c, s = np.cos(log.pose[0, 2]), np.sin(log.pose[0, 2])
    turned = exact[:, :2] @ np.array([[c, -s], [s, c]])
    np.testing.assert_allclose(dead_reckoning(log)[:, :2], turned, atol=2e-3)
    np.testing.assert_allclose(dead_reckoning(log)[:, 2], exact[:, 2], atol=2e-3)

    def cut(begin, end, log=log):
        keep = np.r_[0:begin, end : len(log.time)]
        channels = {n: getattr(log, n)[keep] for n in ("time", "wheel_velocity", "wheel_torque")}
        return Log("cut", log.platform, **channels, starts=(0, begin))

    turning = int(np.argmax(np.abs(log.velocity()[400:1600, 2]))) + 400
    short, long = cut(turning, turning + 20), cut(turning, turning + 200)
    assert bridged(short)
    assert not bridged(long)
    assert unknown_pose(long)
    kept = np.r_[0:turning, turning + 20 : len(log.time)]
    gap = np.abs(restored(short, PAPER).pose[:, 2] - exact[kept, 2]).max()
    assert gap < 0.02
    assert restored(long, PAPER).pose is None


def test_states_of_a_lag_are_known_at_every_sample():
    model = PAPER.with_effects({"actuator_lag": 0.15})
    log = record(model)
    states = internal_states(log, model)
    # By hand: each torque is held for 10 ms, and the lag follows it exactly.
    keep, expected = np.exp(-0.01 / 0.15), np.empty_like(log.wheel_torque)
    expected[0] = log.wheel_torque[0]
    for k in range(len(expected) - 1):
        expected[k + 1] = log.wheel_torque[k] + keep * (expected[k] - log.wheel_torque[k])
    np.testing.assert_allclose(states, expected, atol=1e-9)
    assert internal_states(log, PAPER).shape == (len(log.time), 0)
