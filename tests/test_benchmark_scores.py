"""What the benchmark of diagnosis counts."""

import json

import pytest

from ident.benchmark.cases import (
    Case,
)
from ident.benchmark.page import benchmark_page
from ident.benchmark.score import score, visible
from ident.benchmark.summary import Rate, summarise


def step(effect, *others, **size):
    return {"effect": effect, "group": [effect, *others], "size": size}


def kept(case, *steps, verdict="named", **more):
    """A record as the runner keeps it, with a given answer."""
    run = {"before": 0.2, "after": 0.05, "noise_floor": 0.01}
    answer = {"verdict": verdict if steps else "nothing_missing", "named": list(steps),
              "free_run": run}  # fmt: skip
    return {
        "method": "diagnosis", "case": case.id, "part": case.part, "hidden": list(case.hidden),
        "size": case.size, "truth": {}, "share": dict.fromkeys(case.hidden, 0.08), "oracle": 0.01,
        "seconds": 1.0, "error": None, "answer": answer,
    } | more  # fmt: skip


def one(*hidden, part="single", size=1.0, number=0):
    return Case(part, hidden, size, number, 0)


def test_scores_of_right_wrong_and_silent_answers():
    case = one("wheel_coulomb_friction")
    right = score(kept(case, step("wheel_coulomb_friction", "stribeck_friction")))
    assert right.exact
    assert right.group
    assert right.size == 2
    assert right.fell
    assert right.closed == pytest.approx(0.15 / 0.19)
    near = score(kept(case, step("stribeck_friction")))
    assert (near.exact, near.group, near.holds, near.wrong) == (False, True, False, False)
    false = score(kept(case, step("floor_slope")))
    assert (false.group, false.wrong) == (False, True)
    second = score(kept(case, step("wheel_coulomb_friction"), step("floor_slope")))
    assert (second.exact, second.first, second.wrong, second.extra) == (False, True, True, True)
    silent = score(kept(case))
    assert (silent.exact, silent.group, silent.wrong, silent.fell) == (False, False, False, None)


def test_scores_of_what_is_outside_of_laws_pairs_and_rollers():
    assert score(kept(one("swinging_load", part="outside"), step("cable_tether"))).wrong
    assert not score(kept(one("swinging_load", part="outside"))).wrong
    law = one("lugre_friction", part="laws")
    assert score(kept(law, step("wheel_coulomb_friction"))).exact
    assert score(kept(law, step("stribeck_friction"))).exact
    assert score(kept(law, step("quadratic_drag"))).wrong
    pair = one("floor_slope", "wheel_coulomb_friction", part="pairs")
    both = step("wheel_coulomb_friction"), step("floor_slope")
    assert score(kept(pair, *both)).all_held
    assert not score(kept(pair, both[0])).all_held
    # One group that holds both does not name both.
    assert not score(kept(pair, step("floor_slope", "wheel_coulomb_friction"))).all_held
    quiet = one(part="rollers")
    assert not score(kept(quiet, step("roller_ripple"))).names
    assert score(kept(quiet, step("roller_ripple"), step("torque_gain"))).wrong


def test_intervals_are_compared_in_what_a_record_can_show():
    truth = {"torque_gain": {f"e_{wheel}": 0.2 * (wheel == "fl") for wheel in
                             ("fl", "fr", "rl", "rr")}}  # fmt: skip
    seen = visible("torque_gain", truth["torque_gain"])
    assert seen["e_fl"] == pytest.approx(1.2 / 1.05 - 1)
    found = {name: {"value": v, "unit": "", "ci95": [v - 0.01, v + 0.01]}
             for name, v in seen.items()}  # fmt: skip
    found["e_rr"]["ci95"] = [0.0, 0.1]
    answer = kept(one("torque_gain"), step("torque_gain", **found), truth=truth)
    assert score(answer).covered == {"e_fl": True, "e_fr": True, "e_rl": True, "e_rr": False}
    # One value for all wheels cannot be compared with friction on one of them.
    truth = {"wheel_coulomb_friction": {"fc_fl": 0.3, "fc_fr": 0.0, "fc_rl": 0.0, "fc_rr": 0.0}}
    common = {"fc": {"value": 0.1, "unit": "N m", "ci95": [0.0, 0.2]}}
    case = one("wheel_coulomb_friction")
    answer = kept(case, step("wheel_coulomb_friction", **common), truth=truth)
    assert score(answer).covered == {}


def test_offsets_that_move_nothing_do_not_count():
    still = dict(zip(("b_fl", "b_fr", "b_rl", "b_rr"), (0.1, 0.1, -0.1, -0.1), strict=True))
    assert list(visible("torque_offset", still).values()) == pytest.approx([0.0] * 4)


def test_summary_counts_and_the_page_says_it():
    cases = [one("floor_slope", size=s, number=k) for s in (1.0, 0.5, 0.25) for k in range(4)]
    records = [kept(c, step("floor_slope")) if c.number else kept(c) for c in cases]
    records += [kept(one(part="nothing", number=k)) for k in range(9)]
    records.append(kept(one(part="nothing", number=9), step("torque_gain")))
    records.append(
        kept(one(part="nothing", number=10), error="Traceback\nValueError: no", answer={})
    )
    found = summarise(records)
    targets = {t["what"]: t for t in found["targets"]}
    assert targets["exact name, full size"]["value"] == 0.75
    assert targets["false alarms, nothing hidden"]["hits"] == 1
    assert targets["false alarms, nothing hidden"]["count"] == 10
    assert not targets["their upper limit"]["met"]
    assert found["confusion"] == {"floor_slope": {"floor_slope": 3, "nothing_missing": 1}}
    assert found["failed"][0]["error"] == "ValueError: no"
    json.dumps(found, allow_nan=False)
    provenance = {"command": "x", "seed": 0, "date": "today", "versions": {"python": "3"}}
    page = benchmark_page(found | {"provenance": provenance, "version": "v"})
    html = page.html()
    assert "floor_slope" in html
    assert "ValueError: no" in html
    assert not page.good


def test_rates_have_exact_intervals():
    # Clopper and Pearson (1934): of 20 none, the upper limit is 1 - 0.025^(1/20).
    low, high = Rate(0, 20).ci95
    assert (low, high) == (0.0, pytest.approx(1 - 0.025 ** (1 / 20)))
    assert Rate.of([]).ci95 is None
