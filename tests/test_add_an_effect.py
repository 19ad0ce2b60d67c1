"""The page on effects of one's own: its code runs, and diagnosis finds what it defines."""

import re
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from ident import diagnose
from ident.log import Log
from youbot_env import effects
from youbot_env.backend import FLOAT, NUMPY, casadi_ops
from youbot_env.model_file import load_model
from youbot_env.plant import Structure
from youbot_env.references import SmoothRandom, calibration_sequence
from youbot_env.simulation import Sensors, record_closed_loop

PAGE = Path(__file__).resolve().parent.parent / "docs" / "add_an_effect.md"


@pytest.fixture
def caster_drag(monkeypatch):
    """The effect of the page, known for one test only."""
    monkeypatch.setattr(effects, "_EXTRA", {})
    blocks = re.findall(r"```python\n(.*?)```", PAGE.read_text(encoding="utf-8"), re.DOTALL)
    exec("\n".join(blocks), {"__name__": "own_effect"})
    return effects.get_effect("caster_drag")


def test_law_is_the_same_on_floats_arrays_and_symbols(caster_drag):
    structure = Structure.of(load_model("paper").with_effects({"caster_drag": 40.0}))
    values, v = (*load_model("paper").values(), 40.0), (0.3, -0.2, 0.8)

    def wrench(v, ops):
        robot = structure.bind(values)
        s = robot.signals(0.0, v, (0.0,) * 3, (), (0.0,) * 4, ops)
        return robot.wrench((0.0,) * 4, s, structure.rest().internal, ops)

    exact = wrench(v, FLOAT)
    assert exact[2] == pytest.approx(-40.0 * np.hypot(0.3, 0.2) * 0.8, rel=1e-4)
    assert [c[0] for c in wrench(tuple(np.full(2, c) for c in v), NUMPY)[2:]] == [
        pytest.approx(exact[2])
    ]
    symbols = tuple(ca.SX.sym(name) for name in "xyo")
    function = ca.Function("w", list(symbols), [wrench(symbols, casadi_ops())[2]])
    assert float(function(*v)) == pytest.approx(exact[2])


def test_diagnosis_finds_it_and_without_it_says_outside(caster_drag, monkeypatch):
    hidden = load_model("paper").with_effects({"caster_drag": 40.0})
    logs = []
    motions = ((calibration_sequence(seconds=112.0), 112.0), (SmoothRandom(0.3, 1.0), 48.0))
    for seed, (motion, seconds) in enumerate(motions):
        times = np.arange(seconds * 100) / 100
        channels = record_closed_loop(hidden, motion, times, Sensors(), seed=seed)
        logs.append(Log(f"log{seed}", hidden.platform, **channels))
    found = diagnose(logs[0], "nominal", logs[1])
    assert found.verdict == "named"
    assert found.named[0].best.identifier == "caster_drag"
    assert found.named[0].sizes(found.model)["c"].value == pytest.approx(40.0, rel=0.02)
    monkeypatch.setattr(effects, "_EXTRA", {})
    unknown = diagnose(logs[0], "nominal", logs[1])
    assert unknown.verdict == "outside_library"
    assert unknown.depends_on[0][0] == "yaw rate"
