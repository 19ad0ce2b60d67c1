"""Comparison: the true model is best, the error is found where it was put, and chance is not."""

import json
import re
import subprocess
import sys
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from scipy.signal import lfilter
from shared_data import shared

from ident.comparison import compare, rank
from ident.comparison.binned import bin_means, cell_medians
from ident.comparison.moments import Moments, wheel_torques
from ident.comparison.shares import locate, stretch_numbers
from ident.comparison.stretches import track, window_errors
from ident.log import Log
from ident.regression import build_regression
from youbot_env.model_file import load_model, save_model
from youbot_env.references import calibration_sequence
from youbot_env.simulation import Sensors, record_closed_loop

ROOT = Path(__file__).resolve().parent.parent
SCRIPT = ROOT / "scripts" / "compare.py"
PAPER = load_model("paper")
FIGURES = {"free_run", "regimes", "velocity_map", "signals", "time", "log"}


def record(model, seconds=60.0, seed=1):
    channels = record_closed_loop(
        model, calibration_sequence(seconds=seconds), np.arange(seconds * 100) / 100, Sensors(),
        seed=seed,
    )  # fmt: skip
    return Log("log", model.platform, **channels)


@pytest.fixture(scope="module")
def plain():
    """A log of the paper's robot with nothing hidden."""
    return record(PAPER)


def regime(comparison, name):
    return next(found for found in comparison.where if found.name == name)


def test_the_true_model_is_best_by_both_errors(plain):
    true, nominal = compare(plain, [PAPER, load_model("nominal")])
    assert true.run.nrmse < 0.05 * nominal.run.nrmse
    assert true.equation[3] < 0.2 * nominal.equation[3]
    best, other = rank([nominal, true])
    assert best.comparison is true
    assert other.worse
    assert other.ci95[0] < other.ratio < other.ci95[1]


def test_models_that_predict_alike_are_not_ranked_by_chance(plain):
    twin = PAPER.with_values(np.array(PAPER.values()) * 1.0001, "twin")
    _, second = rank(compare(plain, [PAPER, twin]))
    assert not second.worse


def test_errors_hang_together(plain):
    (found,) = compare(plain, [load_model("nominal")])
    low, high = found.run_ci95
    assert low < found.run.nrmse < high
    assert np.sqrt(window_errors(found.run).mean()) == pytest.approx(found.run.nrmse)
    assert np.sqrt(np.mean(found.run_nrmse**2)) == pytest.approx(found.run.nrmse)
    shares = [stretch.share_of_error for stretch in found.worst]
    assert shares == sorted(shares, reverse=True)
    force = found.force_residual[:, 0]
    assert found.force_rmse[0] == pytest.approx(np.sqrt(np.mean(force**2)))
    assert force[0] * plain.platform.lever == pytest.approx(found.residual[0, 0])


def test_shares_of_axes_and_of_wheels_add_up(plain):
    (found,) = compare(plain, [load_model("nominal")])
    for kind in ("axis", "wheel"):
        shares = [
            r.share_of_error for r in found.where if r.name.startswith(kind) and r.of == "all"
        ]
        assert sum(shares) == pytest.approx(1.0)


def test_error_in_time_is_found_where_it_was_put():
    changed = PAPER.with_effects({"payload_change": {"dm": 8.0, "dI": 0.5, "t0": 45.0}})
    (found,) = compare(record(changed), [PAPER])
    last = regime(found, "last quarter of the time")
    assert last.excess > 1.5
    quarters = [r for r in found.where if r.name.endswith("quarter of the time")]
    assert last is quarters[0]
    assert last.excess_ci95[0] < last.excess < last.excess_ci95[1]


def test_the_wheel_whose_torque_is_wrong_is_flagged():
    weak = PAPER.with_effects({"torque_gain": {"e_fl": 0.2}})
    (found,) = compare(record(weak), [PAPER])
    wheels = {r.name: r for r in found.where if r.kind == "wheel"}
    assert max(wheels.values(), key=lambda r: r.share_of_error).name == "wheel fl"
    assert wheels["wheel fl"].flagged
    assert not wheels["wheel rl"].flagged


def test_a_torque_on_one_wheel_is_shared_out_to_it_first():
    lever, jacobian = PAPER.platform.lever, PAPER.platform.jacobian_array
    residual = 0.3 * jacobian[2] * (lever, lever, 1.0)
    torque = wheel_torques(residual[None], PAPER.platform)[0]
    assert np.argmax(np.abs(torque)) == 2
    assert jacobian.T @ torque == pytest.approx(0.3 * jacobian[2])


