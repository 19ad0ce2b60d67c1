"""Estimation keeps the prior where the logs see nothing, and says so."""

from dataclasses import replace

import numpy as np
import pytest

from ident.identification import identify
from ident.log import Log
from ident.results import UNSEEN
from youbot_env.model_file import load_model
from youbot_env.recording import record_motion, write_table
from youbot_env.references import make_reference
from youbot_env.simulation import AnalyticPlant, Sensors


@pytest.fixture(scope="module")
def translation(tmp_path_factory):
    plant = AnalyticPlant(load_model("paper"), 0.02)
    columns = record_motion(plant, make_reference("III"), 20.0, sensors=Sensors(), seed=4)
    path = write_table(tmp_path_factory.mktemp("logs") / "translation.csv", columns)
    return Log.load(path)


@pytest.mark.parametrize("method", ["ls", "iv"])
def test_translation_says_nothing_about_turning(translation, method):
    result = identify(translation, "nominal", method=method)
    nominal = load_model("nominal").parameters
    assert result.parameters["I0"].value == pytest.approx(nominal.I0)
    for name in ("I0", "m0", "I1"):  # m0 and I1 trade with each other in translation
        assert result.parameters[name].ci95 is None
        assert result.parameters[name].source == UNSEEN
        assert name not in result.model.standard_errors
    assert any("cannot be told apart" in words for words in result.observability.words)


def test_a_reference_that_was_not_driven_is_no_instrument(translation):
    still = replace(translation, reference=np.zeros_like(translation.reference))
    assert identify(still, "nominal").method == "least squares"
    with pytest.raises(ValueError, match="cannot serve as instruments"):
        identify(still, "nominal", method="iv")


def test_what_translation_does_see_is_right(translation):
    result, true = identify(translation, "nominal"), load_model("paper")
    low, high = result.lumps["x1+x3"].ci95
    assert low < 6.826 < high
    # Twenty seconds do not tell how the torque was recorded; where that is known all is well.
    known = {"drive_hold": {"kind": 0.0}, "drive_offset": {"d": 0.0}}
    told = identify(replace(translation, recording=known), "nominal")
    assert told.lumps["x1+x3"].value == pytest.approx(6.826, rel=0.03)
    for name in ("mu1", "mu2"):
        assert result.parameters[name].value == pytest.approx(
            getattr(true.parameters, name), rel=0.02
        )
        assert result.parameters[name].ci95 is not None
    covariance = np.array(result.model.covariance)
    assert np.all(np.isfinite(covariance))
    assert result.model.parameters.problems(result.model.platform) == []


def test_unequal_gains_start_from_equal_wheels(translation):
    result = identify(translation, "nominal", add=("torque_gain",), method="ls")
    gains = [q.value for q in result.effects["torque_gain"].values()]
    assert sum(gains) == pytest.approx(0.0, abs=1e-9)
    assert max(map(abs, gains)) < 0.02  # the true gains are equal
