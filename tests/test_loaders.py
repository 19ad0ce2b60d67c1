"""Every format returns the same log, in SI units and paper signs; damaged files are refused."""

from pathlib import Path

import numpy as np
import polars as pl
import pytest
from foreign_logs import JOINTS, make, write_bag, write_duty, write_traces

from ident.doctor import LogError
from ident.loaders import find_loader, loaders
from ident.log import Log
from youbot_env.platform import omni3

DATA = Path(__file__).parents[2] / "shared" / "data"
CHANNELS = ("wheel_velocity", "wheel_torque", "reference", "pose")


def assert_same(log: Log, good: Log, tolerance: float = 1e-9) -> None:
    np.testing.assert_allclose(log.time, good.time, atol=1e-6)
    for channel in CHANNELS:
        np.testing.assert_allclose(getattr(log, channel), getattr(good, channel), atol=tolerance)


def told(log: Log, words: str) -> bool:
    return any(words in str(finding) for finding in log.findings)


# Text tables


@pytest.mark.parametrize("separator", [",", ";", "\t"])
@pytest.mark.parametrize("newline", ["\n", "\r\n", "\r"])
def test_csv_dialects(tmp_path, separator, newline):
    good, path = make(), tmp_path / "log.csv"
    text = good.save(tmp_path / "plain.csv").read_text()
    text = "# a comment, with a comma\n\n" + text.replace(",", separator)
    path.write_bytes(text.replace("\n", newline).encode())
    log = Log.load(path)
    assert_same(log, good)
    assert not log.findings


def test_comments_and_blank_lines_keep_line_numbers_right(tmp_path):
    lines = make().save(tmp_path / "plain.csv").read_text().splitlines()
    lines[3:3] = ["# half way", ""]
    lines[20] = lines[20].replace(lines[20].split(",")[2], "oops")
    path = tmp_path / "log.csv"
    path.write_text("\n".join(lines))
    with pytest.raises(LogError, match=r"line 21, column wheel_velocity_fr: 'oops' is not a num"):
        Log.load(path)


def test_names_in_a_comment(tmp_path):
    good = make()
    path = good.save(tmp_path / "log.csv")
    path.write_text("# " + path.read_text())
    assert_same(Log.load(path), good)


def test_mapping_with_sign_and_unit(tmp_path):
    good = make()
    frame = pl.read_csv(good.save(tmp_path / "log.csv"))
    frame = frame.rename({"wheel_velocity_rl": "Hinten links"})
    frame = frame.with_columns(-pl.col("Hinten links") * 30 / np.pi)
    frame.write_csv(tmp_path / "foreign.csv")
    with pytest.raises(LogError, match="wheel_velocity_rl"):
        Log.load(tmp_path / "foreign.csv")
    log = Log.load(tmp_path / "foreign.csv", mapping={"wheel_velocity_rl": "-Hinten links [rpm]"})
    assert_same(log, good)


@pytest.mark.parametrize(
    ("mapping", "words"),
    [
        ({"wheel_speed_fl": "time"}, "did you mean 'wheel_velocity_fl'|no name of a log"),
        ({"time": "zeit"}, "time=zeit names no column"),
    ],
)
def test_wrong_mapping_is_refused(tmp_path, mapping, words):
    path = make().save(tmp_path / "log.csv")
    with pytest.raises(LogError, match=words):
        Log.load(path, mapping=mapping)


def test_unit_in_the_header(tmp_path):
    good = make()
    frame = pl.read_csv(good.save(tmp_path / "log.csv"))
    frame = frame.with_columns(pl.col("^wheel_torque_.*$") * 100, pl.col("time") * 1000)
    frame = frame.rename({"time": "Time [ms]"} | {
        name: f"{name} [N cm]" for name in frame.columns if "torque" in name
    })  # fmt: skip
    frame.write_csv(tmp_path / "units.csv")
    log = Log.load(tmp_path / "units.csv")
    assert_same(log, good)
    assert told(log, "N cm")
    assert told(log, "ms")


@pytest.mark.parametrize("scale", [1.0, 1000.0])
def test_currents_become_torques(tmp_path, scale):
    good = make()
    frame = pl.read_csv(good.save(tmp_path / "log.csv"))
    names = {n: n.replace("torque", "current") for n in frame.columns if "torque" in n}
    frame = frame.with_columns(pl.col("^wheel_torque_.*$") / (0.0335 * 9405 / 364) * scale)
    frame.rename(names).write_csv(tmp_path / "current.csv")
    log = Log.load(tmp_path / "current.csv")
    np.testing.assert_allclose(log.wheel_torque, good.wheel_torque, atol=1e-9)
    assert told(log, "kt 0.0335")
    assert told(log, "mA") == (scale == 1000.0)
    double = Log.load(tmp_path / "current.csv", kt=0.067, gear=9405 / 364)
    np.testing.assert_allclose(double.wheel_torque, 2 * good.wheel_torque, atol=1e-9)


