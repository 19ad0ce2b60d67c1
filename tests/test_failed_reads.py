"""Failed reads, frozen records and coarse steps: mended or told, and nothing good is touched."""

import numpy as np
import pytest
from shared_data import shared
from spoiled_logs import M, P, R, V, apply, both, everywhere, good_frame, put, simulate
from test_doctor import difference, load, warnings

from ident.log import Log, find_log

COUNT = 4000


def rows_of(share: float, width: int, seed: int = 3) -> np.ndarray:
    """Rows of bursts of ``width`` that hold a share of the good log."""
    places = np.arange(20, COUNT - 20 - width, width + 1)
    rng = np.random.default_rng(seed)
    begins = rng.choice(places, round(share * COUNT / width), replace=False)
    return (begins[:, None] + np.arange(width)).ravel()


def failing(names: list[str], share: float, width: int = 1, value: float = 0.0):
    rows = rows_of(share, width)
    return both(*[put(name, rows, value) for name in names])


def frozen(names: list[str], seconds: float, times: int = 3):
    def spoil(frame):
        for begin in 400 + 1100 * np.arange(times):
            rows = slice(begin, begin + round(100 * seconds))
            for name in names:
                frame = put(name, rows, frame[name][int(begin)])(frame)
        return frame

    return spoil


def steps(names: list[str], step: float):
    return apply(names, lambda v: np.round(v / step) * step)


FAILING = {
    "a torque at 0, 2 %": (failing(M[2:3], 0.02), 1),
    "a torque at 0, 5 %": (failing(M[1:2], 0.05), 1),
    "a torque at 0, 10 %": (failing(M[:1], 0.10), 1),
    "a torque at 0 in bursts": (failing(M[3:], 0.05, 5), 1),
    "a torque at 0 in long bursts": (failing(M[3:], 0.05, 30), 1),
    "a torque at 999": (failing(M[:1], 0.03, 1, 999.0), 1),
    "a torque at -1": (failing(M[:1], 0.02, 5, -1.0), 1),
    "a speed at 0": (failing(V[2:3], 0.05), 1),
    "a speed at -1": (failing(V[:1], 0.05, 3, -1.0), 1),
    "all speeds at 0": (failing(V, 0.05, 7), 4),
    "everything at 0, single rows": (failing(V + M, 0.05), 4),
    "everything at 0, bursts": (failing(V + M, 0.05, 5), 4),
    "everything at 0, half a second": (failing(V + M, 0.05, 50), 4),
}


@pytest.mark.parametrize("name", FAILING)
def test_failed_reads_are_mended(tmp_path, name):
    spoil, columns = FAILING[name]
    log = load(tmp_path, spoil(good_frame()))
    told = [f for f in log.findings if "failed reads" in f.what]
    assert told
    assert all(f.severity == "fixed" for f in log.findings)
    assert told[0].where.count("wheel_") == columns
    assert difference(log) < 0.015  # the noise of 10 % of a channel's rows, no more


def test_too_many_failed_reads_are_refused(tmp_path):
    with pytest.raises(ValueError, match=r"30\.0%. are exactly 0"):
        load(tmp_path, failing(M[:1], 0.3)(good_frame()))


def standing() -> np.ndarray:
    """Commands with three stretches of rest."""
    return lambda t: everywhere(t) if 5 < t < 15 or 20 < t < 35 else np.zeros(3)


def test_robot_that_stands_is_not_touched(tmp_path):
    frame = simulate(standing())
    assert not load(tmp_path, frame).findings
    time = frame["time"].to_numpy()
    rest = (time < 4.9) | ((time > 16.5) & (time < 19.9)) | (time > 36.5)
    exact = both(*[put(name, rest, 0.0) for name in V + M])(frame)
    log = load(tmp_path, exact)
    assert len(log.time) == COUNT
    np.testing.assert_allclose(log.wheel_torque, exact.select(M), atol=1e-6)


FROZEN = {
    "all wheel channels, 2 s": frozen(V + M, 2.0),
    "all wheel channels, half a second": frozen(V + M, 0.5),
    "all wheel channels, 0.06 s": frozen(V + M, 0.06),
    "everything, half a second": frozen(V + M + P, 0.5),
    "all speeds": frozen(V, 0.5),
    "all torques": frozen(M, 2.0),
    "one torque": frozen(M[:1], 0.2),
}


