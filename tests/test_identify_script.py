"""``scripts/identify.py`` as users call it: verdict, files, page, exit statuses."""

import json
import re
import subprocess
import sys
from pathlib import Path

import numpy as np
import pytest

from ident.report.look import thin
from ident.report.outcome import percent, rounded
from youbot_env.model_file import load_model
from youbot_env.recording import record_motion, write_table
from youbot_env.references import make_reference
from youbot_env.simulation import AnalyticPlant, Sensors

ROOT = Path(__file__).resolve().parent.parent
SCRIPT = ROOT / "scripts" / "identify.py"
FIGURES = {"free_run", "correlation", "estimates", "forces", "residual", "log"}


def record(path, model, motion, length, seed, sensors=None, **options):
    plant = AnalyticPlant(load_model(model), 0.02)
    reference = make_reference(motion, **options)
    return write_table(path, record_motion(plant, reference, length, None, sensors, seed))


@pytest.fixture(scope="module")
def logs(tmp_path_factory):
    folder = tmp_path_factory.mktemp("logs")
    record(folder / "fit.csv", "paper", "calibration", 28.0, 1, Sensors(), seconds=28.0)
    record(folder / "test.csv", "paper", "smooth_random", 16.0, 2, Sensors())
    record(folder / "other_robot.csv", "nominal", "smooth_random", 16.0, 3, Sensors())
    record(folder / "rest.csv", "paper", "III", 4.0, 4, speed=1e-4)
    return folder


@pytest.fixture
def command(monkeypatch, tmp_path, capsys):
    """Call the script in this process, in an empty folder; gives status and what it printed."""
    monkeypatch.chdir(tmp_path)
    from youbot_cli import console, identify

    def call(*arguments):
        monkeypatch.setattr(sys, "argv", [str(SCRIPT), *map(str, arguments)])
        with pytest.raises(SystemExit) as end:
            console.run(identify.main, "")
        return end.value.code, capsys.readouterr()

    return call


@pytest.fixture(scope="module")
def full_run(logs, tmp_path_factory):
    folder = tmp_path_factory.mktemp("run")
    words = [sys.executable, SCRIPT, logs / "fit.csv", "--test", logs / "test.csv"]
    words += ["--out", "robot.yaml", "--report", "page", "--json", "result.json"]
    done = subprocess.run(words, cwd=folder, capture_output=True, text=True, timeout=120)
    assert done.returncode == 0, done.stderr
    return folder, done.stdout


def test_verdict_comes_first_and_is_true(full_run):
    _, shown = full_run
    found = re.match(
        r"Free-run error on the held-out log test: nominal (\S+) %, identified (\S+) %", shown
    )
    nominal, identified = map(float, found.groups())
    assert identified < 5.0 < 20.0 < nominal
    assert "page: page/index.html" in shown
    assert "model: robot.yaml" in shown


def test_json_holds_what_the_contract_promises(full_run):
    result = json.loads((full_run[0] / "result.json").read_text())
    for name in ("parameters", "lumps", "condition", "undetermined", "invisible", "fit", "effects"):
        assert name in result
    assert set(result["parameters"]) == {"m0", "I0", "I1", "a_x", "a_y", "mu1", "mu2"}
    for quantity in [*result["parameters"].values(), *result["lumps"].values()]:
        low, high = quantity["ci95"]
        assert low < quantity["value"] < high
        assert quantity["unit"]
    assert set(result["lumps"]) == {"x1+x3", "x2+x3", "x6", "x7"}
    assert result["judged_on"]["after"]["nrmse"] < result["judged_on"]["before"]["nrmse"]
    assert len(result["provenance"]["logs"]["fit.csv"]) == 64


def test_model_loads_again_and_is_the_robot(full_run):
    model, true = load_model(full_run[0] / "robot.yaml"), load_model("paper")
    assert model.name == "robot"
    for name in ("m0", "mu1", "mu2"):
        value = getattr(model.parameters, name)
        assert value == pytest.approx(getattr(true.parameters, name), rel=0.1)
        assert model.standard_errors[name] > 0
    assert np.linalg.eigvalsh(np.array(model.covariance)).min() > -1e-12
    command = model.provenance["command"]
    assert command.startswith("python scripts/identify.py")
    assert str(full_run[0].parent) not in command
    assert {"date", "versions", "git_commit", "logs", "method"} <= set(model.provenance)


