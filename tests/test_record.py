"""Recording of logs: reproducible, replayable, hidden where asked, clear about bad input."""

import functools
import json
import os
import re
import subprocess
import sys
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from written_logs import comments, read

import youbot_env
from youbot_env.channels import channel_columns
from youbot_env.model_file import load_model
from youbot_env.platform import omni3, youbot
from youbot_env.recording import RecordLog, record_motion, write_table
from youbot_env.references import make_reference
from youbot_env.simulation import AnalyticPlant, Sensors

gym.register_envs(youbot_env)

SCRIPTS = Path(__file__).resolve().parent.parent / "scripts"
LOGS = SCRIPTS.parent / "ident" / "logs"
PLATFORM = youbot()
COLUMNS = channel_columns(PLATFORM)
LOGGED = ("wheel_velocity", "wheel_torque", "pose", "reference")


@pytest.fixture
def record(script):
    """Run scripts/record.py in an empty folder; returns (exit status, stdout, stderr)."""
    return functools.partial(script, "record.py")


def replay(table, model, dt):
    """Wheel speeds (N, n) and poses (N, 3) of a plant under the recorded torques."""
    plant, first = AnalyticPlant(model, dt), table.select(COLUMNS["wheel_velocity"]).row(0)
    velocity = np.linalg.pinv(PLATFORM.jacobian_array) @ first
    plant.reset(table.select(COLUMNS["pose"]).row(0), velocity)
    speeds, poses = [], []
    for torque in table.select(COLUMNS["wheel_torque"]).iter_rows():
        speeds.append(plant.wheel_velocity)
        poses.append(plant.pose)
        plant.step(torque)
    return np.array(speeds), np.array(poses)


@pytest.mark.parametrize("plant", ["analytic", "rollers"])
def test_equal_seeds_give_equal_bytes_wherever_the_log_goes(record, plant):
    if plant == "rollers":
        pytest.importorskip("mujoco")
    options = ("--plant", plant, "--motion", "smooth_random", "--seconds", 1.5, "--effect",
               "wheel_coulomb_friction=0.2")  # fmt: skip
    for name, seed in (("a.csv", 4), ("deep/b.csv", 4), ("c.csv", 5)):
        status, out, err = record(*options, "--seed", seed, "--out", name)
        assert status == 0, err
        assert f"{name}: 150 samples" in out
    assert Path("a.csv").read_bytes() == Path("deep/b.csv").read_bytes()
    assert not np.array_equal(read("a.csv")["x"], read("c.csv")["x"])


def test_table_has_the_columns_of_the_contract_at_the_rate_asked_for(record):
    assert record("--seconds", 3, "--rate", 50, "--out", "log.csv")[0] == 0
    table = read("log.csv")
    assert table.columns == ["time", *(name for channel in LOGGED for name in COLUMNS[channel])]
    np.testing.assert_allclose(table["time"], np.arange(150) / 50, atol=1e-9)
    assert re.search(r"--motion calibration .*--rate 50 .*--seed 0", comments("log.csv")[0])


LOOPS = (("--loop-rate", 500), ("--hold", "averaged", "--rate", 20), ("--hold", "held"))


@pytest.mark.parametrize("options", LOOPS)
def test_command_in_the_log_makes_the_log_again(record, options):
    given = ("--seconds", 1.5, "--motion", "eight", "--seed", 3, *options, "--declare")
    assert record(*given, "--out", "a.csv")[0] == 0
    command, declared = comments("a.csv")[:2]
    held = options[1] if options[0] == "--hold" else "sampled"
    assert declared == f"# recording: drive_hold={held}"
    assert record(*command.split()[3:], "--out", "b.csv")[0] == 0
    assert Path("a.csv").read_bytes() == Path("b.csv").read_bytes()


def test_log_says_how_its_rows_came_to_be_only_when_asked(record):
    assert record("--seconds", 1, "--out", "log.csv")[0] == 0
    assert len(comments("log.csv")) == 1
    assert "--rate 100 --loop-rate 1000 --hold sampled" in comments("log.csv")[0]


