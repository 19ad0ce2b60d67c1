"""Intervals hold what an effect that the model lacks does to the values."""

from pathlib import Path

import numpy as np
import pytest

from ident.consistency import lump_weights
from ident.identifiability import Seen, observe_regression
from ident.identification import identify
from ident.log import Log
from ident.report.outcome import Outcome
from ident.unexplained import rolling_shift
from youbot_env.model_file import load_model
from youbot_env.references import calibration_sequence
from youbot_env.simulation import Sensors, record_closed_loop

PAPER = load_model("paper")
LOGS = Path(__file__).resolve().parent.parent / "ident" / "logs"
KNOWN = {"drive_hold": {"kind": 0.0}, "drive_offset": {"d": 0.0}}


def misses(effects):
    """By how many half widths of its interval each lump misses the truth, and the result."""
    robot = PAPER.with_effects(effects)
    motion, times = calibration_sequence(seconds=60.0), np.arange(3000) / 50
    channels = record_closed_loop(robot, motion, times, Sensors(), seed=1)
    found = identify(Log("log", robot.platform, **channels, recording=KNOWN))
    missed = {}
    for name, (weights, _) in lump_weights(PAPER).items():
        if found.lumps[name].ci95 is None:
            continue
        low, high = found.lumps[name].ci95
        truth = float(weights @ np.array(PAPER.values()))
        missed[name] = abs(found.lumps[name].value - truth) / (0.5 * (high - low))
    return missed, found


@pytest.mark.parametrize(
    "effects",
    [{"wheel_coulomb_friction": 0.3}, {"torque_gain": None}, {"caster_drag": None}],
    ids=lambda effects: next(iter(effects)),
)
def test_a_missing_effect_does_not_leave_the_truth_out(effects):
    missed, found = misses(effects)
    assert found.unexplained.certain
    assert max(missed.values()) < 1.0
    # From the scatter alone at least one would exclude it.
    estimate = found.estimates[found.method]
    weights = {name: w[:7] for name, (w, _) in lump_weights(PAPER).items()}
    scatter = {name: estimate.combination(w)[1] for name, w in weights.items()}
    assert any(missed[n] * found.lumps[n].se > 1.2 * scatter[n] for n in missed)
    assert sum("intervals are widened" in d for d in Outcome.of(found, found.prior).doubts) == 1


def test_nothing_is_widened_where_nothing_is_missing():
    found = misses({})[1]
    assert not found.unexplained.likely
    assert found.unexplained.share == 0.0
    estimate = found.estimates[found.method]
    weights = lump_weights(PAPER)["x6"][0][:7]
    assert found.lumps["x6"].se == pytest.approx(estimate.combination(weights)[1])
    assert not any("intervals" in d for d in Outcome.of(found, found.prior).doubts)


def test_finite_rollers_shift_values_as_told():
    missed, found = misses({"roller_ripple": {"size": 1.0}})
    assert found.rolling
    assert max(missed.values()) < 1.0
    # The scatter alone would exclude the truth, and the shift is most of what is wrong.
    shift = rolling_shift(whole(found.regression, found.model), found.logs, found.model)
    names, truth = found.regression.names, dict(zip(PAPER.names(), PAPER.values(), strict=True))
    at = names.index("mu2")
    estimate = found.estimates[found.method]
    error = estimate.values[at] - truth["mu2"]
    assert abs(error) > 5.0 * estimate.standard_errors[at]
    assert shift[at] == pytest.approx(error, rel=0.35)
    assert sum("add roller_ripple" in d for d in Outcome.of(found, found.prior).doubts) == 1


def test_ideal_rollers_shift_nothing():
    assert not misses({})[1].rolling


def test_intervals_of_the_bundled_log_of_real_rollers_hold():
    found = identify("youbot_fit")
    truth = load_model(LOGS / "truth.yaml").parameters.as_dict()
    assert found.rolling
    assert list(truth) == [name for name, q in found.parameters.items() if q.ci95 is not None]
    for name, value in truth.items():
        low, high = found.parameters[name].ci95
        assert low <= value <= high, name


def whole(regression, model):
    """All directions of a regression, as seen."""
    values = dict(zip(model.names(), model.values(), strict=True))
    start = np.array([values[name] for name in regression.names])
    return Seen.of(observe_regression(regression, model), regression, start, model)
