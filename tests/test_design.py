"""Experiment design: expected intervals are those of simulated experiments, designs beat I-IV."""

import json
import math
import os
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from ident.design import (
    Criterion,
    Limits,
    NoiseModel,
    design_motion,
    intervals,
    quantities,
    simulate,
)
from ident.design.calibration import best_calibration
from ident.design.noise import RATE
from ident.motion_columns import motion_columns
from youbot_env.backend import NUMPY
from youbot_env.model_file import load_model
from youbot_env.parameters import UNITS
from youbot_env.references import (
    Fourier,
    MotionFileError,
    load_motion,
    make_reference,
    save_motion,
)
from youbot_env.simulation import Sensors

ROOT = Path(__file__).parent.parent
NOMINAL = load_model("nominal")
PERIOD = 8.0
MOTION = Fourier(
    frequency=2 * math.pi / PERIOD,
    amplitudes=((0.1, 0.05, 0.02), (0.12, 0.03, 0.02), (0.5, 0.2, 0.05)),
    phases=((0.0, 1.0, 2.0), (0.5, -1.0, 0.3), (2.0, 0.1, 1.0)),
)


def expected(motion, model, seconds, sensors=None):
    time = np.arange(800) * PERIOD / 800
    columns = motion_columns(motion.sample(time), model)
    information = NoiseModel.of(model, sensors).information(columns, PERIOD / 800)
    return information.covariance(seconds * RATE)


@pytest.fixture(scope="module")
def small():
    """A small search, fast enough for tests."""
    return design_motion("m0", NOMINAL, seconds=24.0, harmonics=4, starts=2, seed=1)


@pytest.mark.parametrize(
    "sensors",
    [
        Sensors(),
        # Wheel-speed noise alone: it enters the residual through damping, mass and a derivative.
        Sensors(wheel_torque=0.0, wheel_torque_step=0.0, wheel_velocity=0.05),
    ],
)
def test_expected_intervals_are_those_of_simulated_experiments(sensors):
    experiment = simulate(MOTION, NOMINAL, 24.0, 100, sensors=sensors)
    predicted = intervals(expected(MOTION, NOMINAL, 24.0, sensors), NOMINAL)
    scatter = experiment.scatter()
    # A standard deviation from 100 runs is good to 7 %.
    ratios = np.array([scatter[name] / predicted[name] for name in UNITS])
    np.testing.assert_allclose(ratios, 1.0, atol=0.2)
    assert ratios.mean() == pytest.approx(1.0, abs=0.1)
    error = experiment.estimates.mean(axis=0) - np.array(NOMINAL.values())
    assert np.all(np.abs(error) < 0.4 * experiment.estimates.std(axis=0))


def test_expected_intervals_are_those_an_identification_reports():
    reported = simulate(MOTION, NOMINAL, 100.0, 12).reported()
    predicted = intervals(expected(MOTION, NOMINAL, 100.0), NOMINAL)
    ratios = [reported[name] / predicted[name] for name in UNITS]
    assert np.mean(ratios) == pytest.approx(1.0, abs=0.1)
    np.testing.assert_allclose(ratios, 1.0, atol=0.15)


def test_twice_the_time_and_half_the_noise_shrink_intervals_as_they_must():
    one = expected(MOTION, NOMINAL, 20.0)
    np.testing.assert_allclose(expected(MOTION, NOMINAL, 80.0), one / 4)
    quiet = Sensors(*(value / 2 for value in (0.02, 4.053e-3, 0.03, 8.6557e-4, 1e-3, 2e-3)))
    np.testing.assert_allclose(expected(MOTION, NOMINAL, 20.0, quiet), one / 4)


def test_the_gramian_is_that_of_filtered_columns():
    """A sine through F = a / (p + a): the energy falls by 1 + (w / a)^2."""
    still = replace(MOTION, amplitudes=((0.1, 0, 0), (0, 0, 0), (0, 0, 0)))
    time = np.arange(800) * PERIOD / 800
    columns = motion_columns(still.sample(time), NOMINAL)
    noise = NoiseModel.of(NOMINAL)
    gramian = noise.information(columns, PERIOD / 800).gramian
    energy = np.einsum("nap,naq->pq", columns, columns) / 800
    gain = 1 / (1 + (2 * math.pi / PERIOD / noise.corner) ** 2)
    np.testing.assert_allclose(gramian, gain * energy, atol=1e-12 * energy.max())