@pytest.mark.parametrize("name", FROZEN)
def test_frozen_records_are_cut_out(tmp_path, name):
    log = load(tmp_path, FROZEN[name](good_frame()))
    assert any("repeat the same digits" in str(f) for f in log.findings)
    assert all(f.severity == "fixed" for f in log.findings)
    assert len(log.starts) == 4
    assert difference(log) < 1e-3


def test_mostly_frozen_is_refused(tmp_path):
    with pytest.raises(ValueError, match="frozen in"):
        load(tmp_path, frozen(V + M, 10.0)(good_frame()))


@pytest.mark.parametrize("step", [0.1, 0.2, 0.5])
def test_coarse_torques_are_told_and_kept(tmp_path, step):
    log = load(tmp_path, steps(M, step)(good_frame()))
    assert len(log.time) == COUNT
    (told,) = log.findings
    assert told.severity == "warning"
    assert f"recorded in steps of {step:.4g}" in told.what


def test_coarse_speeds_are_told_and_kept(tmp_path):
    (told,) = load(tmp_path, steps(V, 0.5)(good_frame())).findings
    assert "recorded in steps of 0.5" in told.what
    assert not load(tmp_path, steps(V, 2.83 / 16)(good_frame())).findings  # 3 % of the rms


def test_ticks_at_rest_are_no_frozen_record(tmp_path):
    frame = both(steps(V, 0.15), steps(M, 0.1))(simulate(standing()))
    log = load(tmp_path, frame)
    assert len(log.time) == COUNT
    assert not any(f.severity == "fixed" for f in log.findings)


def test_coarse_sensor_that_is_stuck_is_found(tmp_path):
    spoil = both(steps(M, 0.2), put(M[2], slice(1500, 1900), 0.2))
    log = load(tmp_path, spoil(good_frame()))
    assert any("stands at 0.2 for 4" in str(f) for f in log.findings)


@pytest.mark.parametrize("rows", [2, 15])
def test_late_torques_are_neither_mended_nor_refused(tmp_path, rows):
    frame = good_frame()
    late = frame[rows:].with_columns(frame[:-rows].select(M))
    log = load(tmp_path, late)
    np.testing.assert_allclose(log.wheel_torque, late.select(M), atol=1e-6)
    assert not any(f.severity == "fixed" for f in log.findings)


@pytest.mark.parametrize("quarter", range(8))
def test_parts_of_a_log_keep_their_witnesses(tmp_path, quarter):
    """Circles and single axes: what a motion does not show is no evidence against anybody."""
    frame = good_frame()[500 * quarter : 500 * (quarter + 1)]
    for columns in ([], P, R):
        log = load(tmp_path, frame.drop(columns))
        assert not [t for t in warnings(log) if "lasts only" not in t]


@pytest.mark.parametrize("start", range(0, 11200, 2800))
def test_parts_of_the_bundled_log_keep_their_reference(start):
    import polars as pl

    from ident.doctor import examine
    from ident.doctor.table import Table
    from youbot_env.platform import youbot

    path = find_log("youbot_fit")
    frame = pl.read_csv(path, comment_prefix="#", infer_schema_length=None)
    part = frame[start : start + 2800]
    columns = {name: part[name].to_numpy().copy() for name in part.columns}
    record = examine(Table(columns, np.arange(len(part))), path.name, youbot())
    assert {"reference", "pose"} <= set(record.channels)
    assert not [f for f in record.findings if "hardly any" not in f.what and "spikes" not in f.what]


# Logs beside the project


def test_shared_failed_reads():
    log = Log.load(shared("broken-inputs", "torque_fr_5pct_zero.csv"))
    good = Log.load(shared("broken-inputs", "rate100.csv"))
    assert any("309 rows (5.1%) are exactly 0" in f.what for f in log.findings)
    assert np.std(log.wheel_torque - good.wheel_torque) < 0.01
    log = Log.load(shared("public-cases", "c11c_zero_bursts.csv"))
    assert any("failed reads" in f.what for f in log.findings)
    assert np.abs(log.wheel_velocity).min(axis=1).max() > 0


def test_shared_frozen_record():
    log = Log.load(shared("broken-inputs", "all8_frozen_3x2s.csv"))
    assert len(log.time) == 5400
    assert len(log.starts) == 4


@pytest.mark.parametrize("name", ["torque_late_20ms.csv", "bundled_84_112.csv"])
def test_shared_log_keeps_everything(name):
    log = Log.load(shared("broken-inputs", name))
    assert log.reference is not None
    assert not [f for f in log.findings if f.severity == "fixed"]