def test_ripple_is_found_with_its_size():
    sizes = {f"{part}_{wheel}": 0.0 for part in "ab" for wheel in PAPER.platform.wheel_names}
    rippled = PAPER.with_effects({"torque_ripple": sizes | {"a_fr": 0.12, "b_fr": -0.09, "k": 6.0}})
    (found,) = compare(record(rippled), [PAPER])
    first = found.ripple[0]
    assert (first.wheel, first.order) == ("fr", 6)
    assert first.flagged
    assert first.ci95[0] < 0.15 < first.ci95[1]
    assert first.ci95[1] - first.ci95[0] < 0.05
    others = [h.amplitude for h in found.ripple if (h.wheel, h.order) != ("fr", 6)]
    assert max(others) < 0.01


def test_dry_friction_is_a_step_over_the_wheel_speed():
    (found,) = compare(record(PAPER.with_effects({"wheel_coulomb_friction": 0.2})), [PAPER])
    stretch = stretch_numbers(found.regression)
    torque = wheel_torques(found.residual, PAPER.platform)
    means = bin_means(found.moments.wheel_speed[:, 0], torque[:, 0], stretch)
    fast = np.abs(means.centre) > 2.0
    step = means.mean[fast] * np.sign(means.centre[fast])
    assert np.nanmean(step) == pytest.approx(0.2, abs=0.05)
    assert np.nanmin(step - means.half[fast]) > 0.0


def test_what_depends_on_nothing_is_rarely_flagged(plain):
    regression = build_regression(plain, PAPER)
    moments, rng = Moments.of(plain, regression), np.random.default_rng(0)
    dt, flagged, draws = np.median(np.diff(regression.time)), 0, 40
    for _ in range(draws):
        noise = rng.standard_normal((len(regression.time), 3))
        residual = lfilter([1.0], [1.0, -np.exp(-dt / 0.3)], noise, axis=0)
        found = locate(moments, regression, residual, rng)
        flagged += any(r.flagged for r in found)
    assert flagged <= 4  # 2 expected at the nominal 5 %


def test_intervals_of_bin_means_hold_the_mean():
    rng, held, asked = np.random.default_rng(1), 0, 0
    stretch = np.arange(2400) * 24 // 2400
    for _ in range(60):
        signal = rng.uniform(0, 1, 2400)
        level = rng.standard_normal(24)[stretch]
        found = bin_means(signal, level + rng.standard_normal(2400), stretch, (0.0, 1.0), 4)
        held += np.sum(np.abs(found.mean) < found.half)
        asked += 4
    assert 0.88 < held / asked <= 1.0


def test_cells_hold_medians_and_say_nothing_where_they_are_empty():
    x = np.repeat([0.1, 0.9], 50)
    y = np.repeat([0.1, 0.9], 50)
    *_, found = cell_medians(x, y, np.column_stack([3.0 * x, y]), 2, 10)
    assert found[0, 0] == pytest.approx([0.3, 0.1])
    assert found[1, 1] == pytest.approx([2.7, 0.9])
    assert np.all(np.isnan(found[0, 1]))


def test_a_track_is_the_circle_that_was_driven():
    time = np.linspace(0.0, np.pi, 400)
    poses = track(time, np.tile((0.5, 0.0, 1.0), (400, 1)), (1.0, 2.0, np.pi / 2))
    assert poses[0] == pytest.approx((1.0, 2.0, np.pi / 2))
    assert poses[-1] == pytest.approx((0.0, 2.0, 1.5 * np.pi), abs=1e-4)


def test_without_wheel_speeds_no_wheel_angle_is_made_up(plain):
    body = replace(plain, body_velocity=plain.velocity(), wheel_velocity=None)
    (found,) = compare(body, [PAPER])
    assert found.ripple == ()
    assert all(r.kind != "wheel angle" for r in found.where)


def test_a_model_of_another_platform_is_refused(plain):
    larger = replace(PAPER, platform=replace(PAPER.platform, wheel_radius=0.05), name="larger")
    with pytest.raises(ValueError, match="another wheel table"):
        compare(plain, [PAPER, larger])


@pytest.fixture
def command(monkeypatch, tmp_path, capsys):
    """Call the script in this process, in an empty folder; gives status and what it printed."""
    monkeypatch.chdir(tmp_path)
    from youbot_cli import compare as script
    from youbot_cli import console

    def call(*arguments):
        monkeypatch.setattr(sys, "argv", [str(SCRIPT), *map(str, arguments)])
        with pytest.raises(SystemExit) as end:
            console.run(script.main, "", several=("--model",))
        return end.value.code, capsys.readouterr()

    return call


