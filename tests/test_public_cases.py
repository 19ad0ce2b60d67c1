"""Situations of public bug reports, remade: each is put right, refused by name, or cannot say."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from spoiled_logs import C, M, P, R, V, good_frame, put, scale
from test_doctor import difference, load, warnings
from test_frames import BODY, with_body

from ident.diagnosis.excitation import unfit
from ident.doctor import LogError
from ident.doctor.finding import NAMES
from ident.doctor.signs import other_hand
from ident.identification import identify
from ident.kinematics import calibrate_kinematics
from ident.log import Log
from ident.report.outcome import Outcome
from youbot_env.model_file import load_model
from youbot_env.platform import youbot

KT, GEAR = 0.0335, 9405 / 364


def named(log: Log, name: str) -> list:
    return [finding for finding in log.findings if finding.name == name]


def refused(tmp_path, frame: pl.DataFrame, name: str, alone: bool = True) -> LogError:
    """The error of a log, which can be accepted by its name; ``alone`` if nothing else is wrong."""
    with pytest.raises(LogError) as caught:
        load(tmp_path, frame)
    errors = [finding for finding in caught.value.findings if finding.severity == "error"]
    assert [finding.name for finding in errors] == [name]
    assert f"--accept {name}" in str(caught.value)
    if not alone:
        return caught.value
    log = load(tmp_path, frame, accept=(name,))
    assert log.accepted == (name,)
    assert any(finding.what.startswith("accepted: ") for finding in named(log, name))
    return caught.value


def wrapped(names: list[str], period: float, lowest: float):
    """Integers that go on at their smallest value: [lowest, lowest + period)."""
    return lambda f: f.with_columns(((pl.col(names) - lowest) % period + lowest).name.keep())


def in_currents(f: pl.DataFrame) -> pl.DataFrame:
    return f.rename(dict(zip(M, C, strict=True))).with_columns(pl.col(C) / (KT * GEAR))


# Overflow


@pytest.mark.parametrize("names", [V, V[:1]])
@pytest.mark.parametrize("columns", [[], P + R])
def test_speeds_that_wrap_round_are_unwrapped(tmp_path, names, columns):
    log = load(tmp_path, wrapped(names, 14.0, -7.0)(good_frame()).drop(columns))
    assert "an integer wrapped round (overflow)" in named(log, "overflow")[0].what
    assert difference(log) < 0.002


def test_speeds_that_wrap_round_are_unwrapped_at_25_hz(tmp_path):
    log = load(tmp_path, wrapped(V, 14.0, -7.0)(good_frame())[::4])
    good = good_frame()[::4].select(V).to_numpy()
    assert np.std(log.wheel_velocity - good) < 0.01


@pytest.mark.parametrize("columns", [[], P + R])
def test_twos_complement_is_refused(tmp_path, columns):
    frame = wrapped(C, 65.536, 0.0)(in_currents(good_frame())).drop(columns)
    assert "two's complement" in str(refused(tmp_path, frame, "overflow", alone=False))


def test_wheels_that_start_between_two_rows_do_not_wrap(tmp_path):
    """Strokes at 5 Hz: from rest to full speed from one row to the next, there and back."""
    on = (np.arange(200) // 10) % 4
    motion = np.zeros((200, 3))
    motion[on == 1, 0], motion[on == 3, 0] = 0.3, -0.3
    speeds = motion @ youbot().jacobian_array.T
    speeds += 0.02 * np.random.default_rng(3).standard_normal(speeds.shape)
    data = np.column_stack([0.2 * np.arange(200), speeds, 0.1 * speeds, motion])
    frame = pl.DataFrame(data, schema=["time", *V, *M, *R])
    assert not named(load(tmp_path, frame), "overflow")


# Units


@pytest.mark.parametrize("factor", [1000 / 2.1, 100.0, 1000.0])
def test_units_of_torques_are_asked_for(tmp_path, factor):
    error = refused(tmp_path, scale(factor, *M)(good_frame()), "mass")
    assert "[mN m]" in str(error)
    assert "per mille" in str(error)


def test_three_times_the_mass_is_doubted(tmp_path):
    (found,) = load(tmp_path, scale(3.4, *M)(good_frame())).findings
    assert found.name == "mass"
    assert "times the data sheet's" in found.what


# Frames before columns


def test_turned_sensor_without_wheels_is_named_first(tmp_path):
    frame = with_body(good_frame(), 45).drop(V)
    error = refused(tmp_path, frame, "signs")
    assert str(error).index("body_velocity: turned by 4") < str(error).index("wheel_torque: ")


def test_velocities_in_world_axes_are_seen_by_the_pose(tmp_path):
    frame = with_body(good_frame(), world=True).drop(V).with_columns(good_frame().select(P))
    log = load(tmp_path, frame)
    assert "the pose explains" in named(log, "world_frame")[0].what
    good = with_body(good_frame()).select(BODY).to_numpy()
    assert np.std(log.body_velocity - good) < 0.01


def with_other_rollers(f: pl.DataFrame) -> pl.DataFrame:
    """The same motion and forces with rollers of the other hand."""
    mine, theirs = youbot().jacobian_array, other_hand(youbot()).jacobian_array
    speeds = f.select(V).to_numpy() @ np.linalg.pinv(mine).T @ theirs.T
    torques = f.select(M).to_numpy() @ mine @ np.linalg.pinv(theirs)
    return f.with_columns(
        [pl.Series(name, speeds[:, k]) for k, name in enumerate(V)]
        + [pl.Series(name, torques[:, k]) for k, name in enumerate(M)]
    )


@pytest.mark.parametrize("columns", [[], R])
def test_rollers_of_the_other_hand_are_no_exchanged_columns(tmp_path, columns):
    frame = with_other_rollers(good_frame()).drop(columns)
    assert "other hand" in str(refused(tmp_path, frame, "roller_hand", alone=False))
    log = Log.load(tmp_path / "log.csv", other_hand(youbot()))
    assert not log.findings


# Poses


def summed(f: pl.DataFrame, turning: float = 1.0) -> pl.DataFrame:
    """Odometry in place of the pose, computed with a lever ``turning`` times shorter."""
    v = f.select(V).to_numpy() @ np.linalg.pinv(youbot().jacobian_array).T * [1, 1, turning]
    yaw = np.concatenate([[0.0], np.cumsum(0.01 * v[:-1, 2])])
    c, s = np.cos(yaw), np.sin(yaw)
    way = np.cumsum(
        0.01 * np.column_stack([c * v[:, 0] - s * v[:, 1], s * v[:, 0] + c * v[:, 1]]), 0
    )
    return f.with_columns(
        pl.Series("x", way[:, 0]), pl.Series("y", way[:, 1]), pl.Series("yaw", yaw)
    )


def test_pose_computed_from_the_wheels_confirms_nothing(tmp_path):
    log = load(tmp_path, summed(good_frame(), 2.0))
    (found,) = named(log, "wheel_odometry")
    assert "lever l + h of 0.193 m" in found.what
    assert log.pose is None
    assert found.geometry
    assert "wheel_odometry" in unfit([log])
    with pytest.raises(ValueError, match="computed from its wheel speeds"):
        calibrate_kinematics(log)
    (right,) = named(load(tmp_path, summed(good_frame())), "wheel_odometry")
    assert not right.geometry
    used = load(tmp_path, summed(good_frame(), 2.0), accept=("wheel_odometry",))
    assert used.pose is not None
    assert "wheel_odometry" not in unfit([used])


def test_measured_pose_is_not_taken_for_a_computed_one(tmp_path):
    assert not load(tmp_path, good_frame()).findings


@pytest.mark.parametrize("factor", [1.65, 0.5])
def test_yaw_off_the_lever_ends_in_cannot_say(tmp_path, factor):
    log = load(tmp_path, scale(factor, "yaw")(good_frame()))
    (found,) = [f for f in named(log, "lever") if f.geometry]
    assert f"{youbot().lever / factor:.3f}" in found.what
    assert "--accept lever" in unfit([log])
    used = load(tmp_path, scale(factor, "yaw")(good_frame()), accept=["lever"])
    assert "lever" not in unfit([used])


def test_jumps_of_the_pose_split_the_log(tmp_path):
    frame = put("x", slice(1500, None), lambda x: x + 0.3)(good_frame())
    frame = put("y", slice(2600, None), lambda y: y - 0.2)(frame)
    log = load(tmp_path, frame)
    assert "jumps 2 times, by up to 0.298 m" in named(log, "pose_jumps")[0].what
    assert log.starts == (0, 1500, 2600)
    good = calibrate_kinematics(load(tmp_path, good_frame()))
    found = calibrate_kinematics(log)
    for axis, gain in good.gains.items():
        assert found.gains[axis].value == pytest.approx(gain.value, abs=0.005)


def test_sideways_shortfall_is_slip_before_it_is_a_roller_angle(tmp_path):
    frame = summed(good_frame())
    v = good_frame().select(V).to_numpy() @ np.linalg.pinv(youbot().jacobian_array).T
    v *= [1.0, 0.8, 1.0]
    yaw = frame["yaw"].to_numpy()
    c, s = np.cos(yaw), np.sin(yaw)
    way = 0.01 * np.cumsum(
        np.column_stack([c * v[:, 0] - s * v[:, 1], s * v[:, 0] + c * v[:, 1]]), 0
    )
    rng = np.random.default_rng(2)
    noisy = np.column_stack([way, yaw]) + 1e-3 * rng.standard_normal((len(way), 3))
    frame = frame.with_columns([pl.Series(name, noisy[:, k]) for k, name in enumerate(P)])
    remarks = " ".join(calibrate_kinematics(load(tmp_path, frame)).remarks)
    assert "0.799 times" in remarks
    assert "slip" in remarks


# Failed reads and repeated rows


@pytest.mark.parametrize("rows", [[900, 2300], [1234]])
def test_all_wheels_zero_for_single_rows_are_replaced(tmp_path, rows):
    frame = good_frame()
    for name in V:
        frame = put(name, rows, 0.0)(frame)
    log = load(tmp_path, frame)
    assert "failed reads" in named(log, "failed_reads")[0].what
    assert difference(log) < 0.002


@pytest.mark.parametrize("width", [1, 3])
def test_repeated_rows_are_told_and_replaced(tmp_path, width):
    taken = np.arange(4000)
    for row in range(100, 3900, 190):
        taken[row : row + width] = row - 1
    frame = good_frame()
    frame = frame.with_columns([pl.Series(n, frame[n].to_numpy()[taken]) for n in (*V, *M)])
    log = load(tmp_path, frame)
    assert f"{20 * width} rows" in named(log, "frozen_rows")[0].what
    assert difference(log) < 0.01


def test_wheels_that_stand_by_command_are_not_stuck(tmp_path):
    """Along a diagonal two wheels stand for 15 s, exactly; a sensor that fails does so too."""
    frame, J = good_frame()[:3000], youbot().jacobian_array
    t = frame["time"].to_numpy()
    motion = frame.select(R).to_numpy().copy()
    along = 0.2 * np.sin(1.3 * t)
    motion[:1500] = np.column_stack([along, along, 0 * t])[:1500]
    rng = np.random.default_rng(4)
    speeds = motion @ J.T
    still = np.abs(speeds) < 1e-9
    speeds += 0.02 * rng.standard_normal(speeds.shape)
    speeds[still] = 0.0
    torques = 0.1 * motion @ J.T + 0.02 * rng.standard_normal(speeds.shape)
    torques[still] = 0.0
    assert still[:1500].all(axis=0).sum() == 2
    frame = pl.DataFrame(np.column_stack([t, speeds, torques, motion]), schema=["time", *V, *M, *R])
    log = load(tmp_path, frame)
    assert len(log.time) == 3000
    assert not named(log, "stuck_sensor")
    broken = put(V[int(np.argmax(np.std(speeds[:1500], axis=0)))], slice(500, 900), 0.0)(frame)
    assert named(load(tmp_path, broken), "stuck_sensor")


# Start values, late speeds


def test_start_values_do_not_decide_what_a_log_sees(tmp_path):
    log = load(tmp_path, good_frame())
    nominal = load_model("nominal")
    start = replace(nominal.parameters, mu1=1e-8, mu2=1e-8)
    small = replace(nominal, parameters=start)
    usual, found = (identify(log, model) for model in (nominal, small))
    assert found.observability.rank == 7
    for name in ("x1+x3", "x6", "x7"):
        assert found.lumps[name].value == pytest.approx(usual.lumps[name].value, rel=0.01)


def test_wheel_speeds_that_are_means_are_late_against_the_pose(tmp_path):
    """A motor hub's speeds are means over 50 ms: half of that late, which the robot is not."""
    frame = good_frame()
    sums = np.cumsum(frame.select(V).to_numpy(), axis=0)
    means = np.diff(sums, axis=0, prepend=0 * sums[:1])
    means[5:] = (sums[5:] - sums[:-5]) / 5
    late = frame.with_columns([pl.Series(name, means[:, k]) for k, name in enumerate(V)])
    good, found = (identify(load(tmp_path, f)) for f in (frame, late))
    (word,) = [one for one in found.recording if "later than the pose" in one.words]
    assert word.value == pytest.approx(0.02, abs=0.006)  # half of 50 ms, less half a row
    assert not [one for one in good.recording if "later than the pose" in one.words]
    for name in ("x1+x3", "x2+x3", "x6", "x7"):
        assert found.lumps[name].value == pytest.approx(good.lumps[name].value, rel=0.015)


