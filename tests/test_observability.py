"""Observability: what the paper's motions can tell is found from the Gramian, with no fit."""

import math
from dataclasses import replace

import numpy as np
import pytest

from ident.identifiability import observe_motion, observe_regression
from ident.log import Log
from ident.regression import build_regression
from ident.sequential import cut_calibration, identify_by_motion
from youbot_env.channels import channel_columns
from youbot_env.model_file import load_model
from youbot_env.parameters import to_x
from youbot_env.platform import omni3
from youbot_env.recording import record_motion
from youbot_env.references import make_reference
from youbot_env.simulation import AnalyticPlant, Sensors

NOMINAL = load_model("nominal")
SENSORS = Sensors()
PERIOD = 2 * math.pi / 0.8

# Physics of paper section 3: rank, directions without a trace, independent blocks.
PAPER = {
    "I": (6, [[1, 1, 0, 0, 1, 0, 0]], {"x4", "x6 x7", "x1 x2 x3 x5"}),
    "II": (6, [[1, 1, 0, -1, 0, 0, 0]], {"x5", "x6 x7", "x1 x2 x3 x4"}),
    "III": (5, [[0, 1, 0, 0, 0, 0, 0], [1, 0, -1, 0, 0, 0, 0]], None),
    "IV": (6, [[1, 0, 0, 0, 0, 0, 0]], None),
}


def motion(name, **options):
    return make_reference(name, frequency=0.8, **options)


def record(reference, seconds, model=NOMINAL, sensors=SENSORS, seed=1, dt=0.01):
    # Not eased in: a start along the path shows what the motion itself does not.
    columns = record_motion(
        AnalyticPlant(model, dt), reference, seconds, None, sensors, seed, ease=0.0
    )
    channels = {
        channel: np.column_stack([columns[name] for name in names])
        for channel, names in channel_columns(model.platform).items()
        if names[0] in columns
    }
    return Log("simulated", model.platform, columns["time"], **channels)


@pytest.mark.parametrize("name", PAPER)
def test_motions_see_what_the_paper_says(name):
    rank, null, blocks = PAPER[name]
    seen = observe_motion(motion(name), NOMINAL, 4 * PERIOD)
    assert seen.rank == rank
    np.testing.assert_allclose(seen.null, null, atol=1e-9)
    np.testing.assert_allclose(seen.gramian @ seen.null.T, 0.0, atol=1e-9)
    if blocks is not None:
        assert {" ".join(block) for block in seen.blocks} == blocks
    assert seen.condition == math.inf
    np.testing.assert_array_equal(np.isinf(seen.vif), np.any(null, axis=0))
    np.testing.assert_array_equal(seen.sees(), ~np.any(null, axis=0))


def test_turns_about_the_two_points_together_see_everything():
    both = make_reference("calibration", frequency=0.8, seconds=16 * PERIOD)
    seen = observe_motion(both, NOMINAL, 16 * PERIOD)
    first, second = (observe_motion(motion(name), NOMINAL, 4 * PERIOD) for name in ("I", "II"))
    assert np.linalg.matrix_rank(first.gramian + second.gramian, rtol=1e-9) == 7
    assert seen.rank == 7
    assert seen.condition < 10
    # Variance inflation factors are the diagonal of the inverse correlation matrix.
    length = np.sqrt(np.diag(seen.gramian))
    inverse = np.linalg.inv(seen.gramian / np.outer(length, length))
    np.testing.assert_allclose(seen.vif, np.diag(inverse), rtol=1e-6)


def test_the_gramian_is_that_of_the_paper():
    """Motion I by hand: x1 and x3 are L V_X' = Om', x4 is Om^2 in X, Om' in Y and Om^2 in yaw."""
    seen = observe_motion(motion("I"), NOMINAL, 4 * PERIOD)
    t = np.arange(0, 4 * PERIOD, 1e-3)
    sample = motion("I").sample(t)
    om, rate = sample.rate[2], sample.acceleration[2]
    expected = np.array([np.sum(rate**2 + om**4), np.sum(rate**2), 2 * np.sum(rate**2)]) * 1e-3
    np.testing.assert_allclose(np.diag(seen.gramian)[:3], expected, rtol=1e-3)
    assert seen.gramian[3, 3] == pytest.approx(np.sum(rate**2 + 2 * om**4) * 1e-3, rel=1e-3)


def test_words_name_parameters_and_motion():
    words = observe_motion(motion("I"), NOMINAL, 4 * PERIOD).words
    assert words[0].startswith("x1 + x2 + x5: mass, moment of inertia and lateral offset")
    assert "turning about a point 0.39 m to the left" in words[0]
    words = observe_motion(motion("II"), NOMINAL, 4 * PERIOD).words
    assert words[0].startswith("x1 + x2 - x4:")
    assert "to the rear" in words[0]
    words = observe_motion(motion("III"), NOMINAL, 4 * PERIOD).words
    assert words[0].startswith("x2 (moment of inertia) leaves no trace")
    assert words[1].startswith("x1 - x3: mass and spin inertia of the wheels")
    assert "translation without turning" in words[1]
    words = observe_motion(motion("IV"), NOMINAL, 4 * PERIOD).words
    assert words[0].startswith("x1 (mass) leaves no trace")
    assert "the centre keeps its velocity" in words[0]


