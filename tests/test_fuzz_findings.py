"""What the fuzz found, one small test each."""

import io
import itertools
import json
import os
import warnings
import zipfile
from hashlib import sha256

import numpy as np
import polars as pl
import pytest
from foreign_logs import make, write_bag
from small_policies import policy
from spoiled_logs import good_frame

import ident.log
from controllers.rl_policy import Policy, PolicyFileError
from ident.log import Log, LogError
from youbot_env.model_file import ModelFileError, load_model, write_atomically
from youbot_env.platform_file import read_platform
from youbot_env.references import MotionFileError, load_motion

ALIASES = "a: &a [x,x,x,x,x,x,x,x]\n" + "".join(
    f"{new}: &{new} [{','.join([f'*{old}'] * 8)}]\n" for old, new in itertools.pairwise("abcdefgh")
)
YAML = {
    "t: !!timestamp 9": "what its tag",
    "m: !!int x": "no number",
    "b: !!binary x": "line 1",
    "o: !!omap [1]": "line 1",
    "a: &a [*a]": "alias of itself",
    "a: &a {b: [1, *a]}": "alias of itself",
    ALIASES: "more than 1000000 values",
}


@pytest.mark.parametrize("text", YAML, ids=lambda text: text[:20])
@pytest.mark.parametrize(
    ("read", "kind"),
    [
        (load_model, ModelFileError),
        (load_motion, MotionFileError),
        (lambda path: read_platform(str(path)), ModelFileError),
    ],
    ids=["model", "motion", "platform"],
)
def test_values_that_are_not_what_they_say(tmp_path, text, read, kind):
    path = tmp_path / "m.yaml"
    path.write_text(text)
    with pytest.raises(kind, match=rf"m\.yaml(.|\n)*{YAML[text]}"):
        read(path)


def test_an_alias_is_no_fault(tmp_path):
    path = tmp_path / "p.yaml"
    path.write_text("R: &r 0.05\nr: 0.01\nl: 0.2\nh: 0.2\nlog: {kt: *r, gear: 1}\n")
    assert read_platform(str(path)).kt == 0.05


def test_numbers_that_no_sensor_gives_are_missing_ones(tmp_path):
    frame = good_frame()
    spoiled = frame["wheel_velocity_fl"].to_list()
    spoiled[700] = -1e300
    frame.with_columns(pl.Series("wheel_velocity_fl", spoiled)).write_csv(tmp_path / "log.csv")
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        log = Log.load(tmp_path / "log.csv")
    assert any("1 missing values" in f.what and "line 702" in f.where for f in log.findings)
    assert np.abs(log.wheel_velocity).max() < 100


def test_the_head_of_an_array_that_does_not_end(tmp_path):
    file = policy().save(tmp_path / "p.json")
    weights = file.with_suffix(".npz")
    stream = io.BytesIO()
    with zipfile.ZipFile(weights) as good, zipfile.ZipFile(stream, "w") as bad:
        for name in good.namelist():
            bad.writestr(name, good.read(name).replace(b"'shape': (", b"'shape': [(", 1))
    weights.write_bytes(stream.getvalue())
    data = json.loads(file.read_text())
    data["weights"]["sha256"] = sha256(stream.getvalue()).hexdigest()
    file.write_text(json.dumps(data))
    with pytest.raises(PolicyFileError, match=r"p\.npz holds no network"):
        Policy.load(file)


class PanicException(BaseException):
    """What polars raises when it panics: no ``Exception``."""


@pytest.mark.parametrize("place", ["read", "examine"])
def test_a_panic_of_a_library_is_told_of_the_file(tmp_path, monkeypatch, place):
    def panic(*_, **__):
        raise PanicException("assertion failed: offset + length <= self.length")

    good_frame().write_parquet(tmp_path / "log.parquet")
    if place == "read":
        monkeypatch.setattr(pl, "read_parquet", panic)
    else:
        monkeypatch.setattr(ident.log, "examine", panic)
    with pytest.raises(LogError, match=r"log\.parquet"):
        Log.load(tmp_path / "log.parquet")


