"""Diagnosis: hidden effects are named, silence where nothing is hidden, refusal of weak records."""

import json
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from long_cases import long
from shared_data import shared

from ident import diagnose
from ident.benchmark.cases import Case, record_case
from ident.benchmark.outside import FloorPatches, LateralCubicDrag
from ident.contradiction import wheels_agree
from ident.diagnosis.experiments import distance, menu, separating
from ident.diagnosis.lack_of_fit import dependences
from ident.diagnosis.refit import refit
from ident.diagnosis.score_table import ScoreTable
from ident.diagnosis.splits import FIT, SELECT, VERIFY, divide
from ident.diagnosis.trials import strongest_orders, trials
from ident.log import Log
from ident.noise_floor import noise_floor
from ident.output_error import refine
from ident.residuals import scaled_error
from ident.sensitivity import Linearised
from youbot_env.effects import get_effect
from youbot_env.model import ActiveEffect
from youbot_env.model_file import load_model
from youbot_env.references import (
    Fourier,
    SmoothRandom,
    calibration_sequence,
    load_motion,
    make_reference,
)
from youbot_env.simulation import Sensors, record_closed_loop

ROOT = Path(__file__).resolve().parent.parent
PAPER, NOMINAL = load_model("paper"), load_model("nominal")


def record(model, reference, seconds, seed):
    times = np.arange(seconds * 100) / 100
    channels = record_closed_loop(model, reference, times, Sensors(), seed=seed)
    return Log(f"log{seed}", model.platform, **channels)


def pair(effects):
    model = PAPER.with_effects(effects) if isinstance(effects, dict) else effects
    fit = record(model, calibration_sequence(seconds=80.0), 80.0, 1)
    return fit, record(model, SmoothRandom(0.35, 1.5), 40.0, 2)


@pytest.fixture(scope="module")
def quiet():
    return pair({})


@pytest.fixture(scope="module")
def sticky():
    return pair({"wheel_coulomb_friction": 0.15})


def test_nothing_is_named_where_nothing_is_hidden(quiet):
    fit, test = quiet
    found = diagnose(fit, NOMINAL, test)
    assert found.verdict == "nothing_missing"
    assert found.as_dict()["named"] == []
    # Silence means something: typical sizes would have been seen.
    seen = {one.effect: one for one in found.minimum_detectable}
    for name in ("wheel_coulomb_friction", "floor_slope", "torque_gain", "cable_tether"):
        assert seen[name].power > 0.95
        assert seen[name].smallest < seen[name].typical
    assert diagnose(fit, NOMINAL).verdict == "nothing_missing"


@pytest.mark.parametrize("alone", [False, True])
def test_a_hidden_effect_is_named_with_its_size(sticky, alone):
    fit, test = sticky
    found = diagnose(fit, NOMINAL, None if alone else test)
    assert found.verdict == "named"
    (name,) = found.as_dict()["named"]
    assert name["effect"] == "wheel_coulomb_friction"
    assert name["size"]["fc"]["value"] == pytest.approx(0.15, rel=0.02)
    assert name["p_adjusted"] < 0.05
    assert name["error_drop"] > 0.5
    assert found.errors.after < 2.5 * found.errors.floor
    # The base parameters are those of the robot again.
    assert found.model.parameters.m0 == pytest.approx(PAPER.parameters.m0, rel=0.02)


@pytest.mark.parametrize(
    "effects",
    [
        {"floor_slope": {"sx": 0.012, "sy": -0.008}},
        {"torque_gain": {"e_rr": 0.1}},
        long({"torque_ripple": {"a": 0.2, "b": 0.1, "k": 4.6}}),
        long({"torque_dead_zone": 0.2}),
    ],
)
def test_effects_of_every_kind_are_named(effects):
    fit, test = pair(effects)
    found = diagnose(fit, NOMINAL, test)
    assert found.verdict == "named"
    assert [step.best.identifier for step in found.named] == list(effects)


def test_two_effects_are_found_one_after_the_other():
    effects = {"wheel_coulomb_friction": 0.15, "floor_slope": {"sx": 0.012, "sy": -0.008}}
    fit, test = pair(effects)
    found = diagnose(fit, NOMINAL, test)
    assert found.verdict == "named"
    assert {step.best.identifier for step in found.named} == set(effects)
    assert np.all(np.diff(found.errors.nrmse) < 0)