def test_script_writes_the_contract_and_the_page(tmp_path):
    words = [sys.executable, SCRIPT, "--model", "nominal", "paper", "--model", "c.yaml"]
    save_model(replace(load_model("nominal"), name="c"), tmp_path / "c.yaml")
    done = subprocess.run(
        [*words, "--json", "c.json", "--report", "page"], cwd=tmp_path, capture_output=True,
        text=True, check=False,
    )  # fmt: skip
    assert done.returncode == 0, done.stderr
    assert done.stdout.startswith("paper predicts youbot_test best")
    result = json.loads((tmp_path / "c.json").read_text())
    assert [m["model"] for m in result["models"]] == ["nominal", "paper", "c"]
    assert result["best"] == "paper"
    for entry in result["models"]:
        assert set(entry["free_run"]) == {"vx", "vy", "yaw_rate", "nrmse"}
        assert set(entry["equation"]) == {"x", "y", "yaw", "nrmse"}
        assert {"regime", "share_of_error", "ci95", "p_adjusted"} <= set(entry["where"][0])
    page = tmp_path / "page" / "index.html"
    text = page.read_text(encoding="utf-8")
    assert {p.stem for p in page.parent.glob("*.png")} == FIGURES
    assert page.stat().st_size < 3e6
    assert not re.search(r"(src|href)=\"(?!data:)", text)
    played = json.loads(re.search(r"const data = (\{.*?\});\n", text).group(1))
    assert len(played["stretches"]) == 5
    for stretch in played["stretches"]:
        assert len(stretch["tracks"]) == 1 + 3
        starts = np.array([poses[0] for poses in stretch["tracks"]])
        assert np.ptp(starts, axis=0) == pytest.approx(0.0)
        assert len(stretch["tracks"][0]) > 100
    assert played["models"][-1]["name"] == "paper"


@pytest.mark.parametrize(
    ("arguments", "told"),
    [
        (["none.csv", "--model", "paper"], "no log"),
        (["--model", "paper", "log.csv"], "put a log before --model"),
        (["--model", "paper", "paper"], "given twice"),
        (["--model", "paper", "absent.yaml"], "absent.yaml"),
        (["--window", "1000"], "shorter window"),
        (["kinematic.csv"], "wheel_torque"),
    ],
)
def test_bad_input_is_told_and_leaves_nothing(command, plain, tmp_path, arguments, told):
    (tmp_path / "log.csv").write_text("time\n")
    replace(plain, wheel_torque=None).save(tmp_path / "kinematic.csv")
    status, shown = command(*arguments, "--json", "r.json", "--report", "page")
    assert status == 2
    assert told in shown.err
    assert {p.name for p in tmp_path.iterdir()} == {"log.csv", "kinematic.csv"}


def test_two_models_of_one_name_are_told_apart(command, tmp_path):
    for folder in ("a", "b"):
        save_model(PAPER, tmp_path / folder / "robot.yaml")
    status, _ = command("--model", "a/robot.yaml", "b/robot.yaml", "--json", "r.json")
    assert status == 0
    names = [m["model"] for m in json.loads((tmp_path / "r.json").read_text())["models"]]
    assert names == ["a/paper", "b/paper"]


def test_a_log_driven_by_voltage_is_compared_in_volts(command, tmp_path):
    log = shared("ftc-mecanum", "red_field_deposit.csv")
    status, shown = command(log, "--model", "nominal", "--json", "r.json")
    assert status == 0
    assert "driven by voltage" in shown.out
    (entry,) = json.loads((tmp_path / "r.json").read_text())["models"]
    assert entry["equation_rms"]["units"]["x"] == "V/m"


def test_an_option_takes_several_values():
    from youbot_cli.console import spread

    several = ("--model",)
    assert spread(["log", "--model", "a", "b", "--seed", "3"], several) == [
        "log", "--model", "a", "--model", "b", "--seed", "3",
    ]  # fmt: skip
    assert spread(["--model", "a", "--model", "b"], several) == ["--model", "a", "--model", "b"]
    assert spread(["--add", "a", "b"], several) == ["--add", "a", "b"]
    assert spread(["--model", "a", "--", "b"], several) == ["--model", "a", "--", "b"]
    assert spread(["--model"], several) == ["--model"]
