"""Whatever is wrong with a file of a log, the answer is an error of one kind, with the place."""

import numpy as np
import polars as pl
import pytest
from spoiled_logs import good_frame

from ident.log import Log, LogError


@pytest.fixture(scope="module")
def frame():
    return good_frame()


def written(frame: pl.DataFrame, path) -> list[bytes]:
    frame.write_csv(path)
    return path.read_bytes().split(b"\n")


def test_a_byte_that_is_no_text_is_told_with_its_line(frame, tmp_path):
    path = tmp_path / "log.csv"
    lines = written(frame, path)
    cells = lines[1000].split(b",")
    cells[2] = b"0.\xe9"
    lines[1000] = b",".join(cells)
    path.write_bytes(b"\n".join(lines))
    with pytest.raises(LogError, match="line 1001, column"):
        Log.load(path)


def test_a_short_and_a_long_line_that_make_up_for_each_other_are_left_out(frame, tmp_path):
    path = tmp_path / "log.csv"
    lines = written(frame, path)
    last = lines[500].rsplit(b",", 1)[1]
    lines[500] = lines[500].rsplit(b",", 1)[0]
    lines[700] = lines[700] + b"," + last
    path.write_bytes(b"\n".join(lines))
    log = Log.load(path)
    assert len(log.time) >= len(frame) - 2
    assert any("2 such lines" in finding.what for finding in log.findings)


@pytest.mark.parametrize("cut", [8, 400, 4000])
def test_damaged_parquet(frame, tmp_path, cut):
    path = tmp_path / "log.parquet"
    frame.write_parquet(path)
    data = bytearray(path.read_bytes())
    rng = np.random.default_rng(cut)
    for place in rng.integers(len(data) - cut - 8, len(data) - 8, 12):
        data[place] ^= 0xFF
    path.write_bytes(bytes(data))
    with pytest.raises(LogError, match=r"log\.parquet"):
        Log.load(path)


@pytest.mark.parametrize("kind", ["list", "binary", "categorical"])
def test_parquet_columns_that_are_no_numbers(frame, tmp_path, kind):
    path, name = tmp_path / "log.parquet", "wheel_velocity_fl"
    strange = {
        "list": pl.Series(name, [[v, v] for v in frame[name]]),
        "binary": pl.Series(name, [b"\x00\xff"] * len(frame)),
        "categorical": pl.Series(name, ["a"] * len(frame), dtype=pl.Categorical),
    }
    frame.with_columns(strange[kind]).write_parquet(path)
    with pytest.raises(LogError, match=name):
        Log.load(path)


def test_a_small_parquet_that_unpacks_to_gigabytes_is_refused_unread(tmp_path, monkeypatch):
    path = tmp_path / "log.parquet"
    columns = {f"c{k}": np.zeros(1_000_000, np.int8) for k in range(51)}
    pl.DataFrame(columns).write_parquet(path)
    assert path.stat().st_size < 200_000
    monkeypatch.setattr(pl, "read_parquet", lambda *_: pytest.fail("the rows were unpacked"))
    with pytest.raises(LogError, match="1000000 rows of 51 columns"):
        Log.load(path)
