"""The examples run in an empty folder, keep to 40 lines, and find what they say they look for."""

import os
import re
import runpy
from pathlib import Path

import pytest

from youbot_env import effects

EXAMPLES = Path(__file__).resolve().parent.parent / "examples"


@pytest.fixture
def example(tmp_path, monkeypatch, capsys):
    """Run an example in an empty folder; returns what it printed."""
    monkeypatch.chdir(tmp_path)

    def call(name):
        before = os.listdir(EXAMPLES)
        runpy.run_path(str(EXAMPLES / f"{name}.py"), run_name="__main__")
        assert os.listdir(EXAMPLES) == before
        return capsys.readouterr().out

    yield call
    effects.unregister("turning_drag")


def numbers(pattern, text):
    """What the groups of the pattern stand for, as numbers."""
    found = re.search(pattern, text)
    assert found, f"{pattern!r} is not in\n{text}"
    return [float(group) for group in found.groups()]


def identify_and_compare(told):
    nominal, identified = numbers(r"error: (\d+) % nominal, (\d+) % identified", told)
    assert nominal > 100
    assert identified < 20


def diagnose_and_improve(told):
    assert "named: quadratic_drag" in told
    assert numbers(r"found: quadratic_drag \{'c': ([\d.]+)\}", told) == pytest.approx(
        [60], rel=0.03
    )


def control(told):
    nominal, identified, truth = (
        numbers(rf"{name}: position error +([\d.]+) mm", told)[0]
        for name in ("nominal", "identified", "truth")
    )
    assert nominal > 3 * identified
    assert identified > truth


def vector_environment(told):
    low, high = numbers(r"robots ([\d.]+) to ([\d.]+) mm", told)
    assert low < high < 1.0


def calibrate_kinematics(told):
    found, hidden = numbers(r"radius ([\d.]+) mm, hidden: ([\d.]+) mm", told)
    assert found == pytest.approx(hidden, rel=2e-3)
    assert numbers(r"base ([\d.]+) % larger", told) == pytest.approx([1.5], abs=0.1)


def design_a_motion(told):
    expected, got = numbers(r"half width ([\d.]+) kg, got ([\d.]+) kg", told)
    assert got == pytest.approx(expected, rel=0.2)
    designed, usual = numbers(r"m0 +([\d.]+) +([\d.]+)", told)
    assert designed < 0.8 * usual


def effect_of_your_own(told):
    _, low, high = numbers(r"turning_drag.c +([\d.]+) +([\d.]+) +([\d.]+)", told)
    assert low < 40.0 < high


def batch_of_logs(told):
    rows = re.findall(r"run\d\.csv +\S +([\d.]+) +\S +([\d.]+)", told)
    assert len(rows) == 5
    assert all(float(identified) < 0.05 < 1.0 < float(nominal) for nominal, identified in rows)


CHECKS = (
    identify_and_compare, diagnose_and_improve, control, vector_environment, calibrate_kinematics,
    design_a_motion, effect_of_your_own, batch_of_logs,
)  # fmt: skip


@pytest.mark.parametrize("check", CHECKS, ids=lambda check: check.__name__)
def test_an_example_finds_what_it_looks_for(example, check):
    check(example(check.__name__))


def test_every_example_is_short_and_checked():
    files = sorted(EXAMPLES.glob("*.py"))
    assert [file.stem for file in files] == sorted(check.__name__ for check in CHECKS)
    for file in files:
        assert 15 <= len(file.read_text("utf-8").splitlines()) <= 40, file
