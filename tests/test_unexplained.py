"""Intervals hold what an effect that the model lacks does to the values."""

import numpy as np
import pytest

from ident.consistency import lump_weights
from ident.identification import identify
from ident.log import Log
from ident.report.outcome import Outcome
from youbot_env.model_file import load_model
from youbot_env.references import calibration_sequence
from youbot_env.simulation import Sensors, record_closed_loop

PAPER = load_model("paper")
KNOWN = {"drive_hold": {"kind": 0.0}, "drive_offset": {"d": 0.0}}


def misses(effects):
    """By how many half widths of its interval each lump misses the truth, and the result."""
    robot = PAPER.with_effects(effects)
    motion, times = calibration_sequence(seconds=60.0), np.arange(3000) / 50
    channels = record_closed_loop(robot, motion, times, Sensors(), seed=1)
    found = identify(Log("log", robot.platform, **channels, recording=KNOWN))
    missed = {}
    for name, (weights, _) in lump_weights(PAPER).items():
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
    assert not found.unexplained.certain
    assert found.unexplained.share == 0.0
    estimate = found.estimates[found.method]
    weights = lump_weights(PAPER)["x6"][0][:7]
    assert found.lumps["x6"].se == pytest.approx(estimate.combination(weights)[1])
    assert not any("intervals" in d for d in Outcome.of(found, found.prior).doubts)
