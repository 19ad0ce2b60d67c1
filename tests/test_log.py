"""The log object: shapes, derived quantities, cutting, writing and reading back."""

import re
from pathlib import Path

import numpy as np
import pytest

from ident.log import Log
from youbot_env.platform import omni3, youbot


def motion(count: int, dt: float = 0.01) -> tuple[np.ndarray, np.ndarray]:
    t = np.arange(count) * dt
    v = np.stack([0.3 * np.sin(0.9 * t), 0.2 * np.sin(1.3 * t), 0.5 * np.cos(0.7 * t)], axis=1)
    return t, v


def make(count: int = 2000, platform=None, **channels) -> Log:
    platform = platform or youbot()
    t, v = motion(count)
    speeds = v @ platform.jacobian_array.T
    given = {"wheel_velocity": speeds, "wheel_torque": 0.05 * speeds, "reference": v, **channels}
    return Log("made", platform, t, **given)


@pytest.mark.parametrize("platform", [youbot(), omni3()])
def test_velocity_is_least_squares_of_wheel_speeds(platform):
    log = make(platform=platform)
    np.testing.assert_allclose(log.velocity(), log.reference, atol=1e-12)


def test_independent_velocity_comes_first():
    _, v = motion(2000)
    log = make(body_velocity=1.1 * v)
    np.testing.assert_array_equal(log.velocity(), 1.1 * v)


def test_derived_quantities():
    log = make(2001)
    assert log.dt == pytest.approx(0.01)
    assert log.duration == pytest.approx(20.0)
    assert log.drive == "torque"
    assert make(wheel_torque=None, wheel_voltage=np.ones((2000, 4))).drive == "voltage"
    with pytest.raises(ValueError, match="neither"):
        _ = make(wheel_torque=None).drive


def test_wrong_shape_names_channel_and_shape():
    with pytest.raises(ValueError, match=r"wheel_torque has shape \(2000, 3\), it needs \(2000, 4"):
        make(wheel_torque=np.zeros((2000, 3)))
    with pytest.raises(ValueError, match="no velocities"):
        make(wheel_velocity=None)


def test_arrays_cannot_be_written():
    log = make()
    with pytest.raises(ValueError, match="read-only"):
        log.time[0] = 5.0


def test_pieces_and_parts():
    log = make()
    split = Log(
        "gap", log.platform, log.time, wheel_velocity=log.wheel_velocity, starts=(0, 300, 900)
    )
    pieces = split.pieces()
    assert [len(piece.time) for piece in pieces] == [300, 600, 1100]
    assert all(piece.starts == (0,) for piece in pieces)
    np.testing.assert_array_equal(pieces[1].wheel_velocity, log.wheel_velocity[300:900])
    part = split.part(2.0, 10.0)
    assert part.time[0] == pytest.approx(2.0)
    assert len(part.time) == 800
    assert part.starts == (0, 100, 700)
    with pytest.raises(ValueError, match=r"0 samples from 50.* to 60"):
        log.part(50.0, 60.0)


def test_save_and_load_return_the_same_numbers(tmp_path):
    straight = np.outer(np.arange(2000) * 0.01, [0.3, 0.1, 0.0])
    log = make(pose=straight, reference=None, body_velocity=np.tile([0.3, 0.1, 0.0], (2000, 1)))
    path = log.save(tmp_path / "deep" / "log.csv")
    again = Log.load(path)
    for channel in ("time", "wheel_velocity", "wheel_torque", "body_velocity", "pose"):
        np.testing.assert_array_equal(getattr(again, channel), getattr(log, channel))
    assert len(again.digest) == 64
    assert again.source == "log.csv"
    assert [file.name for file in path.parent.iterdir()] == ["log.csv"]


def test_failed_save_leaves_nothing_behind(tmp_path, monkeypatch):
    import polars as pl

    def broken(*_args):
        raise OSError("disk full")

    monkeypatch.setattr(pl.DataFrame, "write_csv", broken)
    with pytest.raises(OSError, match="disk full"):
        make().save(tmp_path / "log.csv")
    assert not list(tmp_path.iterdir())


def test_digest_follows_the_content(tmp_path):
    make().save(tmp_path / "a.csv")
    make().save(tmp_path / "b.csv")
    make(2001).save(tmp_path / "c.csv")
    a, b, c = (Log.load(tmp_path / f"{name}.csv").digest for name in "abc")
    assert a == b != c


def test_example_of_the_documentation_runs(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    make(3000).save("run.csv")
    page = (Path(__file__).parents[1] / "docs" / "logs.md").read_text()
    exec(re.search(r"```python\n(.*?)```", page, re.DOTALL)[1], {})
    assert Path("clean.csv").is_file()
