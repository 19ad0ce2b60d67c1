"""A platform from a line, a name or a small file; the examples of docs/add_a_platform.md."""

import math
import re
from pathlib import Path

import numpy as np
import pytest
from foreign_logs import make
from shared_data import shared
from test_loaders import told

from ident.doctor.columns import examine_columns
from ident.loaders import read
from ident.log import Log
from youbot_env.model_file import (
    ModelFileError,
    load_model,
    platform_from_dict,
    platform_to_dict,
    save_model,
)
from youbot_env.platform import mecanum, omni3, youbot
from youbot_env.platform_file import read_platform

GUIDE = Path(__file__).parents[1] / "docs" / "add_a_platform.md"


@pytest.fixture
def examples(tmp_path):
    """Paths of the YAML examples of the guide, by name."""
    found = {}
    for text in re.findall(r"```yaml\n(.*?)```", GUIDE.read_text(), re.DOTALL):
        name = re.match(r"# (\S+)", text).group(1)
        found[name] = tmp_path / name
        found[name].write_text(text)
    return found


def test_examples_of_the_guide(examples):
    given = read_platform(str(examples["robotino.yaml"]))
    three = omni3(0.125, 0.04, 0.008)
    np.testing.assert_allclose(
        given.platform.jacobian_array, three.jacobian_array, atol=1e-12, rtol=1e-12
    )
    assert (given.kt, given.gear) == (0.0514, 16.0)
    assert given.mapping["wheel_velocity_rear"] == "m2vel [rad/s motor]"
    four = read_platform(str(examples["mecanum.yaml"])).platform
    assert four.geometry == mecanum("mine", 0.14, 0.13, 0.05, 0.012, 1.4).geometry
    line = re.search(r'--platform "(R=[^"]*)"', GUIDE.read_text()).group(1)
    assert read_platform(line).platform.geometry == four.geometry
    code = re.search(r"```python\n(.*?)```", GUIDE.read_text(), re.DOTALL).group(1)
    make(300).save(examples["mecanum.yaml"].parent / "run.csv")
    lines = [line for line in code.splitlines() if "robotino" not in line]
    text = "\n".join(lines).replace('"run.csv"', "run").replace('"mecanum.yaml"', "four")
    names = {
        "run": examples["mecanum.yaml"].parent / "run.csv",
        "four": str(examples["mecanum.yaml"]),
    }
    exec(text, names)
    assert names["log"].platform.name == "mine"


def test_names_lines_and_model_files(tmp_path):
    assert read_platform("youbot").platform == youbot()
    assert read_platform("R=.05, l=0.15, h=0.2").platform.roller_radius == pytest.approx(
        0.05 * 0.014 / 0.0475
    )
    (tmp_path / "letters.yaml").write_text("R: 0.05\nr: 0.01\nl: 0.1\nh: 5e-2\nlog: {gear: 20}\n")
    given = read_platform(str(tmp_path / "letters.yaml"))
    assert given.platform.name == "letters"
    assert given.platform.lever == pytest.approx(0.15)
    assert given.gear == 20
    save_model(load_model("nominal"), tmp_path / "model.yaml")
    assert read_platform(str(tmp_path / "model.yaml")).platform == youbot()


def test_a_platform_survives_being_written():
    for platform in (youbot(), omni3()):
        again = platform_from_dict(platform_to_dict(platform))
        np.testing.assert_allclose(again.jacobian_array, platform.jacobian_array, rtol=1e-12)
        assert again.wheel_names == platform.wheel_names


def test_levers():
    for platform in (youbot(), omni3()):
        scaled = platform.with_lever(0.3)
        assert scaled.lever == pytest.approx(0.3)
        np.testing.assert_allclose(scaled.jacobian_array[:, :2], platform.jacobian_array[:, :2])
        angles = [math.atan2(wheel.y, wheel.x) for wheel in scaled.wheels]
        assert angles == pytest.approx([math.atan2(w.y, w.x) for w in platform.wheels])


@pytest.mark.parametrize(("text", "words"), [
    ("nothing.yaml", "no platform 'nothing.yaml'.*R=0.05"),
    ("R=0.05 l=0.1", "h .half the distance between front and rear.* is missing"),
    ("R=0.05 l=0.1 h=big", "h = 'big' must be a positive number"),
    ("R=0.05 l=0.1 h=0.1 w=3", "'w' is none of R"),
    ("R=0.05 R=0.06 l=0.1 h=0.1", "R stands twice"),
    ("R=0.05 r=0.06 l=0.1 h=0.1", "roller_radius = 0.06 m must be smaller"),
])  # fmt: skip
def test_bad_lines(tmp_path, monkeypatch, text, words):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ModelFileError, match=words):
        read_platform(text)