def test_page_is_one_file_with_every_figure(full_run):
    page = full_run[0] / "page" / "index.html"
    text = page.read_text(encoding="utf-8")
    assert {p.stem for p in page.parent.glob("*.png")} == FIGURES
    assert text.count("data:image/png;base64,") == len(FIGURES)
    assert not re.search(r"(src|href)=\"(?!data:)", text)
    assert page.stat().st_size < 3e6
    heading = re.search(r"<h1[^>]*>(.*?)</h1>", text).group(1)
    assert heading.startswith("Free-run error on the held-out log test: nominal")
    for png in page.parent.glob("*.png"):
        assert png.read_bytes().startswith(b"\x89PNG")
    for said in ("total mass", "Structurally unidentifiable", "kg m\u00b2", "scripts/identify.py"):
        assert said in text


def test_without_a_test_log_the_verdict_says_so(command, logs):
    # Of an effect that is not there either sign may be found; a slope can have both.
    status, shown = command(logs / "fit.csv", "--method", "ls", "--add", "floor_slope")
    assert status == 0
    assert shown.out.startswith("Free-run error on the log it was fitted to")
    assert "floor_slope.sx" in shown.out
    assert load_model("models/identified.yaml").effects[0].identifier == "floor_slope"


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["{logs}/absent.csv"], "no log"),
        (["{logs}/rest.csv"], "hardly moves"),
        (["{logs}/fit.csv", "--add", "wind"], "wind"),
        (["{logs}/fit.csv", "--test", "{logs}/fit.csv"], "same record"),
        (["{logs}/fit.csv", "--method", "guess"], "guess"),
        (["{logs}/fit.csv", "--model", "absent"], "absent"),
        (["{logs}/fit.csv", "--map", "time"], "NAME=COLUMN"),
        (["{logs}/fit.csv", "--map", "time=stamp"], "stamp"),
        (["{logs}/fit.csv", "--report", "{logs}/fit.csv"], "folder"),
    ],
)
def test_bad_input_is_told_and_leaves_nothing(command, logs, tmp_path, arguments, told):
    results = ["--out", "m.yaml", "--json", "r.json"]
    results += [] if "--report" in arguments else ["--report", "page"]
    status, shown = command(*(word.format(logs=logs) for word in arguments), *results)
    assert status == 2
    assert told in shown.err
    assert "Traceback" not in shown.err
    assert list(tmp_path.iterdir()) == []


def test_a_model_that_predicts_worse_is_not_written(command, logs, tmp_path):
    used = "provenance: {command: python scripts/identify.py before.csv}  # the model in use"
    (tmp_path / "m.yaml").write_text(used)
    status, shown = command(
        logs / "fit.csv", "--test", logs / "other_robot.csv", "--out", "m.yaml", "--json", "r.json"
    )
    assert status == 1
    assert "predicts worse" in shown.err
    assert (tmp_path / "m.yaml").read_text() == used
    assert json.loads((tmp_path / "r.json").read_text())["model"] is None


def test_motions_one_by_one_and_draws_of_the_posterior(command, logs, tmp_path):
    status, printed = command(
        logs / "fit.csv", "--by-motion", "--posterior", 20, "--out", "m.yaml", "--json", "m.json"
    )
    assert status == 0
    assert "Motion by motion" in printed.out
    found = json.loads((tmp_path / "m.json").read_text())["by_motion"]
    assert found["motions"] == ["I", "III", "II", "IV"]
    assert len(found["decomposed"]) == len(found["joint"]) == 7
    drawn = np.genfromtxt(tmp_path / "m.posterior.csv", delimiter=",", names=True)
    assert drawn.shape == (20,)
    assert np.std(drawn["m0"]) > 0


def test_thinning_keeps_peaks_and_lifts_the_pen_between_pieces():
    x = np.arange(100_000.0)
    y = np.sin(x / 5000)
    y[31_337] = 9.0
    piece = (x > 60_000).astype(int)
    at, thinned = thin(x, y, piece, points=1000)
    assert len(at) < 1100
    assert np.nanmax(thinned) == 9.0
    assert np.count_nonzero(np.isnan(thinned)) == 1


def test_numbers_are_printed_with_the_digits_that_count():
    assert [percent(share) for share in (1.224, 0.151, 0.0098)] == ["122 %", "15 %", "0.98 %"]
    assert percent(np.inf) == "without bound"
    assert rounded(0.0057821532, 2.7e-6) == "0.0057822"
    assert rounded(35.3011, 0.0955) == "35.301"
    assert rounded(35.3011, None) == "35.3"


def test_what_to_do_next_is_said(command, tmp_path):
    """Of the bundled log, whose robot has an effect that the model lacks, improve is proposed."""
    status, (out, _) = command("--out", tmp_path / "found.yaml")
    assert status == 0
    said = " ".join(out.split())
    assert "youbot improve youbot_fit --test youbot_test: looks for what is missing" in said
    assert "youbot compare youbot_test --model nominal found.yaml" in said