def test_currents_of_another_platform_need_their_constants(tmp_path):
    good = make(platform=omni3())
    frame = pl.read_csv(good.save(tmp_path / "log.csv"))
    names = {n: n.replace("torque", "current") for n in frame.columns if "torque" in n}
    frame.rename(names).write_csv(tmp_path / "current.csv")
    with pytest.raises(LogError, match="give kt"):
        Log.load(tmp_path / "current.csv", omni3())
    log = Log.load(tmp_path / "current.csv", omni3(), kt=0.1, gear=10.0)
    np.testing.assert_allclose(log.wheel_torque, good.wheel_torque, atol=1e-9)


def test_duty_becomes_voltage_and_dead_battery_samples_are_repaired(tmp_path):
    good, battery = make(), np.full(1500, 12.0)
    battery[:5] = 0.0
    log = Log.load(write_duty(tmp_path / "log.csv", good, battery))
    expected = 12 * np.clip(0.08 * good.wheel_velocity, -1, 1)
    np.testing.assert_allclose(log.wheel_voltage, expected, atol=1e-12)
    assert log.drive == "voltage"
    assert told(log, "glitches")
    percent = Log.load(write_duty(tmp_path / "percent.csv", good, battery + 0.0, 100.0))
    np.testing.assert_allclose(percent.wheel_voltage, expected, atol=1e-12)
    assert told(percent, "per cent")


def test_duty_without_battery_is_refused(tmp_path):
    path = write_duty(tmp_path / "log.csv", make(), np.full(1500, 12.0))
    pl.read_csv(path).drop("battery_voltage").write_csv(path)
    with pytest.raises(LogError, match="add battery_voltage"):
        Log.load(path)


# Binary formats


