"""The hidden-effect benchmark: what is hidden is as large as said, scored right, and kept."""

import subprocess
import sys
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import pytest

from ident.benchmark import runner
from ident.benchmark.cases import (
    FULL,
    FULL_PLAN,
    PARTS,
    QUICK_PLAN,
    Case,
    Plan,
    alike,
    record_case,
)
from ident.benchmark.conditions import Conditions
from ident.benchmark.hidden import EFFECTS, draw_hidden, hide, named
from ident.benchmark.laws import LAWS, LuGreFriction
from ident.benchmark.outside import OUTSIDE, TorqueHysteresis
from ident.benchmark.robots import draw_robots
from ident.benchmark.scaling import torque_share
from ident.benchmark.score import score
from ident.benchmark.store import Store
from ident.benchmark.summary import summarise
from youbot_env.backend import FLOAT
from youbot_env.effects import effect_names, get_effect
from youbot_env.simulation import AnalyticPlant

ROOT = Path(__file__).resolve().parent.parent
OTHERS = [e.identifier for e in (*OUTSIDE, *LAWS)]


def one(*hidden, part="single", size=1.0, number=0):
    return Case(part, hidden, size, number, 0)


def test_plan_covers_what_was_promised():
    cases = FULL_PLAN.cases(0)
    parts = {part: [c for c in cases if c.part == part] for part in PARTS}
    assert len({case.id for case in cases}) == len(cases)
    assert len(parts["nothing"]) >= 400
    assert len({c.hidden for c in parts["single"]}) >= 14
    assert {c.size for c in parts["single"]} == {1.0, 0.5, 0.25}
    assert len(parts["single"]) == 3 * 20 * len(EFFECTS)
    assert len({c.hidden for c in parts["outside"]}) >= 4
    assert all(not alike(*case.hidden) for case in parts["pairs"])
    assert {c.part for c in QUICK_PLAN.cases(0)} == set(PARTS)


def test_nothing_of_this_room_is_a_candidate():
    assert not set(OTHERS) & set(effect_names())
    with pytest.raises(ValueError, match="unknown effect"):
        get_effect("swinging_load")


@pytest.mark.parametrize("identifier", [*EFFECTS, *OTHERS])
def test_every_draw_is_possible_and_grows_with_its_amount(identifier):
    (robot,) = draw_robots(1, 1)
    for number in range(20):
        hidden = draw_hidden(identifier, np.random.default_rng(number), robot.platform)
        assert hidden.values(1.0) != hidden.values(0.5)
        for amount in (1e-3, 1.0, 1e3):
            active = hide(robot, [(hidden, amount)]).effects[0]
            assert named(identifier).complete(active.values, robot.platform) == active.values


@pytest.mark.parametrize(
    "identifier",
    ["wheel_coulomb_friction", "torque_gain", "actuator_lag", "torque_saturation",
     "floor_patches", "lugre_friction"],
)  # fmt: skip
def test_full_size_is_eight_percent_of_the_torque_and_a_quarter_a_quarter(identifier):
    part = "single" if identifier in EFFECTS else "outside"
    full, quarter = (record_case(one(identifier, part=part, size=s, number=3)) for s in (1.0, 0.25))
    assert full.share[identifier] == pytest.approx(FULL, rel=0.1)
    assert quarter.share[identifier] == pytest.approx(FULL / 4, rel=0.1)
    assert full.truth.parameters == quarter.truth.parameters
    assert full.conditions == quarter.conditions
    # Seen from the noisy record the share is the hidden one and the noise.
    if not full.conditions.jitter:
        assert torque_share(full.fit, draw_robots(1, one(identifier, part=part, number=3)
                                                  .children(5)[0])[0]) > 0.9 * FULL  # fmt: skip


def test_a_delay_stays_what_the_loops_can_bear():
    recorded = record_case(one("actuator_delay", part="single", size=1.0, number=3))
    (active,) = recorded.truth.effects
    assert 0.01 < active.values["d"] < 0.1
    assert recorded.share["actuator_delay"] < FULL
    assert np.abs(recorded.fit.wheel_velocity).max() < 30.0


def test_a_payload_stays_what_the_robot_can_carry():
    recorded = record_case(one("payload_change", number=1))
    (active,) = recorded.truth.effects
    assert active.values["dm"] == pytest.approx(20.0)
    assert recorded.share["payload_change"] < FULL


def test_cases_repeat_and_differ():
    first, again, other = (record_case(one(part="nothing", number=n)) for n in (0, 0, 1))
    assert np.array_equal(first.fit.wheel_torque, again.fit.wheel_torque)
    assert first.truth.parameters != other.truth.parameters
    assert not np.array_equal(first.fit.time, first.verify.time)
    assert first.fit.duration == pytest.approx(112, abs=0.1)
    assert first.verify.duration == pytest.approx(48, abs=0.1)


def test_conditions_vary_and_slow_drives_stay_stable():
    drawn = [Conditions.draw(np.random.default_rng(k)) for k in range(100)]
    assert {c.rate for c in drawn} == {50.0, 100.0}
    assert {c.motion for c in drawn} == {"calibration", "smooth_random"}
    assert 0 < sum(c.jitter > 0 for c in drawn) < 50
    fast = [Conditions.draw(np.random.default_rng(k), fast=True) for k in range(100)]
    assert {c.rate for c in fast} == {100.0}


