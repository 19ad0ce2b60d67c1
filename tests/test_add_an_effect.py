"""The page on effects of one's own: its code and commands run, diagnosis finds what it defines."""

import json
import re
import shlex
import subprocess
import sys
from pathlib import Path

import casadi as ca
import numpy as np
import pytest

from ident import diagnose
from ident.log import Log
from youbot_env import effects
from youbot_env.backend import FLOAT, NUMPY, casadi_ops
from youbot_env.effects_file import load_effects_file
from youbot_env.model_file import load_model
from youbot_env.plant import ModelStructure
from youbot_env.references import SmoothRandom, calibration_sequence
from youbot_env.simulation import Sensors, record_closed_loop

ROOT = Path(__file__).resolve().parent.parent
PAGE = (ROOT / "docs" / "add_an_effect.md").read_text(encoding="utf-8")
TRUTH = 40.0


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", PAGE, re.DOTALL)


@pytest.fixture
def file(tmp_path):
    """The file of the page, by itself in a folder."""
    path = tmp_path / "turning_drag.py"
    path.write_text(blocks("python")[0], encoding="utf-8")
    return path


@pytest.fixture
def hidden(file):
    """A robot with the effect, which is known for one test only."""
    assert load_effects_file(file) == ("turning_drag",)
    yield load_model("paper").with_effects({"turning_drag": TRUTH})
    effects.unregister("turning_drag")


def test_law_is_the_same_on_floats_arrays_and_symbols(hidden):
    structure, values = ModelStructure.of(hidden), hidden.values()

    def wrench(v, ops):
        robot = structure.bind(values)
        s = robot.signals(0.0, v, (0.0,) * 3, (), (0.0,) * 4, ops)
        return robot.wrench((0.0,) * 4, s, structure.rest().internal, ops)

    v = np.random.default_rng(0).uniform(-1.0, 1.0, (3, 5))
    exact = np.array([wrench(tuple(column), FLOAT) for column in v.T.tolist()]).T
    expected = -TRUTH * np.hypot(v[0], v[1]) * v[2]
    np.testing.assert_allclose(exact[2], expected, rtol=1e-3)
    np.testing.assert_allclose(wrench(tuple(v), NUMPY)[2], exact[2], rtol=1e-12)
    symbols = ca.SX.sym("v", 3)
    function = ca.Function("w", [symbols], [wrench(tuple(ca.vertsplit(symbols)), casadi_ops())[2]])
    np.testing.assert_allclose(function(v).full().ravel(), exact[2], rtol=1e-12)


def test_diagnosis_finds_it_and_without_it_says_outside(hidden):
    logs = []
    motions = ((calibration_sequence(seconds=112.0), 112.0), (SmoothRandom(0.3, 1.0), 48.0))
    for seed, (motion, seconds) in enumerate(motions):
        times = np.arange(seconds * 100) / 100
        channels = record_closed_loop(hidden, motion, times, Sensors(), seed=seed)
        logs.append(Log(f"log{seed}", hidden.platform, **channels))
    found = diagnose(logs[0], "nominal", logs[1])
    assert found.verdict == "named"
    assert found.named[0].best.identifier == "turning_drag"
    size = found.named[0].sizes(found.model)["c"]
    assert size.value == pytest.approx(TRUTH, rel=0.02)
    low, high = size.ci95
    assert low - 0.01 * TRUTH < TRUTH < high + 0.01 * TRUTH
    effects.unregister("turning_drag")
    unknown = diagnose(logs[0], "nominal", logs[1])
    assert unknown.verdict == "outside_library"
    assert unknown.depends_on[0][0] == "yaw rate"


def test_commands_of_the_page_record_identify_and_control(file):
    for line in "".join(blocks("sh")).splitlines():
        program, name, *options = shlex.split(line)
        assert program == "youbot"
        done = run(ROOT / "scripts" / f"{name}.py", *options, folder=file.parent)
        assert done.returncode == 0, done.stderr
    log = (file.parent / "runs" / "a.csv").read_text(encoding="utf-8")
    assert "turning_drag" not in log.partition("\ntime,")[0]
    told, found = (re.search(r"identified ([\d.]+) %", text)[1] for text in (PAGE, done.stdout))
    assert float(found) == pytest.approx(float(told), abs=0.2)
    script = file.with_name("control.py")
    script.write_text(blocks("python")[1], encoding="utf-8")
    done = run(script, folder=file.parent)
    knowing, ignorant = (float(x) for x in re.findall(r"up to ([\d.]+) mrad", done.stdout))
    assert knowing < 0.05 * ignorant


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ("x = 1\n", "defines no effect"),
        ("def broken(:\n", "line 1"),
        ("import math\n\nmath.nothing\n", "line 3"),
        ("from youbot_env.effects import Effect\n\n\nclass Bare(Effect):\n"
         "    identifier = 'bare'\n", "'title'"),
    ],
)  # fmt: skip
def test_a_file_that_is_no_effect_is_refused_with_the_reason(tmp_path, text, told):
    path = tmp_path / "mine.py"
    path.write_text(text, encoding="utf-8")
    with pytest.raises(ValueError, match=told):
        load_effects_file(path)
    assert "bare" not in effects.effect_names()
    assert "effects_of_mine" not in sys.modules


def test_a_law_without_hook_or_under_a_taken_name_is_refused(file):
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace("def body", "def bodies"), encoding="utf-8")
    with pytest.raises(ValueError, match="does nothing"):
        load_effects_file(file)
    file.write_text(text.replace('"turning_drag"', '"wheel_slip"'), encoding="utf-8")
    with pytest.raises(ValueError, match="exists already"):
        load_effects_file(file)
    # The name of the class alone does not make it the same.
    file.write_text(file.read_text(encoding="utf-8").replace("TurningDrag", "WheelSlip"), "utf-8")
    with pytest.raises(ValueError, match="exists already"):
        load_effects_file(file)


def test_of_a_file_that_fails_half_way_nothing_is_known(file):
    text = file.read_text(encoding="utf-8")
    file.write_text(f"{text}\n\nclass Bare(Effect):\n    identifier = 'bare'\n", encoding="utf-8")
    with pytest.raises(ValueError, match="'title'"):
        load_effects_file(file)
    assert not {"bare", "turning_drag"} & set(effects.effect_names())


@pytest.mark.long
def test_processes_that_share_the_work_know_it(file):
    options = "--controller computed_torque --reference circle --frequency 1 --plant analytic"
    options += (
        " --robots 2 --steps 0 --no-wrong --jobs 2 --effect turning_drag=40 --json found.json"
    )
    script = ROOT / "scripts/evaluate.py"
    done = run(script, "--effects", str(file), *options.split(), folder=file.parent)
    assert done.returncode == 0, done.stderr
    found = json.loads((file.parent / "found.json").read_text(encoding="utf-8"))
    assert found["setup"]["hidden"] == {"turning_drag": 40.0}
    gap = next(c for c in found["claims"] if "identified + effects: gap" in c["claim"])
    assert gap["value"] > 0.98


def test_a_missing_file_ends_with_status_two_and_nothing_written(tmp_path):
    done = run(ROOT / "scripts/record.py", "--effects", "gone.py", folder=tmp_path)
    assert done.returncode == 2
    assert "gone.py" in done.stderr
    assert "Traceback" not in done.stderr
    assert not (tmp_path / "runs").exists()


def run(script, *options, folder):
    command = [sys.executable, str(script), *options]
    return subprocess.run(command, cwd=folder, capture_output=True, text=True, timeout=120)
