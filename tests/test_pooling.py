"""Many short logs are one record: how they are joined, cut, kept out, and what they tell."""

from dataclasses import replace

import numpy as np
import pytest

from ident import diagnose
from ident.comparison import compare
from ident.diagnosis.excitation import unfit
from ident.diagnosis.splits import FIT, SELECT, VERIFY, divide
from ident.free_run import cut_windows, free_run
from ident.identification import identify
from ident.log import Log
from ident.pooling import APART, as_one, joined, pooled
from ident.sensitivity import Linearised, window_length
from youbot_env.model_file import load_model
from youbot_env.references import SmoothRandom
from youbot_env.simulation import Sensors, record_closed_loop

PAPER, NOMINAL = load_model("paper"), load_model("nominal")
ROBOT = PAPER.with_effects({"wheel_coulomb_friction": 0.2})


def run(seed, seconds=9.0, rate=50.0):
    times = np.arange(round(seconds * rate)) / rate
    channels = record_closed_loop(ROBOT, SmoothRandom(0.35, 1.5, seed), times, Sensors(), seed=seed)
    return Log(f"run{seed}", ROBOT.platform, **channels)


@pytest.fixture(scope="module")
def runs():
    return [run(seed) for seed in range(12)]


def test_joined_logs_keep_their_rows_names_and_findings(runs):
    log = joined(runs[:3])
    assert log.name == "run0 and 2 more"
    assert log.spans == [(0, 450), (450, 900), (900, 1350)]
    assert np.array_equal(log.wheel_velocity[450:900], runs[1].wheel_velocity)
    assert log.time[450] - log.time[449] == pytest.approx(APART)
    assert log.duration == pytest.approx(sum(r.duration for r in runs[:3]))
    assert log.run_of(log.time[[0, 449, 450, 1349]]).tolist() == [0, 0, 1, 2]
    assert log.run_name(1) == "run1"
    part = log.part(log.time[450], log.time[-1] + 1)
    assert [name for name, _ in part.runs] == ["run1", "run2"]
    assert part.duration == pytest.approx(2 * runs[0].duration)


def test_only_short_logs_of_one_kind_are_joined(runs):
    long = run(20, 21.0)
    assert pooled([long, run(21, 22.0)])[0] is long
    assert [log.name for log in pooled([*runs[:3], long])] == ["run0 and 2 more", "run20"]
    assert [log.name for log in pooled([*runs[:4], long])] == ["run0 and 4 more"]
    bare = replace(runs[1], reference=None)
    assert [log.name for log in pooled([runs[0], bare])] == ["run0", "run1"]
    with pytest.raises(ValueError, match=r"run1.*compare each by itself"):
        as_one([runs[0], bare])


def test_windows_reach_the_end_of_every_piece(runs):
    log = joined([runs[0], run(30, 3.2)])
    index = cut_windows(log, NOMINAL, window_length(log)).index
    ends = {stop - 1 for _, stop in log.spans}
    assert ends <= set(index[:, -1].tolist())
    assert len(np.unique(index)) > 0.95 * len(log.time)
    shown = free_run(run(30, 3.2), NOMINAL)  # shorter than the usual window
    assert np.isfinite(shown.nrmse)


def test_whole_runs_are_kept_out_and_help_to_choose(runs):
    log, other = joined(runs[:7]), joined(runs[7:])
    (alone,) = divide([log], [], NOMINAL)
    assert set(alone.run[alone.windows(VERIFY)]) == {4}
    assert set(alone.run[alone.windows(FIT)]) == {0, 1, 2, 3, 5, 6}
    _, second = divide([log], [other], NOMINAL)
    assert set(second.run[second.windows(SELECT)]) == {0, 1, 2}
    assert set(second.run[second.windows(VERIFY)]) == {3, 4}


def test_many_runs_and_not_their_windows_are_independent(runs):
    many = joined([run(seed, 4.5, 25.0) for seed in range(25)])
    (part,) = divide([many], [], NOMINAL)
    assert part.fitted == 20
    (few,) = divide([joined(runs)], [], NOMINAL)
    assert few.fitted == few.windows(FIT).sum()
    sim = Linearised.of(many, NOMINAL)
    assert set(many.run_of(sim.begin)) == set(range(25))


def test_logs_that_are_too_short_alone_decide_together(runs):
    assert "run0 lasts 8.98 s" in unfit(pooled(runs[:1]))
    assert "together last 18" in unfit(pooled(runs[:2]))
    assert unfit(pooled(runs)) == ""
    found = diagnose(runs[:9], NOMINAL, runs[9:])
    assert "wheel_coulomb_friction" in found.named[0].group
    assert found.log == "run0 and 8 more"
    names = {one.effect for one in found.minimum_detectable}
    assert not names & {"battery_sag", "friction_warmup", "payload_change"}


def test_identification_and_comparison_read_all_runs(runs):
    found = identify(runs[:9], ROBOT, test=runs[9:])
    low, high = found.lumps["x1+x3"].ci95
    assert low < 6.826 < high
    assert found.as_dict()["logs"] == [log.name for log in runs[:9]]
    assert len(found.fit_run.time) > 0.95 * 9 * 450
    assert found.model.provenance["logs"][8]["name"] == "run8"
    (one,) = compare(runs[:9], [ROBOT])
    assert not any("quarter" in regime.name for regime in one.where)
    assert {stretch.log for stretch in one.worst} <= {log.name for log in runs}