def test_a_folder_of_other_things_is_said_to_be_one_and_not_hashed(script, tmp_path, monkeypatch):
    (tmp_path / "usr").mkdir()
    (tmp_path / "usr" / "notes").write_text("x")
    monkeypatch.setattr(ident.log, "_digest", lambda path: pytest.fail("hashed"))
    with pytest.raises(LogError, match="it is a folder"):
        Log.load(tmp_path / "usr")
    status, _, said = script("identify.py", "usr")
    assert status == 2
    assert "'usr' is a folder, and no log lies directly in it" in said


def test_a_name_that_is_no_text_is_refused_at_once(script, tmp_path):
    name = os.fsdecode(b"l\xe9g.csv")
    for words in ((name,), ("a.csv", "--out", name)):
        status, _, said = script("identify.py", *words)
        assert status == 2
        assert "not UTF-8" in said
    (tmp_path / "runs").mkdir()
    try:
        (tmp_path / "runs" / name).write_text("time\n")
    except OSError:
        pytest.skip("this file system has no such names")
    status, _, said = script("identify.py", "runs")
    assert status == 2
    assert "not UTF-8" in said


def test_content_is_on_the_disk_before_its_name(tmp_path, monkeypatch):
    done = []
    monkeypatch.setattr(os, "fsync", lambda handle: done.append("content"))
    replace = os.replace

    def named(*names):
        done.append("name")
        replace(*names)

    monkeypatch.setattr(os, "replace", named)
    write_atomically(tmp_path / "a.txt", "new")
    assert done == ["content", "name"]
    assert (tmp_path / "a.txt").read_text() == "new"


@pytest.mark.parametrize("kind", [pl.Duration("ns"), pl.Datetime("us")], ids=str)
def test_a_time_in_place_of_a_torque(tmp_path, kind):
    frame = good_frame()
    spoiled = frame["wheel_torque_rl"].cast(pl.Int64).cast(kind)
    frame.with_columns(spoiled).write_parquet(tmp_path / "log.parquet")
    with pytest.raises(LogError, match="wheel_torque_rl cannot be in 's'"):
        Log.load(tmp_path / "log.parquet")


def test_a_channel_of_nothing_but_rounding(tmp_path):
    frame = good_frame()
    frame.with_columns(pl.col("wheel_torque_rl") * 1e-9).write_csv(tmp_path / "log.csv")
    with pytest.raises(LogError, match=r"wheel_torque_rl: always .* while the others change"):
        Log.load(tmp_path / "log.csv")


@pytest.mark.parametrize(
    "text", [ALIASES, "a: " + "[" * 2000, "\xff", "a: 1\n" * 300_000], ids=lambda text: text[:9]
)
def test_metadata_of_a_bag_that_never_ends(tmp_path, text):
    pytest.importorskip("rosbags")
    folder = write_bag(tmp_path / "bag", make(60), "mcap")
    (folder / "metadata.yaml").write_text(text, encoding="latin-1")
    with pytest.raises(LogError, match=r"damaged metadata"):
        Log.load(folder)


def test_yaml_without_end(tmp_path):
    (tmp_path / "m.yaml").write_text("# \n" * 500_000)
    with pytest.raises(ModelFileError, match="1500000 bytes, 500000 are allowed"):
        load_model(tmp_path / "m.yaml")


@pytest.mark.parametrize("size", [1e4, 1e20])
def test_a_spike_makes_no_other_channel_dead(tmp_path, size):
    frame = good_frame()
    spoiled = frame["wheel_torque_fl"].to_list()
    spoiled[700] = size
    frame.with_columns(pl.Series("wheel_torque_fl", spoiled)).write_csv(tmp_path / "log.csv")
    log = Log.load(tmp_path / "log.csv")
    assert any("spike" in finding.what for finding in log.findings)
    assert np.abs(log.wheel_torque).max() < 100