def test_delay_and_lag_are_a_group_with_the_motion_that_separates_them():
    fit, test = pair({"actuator_delay": 0.02})
    found = diagnose(fit, NOMINAL, test)
    assert found.verdict in ("named", "ambiguous")
    assert "actuator_delay" in found.steps[0].group
    delay, lag = (PAPER.with_effects({n: 0.02}) for n in ("actuator_delay", "actuator_lag"))
    experiment = separating({"actuator_delay": delay, "actuator_lag": lag}, 5e-5)
    assert experiment.motion == "chirp"
    assert experiment.odds > 100 * dict(experiment.alternatives)["slow_ramps"]
    chirp = menu()["chirp"]
    assert distance(delay, delay, chirp) < 1e-3 * distance(delay, lag, chirp)


def test_what_no_effect_explains_is_said_to_lie_outside():
    patches = FloorPatches()
    hidden = ActiveEffect(patches, patches.complete({"c": 150.0}, PAPER.platform))
    found = diagnose(*pair(replace(PAPER, effects=(hidden,)))[:1], NOMINAL)
    assert found.verdict in ("outside_library", "cannot_say")
    assert found.as_dict()["named"] == []


@pytest.mark.long
def test_what_acts_in_a_few_moments_is_compared_though_their_number_proves_little():
    recorded = record_case(Case("single", ("torque_saturation",), 0.5, 0, 1))
    found = diagnose(recorded.fit, NOMINAL, recorded.verify)
    assert [step.best.identifier for step in found.named] == ["torque_saturation"]
    limit = found.named[0].sizes(found.model)["limit"].value
    assert limit == pytest.approx(recorded.truth.effects[0].values["limit"], rel=0.01)


@pytest.mark.long
def test_a_payload_is_found_with_its_moment():
    effects = {"payload_change": {"dm": 12.0, "dI": 0.3, "dpx": -0.6, "dpy": 0.3, "t0": 37.0}}
    fit, test = pair(effects)
    found = diagnose(fit, NOMINAL, test)
    assert [step.best.identifier for step in found.named] == ["payload_change"]
    sizes = found.named[0].sizes(found.model)
    assert sizes["t0"].value == pytest.approx(37.0, abs=0.1)
    assert sizes["dm"].value == pytest.approx(12.0, rel=0.1)


def test_a_law_that_looks_like_one_of_the_library_is_told_by_what_is_left():
    drag = LateralCubicDrag()
    hidden = ActiveEffect(drag, drag.complete({"c": 730.0}, PAPER.platform))
    fit = record(replace(PAPER, effects=(hidden,)), SmoothRandom(0.3, 1.0), 80, 1)
    test = record(replace(PAPER, effects=(hidden,)), SmoothRandom(0.3, 1.5), 40, 2)
    assert diagnose(fit, NOMINAL, test).verdict in ("outside_library", "cannot_say")


def test_weak_records_are_refused_with_the_reason(quiet):
    fit, test = quiet
    short = diagnose(fit.part(0.0, 10.0), NOMINAL, test)
    assert short.verdict == "cannot_say"
    assert "20 s" in short.reason
    assert short.experiment.motion == "calibration"
    still = replace(fit, wheel_velocity=0.001 * fit.wheel_velocity)
    assert "hardly moves" in diagnose(still, NOMINAL, test).reason
    for channel, size in (("wheel_torque", 1.0), ("wheel_velocity", 4.0)):
        signal = np.clip(getattr(fit, channel), -size, size)
        clipped = diagnose(replace(fit, **{channel: signal}), NOMINAL, test)
        assert clipped.verdict == "cannot_say"
        assert "clipped" in clipped.reason
        assert not clipped.named


def test_windows_are_never_fitted_and_judged_at_once(quiet):
    fit, test = quiet
    first, second = divide([fit], [test], NOMINAL)
    assert set(first.role) == {FIT}
    assert set(second.role) == {SELECT, VERIFY}
    assert list(second.role) == sorted(second.role)
    (alone,) = divide([fit], [], NOMINAL)
    assert set(alone.role) == {FIT, VERIFY}
    keep = alone.windows(FIT)
    spoiled = fit.wheel_velocity.copy()
    for window in np.flatnonzero(alone.windows(VERIFY)):
        length = round(fit.duration / 28 / fit.dt)
        spoiled[(window * length) + 30 : (window + 1) * length - 5] += 3.0
    other = replace(fit, wheel_velocity=spoiled)
    values = [np.array(refine([log], NOMINAL, keep=[keep]).model.values()) for log in (fit, other)]
    assert values[0] == pytest.approx(values[1], rel=0.02)


