"""Every known way of spoiling a log is put right and told, or refused by name; none is silent."""

from __future__ import annotations

import re
import time
from pathlib import Path

import numpy as np
import polars as pl
import pytest
from spoiled_logs import MUTATIONS, M, P, R, V, good_frame, negate, simulate, text_of

from ident.doctor import LogError
from ident.log import Log

DATA = Path(__file__).parents[2] / "shared" / "data"
SILENT = 0.02  # rms difference over rms of the good channel
SIGN_WORDS = ("sign", "order", "unit", "times as", "opposite")


def load(tmp_path: Path, content: pl.DataFrame | str | bytes, **options) -> Log:
    if isinstance(content, pl.DataFrame):
        content = text_of(content)
    path = tmp_path / "log.csv"
    path.write_bytes(content.encode() if isinstance(content, str) else content)
    return Log.load(path, **options)


def difference(log: Log) -> float:
    """Largest rms difference of speeds and torques from the good log, over their rms."""
    frame, worst = good_frame(), 0.0
    if len(log.time) < 0.7 * len(frame):
        return np.inf
    shift = 0.0 if abs(log.time[0]) < 5 else log.time[0]
    for names, values in ((V, log.wheel_velocity), (M, log.wheel_torque)):
        for column, name in enumerate(names):
            good = np.interp(log.time - shift, frame["time"], frame[name])
            rms = np.sqrt(np.mean(frame[name].to_numpy() ** 2))
            worst = max(worst, np.sqrt(np.mean((values[:, column] - good) ** 2)) / rms)
    return float(worst)


def warnings(log: Log) -> list[str]:
    return [str(finding) for finding in log.findings if finding.severity == "warning"]


def test_good_log_passes_without_a_word(tmp_path):
    log = load(tmp_path, good_frame())
    assert not log.findings
    assert difference(log) < 1e-5


def test_there_are_enough_mutations():
    assert len(MUTATIONS) >= 60


@pytest.mark.parametrize("name", MUTATIONS)
def test_mutation_is_never_silent(tmp_path, name):
    spoil, outcome, words = MUTATIONS[name]
    content = spoil(good_frame())
    if outcome == "refused":
        with pytest.raises(LogError, match=f"(?s)log.csv cannot be used.*{words}"):
            load(tmp_path, content)
        return
    log = load(tmp_path, content)
    text = "\n".join(map(str, log.findings))
    assert re.search(words, text), text or "silent"
    if outcome == "fixed":
        assert not warnings(log), text
        assert difference(log) < SILENT


def shuffled(frame: pl.DataFrame) -> pl.DataFrame:
    return frame.select(sorted(frame.columns, key=lambda name: name[::-1]))


def lines_of(frame: pl.DataFrame) -> list[str]:
    return text_of(frame).splitlines()


HARMLESS = {
    "byte order mark": lambda f: b"\xef\xbb\xbf" + text_of(f).encode(),
    "Windows line ends": lambda f: text_of(f).replace("\n", "\r\n"),
    "UTF-16": lambda f: text_of(f).encode("utf-16"),
    "scientific notation": lambda f: f.write_csv(float_scientific=True),
    "separators at the end of rows": lambda f: text_of(f).replace("\n", ",\n"),
    "separators at the end of all rows but the names": lambda f: "\n".join(
        [lines_of(f)[0], *(line + "," for line in lines_of(f)[1:])]
    ),
    "no line end at the end": lambda f: text_of(f).rstrip("\n"),
    "blank lines": lambda f: text_of(f).replace("\n", "\n\n"),
    "comments": lambda f: "# made by hand\n" + text_of(f).replace("\n10.", "\n# ten\n10."),
    "capital letters": lambda f: text_of(f.rename(str.title)),
    "spaces": lambda f: text_of(f).replace(",", ", "),
    "quotes": lambda f: f.write_csv(quote_style="always"),
    "names of the driver": lambda f: text_of(f).replace("_rl", "_bl").replace("_rr", "_br"),
    "another order of columns": lambda f: text_of(shuffled(f)),
    "absolute time": lambda f: text_of(f.with_columns(pl.col("time") + 1.7e9)),
    "an inertial sensor": lambda f: text_of(f.with_columns(imu_ax=pl.lit(0.1))),
}


@pytest.mark.parametrize("name", HARMLESS)
def test_dialect_changes_nothing(tmp_path, name):
    log = load(tmp_path, HARMLESS[name](good_frame()))
    assert not log.findings
    assert difference(log) < 1e-5


def test_strict_refuses_what_is_only_told(tmp_path):
    spoil, _, words = MUTATIONS["speed with an offset"]
    with pytest.raises(LogError, match=words):
        load(tmp_path, spoil(good_frame()), strict=True)


def test_without_witness_two_explanations_are_refused(tmp_path):
    frame = negate(*V)(good_frame()).drop(P + R)
    with pytest.raises(LogError, match=r"2 ways.*all wheels have.*; or .*all wheels have"):
        load(tmp_path, frame)
    assert any("neither reference nor pose" in text for text in warnings(
        load(tmp_path, good_frame().drop(P + R))))  # fmt: skip


def test_reference_alone_cannot_tell_the_ends_of_a_robot(tmp_path):
    """Wheel speeds and torques agree: the command goes, eight good columns stay."""
    log = load(tmp_path, negate(R[1])(good_frame()).drop(P))
    assert log.reference is None
    assert difference(log) < 1e-5
    assert any("reference contradicts wheel_velocity and wheel_torque" in t for t in warnings(log))


