"""The page of a diagnosis: says what was found, and draws it from the diagnosis."""

import io
import re
from dataclasses import replace

import numpy as np
import pytest
from PIL import Image

from ident import diagnose
from ident.diagnosis.holdout import FreeRunErrors
from ident.diagnosis.splits import VERIFY
from ident.free_run import free_run
from ident.log import Log
from ident.report.diagnose import diagnosis_page, odds
from ident.report.diagnose_error import FALLING, held_out, since_reversal, strongest_period
from ident.report.diagnose_figures import error_steps_figure
from ident.report.look import IDENTIFIED, NOMINAL
from ident.report.outcome import rounded
from ident.sensitivity import window_length
from youbot_env.model_file import load_model
from youbot_env.references import SmoothRandom
from youbot_env.simulation import Sensors, record_closed_loop

PAPER = load_model("paper")
STICKY = PAPER.with_effects({"wheel_coulomb_friction": 0.15})
PROVENANCE = {"command": "python scripts/diagnose.py", "seed": "0"}


def record(model, seconds, seed):
    times = np.arange(seconds * 50) / 50
    motion = SmoothRandom(0.35, 1.5)
    channels = record_closed_loop(model, motion, times, Sensors(), seed=seed)
    return Log(f"log{seed}", model.platform, **channels)


@pytest.fixture(scope="module")
def found():
    return diagnose(record(STICKY, 40, 1), PAPER, record(STICKY, 24, 2))


@pytest.fixture(scope="module")
def page(found):
    return diagnosis_page(found, PROVENANCE)


def text(page):
    return re.sub(r"<[^>]*>", " ", page.html())


def block(page, name):
    return next(b for s in page.sections for b in s.blocks if getattr(b, "name", "") == name)


def colored(png, color):
    """Number of pixels of a colour."""
    pixels = np.array(Image.open(io.BytesIO(png)).convert("RGB"))
    wanted = [int(color[k : k + 2], 16) for k in (1, 3, 5)]
    return int(np.all(pixels == wanted, axis=2).sum())


def test_verdict_and_every_effect_are_on_the_page(found, page):
    words = text(page)
    assert found.verdict in ("named", "ambiguous")
    assert page.good == (found.verdict == "named")
    assert found.reason.split("%")[0].strip() in words.replace("\u00a0", " ")
    assert all(one.effect in words for one in found.minimum_detectable)
    quantity = found.steps[0].sizes(found.model)["fc"]
    assert rounded(quantity.value, quantity.se) in words
    assert all(value in words for value in PROVENANCE.values())


def test_page_is_one_file_with_its_figures_beside_it(page, tmp_path):
    file = page.write(tmp_path)
    assert not re.search(r'(src|href)="(?!data:|#)', file.read_text(encoding="utf-8"))
    pictures = [b.name for s in page.sections for b in s.blocks if b.kind == "picture"]
    assert len(set(pictures)) == len(pictures)
    assert {"effects", "sizes", "error_falling", "velocities", "where_base"} <= set(pictures)
    for name in pictures:
        assert Image.open(tmp_path / f"{name}.png").size[0] == 1400


def test_dependence_is_drawn_before_and_after(found, page):
    assert "wheel speed" in dict(found.first.dependences())
    before, after = block(page, "base_depends_on"), block(page, "depends_on")
    assert before.png != after.png
    assert "base model" in before.caption
    assert "final model" in after.caption


def test_only_held_out_windows_are_shown(found):
    part = found.first.parts[-1]
    run = free_run(part.log, found.model, window_length(part.log))
    shown = held_out(part, run)
    kept = np.flatnonzero(part.role == VERIFY)
    assert set(shown.window) == set(kept)
    assert 0 < len(kept) < len(part.role)
    share = np.isin(run.window, kept)
    np.testing.assert_array_equal(shown.measured, run.measured[share])


def test_falling_error_is_drawn_to_scale(found):
    axes = np.array([[0.02, 0.02, 0.04], [0.01, 0.01, 0.02]])
    halved = FreeRunErrors(
        ("", "floor_slope"), (0.2, 0.1), axes, 0.02, 0.0, 0.0, 0.0, (0.4, 0.6), 9
    )
    png = error_steps_figure(halved)
    assert colored(png, IDENTIFIED) / colored(png, NOMINAL) == pytest.approx(0.5, abs=0.05)


def test_nothing_added_is_said_and_drawn_with_the_base_alone(found):
    errors = found.errors
    alone = FreeRunErrors(
        ("",),
        errors.nrmse[:1],
        errors.axes[:1],
        errors.floor,
        0.0,
        0.0,
        0.0,
        (0.0, 0.0),
        errors.windows,
    )
    quiet = replace(found, verdict="nothing_missing", reason="nothing does", steps=(),
                    model=found.base, chain=found.chain[:1], errors=alone)  # fmt: skip
    page = diagnosis_page(quiet, PROVENANCE)
    titles = [section.title for section in page.sections]
    assert page.good
    assert FALLING in titles
    assert "What was added" not in titles
    assert "final model" not in text(page)


def test_a_log_that_cannot_say_is_shown_with_what_to_record():
    short = record(PAPER, 2, 3)
    found = diagnose(short, PAPER)
    assert found.verdict == "cannot_say"
    page = diagnosis_page(found, PROVENANCE, (short,))
    assert not page.good
    assert found.experiment.command in text(page)
    assert block(page, "log_log3").png.startswith(b"\x89PNG")


def test_time_since_a_reversal_and_period_of_a_disturbance():
    time = np.arange(2000) / 50
    speed = np.sin(2 * np.pi * 0.1 * time + 0.3)[:, None]
    since = since_reversal(time, speed)[:, 0]
    assert np.all(np.isinf(since[time < 3.0]))
    assert since[np.searchsorted(time, 5.0)] == pytest.approx(5.0 - (np.pi - 0.3) / 0.2 / np.pi,
                                                              abs=0.03)  # fmt: skip
    noise = np.random.default_rng(0).normal(size=(2000, 3))
    force = noise + np.array([0, 2, 0]) * np.sin(2 * np.pi * 0.7 * time)[:, None]
    assert 1 / strongest_period(time, force) == pytest.approx(0.7, abs=0.02)
    assert strongest_period(time[:20], force[:20]) is None


def test_odds_in_words():
    assert odds(1.52) == "1.5 to 1"
    assert odds(1234.0) == "1,234 to 1"
    assert odds(1e6) == "more than 1,000,000 to 1"


def test_a_log_that_cannot_say_is_told_what_to_record(script, tmp_path):
    record(PAPER, 10.0, 1).save(tmp_path / "short.csv")
    status, out, _ = script("diagnose.py", tmp_path / "short.csv")
    assert status == 0
    assert "What to record next" in out
    assert "youbot record --motion calibration" in out
