"""Logs in formats that nobody here chose: each made by a few lines, read without a converter."""

import numpy as np
import polars as pl
import pytest
from foreign_logs import make
from shared_data import shared
from test_loaders import assert_same, told

from ident.doctor import LogError
from ident.loaders.wheel_names import match_wheels
from ident.log import Log
from youbot_env.platform import mecanum, omni3, youbot

WHEELS = ("fl", "fr", "rl", "rr")
NAMES = ["front_left_wheel_joint", "front_right_wheel_joint",
         "rear_left_wheel_joint", "rear_right_wheel_joint"]  # fmt: skip


# Bags


def write_joints(path, messages):
    """A bag of joint states: ``(time, names, position, velocity, effort, frame)`` each."""
    from rosbags.rosbag2 import StoragePlugin, Writer
    from rosbags.typesys import Stores, get_typestore

    store = get_typestore(Stores.ROS2_HUMBLE)
    types, kind = store.types, "sensor_msgs/msg/JointState"
    with Writer(path, version=9, storage_plugin=StoragePlugin.MCAP) as writer:
        link = writer.add_connection("/joint_states", kind, typestore=store)
        for stamp, names, *values, frame in messages:
            now = round(stamp * 1e9)
            time = types["builtin_interfaces/msg/Time"](now // 10**9, now % 10**9)
            header = types["std_msgs/msg/Header"](time, frame)
            values = [np.asarray(v, float) for v in values]
            message = types[kind](header, list(names), *values)
            writer.write(link, now, store.serialize_cdr(message, kind))
    return path


def states(good, names, frame="base"):
    position = np.cumsum(good.wheel_velocity, axis=0) * good.dt
    for k, t in enumerate(good.time):
        yield t, names, position[k], good.wheel_velocity[k], good.wheel_torque[k], frame


@pytest.mark.parametrize("names", [
    NAMES, [f"wheel_{w}" for w in ("fl", "fr", "bl", "br")],
    ["FrontLeftWheel", "FrontRightWheel", "BackLeftWheel", "BackRightWheel"],
    ["lf_motor", "rf_motor", "lb_motor", "rb_motor"],
])  # fmt: skip
def test_bags_with_any_usual_names_of_the_joints(tmp_path, names):
    good = make(600)
    log = Log.load(write_joints(tmp_path / "bag", states(good, names)))
    np.testing.assert_allclose(log.wheel_velocity, good.wheel_velocity, atol=1e-9)
    np.testing.assert_allclose(log.wheel_torque, good.wheel_torque, atol=1e-9)
    assert told(log, "looks like a log of another robot") == (names[0] != "wheel_joint_fl")


def test_unknown_joints_are_listed_and_mapped_by_their_names(tmp_path):
    good, names = make(600), ["m1", "m2", "m3", "m4"]
    path = write_joints(tmp_path / "bag", states(good, names))
    with pytest.raises(LogError, match=r"joints are m1, m2, m3, m4; name .*--map wheel_fl=JOINT"):
        Log.load(path)
    log = Log.load(path, mapping={f"wheel_{w}": n for w, n in zip(WHEELS, names, strict=True)})
    np.testing.assert_allclose(log.wheel_velocity, good.wheel_velocity, atol=1e-9)
    np.testing.assert_allclose(log.wheel_torque, good.wheel_torque, atol=1e-9)
    single = {f"wheel_{channel}_{w}": n for w, n in zip(WHEELS, names, strict=True)
              for channel in ("velocity", "torque")}  # fmt: skip
    np.testing.assert_allclose(Log.load(path, mapping=single).wheel_torque, good.wheel_torque)


@pytest.mark.parametrize("frame", ["", "other"])
def test_two_publishers_on_joint_states(tmp_path, frame):
    good = make(600)

    def both():
        for k, (t, names, *values) in enumerate(states(good, NAMES)):
            yield t, names, *values
            if k % 2 == 0:
                yield t, names, values[0], [], [], frame

    log = Log.load(write_joints(tmp_path / "bag", both()))
    assert len(log.time) == 600
    np.testing.assert_allclose(log.wheel_velocity, good.wheel_velocity, atol=1e-9)
    (finding,) = [f for f in log.findings if "two publishers" in f.what]
    assert "600 messages of /joint_states from frame 'base': position and velocity" in finding.what
    assert "300 messages of /joint_states" in finding.what
    assert not frame or "frame 'other': position of front_left_wheel_joint" in finding.what


def test_publishers_of_zeros_and_of_nothing_do_not_speak_for_the_wheels(tmp_path):
    good = make(300)

    def all_of_them():
        for t, names, *values in states(good, NAMES):
            yield t, names, *values
            for frame, filler in (("zeros", 0.0), ("nothing", np.nan)):
                for part in (0.1, 0.2):
                    yield t + part * good.dt, names, *([np.full(4, filler)] * 3), frame

    messages = sorted(all_of_them(), key=lambda message: message[0])
    log = Log.load(write_joints(tmp_path / "bag", messages))
    np.testing.assert_allclose(log.wheel_velocity, good.wheel_velocity, atol=1e-9)
    assert told(log, "frame 'zeros'")


def test_matching_of_wheel_names():
    assert (
        list(match_wheels([*NAMES, "arm_joint_1", "front_left_caster"], youbot()).values()) == NAMES
    )
    assert match_wheels(NAMES[:3], youbot()) == {}
    assert match_wheels([*NAMES, "wheel_fl"], youbot()) == {}
    found = match_wheels(["wheel_left_joint", "wheel_back_joint", "wheel_right_joint"], omni3())
    assert found["rear"] == "wheel_back_joint"


# Text


def test_rostopic_echo(tmp_path):
    good = make(600)
    columns = {"%time": np.round(good.time * 1e9).astype(np.int64)}
    for k, wheel in enumerate(reversed(range(4))):
        columns[f"field.velocity{k}"] = good.wheel_velocity[:, wheel]
        columns[f"field.effort{k}"] = good.wheel_torque[:, wheel]
    path = tmp_path / "echo.csv"
    pl.DataFrame(columns).write_csv(path)
    with pytest.raises(LogError, match=r"columns are %time, field\.velocity0.*--map"):
        Log.load(path)
    mapping = {f"wheel_{channel}_{w}": f"field.{name}{k}"
               for k, w in enumerate(reversed(WHEELS))
               for channel, name in (("velocity", "velocity"), ("torque", "effort"))}  # fmt: skip
    log = Log.load(path, mapping=mapping)
    np.testing.assert_allclose(log.wheel_velocity, good.wheel_velocity, atol=1e-9)
    np.testing.assert_allclose(log.time - log.time[0], good.time - good.time[0], atol=1e-6)
    named = {f"field.name{k}": [n] * 600 for k, n in enumerate(reversed(NAMES))}
    pl.DataFrame(columns | named).write_csv(path)
    np.testing.assert_allclose(Log.load(path).wheel_torque, good.wheel_torque, atol=1e-9)


@pytest.mark.parametrize("style", ["/joint_states/{}/{}", "{}_{}", "{}.{} [{unit}]"])
def test_a_column_for_each_joint(tmp_path, style):
    good = make(600)
    columns, words = {"__time": good.time}, {"velocity": "rad/s", "effort": "N m"}
    for k, name in enumerate(NAMES):
        for word, unit in words.items():
            values = good.wheel_velocity if word == "velocity" else good.wheel_torque
            columns[style.format(name, word, unit=unit)] = values[:, k]
            columns[style.format(name, f"{word}_command", unit=unit)] = 0 * values[:, k]
    pl.DataFrame(columns).write_csv(tmp_path / "log.csv")
    log = Log.load(tmp_path / "log.csv")
    np.testing.assert_allclose(log.wheel_velocity, good.wheel_velocity, atol=1e-9)
    np.testing.assert_allclose(log.wheel_torque, good.wheel_torque, atol=1e-9)
    assert told(log, "looks like a log of another robot")


@pytest.mark.parametrize("names", [
    ("sec", "nanosec"), ("secs", "nsecs"), ("header.stamp.sec", "header.stamp.nanosec"),
    ("field.header.stamp.secs", "field.header.stamp.nsecs"),
])  # fmt: skip
def test_seconds_and_nanoseconds(tmp_path, names):
    good = make(600)
    frame = pl.read_csv(good.save(tmp_path / "log.csv"))
    nanoseconds = np.round(good.time * 1e9).astype(np.int64)
    two = {names[0]: nanoseconds // 10**9, names[1]: nanoseconds % 10**9}
    frame.drop("time").with_columns(**{k: pl.Series(v) for k, v in two.items()}).write_csv(
        tmp_path / "log.csv"
    )
    log = Log.load(tmp_path / "log.csv")
    assert_same(log, good)
    assert told(log, f"time is in {names[0]} and {names[1]}")


def test_three_header_lines_separators_at_the_end_and_decimal_commas(tmp_path):
    good = make(600)
    frame = pl.read_csv(good.save(tmp_path / "log.csv"))
    units = {"time": "ms"} | {n: "rpm" for n in frame.columns if "velocity" in n}
    frame = frame.with_columns(
        pl.col("time") * 1000, pl.col("^wheel_velocity_.*$") * 30 / np.pi
    ).with_columns(pixels=pl.lit(3.0))
    names = {name: f"The {k}th quantity" for k, name in enumerate(frame.columns)}
    short = [f"q{k}" for k in range(len(names))]
    kinds = {"wheel_torque": "N m", "reference": "m/s", "pixels": "pix", "x": "m", "y": "m"}
    row = [units.get(n) or kinds.get(n) or kinds.get(n.rpartition("_")[0], "rad") for n in names]
    row = ["rad/s" if n == "reference_yaw_rate" else u for n, u in zip(names, row, strict=True)]
    head = [";".join(cells) + ";" for cells in (names.values(), row, short)]
    rows = [";".join(map(str, values)).replace(".", ",") + ";" for values in frame.rows()]
    (tmp_path / "log.csv").write_text("\n".join([*head, *rows]) + "\n")
    mapping = {name: short[k] for k, name in enumerate(names) if name != "pixels"}
    mapping["time"] = names["time"]  # by any of its names
    log = Log.load(tmp_path / "log.csv", mapping=mapping)
    assert_same(log, good)
    assert told(log, "3 header lines: names, units, other names")
    with pytest.raises(LogError, match=r"unit 'pix' is unknown.*--map x="):
        Log.load(tmp_path / "log.csv", mapping=mapping | {"x": short[-1]})


@pytest.mark.parametrize(("name", "form"), [
    ("timestamp_ms", lambda t: 1e3 * t), ("t_us", lambda t: np.round(1e6 * t).astype(np.int64)),
    ("header.stamp", lambda t: np.round(1e9 * t).astype(np.int64)),
    ("time", lambda t: [f"2026-03-01T12:{int(s // 60):02}:{s % 60:09.6f}Z" for s in t]),
    ("Timestamp", lambda t: [f"2026-03-01 12:{int(s // 60):02}:{s % 60:06.3f}" for s in t]),
])  # fmt: skip
def test_stamps_of_other_names_units_and_forms(tmp_path, name, form):
    good = make(600)
    frame = pl.read_csv(good.save(tmp_path / "log.csv")).drop("time")
    frame.with_columns(pl.Series(name, form(good.time))).write_csv(tmp_path / "log.csv")
    log = Log.load(tmp_path / "log.csv")
    np.testing.assert_allclose(log.time - log.time[0], good.time - good.time[0], atol=2e-6)
    np.testing.assert_allclose(log.wheel_torque, good.wheel_torque, atol=1e-9)


@pytest.mark.parametrize("above", ["Experiment 12\n", "Robot;omni\nDate;today\n\n", ""])
@pytest.mark.parametrize("end", [";", ""])
def test_lines_above_the_names(tmp_path, above, end):
    good = make(600)
    lines = good.save(tmp_path / "log.csv").read_text().replace(",", ";").splitlines()
    (tmp_path / "log.csv").write_text(above + "\n".join([lines[0] + end, *lines[1:]]))
    log = Log.load(tmp_path / "log.csv")
    assert_same(log, good)
    assert told(log, "lines above the names") == bool(above)


@pytest.mark.parametrize(("unit", "channel", "factor"), [
    ("rpm", "wheel_velocity", 30 / np.pi), ("deg/s", "wheel_velocity", 180 / np.pi),
    ("m/s", "wheel_velocity", 0.0475), ("rpm motor", "wheel_velocity", 26 * 30 / np.pi),
    ("ticks/s of 2048 motor", "wheel_velocity", 26 * 2048 / (2 * np.pi)),
    ("N m motor", "wheel_torque", 1 / 26), ("mN m", "wheel_torque", 1000.0),
])  # fmt: skip
def test_declared_units(tmp_path, unit, channel, factor):
    good = make(600)
    frame = pl.read_csv(good.save(tmp_path / "log.csv"))
    frame = frame.with_columns(pl.col(f"^{channel}_.*$") * factor)
    frame.rename({f"{channel}_{w}": f"{channel}_{w} [{unit}]" for w in WHEELS}).write_csv(
        tmp_path / "log.csv"
    )
    assert_same(Log.load(tmp_path / "log.csv", gear=26.0), good)
    if "motor" in unit:
        with pytest.raises(LogError, match="needs the gear"):
            Log.load(tmp_path / "log.csv")


def test_a_unit_of_another_quantity_is_refused(tmp_path):
    path = make(600).save(tmp_path / "log.csv")
    path.write_text(path.read_text().replace("wheel_torque_fl", "wheel_torque_fl [rpm]", 1))
    with pytest.raises(LogError, match="wheel_torque_fl cannot be in 'rpm'"):
        Log.load(path)


def test_a_pose_in_inches_is_put_right_and_asked_about(tmp_path):
    good = make(1500)
    frame = pl.read_csv(good.save(tmp_path / "log.csv"))
    frame = frame.drop("reference_vx", "reference_vy", "reference_yaw_rate")
    frame.with_columns(pl.col("x", "y") / 0.0254).write_csv(tmp_path / "log.csv")
    log = Log.load(tmp_path / "log.csv")
    np.testing.assert_allclose(log.pose, good.pose, atol=1e-9)
    (finding,) = [f for f in log.findings if "inches" in f.what]
    assert finding.severity == "warning"
    assert "--map x='x [in]'" in finding.remedy
    log = Log.load(tmp_path / "log.csv", mapping={"x": "x [in]", "y": "y [in]"})
    np.testing.assert_allclose(log.pose, good.pose, atol=1e-9)
    assert not told(log, "inches")


# Angles and currents


def with_angles(tmp_path, good, angle, speed=None, unit=""):
    frame = pl.read_csv(good.save(tmp_path / "log.csv"))
    frame = frame.drop([f"wheel_velocity_{w}" for w in WHEELS])
    for k, w in enumerate(WHEELS):
        frame = frame.with_columns(pl.Series(f"wheel_position_{w}{unit}", angle[:, k]))
        if speed is not None:
            frame = frame.with_columns(pl.Series(f"wheel_velocity_{w}", speed[:, k]))
    frame.write_csv(tmp_path / "log.csv")
    return tmp_path / "log.csv"


def angles(good):
    step = np.diff(good.time)[:, None]
    moved = 0.5 * (good.wheel_velocity[1:] + good.wheel_velocity[:-1]) * step
    return np.vstack([np.zeros(4), np.cumsum(moved, axis=0)])


def test_speeds_come_from_angles_where_those_are_finer(tmp_path):
    good = make()
    coarse = np.round(good.wheel_velocity / 0.8) * 0.8
    log = Log.load(with_angles(tmp_path, good, np.round(angles(good), 5), coarse))
    inner = slice(1, -1)
    np.testing.assert_allclose(log.wheel_velocity[inner], good.wheel_velocity[inner], atol=0.02)
    assert told(log, "the speeds are taken from the angles")
    log = Log.load(with_angles(tmp_path, good, np.round(300 * angles(good)), coarse))
    assert not told(log, "taken from the angles")  # in a unit that nobody says
    fine = good.wheel_velocity + 1e-3 * np.random.default_rng(0).standard_normal(coarse.shape)
    log = Log.load(with_angles(tmp_path, good, np.round(angles(good), 2), fine))
    np.testing.assert_array_equal(log.wheel_velocity, fine)


def test_jittering_angles_do_not_replace_coarse_speeds(tmp_path):
    """Fine ticks that are read at unsteady times are no better than speeds in steps."""
    good = make()
    coarse = np.round(good.wheel_velocity / 0.4) * 0.4
    late = 0.01 * np.random.default_rng(0).random((len(good.time), 1))
    log = Log.load(with_angles(tmp_path, good, angles(good) - late * good.wheel_velocity, coarse))
    np.testing.assert_allclose(log.wheel_velocity, coarse, atol=1e-12)


def test_ticks(tmp_path):
    good = make()
    ticks = np.round(angles(good) * 4096 / (2 * np.pi)) + 30000
    with pytest.raises(LogError, match=r"how many make a turn.*\[ticks of N\]"):
        Log.load(with_angles(tmp_path, good, ticks, unit=" [ticks]"))
    inner = slice(1, -1)
    for period in (None, 65536.0):  # a counter of 16 bits runs over
        counter = ticks if period is None else np.mod(ticks, period)
        path = with_angles(tmp_path, good, counter, unit=" [ticks of 4096]")
        log = Log.load(path)
        np.testing.assert_allclose(log.wheel_velocity[inner], good.wheel_velocity[inner], atol=0.06)
        assert told(log, "16 bits") == (period is not None and bool(np.ptp(counter - ticks) > 1))
    noisy = np.round(good.wheel_velocity / 0.8) * 0.8
    log = Log.load(with_angles(tmp_path, good, ticks, noisy, unit=" [ticks]"))
    (finding,) = [f for f in log.findings if "ticks a turn" in f.what]
    assert float(finding.what.split()[0]) == pytest.approx(4096, rel=0.01)


@pytest.mark.parametrize("commanded", [True, False])
def test_unsigned_currents_get_a_sign(tmp_path, commanded):
    good = make()
    torque = np.abs(good.wheel_velocity) * 0.3 * np.sign(good.wheel_velocity)
    frame = pl.read_csv(good.save(tmp_path / "log.csv"))
    names = {f"wheel_torque_{w}": f"wheel_current_{w}" for w in WHEELS}
    frame = frame.with_columns(
        pl.Series(n, np.abs(torque[:, k])) for k, n in enumerate(names)
    ).rename(names)
    if not commanded:
        frame = frame.drop([n for n in frame.columns if n.startswith("reference")])
    frame.write_csv(tmp_path / "log.csv")
    log = Log.load(tmp_path / "log.csv", kt=0.1, gear=10.0)
    sure = np.abs(good.wheel_velocity) > 0.3
    np.testing.assert_allclose(log.wheel_torque[sure], torque[sure], atol=1e-9)
    assert told(log, "magnitudes alone")
    assert told(log, "the set speed") == commanded


def test_currents_of_16_bits_read_as_unsigned_are_no_magnitudes(tmp_path):
    good = make()
    frame = pl.read_csv(good.save(tmp_path / "log.csv"))
    names = {f"wheel_torque_{w}": f"wheel_current_{w}" for w in WHEELS}
    counts = np.mod(np.round(good.wheel_torque / 0.01), 65536)
    frame.with_columns(pl.Series(n, 0.01 * counts[:, k]) for k, n in enumerate(names)).rename(
        names
    ).write_csv(tmp_path / "log.csv")
    try:
        found = Log.load(tmp_path / "log.csv", kt=0.1, gear=10.0).findings
    except LogError as error:
        found = error.findings
    assert found
    assert not any("magnitudes" in str(finding) for finding in found)


# Platforms


def test_the_youbots_table_is_not_taken_for_granted(tmp_path):
    lines = ["time,battery_voltage,fl,fr,bl,br,x_position,y_position,angle,x_velocity,y_velocity,"
             "angular_velocity"]  # fmt: skip
    good = make(600)
    duty = np.clip(0.05 * good.wheel_velocity, -1, 1)
    v = good.reference
    for k, t in enumerate(good.time):
        lines.append(",".join(f"{x:.9g}" for x in (t, 12.0, *duty[k], *good.pose[k], *v[k])))
    (tmp_path / "log.csv").write_text("\n".join(lines))
    assert told(Log.load(tmp_path / "log.csv"), "youBot's wheel table")
    own = mecanum("own", 0.15, 0.15, 0.05, 0.01, 1.0)
    for platform in (own, "R=0.05 l=0.15 h=0.15"):
        log = Log.load(tmp_path / "log.csv", platform)
        assert not told(log, "youBot's wheel table")
        assert log.platform.lever == pytest.approx(0.3)


@pytest.mark.parametrize("channel", ["pose", "body_velocity"])
def test_a_lever_that_pose_or_gyro_contradict_is_told_with_its_value(tmp_path, channel):
    good = make(2500)
    frame = pl.read_csv(good.save(tmp_path / "log.csv"))
    if channel == "body_velocity":
        measured = ("body_velocity_x", "body_velocity_y", "yaw_rate")
        commanded = ("reference_vx", "reference_vy", "reference_yaw_rate")
        names = dict(zip(commanded, measured, strict=True))
        frame = frame.drop("x", "y", "yaw").rename(names)
    else:
        frame = frame.drop("reference_vx", "reference_vy", "reference_yaw_rate")
    frame.write_csv(tmp_path / "log.csv")
    assert not told(Log.load(tmp_path / "log.csv"), "lever")
    # The same robot read with a table of too wide a base, and told of its lever.
    wide = "R=0.0475 r=0.014 l=0.2 h=0.2355"
    log = Log.load(tmp_path / "log.csv", wide)
    (finding,) = [f for f in log.findings if "turns as with a lever" in f.what]
    assert "l + h of 0.38" in finding.what
    assert "the wheel table has 0.435 m" in finding.what
    value = float(finding.remedy.split("--lever ")[1].split(";")[0])
    assert value == pytest.approx(youbot().lever, rel=0.01)
    assert not told(Log.load(tmp_path / "log.csv", wide, lever=value), "lever")


def test_public_cases_of_formats():
    assert len(Log.load(shared("public-cases", "c12_two_publishers")).time) == 650
    assert len(Log.load(shared("public-cases", "c12d_mdc_names")).time) == 800
    assert told(Log.load(shared("public-cases", "c26_pose_inches.csv")), "inches")