def test_bristles_hold_and_then_slip():
    values = {"fc": 0.2, "fs": 0.3, "ws": 0.5, "bend": 0.02}
    (robot,) = draw_robots(1, 0)
    effect, wheels = LuGreFriction(), len(robot.platform.wheels)
    p = effect.arrange(effect.complete(values, robot.platform), robot.platform)

    def moved(speed, seconds):
        s = SimpleNamespace(wheel_velocity=(speed,) * wheels, state=(0.0,) * wheels)
        s.state = effect.evolve(p, (), s, seconds, FLOAT)
        return -effect.shaft(p, s, FLOAT)[0]

    assert moved(1e-3, 1.0) == pytest.approx(p.fc / p.bend * 1e-3, rel=0.05)  # a spring
    assert moved(0.02, 60.0) == pytest.approx(p.fs, rel=0.01)  # static level
    assert moved(5.0, 60.0) == pytest.approx(p.fc, rel=0.01)  # dynamic level
    assert moved(-5.0, 60.0) == pytest.approx(-p.fc, rel=0.01)


def test_hysteresis_loses_the_play_and_keeps_it_on_the_way_back():
    (robot,) = draw_robots(1, 0)
    hidden = draw_hidden("torque_hysteresis", np.random.default_rng(0), robot.platform)
    plant = AnalyticPlant(hide(robot, [(hidden, 1.0)]))
    assert isinstance(plant.model.effects[0].effect, TorqueHysteresis)
    play = plant.model.effects[0].values["b"]
    for torque, delivered in ((0.5 * play, 0.0), (3 * play, 2 * play), (1.5 * play, 2 * play)):
        plant.step(np.full(4, torque))
        assert plant._stepper.state[-4:] == pytest.approx(np.full(4, delivered))


def fake(fit, verify, seed):
    assert fit.duration > verify.duration
    return {"verdict": "nothing_missing", "named": []}


def broken(fit, verify, seed):
    raise RuntimeError("no answer")


def test_runs_go_on_where_they_stopped(tmp_path):
    cases = Plan(seeds=1, sizes=(1.0,), nothing=2).cases(0)[:2]
    store = Store(tmp_path / "runs" / "kept.jsonl", "v1")
    counted = []

    def answer(fit, verify, seed):
        counted.append(seed)
        return fake(fit, verify, seed)

    tasks = [("diagnosis", case) for case in cases]
    first = runner.run(tasks[:1], store, methods={"diagnosis": answer})
    assert first[0]["answer"]["verdict"] == "nothing_missing"
    with store.path.open("a") as file:
        file.write('{"half a line')  # a run that was killed
    records = runner.run(tasks, store, methods={"diagnosis": answer})
    assert [r["case"] for r in records] == [case.id for case in cases]
    assert len(set(counted)) == 2
    assert len(store.finished()) == 2
    assert not Store(store.path, "v2").finished()  # other code, other results
    runner.run(tasks[:1], store, methods={"diagnosis": answer}, resume=False)
    assert len(counted) == 3


def test_a_failure_is_kept_and_stops_nothing(tmp_path):
    cases = Plan(nothing=1).cases(0)[:1]
    store = Store(tmp_path / "kept.jsonl", "v1")
    (record,) = runner.run([("bad", cases[0])], store, methods={"bad": broken})
    assert "RuntimeError: no answer" in record["error"]
    assert record["answer"] is None
    assert not store.finished()  # tried again next time
    assert summarise([record])["failed"][0]["case"] == cases[0].id


@pytest.mark.long
def test_one_case_of_each_kind_through_the_real_diagnosis(tmp_path):
    cases = [one(part="nothing"), one("floor_slope"), one("actuator_lag", size=0.25)]
    records = runner.run([("diagnosis", c) for c in cases], Store(tmp_path / "a.jsonl", "v"))
    assert [r["error"] for r in records] == [None] * 3
    quiet, slope, _ = (score(r) for r in records)
    assert not quiet.names
    assert slope.exact
    assert slope.fell


def test_baselines_answer_in_the_same_form():
    pytest.importorskip("pysindy")
    pytest.importorskip("sysidentpy")
    recorded = record_case(one("quadratic_drag", number=1))
    for method in ("pysindy", "sysidentpy"):
        answer = runner.METHODS[method](recorded.fit, recorded.verify, 0)
        assert "quadratic_drag" in [found["effect"] for found in answer["named"]]
        assert {found["effect"] for found in answer["named"]} <= set(effect_names())


def test_command_lists_cases_and_refuses_what_is_not_there(tmp_path):
    def call(*words):
        command = [sys.executable, "scripts/benchmark_diagnosis.py", *words]
        return subprocess.run(command, cwd=ROOT, capture_output=True, text=True, check=False)

    listed = call("--quick", "--part", "single", "--list")
    assert listed.returncode == 0
    assert "single/floor_slope/000@1" in listed.stdout.split()
    for words, message in (
        (("--part", "many"), "choose one of"),
        (("--cases", "single/no_such_effect/*"), "no case is left"),
    ):
        refused = call(*words)
        assert refused.returncode == 2
        assert message in refused.stderr
