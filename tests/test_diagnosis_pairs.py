"""Two effects at once: found together where neither shows alone, and none invented."""

import numpy as np
import pytest

from ident import diagnose
from ident.diagnosis.refit import Refits, candidate, refit
from ident.diagnosis.rounds import Round
from ident.diagnosis.screening import best_pair
from ident.diagnosis.selection import Search
from ident.diagnosis.splits import divide
from ident.log import Log
from youbot_env.model_file import load_model
from youbot_env.references import SmoothRandom, calibration_sequence
from youbot_env.simulation import Sensors, record_closed_loop

PAPER, NOMINAL = load_model("paper"), load_model("nominal")


def record(model, motion, seconds, seed):
    times = np.arange(round(seconds * 100)) / 100
    # The motion begins at once: the jerk of the start tells a lag of the drive from its load.
    channels = record_closed_loop(model, motion, times, Sensors(), seed=seed, ease=0.0)
    return Log(f"log{seed}", model.platform, **channels)


def logs(effects):
    model = PAPER.with_effects(effects)
    return (
        record(model, calibration_sequence(seconds=80.0), 80.0, 1),
        record(model, SmoothRandom(0.35, 1.5), 40.0, 2),
    )


def first_round(fit, test):
    parts = divide([fit], [test], NOMINAL)
    refined, simulations = refit(parts, NOMINAL)
    refined, simulations = refit(parts, refined.model)
    return Round.of(parts, simulations, [], 0)


@pytest.fixture(scope="module")
def two():
    return logs({"load_dependent_friction": {"k": 0.08}, "actuator_lag": {"T": 0.03}})


def test_a_pair_explains_what_no_single_effect_does(two):
    now = first_round(*two)
    alone = max(now.gains)
    first, second = best_pair(now.table, alone)
    names = {now.trial(k).identifier for k in (first, second)}
    assert "load_dependent_friction" in names
    assert names & {"actuator_lag", "actuator_delay"}
    together = now.table.gain(first, beside=second)
    assert 1.0 - together < 0.5 * (1.0 - alone)
    # Beside the other half the size is nearer to what is hidden.
    load = first if now.trial(first).identifier == "load_dependent_friction" else second
    late = second if load == first else first
    right = now.table.coefficients(load, beside=late)[0] * now.trial(load).units[0]
    wrong = now.table.coefficients(load)[0] * now.trial(load).units[0]
    assert abs(right - 0.08) < 0.8 * abs(wrong - 0.08)


def test_diagnosis_names_both_with_their_sizes(two):
    found = diagnose(two[0], NOMINAL, two[1])
    assert found.verdict in ("named", "ambiguous")
    groups = [set(step.group) for step in found.steps]
    assert {"load_dependent_friction"} in groups
    assert any("actuator_lag" in group for group in groups)
    load = next(s for s in found.steps if s.best.identifier == "load_dependent_friction")
    size = load.sizes(found.model)["k"]
    assert abs(size.value - 0.08) < 3.5 * size.se < 0.01


def test_nothing_hidden_gives_no_pair():
    now = first_round(*logs({}))
    assert now.pair([]) is None


def test_one_effect_gives_no_pair():
    fit, test = logs({"wheel_coulomb_friction": 0.15})
    now = first_round(fit, test)
    assert now.pair(now.choose()) is None


@pytest.mark.long
def test_a_step_is_chosen_again_beside_what_came_later(two):
    parts = divide([two[0]], [two[1]], NOMINAL)
    base, simulations = refit(parts, NOMINAL)
    first = Round.of(parts, simulations, [], 0)
    at = Search(Refits(parts), base, [], [0], lambda what: None, first, first, [])
    # Begin with a wrong guess for the friction, then add the delay.
    guess = next(k for k, t in enumerate(first.table.trials)
                 if t.identifier == "rolling_resistance")  # fmt: skip
    at.add([candidate(parts, first.table, guess)], 1.0)
    at.last = at.after(at.steps[0].best.simulations, None)
    late = next(k for k, t in enumerate(at.last.table.trials)
                if t.identifier == "actuator_lag")  # fmt: skip
    at.add([candidate(parts, at.last.table, late)], 1.0)
    at.settle()
    assert at.steps[0].best.identifier == "load_dependent_friction"
    assert at.steps[0].beside == {"actuator_lag"}
