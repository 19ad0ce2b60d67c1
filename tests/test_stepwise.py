"""The loop one step at a time: the same errors, effects and verdicts as the loop in one go."""

import numpy as np
import pytest
from short_logs import HIDDEN, record_two

from ident import diagnose
from ident.log import Log
from ident.report import interactive
from ident.results import quantity_columns
from ident.stepwise import Stepwise


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    """Two short logs of a robot with dry friction that the nominal model lacks."""
    return [Log.load(path) for path in record_two(tmp_path_factory.mktemp("stepwise"))]


@pytest.fixture(scope="module")
def loop(logs):
    """The loop on them, with the best effect added."""
    chain = Stepwise(logs[0], "nominal", logs[1])
    chain.best_before = chain.best.effect
    chain.add(chain.best.effect)
    return chain


def test_the_hidden_effect_is_offered_first_and_lowers_the_held_out_error(loop):
    assert loop.best_before == "wheel_coulomb_friction"
    start, refit, last = (stage.nrmse for stage in loop.stages)
    assert last < 0.5 * refit < 0.5 * start
    low, high = loop.stages[-1].sizes["wheel_coulomb_friction"]["fc"].ci95
    assert low < HIDDEN < high


def test_errors_and_verdict_are_those_of_a_diagnosis(loop, logs):
    found = diagnose(logs[0], "nominal", logs[1])
    assert [step.best.identifier for step in found.steps] == list(loop.added)
    assert loop.verdict()[0] == found.verdict
    # The diagnosis ends on all rows with free clocks, the loop on thinned ones.
    assert loop.stages[1].nrmse == pytest.approx(found.errors.before, rel=0.15)
    assert loop.stages[-1].nrmse == pytest.approx(found.errors.after, rel=0.3)


def test_stepping_back_gives_the_stage_before_again(loop):
    before = [(stage.name, stage.nrmse) for stage in loop.stages]
    loop.back(1)
    assert loop.added == ()
    assert [(stage.name, stage.nrmse) for stage in loop.stages] == before[:2]
    loop.add("wheel_coulomb_friction")
    assert [(stage.name, stage.nrmse) for stage in loop.stages] == before


def test_an_effect_is_not_added_twice_nor_made_up(loop):
    with pytest.raises(ValueError, match="already"):
        loop.add("wheel_coulomb_friction")
    with pytest.raises(ValueError, match="cannot be tried"):
        loop.add("nonsense")


def test_held_out_stretches_lie_in_the_log_and_hold_no_fitted_window(loop):
    number = loop.judging
    spans = loop.held_out(number)
    log = loop.parts[number].log
    assert spans
    assert all(0 <= begin < end <= log.duration + 1.0 for begin, end in spans)
    assert loop.held_out(1 - number) == []  # the other log is fitted as a whole


def test_figures_draw_what_the_results_hold(loop):
    stages = [(stage.name, k, stage.base) for k, stage in enumerate(loop.stages) if stage.base]
    drawn = interactive.parameters(stages)["data"]
    values = [trace["y"][0] for trace in drawn if trace["name"] == "refit"]
    assert values == [float(v) for v in quantity_columns(loop.stages[1].base)["value"]]
    steps = interactive.staircase(("a", "b"), (0.5, 0.05), 0.01)["data"]
    assert steps[0]["y"] == [50.0, 5.0]


def test_residual_torque_steps_at_zero_speed_before_and_is_flat_after(loop, logs):
    from ident.comparison import compare

    number = loop.judging
    log = loop.parts[number].log
    pair = [(s.name, k, compare(log, [s.models[number]])[0])
            for k, s in enumerate(loop.stages) if k]  # fmt: skip
    figure = interactive.residual_torques(pair)
    lines = [t for t in figure["data"] if t.get("mode") == "lines+markers"]
    steps = {}
    for trace in lines:
        x, y = np.array(trace["x"]), np.array(trace["y"])
        steps.setdefault(trace["name"], []).append(y[x > 0].mean() - y[x < 0].mean())
    before, after = (np.mean(np.abs(v)) for v in steps.values())
    assert before > 0.1  # N m
    assert after < 0.2 * before


def test_maps_show_the_resistance_that_the_model_lacks_along_the_velocity(loop):
    from ident.comparison import compare

    number = loop.judging
    log = loop.parts[number].log
    pair = [(s.name, k, compare(log, [s.models[number]])[0])
            for k, s in enumerate(loop.stages) if k]  # fmt: skip
    figure = interactive.residual_map(pair, "velocity map")
    before, after = (np.array(t["z"], float) for t in figure["data"] if t["type"] == "heatmap")
    assert np.nanmedian(after) < 0.3 * np.nanmedian(before)
    # Fitted viscous friction stands in for a part of it, so that slow motion shows it, fast none.
    lost = []
    for _, _, one in pair:
        x, y, force = interactive._mapped(one, "velocity map")
        vx, vy = np.meshgrid(x, y, indexing="ij")
        slow = np.hypot(vx, vy) < 0.5 * np.hypot(vx, vy).max()
        lost.append(float(np.nanmean((force[..., 0] * vx + force[..., 1] * vy)[slow])))
    assert lost[0] > 5 * abs(lost[1])