def test_parquet(tmp_path):
    good = make()
    frame = pl.read_csv(good.save(tmp_path / "log.csv"))
    frame.write_parquet(tmp_path / "log.parquet")
    assert_same(Log.load(tmp_path / "log.parquet"), good)
    data = (tmp_path / "log.parquet").read_bytes()
    (tmp_path / "cut.parquet").write_bytes(data[: len(data) // 2])
    with pytest.raises(LogError, match=r"cut\.parquet.*\n.*damaged Parquet"):
        Log.load(tmp_path / "cut.parquet")


@pytest.mark.parametrize("kind", ["ros1", "sqlite3", "mcap"])
def test_bags(tmp_path, kind):
    good = make(800)
    name = "run.bag" if kind == "ros1" else "run"
    log = Log.load(write_bag(tmp_path / name, good, kind, offset=0.02))
    assert_same(log, good, tolerance=1e-6)
    assert told(log, "signs of the youBot driver")
    assert not any(finding.severity == "warning" for finding in log.findings)
    if kind == "mcap":
        assert_same(Log.load(next((tmp_path / name).glob("*.mcap"))), good, tolerance=1e-6)


def test_damaged_bags_are_refused(tmp_path):
    path = write_bag(tmp_path / "run.bag", make(300), "ros1")
    (tmp_path / "cut.bag").write_bytes(path.read_bytes()[:20000])
    (tmp_path / "absurd.bag").write_bytes(b"#ROSBAG V2.0\n" + b"\xff" * 200)
    for name in ("cut.bag", "absurd.bag"):
        with pytest.raises(LogError, match=rf"{name}.*\n.*damaged bag"):
            Log.load(tmp_path / name)


def test_bag_without_base_names_the_joints(tmp_path):
    path = write_bag(tmp_path / "run.bag", make(100), "ros1")
    with pytest.raises(LogError, match=r"joints are .*wheel_joint_fl.*--map wheel_left=JOINT"):
        Log.load(path, omni3())


@pytest.mark.parametrize("names", [JOINTS, ["Joint_1", "Joint_2", "Joint_3", "Joint_4"]])
def test_datatrace_folder(tmp_path, names):
    good = make(1000)
    log = Log.load(write_traces(tmp_path / "traces", good, names))
    np.testing.assert_allclose(log.time, good.time - good.time[0], atol=1e-6)
    inner = slice(1, -1)  # traces start 0.2 ms apart and are interpolated
    np.testing.assert_allclose(log.wheel_velocity[inner], good.wheel_velocity[inner], atol=0.01)
    np.testing.assert_allclose(log.wheel_torque[inner], good.wheel_torque[inner], atol=0.01)
    assert told(log, "signs of the youBot driver")


def test_incomplete_datatrace_names_the_wheels(tmp_path):
    folder = write_traces(tmp_path / "traces", make(300), JOINTS[:3])
    with pytest.raises(LogError, match=r"no trace of the wheels \['rr'\]"):
        Log.load(folder)


# Finding loaders


def test_unknown_format_and_missing_file_are_named(tmp_path):
    (tmp_path / "log.bin").write_bytes(b"\x00\x01\x02" * 100)
    with pytest.raises(LogError, match=r"format is unknown.*CSV.*ROS"):
        Log.load(tmp_path / "log.bin")
    with pytest.raises(LogError, match="does not exist"):
        Log.load(tmp_path / "nothing.csv")
    with pytest.raises(LogError, match="it is a folder"):
        Log.load(tmp_path)


def test_every_loader_has_its_own_name_and_title():
    assert len({loader.identifier for loader in loaders()}) == len(loaders()) >= 5
    assert all(loader.title for loader in loaders())


NEW_FORMAT = """
import numpy as np
from ident.loaders.base import Loader, Table, head

class MineLoader(Loader):
    identifier, title, priority = "mine", "my format", 5

    def recognises(self, path):
        return head(path, 4) == b"MINE"

    def read(self, path, platform):
        values = np.frombuffer(path.read_bytes()[4:]).reshape(-1, 9)
        columns = {f"c{k}": values[:, k] for k in range(9)}
        table = Table(columns, np.arange(1, len(values) + 1), "row")
        channels, wheels = ("wheel_velocity", "wheel_torque"), platform.wheel_names
        names = [f"{channel}_{wheel}" for channel in channels for wheel in wheels]
        table.names = {"time": "c0", **{name: f"c{k}" for k, name in enumerate(names, 1)}}
        table.names["wheel_velocity_fl"] = "-c1 [rpm]"
        return table
"""


def test_new_file_in_the_folder_is_a_new_format(tmp_path, monkeypatch):
    import ident.loaders

    (tmp_path / "mine_of_the_test.py").write_text(NEW_FORMAT)
    monkeypatch.setattr(ident.loaders, "__path__", [*ident.loaders.__path__, str(tmp_path)])
    ident.loaders._shipped.cache_clear()
    good = make()
    speeds = good.wheel_velocity * [-30 / np.pi, 1, 1, 1]
    values = np.column_stack([good.time, speeds, good.wheel_torque])
    path = tmp_path / "log.mine"
    path.write_bytes(b"MINE" + values.tobytes())
    try:
        log = Log.load(path)
    finally:
        ident.loaders._shipped.cache_clear()
    np.testing.assert_allclose(log.wheel_velocity, good.wheel_velocity, atol=1e-9)
    np.testing.assert_allclose(log.wheel_torque, good.wheel_torque, atol=1e-9)


# Real logs, where they are at hand


@pytest.mark.parametrize("name", ["red_field_deposit.csv", "square.csv"])
def test_real_mecanum_log(name):
    path = DATA / "ftc-mecanum" / name
    if not path.exists():
        pytest.skip("the real logs are not at hand")
    assert find_loader(path).identifier == "ftc"
    log = Log.load(path)
    assert log.drive == "voltage"
    assert log.wheel_velocity is None
    # The robot follows its command with a lag; duties as body motions say where it goes.
    commanded = log.wheel_voltage @ np.linalg.pinv(log.platform.jacobian_array).T
    measured = log.body_velocity
    for axis in range(3):
        later = [measured[lag:, axis] for lag in range(12)]
        together = [np.corrcoef(commanded[: len(v), axis], v)[0, 1] for v in later]
        assert max(together) > 0.7
    words = ("sign", "order", "unit")
    warnings = [str(f) for f in log.findings if f.severity == "warning"]
    assert not any(word in text for word in words for text in warnings)


def test_motor_bench_file_is_refused():
    path = DATA / "ftc-mecanum" / "motor_data_voltage_12.66.csv"
    if not path.exists():
        pytest.skip("the real logs are not at hand")
    with pytest.raises(LogError, match=r"velocities of wheels or body.*wheel_velocity_fl.*bench"):
        Log.load(path)