@pytest.mark.parametrize("motion", ["I", "II", "III", "IV", "circle", "eight", "multisine"])
def test_robot_follows_the_motion(record, motion):
    options = ("--motion", motion, "--speed", 0.25, "--frequency", 0.9, "--seconds", 8)
    assert record(*options, "--out", "log.csv")[0] == 0
    table = read("log.csv")
    speeds = table.select(COLUMNS["wheel_velocity"]).to_numpy()
    wanted = table.select(COLUMNS["reference"]).to_numpy() @ PLATFORM.jacobian_array.T
    settled = table["time"].to_numpy() > 1.0
    error = np.sqrt(np.mean((speeds - wanted)[settled] ** 2))
    assert error < 0.12 * np.sqrt(np.mean(wanted[settled] ** 2))


def test_log_without_noise_is_what_the_model_does_under_its_torques(record):
    # Only torques that are held from row to row can be replayed from the rows.
    options = ("--hold", "held", "--no-noise", "--seconds", 6, "--motion", "multisine", "--effect")
    assert record(*options, "wheel_coulomb_friction=0.2", "--out", "log.csv")[0] == 0
    table = read("log.csv")
    measured = table.select(COLUMNS["wheel_velocity"]).to_numpy()
    true = load_model("paper").with_effects({"wheel_coulomb_friction": 0.2})
    speeds, poses = replay(table, true, 0.01)
    np.testing.assert_allclose(speeds, measured, atol=1e-6)
    np.testing.assert_allclose(poses, table.select(COLUMNS["pose"]).to_numpy(), atol=1e-6)
    without, _ = replay(table, load_model("paper"), 0.01)
    assert np.sqrt(np.mean((without - measured) ** 2)) > 0.2


def test_hidden_effects_are_in_the_truth_file_alone(record):
    options = ("--seconds", 2, "--motion", "eight", "--no-noise")
    effects = ("--effect", "torque_gain.e_fl=0.125", "--effect", "floor_slope=0.017")
    status, out, _ = record(
        *options, *effects, "--hide", "--truth", "t.yaml", "--json", "j.json", "--out", "log.csv"
    )
    assert status == 0
    shown = out + "\n".join(comments("log.csv")) + Path("j.json").read_text()
    assert not re.search(r"torque_gain|0\.125|floor_slope|0\.017", shown)
    truth = load_model("t.yaml")
    sizes = {active.identifier: active.values for active in truth.effects}
    assert sizes["torque_gain"]["e_fl"] == 0.125
    assert sizes["floor_slope"]["sx"] == 0.017
    assert record(*options, "--model", "t.yaml", "--out", "again.csv")[0] == 0
    assert read("again.csv").equals(read("log.csv"))


def test_open_log_names_its_effects_and_json_the_whole_truth(record):
    options = (
        "--seconds",
        1,
        "--effect",
        "torque_offset.b_rl=0.3",
        "--effect",
        "yaw_scrub_friction",
    )
    assert record(*options, "--json", "j.json", "--out", "log.csv")[0] == 0
    assert any("torque_offset: b_fl = 0, b_fr = 0, b_rl = 0.3" in c for c in comments("log.csv"))
    result = json.loads(Path("j.json").read_text())
    assert result["samples"] == 100
    assert result["truth"]["effects"][1]["identifier"] == "yaw_scrub_friction"
    assert set(result["wheels"]) == set(PLATFORM.wheel_names)
    assert len(result["provenance"]["logs"]["log.csv"]) == 64
    assert result["provenance"]["seed"] == 0
    assert "numpy" in result["provenance"]["versions"]


def test_no_absolute_path_is_written(record, tmp_path):
    model = tmp_path.parent / f"{tmp_path.name}-robot.yaml"
    model.write_text("platform: youbot\nparameters: {m0: 30, I0: 2, I1: 0.01, a_x: 0, a_y: 0, "
                     "mu1: 0.1, mu2: 0.005}\n")  # fmt: skip
    for name in ("log.csv", "t.yaml", "j.json"):
        assert not Path(name).exists()
    files = ("--out", tmp_path / "log.csv", "--truth", tmp_path / "t.yaml")
    status, _, err = record("--seconds", 1, "--model", model, *files, "--json", tmp_path / "j.json")
    assert status == 0, err
    for name in ("log.csv", "t.yaml", "j.json"):
        assert str(tmp_path.parent) not in Path(name).read_text()


