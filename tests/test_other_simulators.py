"""Logs of robots that another program simulated, with known answers; skipped where absent."""

from functools import cache

import numpy as np
import pytest
from long_cases import long
from shared_data import shared

from ident import diagnose, identify
from ident.log import Log

# m0 kg, I0 kg m^2, I1 kg m^2 as published: the last digit of I1 is worth 0.013 kg m^2 of a lump.
TRUTH = {"f01": (38.39, 2.266, 0.0105), "f02": (30.60, 2.583, 0.0066),
         "f03": (32.04, 3.586, 0.0060), "f08": (30.72, 3.441, 0.0049)}  # fmt: skip
LEVER, RADIUS, ROUNDED = 0.3855, 0.0475, 0.013


def logs(name):
    return [
        Log.load(shared("foreign-robot", f"{name}.{kind}.parquet")) for kind in ("train", "test")
    ]


@cache
def diagnosed(name):
    """The answer for the logs of a robot."""
    fit, test = logs(name)
    return diagnose(fit, test=test)


@pytest.mark.parametrize("name", TRUTH)
def test_inertias_lie_inside_their_intervals(name):
    m0, I0, I1 = TRUTH[name]
    spin = 4 * I1 * (LEVER / RADIUS) ** 2
    found = identify(logs(name)[0], add=("floor_slope",) if name == "f08" else ())
    for lump, true in (("x1+x3", m0 * LEVER**2 + spin), ("x2+x3", I0 + spin)):
        low, high = found.lumps[lump].ci95
        half = 0.75 * (high - low) + ROUNDED
        assert abs(found.lumps[lump].value - true) < half, lump


@pytest.mark.parametrize(
    ("name", "what", "value", "within"),
    [
        ("f04", "drive_offset", 0.0114, 2e-3),
        ("f05", "velocity_filter", 0.0114, 1e-3),
        ("f07", "sensor_mounting", np.radians(2.5), 2e-3),
        ("f07", "gyro_bias", 0.015, 1e-3),
    ],
)
def test_a_recording_is_told_and_no_robot_blamed(name, what, value, within):
    found = diagnosed(name)
    assert found.verdict == "nothing_missing"
    (told, *_) = [one for one in found.recording if one.what == what]
    assert abs(told.value - value) < within


@pytest.mark.parametrize(
    ("name", "effects"),
    [
        ("f08", {"floor_slope"}),
        long("f09", {"floor_slope"}),
        ("f14", {"payload_change"}),
        long("f15", {"battery_sag", "friction_warmup"}),
    ],
)
def test_what_belongs_to_a_record_is_named(name, effects):
    found = diagnosed(name)
    assert found.verdict in ("named", "ambiguous")
    assert {step.best.identifier for step in found.named} <= effects
    assert found.errors.after < 0.3 * found.errors.before