@pytest.mark.parametrize(("text", "words"), [
    ("- 1", "it holds no entries"),
    ("wheel_radius: 0.05\nwheels: []", "roller_radius is missing"),
    ("R: 0.05\nl: 0.1\nh: 0.1\nlog: {gear: none}", "gear = 'none' must be a positive number"),
    ("R: 0.05\nl: 0.1\nh: 0.1\nlog: {turns: 3}", "log: .*it may hold map, kt, gear"),
    ("wheel_radius: 0.05\nroller_radius: 0.01\nwheels: [{distance: 1}]", "wheel 1 has no at_deg"),
    ("wheel_radius: 0.05\nroller_radius: 0.01\nwheels: [{distance: 1, at_deg: 3, x: 1}]",
     "x and y, or distance and at_deg"),
    ("a: [", "not valid YAML"),
])  # fmt: skip
def test_bad_files_name_themselves(tmp_path, text, words):
    (tmp_path / "bad.yaml").write_text(text)
    with pytest.raises(ModelFileError, match=rf"(?s)bad\.yaml.*{words}"):
        read_platform(str(tmp_path / "bad.yaml"))


def write_robotino(path, good):
    """A log as the laboratory of Robotino writes it: three header lines, ``;`` at each end."""
    moved = 0.5 * (good.wheel_velocity[1:] + good.wheel_velocity[:-1]) * good.dt
    turned = np.vstack([np.zeros(3), np.cumsum(moved, axis=0)])
    counts = np.round(16 * turned * 2000 / (2 * np.pi))
    speed = np.round(16 * good.wheel_velocity / 2.82743) * 2.82743
    current = np.abs(0.9 * np.sign(good.wheel_velocity) + 0.5 * good.wheel_velocity)
    table = [(good.time - good.time[0]) * 1e3, *good.reference.T, *counts.T, *speed.T, *current.T]
    table.append(np.linspace(100, 900, len(good.time)))
    long = ["Time", "X set speed", "Y set speed", "Rotational set speed"]
    long += [f"{k} motor {what}" for what in ("position", "velocity", "current") for k in "123"]
    units = ["ms", "m/s", "m/s", "rad/s", *3 * ["ticks"], *3 * ["rad/s"], *3 * ["A"], "pix"]
    short = ["t", "xsetspeed", "ysetspeed", "setvel"]
    short += [f"m{k}{what}" for what in ("pos", "vel", "cur") for k in "123"]
    rows = [[*long, "X axis global position"], units, [*short, "xpos"]]
    rows += [[f"{value:.9g}" for value in row] for row in np.column_stack(table)]
    path.write_text("".join(";".join(row) + ";\n" for row in rows))
    return path


def test_a_log_of_three_omni_wheels_needs_only_its_platform(tmp_path, examples):
    platform = read_platform(str(examples["robotino.yaml"])).platform
    good = make(1200, 0.03, platform)
    path = write_robotino(tmp_path / "log.csv", good)
    log = Log.load(path, str(examples["robotino.yaml"]))
    inner = slice(2, -2)
    np.testing.assert_allclose(log.wheel_velocity[inner], good.wheel_velocity[inner], atol=0.03)
    np.testing.assert_allclose(log.reference, good.reference, atol=1e-8)
    assert log.pose is None  # pixels are no metres
    turning = np.abs(good.wheel_velocity) > 0.3
    torque = (0.9 * np.sign(good.wheel_velocity) + 0.5 * good.wheel_velocity) * 0.0514 * 16
    np.testing.assert_allclose(log.wheel_torque[turning], torque[turning], atol=1e-6)
    for words in (
        "3 header lines",
        "the unit is ms",
        "magnitudes alone",
        "ticks a turn of the wheel",
    ):
        assert told(log, words)
    (tmp_path / "small.yaml").write_text(
        examples["robotino.yaml"].read_text().replace("m1cur", "m9cur")
    )
    with pytest.raises(ValueError, match=r"wheel_current_rear.*without.*wheel_current_left"):
        Log.load(path, str(tmp_path / "small.yaml"))


def test_real_logs_of_three_omni_wheels_have_all_their_columns(examples):
    given = read_platform(str(examples["robotino.yaml"]))
    files = sorted(shared("robotino", "green").glob("*.csv"))
    assert len(files) == 72
    for path in files:
        table = read(path, given.platform)
        table.usual = given.mapping
        record = examine_columns(table, path.name, given.platform, None, given.gear)
        channels = {"reference", "wheel_position", "wheel_velocity", "wheel_current"}
        assert channels <= set(record.channels)
        assert "pose" not in record.channels