def test_redundancy_alone_finds_one_wheel(tmp_path):
    log = load(tmp_path, negate(V[2])(good_frame()).drop(P + R))
    assert difference(log) < 1e-5
    assert any("rl has the other sign" in str(finding) for finding in log.findings)


def test_mapping_with_a_minus_repairs_what_was_refused(tmp_path):
    frame = negate(*V)(good_frame()).drop(P + R)
    log = load(tmp_path, frame, mapping={name: f"-{name}" for name in V})
    assert difference(log) < 1e-5


def test_angles_decide_the_signs_of_speeds(tmp_path):
    """Stock ROS joint states: angles of the left wheels are negated already, speeds are not."""
    frame = good_frame().drop(P + R)
    angles = {f"wheel_position_{name[-2:]}": frame[name].cum_sum() * 0.01 for name in V}
    frame = negate(V[0], V[2], M[0], M[2])(frame).with_columns(**angles)
    log = load(tmp_path, frame)
    assert difference(log) < 1e-5
    assert any("change of angle have opposite signs" in str(f) for f in log.findings)


L = 0.15 + 0.2355
ORDINARY = {
    "turn about a point on the left": lambda t: np.array([L, 0.0, 1.0]) * 0.5 * np.sin(0.8 * t),
    "turn about a point behind": lambda t: np.array([0.0, L, 1.0]) * 0.5 * np.sin(0.8 * t),
    "straight": lambda t: np.array([0.3 * np.sin(0.7 * t), 0.0, 0.0]),
    "sideways": lambda t: np.array([0.0, 0.3 * np.sin(0.7 * t), 0.0]),
    "diagonal": lambda t: np.array([0.2, 0.2, 0.0]) * np.sin(0.7 * t),
    "on the spot": lambda t: np.array([0.0, 0.0, np.sin(0.7 * t)]),
    "circle": lambda t: np.array([0.3, 0.0, 0.5]) * min(t / 2, 1.0),
    "steps": lambda t: np.array([0.3, 0.2, 0.5]) * np.sign(np.sin(np.array([0.6, 1.0, 0.37]) * t)),
    "stop and go": lambda t: np.array([0.3, 0.1, 0.5]) * max(np.sin(0.5 * t) - 0.6, 0.0),
}


@pytest.mark.parametrize("motion", ORDINARY)
def test_one_sided_motion_raises_no_false_alarm(tmp_path, motion):
    frame = simulate(ORDINARY[motion], seconds=20.0)
    for columns in ([], P, R):
        log = load(tmp_path, frame.drop(columns))
        told = [str(f) for f in log.findings if "hardly any" not in f.what]
        assert not told
        np.testing.assert_allclose(log.wheel_velocity, frame.select(V), atol=1e-6)
        np.testing.assert_allclose(log.wheel_torque, frame.select(M), atol=1e-6)


@pytest.mark.parametrize(
    "path", sorted((DATA / "roller-robot").glob("*.csv")), ids=lambda p: p.name
)
def test_real_rollers_raise_no_false_alarm(path):
    log = Log.load(path)
    assert not log.findings


def real(name: str) -> pl.DataFrame:
    path = DATA / "ftc-mecanum" / name
    if not path.exists():
        pytest.skip("the real logs are not at hand")
    return pl.read_csv(path)


@pytest.mark.parametrize("name", ["red_field_deposit.csv", "square.csv"])
@pytest.mark.parametrize("corner", ["fl", "fr", "bl", "br"])
def test_wrong_duty_sign_of_a_real_robot_is_put_right(tmp_path, name, corner):
    frame = real(name)
    good = load(tmp_path, frame)
    assert not any(word in text for word in SIGN_WORDS for text in warnings(good))
    log = load(tmp_path, frame.with_columns(-pl.col(corner)))
    assert any("has the other sign" in str(finding) for finding in log.findings)
    np.testing.assert_allclose(log.wheel_voltage, good.wheel_voltage)


@pytest.mark.parametrize(
    ("columns", "factor", "words"),
    [
        (["x_velocity", "y_velocity"], 1000.0, "body_velocity is in mm"),
        (["x_position", "y_position"], 1000.0, "pose is in mm"),
        (["angle"], 180 / np.pi, "yaw is in degrees"),
        (["fl", "fr", "bl", "br"], 100.0, "per cent"),
    ],
)
def test_wrong_units_of_a_real_robot_are_put_right(tmp_path, columns, factor, words):
    frame = real("red_field_deposit.csv")
    good = load(tmp_path, frame)
    log = load(tmp_path, frame.with_columns([pl.col(name) * factor for name in columns]))
    assert any(words in str(finding) for finding in log.findings)
    for channel in ("wheel_voltage", "body_velocity", "pose"):
        np.testing.assert_allclose(getattr(log, channel), getattr(good, channel), atol=1e-5)


def test_the_time_to_load_grows_with_the_length_of_a_log(tmp_path):
    """Guards against slow code; an hour (360 000 rows) takes some 2 s on one slow core."""
    took = []
    for count in (3, 15):
        frame = pl.concat([good_frame()] * count)
        frame = frame.with_columns(time=pl.int_range(len(frame)) * 0.01).drop(P)
        path = tmp_path / "long.csv"
        frame.write_csv(path)
        begin = time.perf_counter()
        Log.load(path)
        took.append(time.perf_counter() - begin)
    assert took[1] < 3 * 5 * took[0]