def test_a_design_beats_the_paper_within_the_limits(small):
    assert small.expected()["m0"] < 0.75 * small.expected_calibration()["m0"]
    limits, time = small.limits, np.linspace(0, small.motion.period, 20011)
    _, use = limits.evaluate(small.motion.sample(time), NOMINAL)
    assert use.max() <= 1.0005
    motion = small.motion.sample(time)
    assert np.hypot(*motion.rate[:2]).max() <= limits.speed * 1.0005
    assert np.abs(motion.rate[2]).max() <= limits.yaw_rate * 1.0005
    assert np.hypot(*motion.acceleration[:2]).max() <= limits.acceleration * 1.0005
    # It starts at the origin, from rest, and repeats.
    for part in (motion.pose, motion.rate):
        np.testing.assert_allclose([component[0] for component in part], 0.0, atol=1e-9)
        np.testing.assert_allclose([component[-1] for component in part], 0.0, atol=1e-9)
    assert 24.0 / small.motion.period == pytest.approx(round(24.0 / small.motion.period))


def test_equal_seeds_give_equal_designs(small):
    again = design_motion("m0", NOMINAL, seconds=24.0, harmonics=4, starts=2, seed=1)
    assert again.motion == small.motion
    values = [candidate.value for candidate in small.candidates]
    assert values == sorted(values)


def test_a_torque_limit_binds():
    limits = Limits(torque=0.6)
    found = design_motion("m0", NOMINAL, 24.0, limits, harmonics=3, starts=1)
    shares = limits.shares(found.candidates[0].use)
    assert 0.9 < shares["torque"] <= 1.0
    assert max(shares.values()) <= 1.0


@pytest.mark.parametrize("target", ["m0", "I1"])
def test_shipped_motions_need_at_most_six_tenths_of_the_interval_of_the_paper(target):
    """At 60 s and equal limits, with every one of motions I-IV at its best base frequency."""
    motion = load_motion(ROOT / "youbot_env" / "motions" / f"{target}.yaml")
    limits, noise = Limits(), NoiseModel.of(NOMINAL)
    time = np.arange(2000) * motion.period / 2000
    columns, use = limits.evaluate(motion.sample(time), NOMINAL)
    assert use.max() <= 1.001
    information = noise.information(columns, motion.period / 2000)
    paper = best_calibration(Criterion.of(target, NOMINAL), NOMINAL, limits, 60.0, noise)
    ours, theirs = (
        intervals(part.covariance(60.0 * RATE), NOMINAL)
        for part in (information, paper.information)
    )
    assert ours["m0"] <= 0.6 * theirs["m0"]
    assert ours["I1"] <= 0.6 * theirs["I1"]


def test_the_best_calibration_keeps_the_limits_and_beats_the_default():
    limits, noise = Limits(), NoiseModel.of(NOMINAL)
    criterion = Criterion.of("m0", NOMINAL)
    best = best_calibration(criterion, NOMINAL, limits, 60.0, noise)
    assert best.searched > 500
    informations = []
    for part, length in zip(best.reference.parts, best.reference.lengths, strict=True):
        time = np.arange(3000) * length / 3000
        columns, use = limits.evaluate(part.sample(time), NOMINAL)
        assert 0.97 < use.max() <= 1.001
        informations.append(noise.information(columns, length / 3000))
    gramian = np.mean([part.gramian for part in informations], axis=0)
    np.testing.assert_allclose(gramian, best.information.gramian, rtol=1e-3, atol=1e-4)
    # The paper's motions as shipped, one base frequency for all.
    time = np.arange(6000) * 0.01
    usual = make_reference("calibration", frequency=0.84, seconds=60.0).sample(time)
    information = noise.information(motion_columns(usual, NOMINAL), 0.01)
    assert best.information.covariance(1.0)[0, 0] < information.covariance(1.0)[0, 0]


