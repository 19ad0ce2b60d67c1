"""Models and policies with values that cannot be; results written through a link."""

from dataclasses import replace

import numpy as np
import pytest

from youbot_env.model_file import (
    ModelFileError,
    load_model,
    model_from_dict,
    model_to_dict,
    write_atomically,
)
from youbot_env.simulation import AnalyticPlant


def spoiled(change):
    """The nominal model with a changed covariance, as the content of a file."""
    model = load_model("nominal")
    covariance = np.diag(np.linspace(1e-6, 1e-2, len(model.names())))
    change(covariance)
    return model_to_dict(model) | {"covariance": covariance.tolist()}


def negative(covariance):
    covariance[1, 1] = -1e-6


def uneven(covariance):
    covariance[0, 1] = 0.5 * np.sqrt(covariance[0, 0] * covariance[1, 1])


def indefinite(covariance):
    covariance[0, 1] = covariance[1, 0] = 1.01 * np.sqrt(covariance[0, 0] * covariance[1, 1])


@pytest.mark.parametrize(
    ("change", "what"),
    [
        (negative, "variance -1e-06 in row 2 is negative"),
        (uneven, "not symmetric"),
        (indefinite, "eigenvalue -0.01"),
    ],
)
def test_an_impossible_covariance_is_refused(change, what):
    with pytest.raises(ModelFileError, match=what):
        model_from_dict(spoiled(change))


def test_a_certain_value_is_no_fault():
    def certain(covariance):
        covariance[0, 0] = 0.0

    assert model_from_dict(spoiled(certain)).covariance[0][0] == 0.0


def test_a_link_stays_a_link(tmp_path):
    target, link = tmp_path / "target.yaml", tmp_path / "link.yaml"
    target.write_text("old")
    link.symlink_to(target)
    write_atomically(link, "new")
    assert link.is_symlink()
    assert target.read_text() == "new"


@pytest.mark.parametrize(
    ("text", "what"),
    [
        ("a: 1" + "0" * 400, "401 digits(.|\n)*line 1"),
        ("a: 1" + "0" * 5000, "5001 digits(.|\n)*line 1"),
        ("a: " + "[" * 3000 + "]" * 3000, "nested too deeply"),
    ],
)
def test_yaml_without_measure_is_a_bad_model_file(tmp_path, text, what):
    path = tmp_path / "model.yaml"
    path.write_text(text)
    with pytest.raises(ModelFileError, match=what):
        load_model(path)


def test_a_model_too_stiff_to_simulate_is_refused_at_once():
    paper = load_model("paper")
    stiff = replace(paper, parameters=replace(paper.parameters, mu1=1e6))
    with pytest.raises(ValueError, match="steps in a sample"):
        AnalyticPlant(stiff).step([0.0] * 4)