@pytest.mark.parametrize(("px", "py"), [(0.2, -0.1), (0.05, 0.05)])
def test_a_sensor_off_the_centre_widens_the_intervals(tmp_path, px, py):
    """No wheels beside it tell where it sits; the intervals say what that may have done."""
    frame = with_body(good_frame()).drop(V)
    right = identify(load(tmp_path, frame))
    assert not right.unexplained.certain
    moved = frame.with_columns(
        pl.col(BODY[0]) - py * pl.col(BODY[2]), pl.col(BODY[1]) + px * pl.col(BODY[2])
    )
    found = identify(load(tmp_path, moved))
    assert found.unexplained.certain
    (doubt,) = [d for d in Outcome.of(found, found.prior).doubts if "widened" in d]
    assert "run diagnose" in doubt
    for name in ("x6", "x7"):
        low, high = found.lumps[name].ci95
        assert low < right.lumps[name].value < high
        assert found.lumps[name].se < 0.4 * right.lumps[name].value


# Names


def test_unknown_name_to_accept_lists_the_names(tmp_path):
    with pytest.raises(ValueError, match=r"did you mean 'clock'.*wheel_odometry"):
        load(tmp_path, good_frame(), accept=("clok",))


def test_what_leaves_no_log_cannot_be_accepted(tmp_path):
    with pytest.raises(LogError, match="no log would be left"):
        load(tmp_path, good_frame().drop("time"), accept=("columns",))


def test_every_name_is_documented():
    text = (Path(__file__).parents[1] / "docs/logs.md").read_text()
    assert not [name for name in NAMES if f"`{name}`" not in text]


def test_accepted_warnings_do_not_bend_the_geometry(tmp_path):
    frame = scale(1.65, "yaw")(good_frame())
    log = load(tmp_path, frame, accept=("lever",))
    assert log.accepted == ("lever",)
    assert not any(finding.geometry for finding in log.findings)
    assert warnings(log)
