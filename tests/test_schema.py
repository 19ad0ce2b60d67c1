"""Ranges of numbers in files: one list for readers and for the page that people read."""

import json
from pathlib import Path

import pytest
import yaml
from small_policies import policy

from controllers.file_tables import SECTIONS, file_tables
from controllers.rl_policy import Policy, PolicyFileError
from youbot_env import schema
from youbot_env.model_file import ModelFileError, load_model, model_to_dict
from youbot_env.platform import omni3
from youbot_env.platform_file import read_platform
from youbot_env.references import MotionFileError, load_motion

ROOT = Path(__file__).resolve().parent.parent


def test_the_page_is_that_of_the_schema():
    assert (ROOT / "docs" / "files.md").read_text(encoding="utf-8") == file_tables(), (
        "docs/files.md is old; run: python -m controllers.file_tables > docs/files.md"
    )


def test_shipped_files_hold_only_what_the_schema_lists():
    for path in (ROOT / "youbot_env" / "models").glob("*.yaml"):
        assert set(yaml.safe_load(path.read_text())) <= set(schema.MODEL.names)
    for path in (ROOT / "youbot_env" / "motions").glob("*.yaml"):
        assert set(yaml.safe_load(path.read_text())) <= set(schema.MOTION.names)
    for path in (ROOT / "controllers" / "policies").glob("*.json"):
        data = json.loads(path.read_text())
        for section, entries in zip(SECTIONS[-4:], (data, *map(
            data.get, ("network", "task", "normalisation")
        )), strict=True):  # fmt: skip
            assert set(section.needed) <= set(entries) <= set(section.names)


def numbers(section):
    return [entry.name for entry in section.entries if entry.low is not None]


def refused(tmp_path, content, name, read=load_model, kind=ModelFileError):
    path = tmp_path / "mine.yaml"
    path.write_text(yaml.safe_dump(content))
    with pytest.raises(kind, match=rf"mine(.|\n)*{name} = (.|\n)*give .* to "):
        read(path)


@pytest.mark.parametrize("name", numbers(schema.PARAMETERS))
def test_parameters(tmp_path, name):
    content = model_to_dict(load_model("paper"))
    content["parameters"][name]["value"] = 1.01 * schema.PARAMETERS[name].high
    refused(tmp_path, content, name)


def test_standard_errors(tmp_path):
    content = model_to_dict(load_model("paper"))
    content["parameters"]["m0"]["standard_error"] = -1.0
    refused(tmp_path, content, "standard_error")


@pytest.mark.parametrize("name", numbers(schema.PLATFORM))
def test_platforms(tmp_path, name):
    content = model_to_dict(load_model("paper"))
    content["platform"][name] = 0.5 * schema.PLATFORM[name].low
    refused(tmp_path, content, name)
    letter = {"wheel_radius": "R", "roller_radius": "r", "wheel_mass": "m"}[name]
    line = {"R": 0.05, "r": 0.01, "l": 0.2, "h": 0.2} | {letter: 1e9}
    text = " ".join(f"{key}={value}" for key, value in line.items())
    with pytest.raises(ModelFileError, match=f"{name} = 1e"):
        read_platform(text)


@pytest.mark.parametrize("name", numbers(schema.WHEEL))
def test_wheels(tmp_path, name):
    wheels = [{"name": w.name, "distance": 0.2, "at_deg": 120.0 * k}
              for k, w in enumerate(omni3().wheels)]  # fmt: skip
    wheels[1][name] = 1.01 * schema.WHEEL[name].high
    content = {"wheel_radius": 0.05, "roller_radius": 0.01, "wheels": wheels}
    refused(tmp_path, content, name, lambda path: read_platform(str(path)))


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"frequency": 0.0}, "frequency"),
        ({"speed": -1.0}, "speed"),
        ({"x": [[1e4, 0.0]]}, "amplitude"),
        ({"x": [[0.1, 1e4]]}, "phase"),
    ],
)
def test_motions(tmp_path, change, name):
    content = {"kind": "fourier", "frequency": 0.5} | {a: [[0.1, 0.0]] for a in ("x", "y", "yaw")}
    refused(tmp_path, content | change, name, load_motion, MotionFileError)


def test_a_motion_of_too_many_sines(tmp_path):
    content = {"kind": "fourier", "frequency": 0.5}
    content |= {axis: [[0.0, 0.0]] * 1001 for axis in ("x", "y", "yaw")}
    (tmp_path / "mine.yaml").write_text(yaml.safe_dump(content))
    with pytest.raises(MotionFileError, match="at most 1000"):
        load_motion(tmp_path / "mine.yaml")


@pytest.mark.parametrize(
    ("change", "name"),
    [
        ({"clip": 0.0}, "clip"),
        ({"share": 1e9}, "share"),
        ({"task": {"dt": 1e-9, "torque_limit": 4.0}}, "dt"),
        ({"task": {"dt": 0.01, "torque_limit": 1e200}}, "torque_limit"),
    ],
)
def test_policies(change, name):
    with pytest.raises(PolicyFileError, match=rf"its {name} = .*give .* to "):
        policy(**change)
    assert isinstance(policy(), Policy)
