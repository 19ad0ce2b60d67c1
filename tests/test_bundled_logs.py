"""The bundled logs are what their commands make."""

import re
from pathlib import Path

import gymnasium as gym
import numpy as np
import pytest
from written_logs import comments, read

import youbot_env
from youbot_env.channels import channel_columns
from youbot_env.platform import youbot

gym.register_envs(youbot_env)

LOGS = Path(__file__).resolve().parent.parent / "ident" / "logs"
PLATFORM = youbot()
COLUMNS = channel_columns(PLATFORM)

BUNDLED = {
    "youbot_fit": ("calibration", 112, 0.35, 1.0, 1),
    "youbot_test": ("smooth_random", 48, 0.45, 1.5, 2),
}


@pytest.mark.parametrize("name", BUNDLED)
def test_bundled_log_is_what_its_command_makes(script, name):
    pytest.importorskip("mujoco")
    motion, seconds, speed, frequency, seed = BUNDLED[name]
    options = ("--plant", "rollers", "--model", LOGS / "truth.yaml", "--motion", motion, "--speed",
               speed, "--frequency", frequency, "--hold", "held", "--seed", seed,
               "--hide")  # fmt: skip
    # Only the start: the calibration motions share the seconds, so that one is driven by motion I.
    start = 1.0
    if motion == "calibration":
        options = (*options[:5], "I", *options[6:])
    assert script("record.py", *options, "--seconds", start, "--out", "log.csv")[0] == 0
    ours, bundled = read("log.csv"), read(LOGS / f"{name}.csv")
    assert bundled.columns == ours.columns
    assert len(bundled) == 100 * seconds
    np.testing.assert_allclose(bundled["time"], np.arange(100 * seconds) / 100, atol=1e-9)
    # Contacts amplify the last digits of other versions; after a second that is still little.
    for column in COLUMNS["wheel_velocity"] + COLUMNS["reference"]:
        np.testing.assert_allclose(bundled[column][:100], ours[column], atol=0.15)
    assert f"--motion {motion} --speed {speed}" in comments(LOGS / f"{name}.csv")[0]
    assert f"--seed {seed}" in comments(LOGS / f"{name}.csv")[0]
    assert "coulomb" not in "".join(comments(LOGS / f"{name}.csv"))


@pytest.mark.parametrize("name", BUNDLED)
def test_bundled_log_moves_well_within_the_limits_of_the_drive(name):
    table = read(LOGS / f"{name}.csv")
    torque = np.abs(table.select(COLUMNS["wheel_torque"]).to_numpy())
    assert np.mean(torque > 3.9) < 1e-3
    body = (
        table.select(COLUMNS["wheel_velocity"]).to_numpy()
        @ np.linalg.pinv(PLATFORM.jacobian_array).T
    )
    assert 0.3 < np.hypot(body[:, 0], body[:, 1]).max() < 0.5
    assert np.linalg.cond(np.cov(body.T)) < 30
    assert (LOGS / f"{name}.csv").stat().st_size < 1.6e6


def test_bundled_readme_holds_the_commands():
    text = (LOGS / "README.md").read_text()
    for name in BUNDLED:
        command = comments(LOGS / f"{name}.csv")[0].removeprefix("# ")
        for option in re.findall(
            r"--\w+ (?!--)\S+", command.replace("--rate 100 ", "").replace("--hold sampled ", "")
        ):
            assert option in text, option
        assert f"--out logs/{name}.csv" in text
    before, after = text.split("## Spoiler")
    assert "coulomb" not in before
    assert "wheel_coulomb_friction" in after