def test_criteria_are_what_they_say():
    covariance = expected(MOTION, NOMINAL, 20.0)
    theta = np.array(NOMINAL.values())
    assert Criterion.of("m0", NOMINAL).value(covariance) == pytest.approx(
        0.5 * math.log(covariance[0, 0])
    )
    known = quantities(NOMINAL)
    lever = NOMINAL.platform.lever
    assert known["x1"].value == pytest.approx(lever**2 * 29.9)
    assert known["x1+x3"].gradient @ theta == pytest.approx(known["x1+x3"].value)
    # a_x = (first moment) / (mass without wheels); at a_x = 0 its error is that of the moment.
    assert intervals(covariance, NOMINAL)["a_x"] == pytest.approx(
        1.96 * math.sqrt(covariance[3, 3]) / (29.9 - 5.6)
    )
    for name in ("A", "D"):
        criterion = Criterion.of(name, NOMINAL)
        assert criterion.value(covariance / 4) == pytest.approx(
            criterion.value(covariance) - math.log(2)
        )
        both = criterion.value(np.stack([covariance, 2 * covariance]))
        np.testing.assert_allclose(both[0], criterion.value(covariance))


def test_wrong_requests_name_value_and_remedy():
    with pytest.raises(ValueError, match="'mass'"):
        design_motion("mass", NOMINAL)
    with pytest.raises(ValueError, match=r"seconds = 2.0.*need"):
        design_motion("m0", NOMINAL, seconds=2.0)
    with pytest.raises(ValueError, match=r"speed = -1"):
        Limits(speed=-1)
    with pytest.raises(ValueError, match="harmonics = 1"):
        design_motion("m0", NOMINAL, harmonics=1)
    with pytest.raises(ValueError, match="runs = 2"):
        simulate(MOTION, NOMINAL, 10.0, runs=2)
    with pytest.raises(ValueError, match="floor_slope"):
        simulate(MOTION, NOMINAL.with_effects({"floor_slope": None}), 10.0)


def test_motion_files_come_back_as_they_went(tmp_path):
    path = tmp_path / "m.yaml"
    save_motion(replace(MOTION, purpose="m0", about={"seconds": 60.0}), path)
    back = make_reference(str(path))
    assert back.purpose == "m0"
    assert back.about == {"seconds": 60.0}
    time = np.linspace(0, 20, 500)
    for ours, theirs in zip(back.sample(time), MOTION.sample(time), strict=True):
        np.testing.assert_allclose(ours, theirs, atol=1e-7)
    rates = np.array(back.sample(time).twist(NUMPY)[:2])
    assert np.abs(rates).max() < 0.5


def test_unusable_motion_files_say_why(tmp_path):
    path = tmp_path / "m.yaml"
    with pytest.raises(MotionFileError, match=r"no motion file"):
        make_reference(path)
    save_motion(MOTION, path)
    with pytest.raises(ValueError, match="leave out"):
        make_reference(path, speed=0.2)
    text = path.read_text()
    for old, new, message in (
        ("frequency", "frequenzy", "frequenzy"),
        ("fourier", "spline", "spline"),
        ("x:", "x: 3\nz:", "'z'"),
        ("- [0.1, 0]", "- [0.1, .nan]", "pair"),
        ("- [0.1, 0]", "- [0.1]", "pair"),
        ("  - [0.1, 0]\n", "", "equally many"),
    ):
        path.write_text(text.replace(old, new, 1))
        with pytest.raises(MotionFileError, match=message):
            load_motion(path)


def test_the_script_designs_saves_and_tells(tmp_path):
    motion, result = tmp_path / "m.yaml", tmp_path / "m.json"
    command = [
        sys.executable, str(ROOT / "scripts" / "design.py"), "--for", "x1+x3", "--seconds", "16",
        "--harmonics", "3", "--starts", "1", "--runs", "3", "--out", str(motion),
        "--json", str(result),
    ]  # fmt: skip
    done = subprocess.run(
        command, capture_output=True, text=True, cwd=tmp_path,
        env=os.environ | {"PYTHONPATH": str(ROOT), "COLUMNS": "120"},
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert "x1+x3" in done.stdout
    data = json.loads(result.read_text())
    row = data["quantities"]["x1+x3"]
    assert row["ratio"] == pytest.approx(row["designed"] / row["calibration"])
    assert set(data["calibration_frequencies"]) == {"I", "II", "III", "IV"}
    assert make_reference(motion).purpose == "x1+x3"
    assert str(tmp_path) not in motion.read_text()