def test_small_offsets_of_the_centre_of_mass_are_said_to_be_faint():
    seen = observe_motion(motion("calibration", seconds=16 * PERIOD), NOMINAL, 16 * PERIOD)
    assert seen.rank == 7
    text = " ".join(seen.words)
    assert "forward offset" in text
    assert "lateral offset" in text
    # A direction's share is what it moves the drive's force by.
    assert np.all(seen.share[3:5] < 0.02)
    assert np.all(seen.share[5:] > 0.1)


@pytest.mark.parametrize("name", PAPER)
def test_noise_of_a_log_is_not_taken_for_sight(name):
    rank, null, blocks = PAPER[name]
    seen = observe_regression(build_regression(record(motion(name), 2 * PERIOD), NOMINAL), NOMINAL)
    assert seen.rank == rank
    np.testing.assert_allclose(seen.null, null, atol=0.05)
    if blocks is not None:
        assert {" ".join(block) for block in seen.blocks} == blocks


def test_a_robot_at_rest_shows_nothing():
    still = make_reference("circle", speed=0.0, heading="fixed")
    seen = observe_motion(still, NOMINAL, 10.0)
    assert seen.rank == 0
    assert seen.blocks == ()
    assert len(seen.words) == 7
    assert all("hardly moving" in words for words in seen.words)
    log = record(make_reference("circle", speed=0.0), 10.0)
    assert observe_regression(build_regression(log, NOMINAL), NOMINAL).rank <= 3


def test_effects_take_part_under_their_names():
    model = NOMINAL.with_effects({"torque_offset": {"b_fl": 0.1}, "wheel_coulomb_friction": None})
    reference = make_reference("calibration", frequency=0.8, seconds=40.0)
    offsets = [f"torque_offset.b_{wheel}" for wheel in model.platform.wheel_names]
    log = record(reference, 40.0, model)
    for seen in (
        observe_motion(reference, model, 40.0),
        observe_regression(build_regression(log, model), model),
    ):
        assert seen.names == ("x1", "x2", "x3", "x4", "x5", "x6", "x7", *seen.names[7:])
        assert set(offsets) | {"wheel_coulomb_friction.fc"} == set(seen.names[7:])
        # The torque direction (1, 1, -1, -1) moves nothing: paper section 2.
        assert seen.rank == len(seen.names) - 1
        found = dict(zip(seen.names, seen.null[0], strict=True))
        np.testing.assert_allclose([found[name] for name in offsets], [1, 1, -1, -1], atol=0.02)
        assert any(all(name in words for name in offsets) for words in seen.words)


def test_columns_of_effects_are_those_of_a_noise_free_log():
    model = NOMINAL.with_effects({"wheel_coulomb_friction": None, "floor_slope": None})
    reference = motion("eight")
    exact = observe_motion(reference, model, 15.0)
    log = record(reference, 15.0, model, sensors=None)
    logged = observe_regression(build_regression(log, model), model)
    length = np.sqrt(np.diag(exact.gramian) / np.diag(logged.gramian))[7:]
    assert np.all((length > 0.8) & (length < 1.3))  # filters and loops take a part


def test_three_omni_wheels_cannot_tell_two_frictions_apart_without_turning():
    """Friction of wheels and of rollers are both isotropic there; a mecanum base differs in Y."""
    model = replace(NOMINAL, platform=omni3())
    seen = observe_motion(motion("III"), model, 4 * PERIOD)
    assert seen.rank == 4
    np.testing.assert_array_equal(
        seen.null != 0, [[0, 1, 0, 0, 0, 0, 0], [1, 0, 1, 0, 0, 0, 0], [0, 0, 0, 0, 0, 1, 1]]
    )
    assert observe_motion(motion("multisine"), model, 4 * PERIOD).rank == 7


def test_identification_motion_by_motion_finds_the_robot():
    truth = load_model("paper")
    log = record(motion("calibration", seconds=60.0), 60.0, truth, dt=0.02)
    found = identify_by_motion(cut_calibration(log), NOMINAL)
    x = np.array(to_x(truth.parameters.theta(truth.platform), truth.platform))
    assert found.motions == ("I", "III", "II", "IV")
    # Which motion determines which parameter alone: physics of paper section 3.
    sees = {
        "I": [0, 0, 1, 1, 0, 1, 1],
        "III": [0, 0, 0, 1, 1, 1, 1],
        "II": [0, 0, 1, 0, 1, 1, 1],
        "IV": [0, 1, 1, 1, 1, 1, 1],
    }
    np.testing.assert_array_equal(np.isfinite(found.alone), [sees[m] for m in found.motions])
    np.testing.assert_array_equal(np.isfinite(found.alone_errors), np.isfinite(found.alone))
    score = (found.alone - x) / found.alone_errors
    assert np.nanmax(np.abs(score)) < 4.5
    # Mass and inertia come out once others are put in.
    assert found.source[1] == "IV"
    assert np.abs((found.decomposed - x) / found.decomposed_errors).max() < 4.5
    assert np.abs((found.joint - x) / found.joint_errors).max() < 4.5
    assert np.all(found.joint_errors < found.decomposed_errors * 1.1)


def test_what_no_part_sees_stays_nan():
    log = record(motion("III"), 2 * PERIOD)
    found = identify_by_motion([("III", log)], NOMINAL)
    unseen = [True, True, True, False, False, False, False]
    np.testing.assert_array_equal(np.isnan(found.decomposed), unseen)
    np.testing.assert_array_equal(np.isnan(found.joint), unseen)
    assert found.source[:3] == ("", "", "")
    np.testing.assert_allclose(found.decomposed[3:], found.joint[3:])