def test_traces_are_what_adding_the_effect_changes(quiet):
    fit, _ = quiet
    model = refine([fit], NOMINAL).model
    sim = Linearised.of(fit, model)
    for name in ("wheel_coulomb_friction", "actuator_lag", "floor_slope"):
        small = {p.name: 0.02 * p.default for p in get_effect(name).parameters if p.linear}
        other = model.with_effects({name: small or {"T": 0.02}})
        trace = sim.model_columns([(model, other)])[..., 0]
        exact = sim.residual - Linearised.of(fit, other).residual
        assert np.linalg.norm(trace - exact) < 0.15 * np.linalg.norm(exact)


def test_held_out_gain_of_pure_noise_is_nothing(quiet):
    fit, test = quiet
    parts = divide([fit], [test], NOMINAL)
    refined, simulations = refit(parts, NOMINAL)
    generic = dependences([fit, test])
    tried = trials(refined.model, [fit])
    table = ScoreTable.of(parts, list(simulations), tried, generic)
    gains = [table.gain(k) for k in range(len(table.columns))]
    assert max(gains) < 0.06
    _, adjusted = table.p_values(0)
    assert np.all((adjusted > 0) & (adjusted <= 1))
    again = table.p_values(0)[1]
    assert np.array_equal(adjusted, again)
    floor = noise_floor(simulations[0]).of(parts[0].weights)
    error = np.mean(scaled_error(simulations[0], parts[0].weights) ** 2)
    assert 0.5 * error < floor < 2.0 * error


def test_wheels_that_contradict_each_other_are_noticed(quiet):
    fit, _ = quiet
    assert wheels_agree(fit)
    for effect, agree in (("roller_ripple", False), ("wheel_radius_error", True)):
        robot = PAPER.with_effects({effect: {"e_fl": 0.03} if agree else {}})
        assert wheels_agree(record(robot, SmoothRandom(0.35, 1.5), 30.0, 3)) is agree, effect


def test_order_of_a_torque_ripple_is_read_off_the_record():
    hidden = PAPER.with_effects({"torque_ripple": {"a": 0.1, "k": 4.57}})
    log = record(hidden, calibration_sequence(seconds=80.0), 80.0, 4)
    model = refine([log], NOMINAL).model
    assert min(abs(k - 4.57) for k in strongest_orders(log, model)) < 0.05


def test_motions_of_the_menu_are_the_shipped_files():
    for name, motion in menu().items():
        if isinstance(motion, Fourier):
            assert load_motion(name).amplitudes == pytest.approx(
                np.array(motion.amplitudes), abs=1e-6
            )


@pytest.mark.parametrize(
    ("name", "effect"),
    [
        ("a-nothing-hidden", None),
        ("b-wheel-coulomb", "wheel_coulomb_friction"),
        long("c-floor-slope", "floor_slope"),
        ("d-torque-gain-fl", "torque_gain"),
        long("e-delay-18ms", "actuator_delay"),
        long("f-cable", "cable_tether"),
    ],
)
def test_robots_with_real_rollers(name, effect):
    fit, test = (Log.load(shared("roller-robot", f"{name}.{k}.csv")) for k in ("train", "test"))
    found = diagnose(fit, NOMINAL, test)
    if effect is None:
        assert found.verdict == "nothing_missing"
    else:
        assert found.verdict in ("named", "ambiguous")
        assert found.named[0].group[0] == effect


def test_script_writes_the_contract(tmp_path, sticky):
    logs = [log.save(tmp_path / f"{k}.csv") for k, log in zip("ab", sticky, strict=True)]
    file = tmp_path / "d.json"
    command = [sys.executable, "scripts/diagnose.py", str(logs[0]), "--test", str(logs[1])]
    done = subprocess.run(
        [*command, "--json", str(file)], cwd=ROOT, capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
    result = json.loads(file.read_text())
    assert result["verdict"] == "named"
    assert result["named"][0]["group"][0] == "wheel_coulomb_friction"
    keys = {"log", "verdict", "named", "candidates", "depends_on", "where", "experiment",
            "free_run"}  # fmt: skip
    assert keys <= set(result)
    assert {"effect", "p_adjusted", "size", "ci95", "unit", "power", "smallest_detectable"} <= set(
        result["candidates"][0]
    )
    assert {"before", "after", "noise_floor"} <= set(result["free_run"])
    same = subprocess.run(
        [*command[:3], "--test", str(logs[0])],
        cwd=ROOT,
        capture_output=True,
        text=True,
        check=False,
    )
    assert same.returncode == 2
    assert "same record" in same.stderr


def test_nothing_is_named_below_the_noise():
    """Motion I hardly moves on two axes; one in eight such logs named carpet."""
    log = record(PAPER, make_reference("I", speed=0.3), 60.0, 0)
    found = diagnose(log, NOMINAL)
    assert found.errors.before < found.errors.white
    assert found.verdict == "nothing_missing"
    assert found.as_dict()["named"] == []