BAD = {
    "effect": (("--effect", "wheel_colomb_friction=0.2"), "wheel_coulomb_friction"),
    "effect value": (("--effect", "wheel_coulomb_friction=0,2"), "'0,2' is not a number"),
    "effect size": (("--effect", "wheel_coulomb_friction=-1"), r"-1.* outside \[0"),
    "effect parameter": (("--effect", "floor_slope.sz=0.1"), r"sz.*has \['sx', 'sy'\]"),
    "effect not a number": (("--effect", "floor_slope=nan"), "nan .*outside"),
    "effect twice": (("--effect", "floor_slope", "--effect", "floor_slope=1"), "given twice"),
    "effect without value": (("--effect", "floor_slope.sx"), "floor_slope.sx=VALUE"),
    "plant": (("--plant", "gazebo"), "gazebo.*analytic, rollers"),
    "motion": (("--motion", "V"), "'V'; known: .*circle"),
    "model": (("--model", "kuka"), "'kuka'.*nominal.*paper"),
    "speed": (("--speed", "-0.1"), "-0.1 m/s: give 0 to 3"),
    "speed not a number": (("--speed", "nan"), "nan m/s: give"),
    "frequency": (("--frequency", "0"), "0 rad/s: .*more than 0"),
    "frequency above the rate": (("--frequency", "100"), "at most 62.8 rad/s"),
    "seconds": (("--seconds", "inf"), "inf: at 100 Hz give 0.02 to 10000"),
    "rate": (("--rate", "1"), "1 Hz: give 5 to 1000"),
    "rate of held torques": (("--rate", "20", "--hold", "held"), "20 Hz .*unstable below 25 Hz"),
    "loop rate": (("--loop-rate", "10"), "10 Hz: give 25 to 10000"),
    "rate above the loops": (("--loop-rate", "50"), "100 Hz is above --loop-rate 50 Hz"),
    "hold": (("--hold", "filtered"), "filtered: choose one of sampled, averaged, held"),
    "seed": (("--seed", "-3"), "--seed.*greater than or equal to 0"),
    "rate is text": (("--rate", "fast"), "--rate.*valid number"),
    "floor": (("--floor-friction", "0.3"), "0.3 belongs to --plant rollers.*wheel_slip=0.3"),
    "unknown option": (("--velocity", "3"), "No such option: --velocity"),
    "suffix": (("--out", "log.txt"), "log.txt.*end the name in .csv"),
    "folder": (("--out", "."), "folder; add a file name"),
    "no folder": (("--out", "taken/log.csv"), "'taken' is no folder"),
    "same file": (("--json", "log.csv"), "two results.*'log.csv'; rename"),
    "diverges": (("--effect", "wheel_friction_asymmetry=-1"), r"diverged before t = .*smaller"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_input_ends_with_status_two_one_message_and_no_file(record, case):
    options, message = BAD[case]
    Path("taken").write_text("a file")
    status, out, err = record("--seconds", 2, "--out", "log.csv", *options)
    assert status == 2
    assert out == ""
    assert re.search(message, err), err
    assert "Traceback" not in err
    assert [path.name for path in Path().iterdir()] == ["taken"]


def test_bad_input_of_the_rollers_plant(record):
    pytest.importorskip("mujoco")
    for options, message in (
        (("--rate", 70), "70 Hz: dt = 0.0142.* whole number of physics steps"),
        (("--loop-rate", 2000), "loops at 2000 Hz, 20 steps a row .* of physics steps"),
        (("--floor-friction", 0), "floor_friction = 0.0 must be positive"),
        (("--effect", "wheel_radius_error"), "wheel_radius_error.*use the analytic plant"),
    ):
        status, _, err = record("--plant", "rollers", "--seconds", 1, *options)
        assert status == 2
        assert re.search(message, err), err
        assert not list(Path().iterdir())


def test_failed_write_leaves_the_old_log(record, monkeypatch):
    Path("log.csv").write_text("old")

    def full(*_):
        raise OSError(28, "No space left on device", "log.csv")

    monkeypatch.setattr(os, "replace", full)
    status, _, err = record("--seconds", 1, "--out", "log.csv", "--force")
    assert status == 2
    assert "No space left on device" in err
    assert Path("log.csv").read_text() == "old"
    assert len(list(Path().iterdir())) == 1


def test_overdriven_motion_is_told(record):
    status, _, err = record("--speed", 2.5, "--seconds", 8, "--out", "log.csv")
    assert status == 0
    assert "at its torque limit" in err
    assert "lower --speed" in err


def test_script_runs_from_anywhere_as_a_process(tmp_path):
    command = [sys.executable, str(SCRIPTS / "record.py"), "--seconds", "1", "--effect"]
    for effect, status in (("torque_lag", 2), ("actuator_lag", 0)):
        done = subprocess.run([*command, effect], cwd=tmp_path, capture_output=True, text=True)
        assert done.returncode == status, done.stderr
    assert (tmp_path / "runs" / "log.csv").is_file()


def test_sensors_change_the_record_but_no_column_name():
    plant, motion = AnalyticPlant(load_model("paper")), make_reference("eight")
    exact = record_motion(plant, motion, 3.0)
    noisy = record_motion(plant, motion, 3.0, sensors=Sensors(), seed=1)
    assert list(exact) == list(noisy)
    error = noisy["x"] - exact["x"]
    assert 0.5e-3 < np.std(error) < 2e-3
    np.testing.assert_array_equal(exact["reference_vx"], noisy["reference_vx"])


def test_any_platform_can_be_recorded():
    plant = AnalyticPlant(load_model("paper"))
    assert "wheel_velocity_rl" in record_motion(plant, make_reference("III"), 0.1)
    assert channel_columns(omni3())["wheel_torque"] == (
        "wheel_torque_left", "wheel_torque_rear", "wheel_torque_right"
    )  # fmt: skip
    with pytest.raises(ValueError, match=r"seconds = 0.01; .* two samples of 0.01 s"):
        record_motion(plant, make_reference("III"), 0.01)


def test_recorded_environment_replays(tmp_path):
    env = RecordLog(gym.make("YouBot-v0", action_level="velocity"))
    with pytest.raises(gym.error.ResetNeeded):
        env.step(np.zeros(3, np.float32))
    with pytest.raises(ValueError, match="0 rows"):
        env.table()
    env.reset(seed=0)
    for k in range(150):
        env.step(np.array([np.sin(0.05 * k), 0.3, -0.4], np.float32))
    table = read(env.save(tmp_path / "deep" / "rollout.csv"))
    speeds, poses = replay(table, load_model("paper"), 0.01)
    np.testing.assert_allclose(speeds, table.select(COLUMNS["wheel_velocity"]), atol=1e-4)
    np.testing.assert_allclose(poses, table.select(COLUMNS["pose"]), atol=1e-4)
    assert np.abs(speeds).max() > 5.0
    noisy = env.table(Sensors(), seed=3)
    assert np.std(noisy["wheel_torque_fl"] - table["wheel_torque_fl"].to_numpy()) == pytest.approx(
        0.03, rel=0.2
    )


def test_table_is_written_with_the_digits_asked_for(tmp_path):
    times = np.array([0.0, 1 / 3, 123456.789])
    path = write_table(
        tmp_path / "t.csv", {"time": times, "x": np.array([-1e-9, 1.23456, -2.0])}, ["a\nb"], 3
    )
    assert path.read_text().splitlines() == [
        "# a", "# b", "time,x", "0,0.000", "0.3333333333,1.235", "123456.789,-2.000"
    ]  # fmt: skip
