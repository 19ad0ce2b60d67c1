"""Lasting noise of the drive is read off torques that move nothing, whatever the robot hides."""

from dataclasses import replace

import numpy as np
import pytest

from ident.benchmark.conditions import Conditions, record
from ident.benchmark.foreign import Foreign
from ident.diagnosis.diagnose import diagnose
from ident.drive_noise import NO_NOISE, lasting_noise
from ident.log import Log
from ident.noise_floor import noise_floor
from ident.recording import find_recordings
from ident.restored import restored
from ident.sensitivity import Linearised
from youbot_env.model_file import load_model
from youbot_env.simulation import IDEAL, Sensors

SECONDS = 60.0


def recorded(noise=0.0, correlation=0.15, sensors=None, effects=None, seed=1, **kinds) -> Log:
    how = Foreign(noise=noise, correlation=correlation, motion="smooth_random", **kinds)
    source = np.random.SeedSequence(seed)
    robot = load_model("paper").with_effects(effects or {})
    times = how.times(SECONDS, np.random.default_rng(seed))
    log = record("log", robot, how.fitting(), times, sensors or Sensors(), source, how)
    return how.kept(log, np.random.default_rng(seed))


@pytest.mark.parametrize(("size", "time"), [(0.03, 0.1), (0.06, 0.15), (0.08, 0.3)])
@pytest.mark.parametrize("effects", [None, {"wheel_coulomb_friction": 0.2, "torque_ripple": None}])
def test_size_and_time_of_noise_that_lasts(size, time, effects):
    found = lasting_noise(recorded(size, time, effects=effects))
    assert found.size == pytest.approx(size, rel=0.25)
    assert 0.5 * time < found.time < 1.6 * time


@pytest.mark.parametrize(
    "effects",
    [
        None,
        {"wheel_coulomb_friction": 0.2},
        {"torque_ripple": None},
        {"torque_gain": {"e_fl": -0.1}},
    ],
)
def test_white_noise_and_hidden_effects_are_no_lasting_noise(effects):
    assert lasting_noise(recorded(effects=effects)).size == 0.0


def test_robots_whose_wheels_contradict_each_other_have_none():
    log = recorded(0.06)
    slips = Log(log.name, log.platform, log.time, wheel_torque=log.wheel_torque,
                wheel_velocity=log.wheel_velocity * (1.0, 1.02, 1.0, 0.98)
                + 0.3 * np.sin(log.time)[:, None] * (1, 1, -1, -1))  # fmt: skip
    assert lasting_noise(slips).size == 0.0


def test_noise_that_lasts_is_seen_through_a_filter_of_the_speeds():
    filtered = {"fault": ("velocity_filter", "T", 0.015), "rate": 200.0}
    log = recorded(0.05, 0.15, **filtered)
    # Second differences of filtered noise are small, and wheels seem to contradict each other.
    assert lasting_noise(log).size == 0.0
    known = replace(log, recording={"velocity_filter": {"T": 0.015}})
    assert lasting_noise(known).size == pytest.approx(0.05, rel=0.25)
    robot = load_model("paper")
    assert lasting_noise(restored(known, robot)).size == pytest.approx(0.05, rel=0.25)
    clean = recorded(0.0, **filtered)
    assert lasting_noise(replace(clean, recording=known.recording)).size == 0.0


def test_a_clock_is_found_less_late_for_noise_that_lasts(monkeypatch):
    log = recorded(0.04, 0.15, loop_rate=1000.0, row="sampled", rate=100.0)
    (found,) = find_recordings([log], load_model("nominal"))
    monkeypatch.setattr("ident.drive_noise.lasting_noise", lambda log: NO_NOISE)
    (plain,) = find_recordings([log], load_model("nominal"))
    true = 0.0045  # half a row less half a step of the loops
    assert plain.lead - true > 0.015
    assert abs(found.lead - true) < 0.7 * (plain.lead - true)


def test_floor_is_what_noise_makes_of_the_true_model():
    log = recorded(0.06, 0.15, sensors=IDEAL)
    truth = load_model("paper").with_effects(Conditions().of_recording())
    sim = Linearised.of(log, truth)
    floor = noise_floor(sim)
    left = np.mean(sim.residual[:, 50:] ** 2)
    assert np.mean(floor.lasting) == pytest.approx(left, rel=0.5)
    assert np.mean(floor.white) < 0.1 * left


def test_noise_that_lasts_is_not_physics():
    first, second = (recorded(0.06, seed=seed) for seed in (1, 2))
    found = diagnose(first, test=second)
    assert found.verdict == "nothing_missing"
    assert "of the drive, 0.0" in found.reason
    account = found.errors.account
    assert account["lasting noise of the drive"] > 5 * account["white noise"]
    assert sum(account.values()) == pytest.approx(1.0)
