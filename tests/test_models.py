"""Models and their files: there and back, every kind of broken file, atomic writing."""

import math
from dataclasses import replace

import numpy as np
import pytest

from youbot_env.model import Model
from youbot_env.model_file import ModelFileError, load_model, save_model
from youbot_env.parameters import UNITS, ImpossibleParameters, Parameters
from youbot_env.platform import omni3, youbot

PARAMETERS = "{m0: 30, I0: 2, I1: 0.01, a_x: 0, a_y: 0, mu1: 0.1, mu2: 0.005}"
GOOD = f"platform: youbot\nparameters: {PARAMETERS}\n"
PAPER = Parameters(m0=35.3, I0=4.4, I1=6e-3, a_x=0.016, a_y=-0.026, mu1=0.11, mu2=5.78e-3)


@pytest.fixture
def load(tmp_path):
    def from_text(text):
        path = tmp_path / "robot.yaml"
        path.write_text(text) if isinstance(text, str) else path.write_bytes(text)
        return load_model(path)

    return from_text


def test_shipped_models_are_those_of_paper_and_data_sheet():
    assert load_model("paper").parameters == PAPER
    nominal = load_model("nominal").parameters
    assert nominal.m0 == pytest.approx(20 + 4 + 5.69 + 0.245, abs=0.05)
    rotor = 135e-7 * 25.84**2  # the wheel adds a little
    assert rotor < nominal.I1 < 1.2 * rotor
    assert (nominal.a_x, nominal.a_y) == (0.0, 0.0)
    for name in ("paper", "models/paper", "models/paper.yaml", "paper.yaml"):
        model = load_model(name)
        assert (model.name, model.platform, model.effects) == ("paper", youbot(), ())
    assert load_model(model) is model


def test_file_written_by_hand(load):
    model = load(
        "platform: youbot\nparameters:\n  m0: {value: 30, unit: kg, source: scales}\n  I0: 2\n"
        "  I1: 9e-3\n  a_x: 1E-2\n  a_y: -.5e-2\n  mu1: 1.e-1\n  mu2: 0.005\n"
        "effects:\n  - floor_slope\n  - identifier: torque_gain\n    parameters: {e_fr: 5e-2}\n"
        "  - {identifier: wheel_coulomb_friction, parameters: 0.3}\n"
    )
    assert model.name == "robot"
    assert model.parameters == Parameters(30.0, 2.0, 9e-3, 0.01, -0.005, 0.1, 0.005)
    assert model.sources["m0"] == "scales"
    values = {active.identifier: active.values for active in model.effects}
    assert values == {
        "floor_slope": {"sx": 0.01, "sy": 0.01},
        "torque_gain": {"e_fl": 0.0, "e_fr": 0.05, "e_rl": 0.0, "e_rr": 0.0},
        "wheel_coulomb_friction": {"fc": 0.3},
    }


@pytest.mark.parametrize("platform", [youbot(), omni3()], ids=lambda p: p.name)
def test_save_and_load_return_the_same_model(tmp_path, platform):
    parameters = Parameters(12.3, 0.9, 1 / 300, 0.01, -0.02, 1 / 7, 1e-7)
    model = Model(
        platform,
        parameters,
        name="Prüfstand 3",
        sources={name: f"where {name} comes from" for name in UNITS},
        standard_errors={"m0": 0.1, "I1": 2e-9},
        provenance={"command": "python scripts/identify.py", "seed": 3},
    ).with_effects({"actuator_lag": 0.013, "torque_offset": {f"b_{platform.wheel_names[1]}": 0.1}})
    size = len(model.names())
    model = replace(model, covariance=(np.eye(size) / 3 + 1e-13).tolist())
    path = tmp_path / "deep" / "model.yaml"
    save_model(model, path)
    again = load_model(path)
    assert again.values() == model.values()
    assert again.names() == model.names()
    for name in ("name", "parameters", "sources", "standard_errors", "covariance", "provenance"):
        assert getattr(again, name) == getattr(model, name), name
    ours, theirs = again.platform, model.platform
    np.testing.assert_allclose(ours.jacobian_array, theirs.jacobian_array, rtol=1e-12, atol=1e-12)
    assert ours.wheel_names == theirs.wheel_names
    assert (ours.roller_radius, ours.wheel_mass) == (theirs.roller_radius, theirs.wheel_mass)
    save_model(again, tmp_path / "twice.yaml")
    assert (tmp_path / "twice.yaml").read_bytes() == path.read_bytes()


def parameters(**changes):
    """The good file with other values; None leaves one out."""
    values = dict(pair.split(": ") for pair in PARAMETERS.strip("{}").split(", ")) | changes
    kept = ", ".join(f"{name}: {value}" for name, value in values.items() if value is not None)
    return f"platform: youbot\nparameters: {{{kept}}}\n"


def platform(text):
    return GOOD.replace("platform: youbot", f"platform: {text}")


WHEELS = "[{x: 1, y: 1, roller_angle_deg: 45}, {x: 1, y: -1}]"
MALFORMED = {
    "empty": ("", "expected sections .*found NoneType"),
    "a list": ("- 1\n- 2\n", "expected sections .*found list"),
    "a sentence": ("m0 is 30 kg", "expected sections .*found str"),
    "broken YAML": ("platform: [youbot\n", r"not valid YAML.*line 2"),
    "tabs": ("platform: youbot\n\tparameters: 3", "not valid YAML.*line 2"),
    "binary": (bytes(range(256)), "not valid YAML"),
    "zeros": (b"\0" * 100, "not valid YAML"),
    "two documents": (GOOD + "---\n" + GOOD, "not valid YAML.*single document"),
    "code": ("!!python/object/apply:os.getcwd []", "not valid YAML.*constructor"),
    "key twice": (parameters(m0="30, m0: 31"), "'m0' stands twice; remove one.*line 2"),
    "section unknown": (GOOD + "efects: []\n", r"\['efects'\] among the sections; known.*effects"),
    "no platform": (f"parameters: {PARAMETERS}", "section 'platform' is missing"),
    "no parameters": ("platform: youbot", "section 'parameters' is missing"),
    "parameters are a list": ("platform: youbot\nparameters: [1]", "expected 'name: value'.*1"),
    "parameter missing": (parameters(I1=None), r"missing \['I1'\].*exactly the parameters"),
    "parameter unknown": (parameters(m1="1.4"), r"unknown \['m1'\].*exactly the parameters"),
    "text for a number": (parameters(m0="heavy"), "m0 = 'heavy' is not a number"),
    "decimal comma": (parameters(mu1="'0,1'"), "mu1 = '0,1' is not a number"),
    "truth for a number": (parameters(m0="yes"), "m0 = True is not a number"),
    "nothing for a number": (parameters(m0="null"), "m0 = None is not a number"),
    "not a number": (parameters(I0=".nan"), "I0 = nan is not finite"),
    "infinite": (parameters(I0=".inf"), "I0 = inf is not finite"),
    "wrong unit": (parameters(m0="{value: 30000, unit: g}"), "m0 has unit 'g'; convert it to 'kg'"),
    "no value": (parameters(m0="{unit: kg}"), "m0 has no value"),
    "entry unknown": (parameters(m0="{value: 30, sigma: 1}"), r"\['sigma'\] in m0; known.*stand"),
    "standard error": (parameters(m0="{value: 30, standard_error: small}"), "of m0: 'small' is no"),
    "effect unknown": (
        GOOD + "effects: [gravity_waves]", "unknown effect 'gravity_waves'; .*known effects"
    ),
    "effect misspelled": (
        GOOD + "effects: [wheel_colomb_friction]", "did you mean 'wheel_coulomb_friction'"
    ),
    "effect twice": (GOOD + "effects: [floor_slope, floor_slope]", "'floor_slope' is listed twice"),
    "effect out of bounds": (
        GOOD + "effects: [{identifier: floor_slope, parameters: {sx: 3}}]",
        r"floor_slope: sx = 3 rad is outside \[-0.2, 0.2\] rad",
    ),
    "effect not a number": (
        GOOD + "effects: [{identifier: floor_slope, parameters: {sx: .nan}}]", "sx = nan .*outside"
    ),
    "effect of text": (
        GOOD + "effects: [{identifier: floor_slope, parameters: {sx: steep}}]",
        "sx = 'steep' is not a number",
    ),
    "effect parameter unknown": (
        GOOD + "effects: [{identifier: floor_slope, parameters: {sz: 0.01}}]",
        r"no parameter \['sz'\]; it has \['sx', 'sy'\]",
    ),
    "effect of no wheel": (
        GOOD + "effects: [{identifier: torque_gain, parameters: {e_left: 0.1}}]",
        r"no parameter \['e_left'\]; it has .*'e_fl'",
    ),
    "effect parameters are a list": (
        GOOD + "effects: [{identifier: floor_slope, parameters: [0.1]}]", r"\[0.1\] must be"
    ),
    "effects are a mapping": (
        GOOD + "effects: {wheel_coulomb_friction: {fc: 0.3}}", "not a list; write one '- identifier"
    ),
    "effects are text": (GOOD + "effects: floor_slope", "'floor_slope' is not a list; write"),
    "effect without name": (GOOD + "effects: [{parameters: {fc: 0.3}}]", "has no identifier; give"),
    "effect is a number": (GOOD + "effects: [{identifier: 3}]", "3.* has no identifier; give"),
    "effect entry unknown": (
        GOOD + "effects: [{identifier: floor_slope, value: 0.1}]", r"\['value'\] in effects; known"
    ),
    "covariance of wrong size": (GOOD + "covariance: [[1]]", "7 rows of 7 numbers"),
    "covariance of text": (
        GOOD + f"covariance: {[['a'] * 7] * 7}", "covariance: 'a' is not a finite number"
    ),
    "provenance": (GOOD + "provenance: yesterday", "provenance: expected .*'yesterday'"),
    "platform unknown": (platform("kuka"), r"unknown platform 'kuka'; known: \['omni3', 'you"),
    "platform is a number": (platform("4"), "platform: expected .*found 4"),
    "platform without wheels": (platform("{wheel_radius: 1}"), "platform: wheels is missing"),
    "platform entry": (
        platform("{wheels: [], wheel_radius: 1, roller_radius: 0.1, colour: red}"),
        r"\['colour'\] in platform; known",
    ),
    "no wheel": (
        platform("{wheels: [], wheel_radius: 1, roller_radius: 0.1}"), "0 wheels; it needs 3"
    ),
    "wheels are a number": (
        platform("{wheels: 4, wheel_radius: 1, roller_radius: 0.1}"), "wheels = 4 is not a list"
    ),
    "wheel incomplete": (
        platform(f"{{wheels: {WHEELS}, wheel_radius: 1, roller_radius: 0.1}}"),
        "wheel 2 has no roller_angle_deg",
    ),
    "wheel of text": (
        platform("{wheels: [{x: far}], wheel_radius: 1, roller_radius: 0.1}"), "wheel 1.*'far'"
    ),
    "radius of text": (
        platform("{wheels: [], wheel_radius: big, roller_radius: 0.1}"), "platform: .*'big'"
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", MALFORMED)
def test_malformed_file_is_refused_by_place_value_and_remedy(load, case):
    text, message = MALFORMED[case]
    with pytest.raises(ModelFileError, match=f"(?s)robot.yaml.*{message}"):
        load(text)


IMPOSSIBLE = {
    "mass": ({"m0": "-3"}, "m0 = -3 kg must be positive"),
    "mass below the wheels": ({"m0": "5"}, r"m0 = 5 kg is not more than its 4 wheels \(5.6 kg\)"),
    "inertia": ({"I0": "0"}, r"I0 = 0 kg m\^2 must be positive"),
    "spin": ({"I1": "-1e-3"}, r"I1 = -0.001 kg m\^2 must be positive"),
    "friction": ({"mu1": "-0.1"}, "mu1 = -0.1 N m s must be positive"),
    "roller friction": ({"mu2": "-1e-3"}, "mu2 = -0.001 N m s must be positive"),
    "centre outside": ({"a_x": "0.4"}, r"\(0.4, 0\) m lies outside the wheels.*tip over"),
    "centre to the side": ({"a_y": "-0.16"}, r"\(0, -0.16\) m lies outside"),
    "inertia below the offset": (
        {"a_x": "0.2", "I0": "0.9"}, r"I0 = 0.9 kg m\^2 is below 0.976 kg m\^2"
    ),
}  # fmt: skip


@pytest.mark.parametrize("case", IMPOSSIBLE)
def test_impossible_robot_is_refused_by_value_and_remedy(load, case):
    changes, message = IMPOSSIBLE[case]
    with pytest.raises(ImpossibleParameters, match=f"robot.yaml.*{message}.*; correct"):
        load(parameters(**changes))


def test_all_impossible_values_are_told_at_once(load):
    with pytest.raises(ImpossibleParameters) as told:
        load(parameters(I1="-1", mu1="-2", a_y="3"))
    for part in ("I1 = -1", "mu1 = -2", "(0, 3) m"):
        assert part in str(told.value)


@pytest.mark.parametrize("name", ["nowhere.yaml", "models/nowhere", "", "."])
def test_missing_file_names_what_there_is(tmp_path, monkeypatch, name):
    monkeypatch.chdir(tmp_path)
    with pytest.raises(ModelFileError, match=r"no model file .*'nominal', 'paper'"):
        load_model(name)


def test_effects_are_added_and_replaced_in_copies():
    base = Model(youbot(), PAPER, name="base")
    one = base.with_effects({"actuator_lag": 0.03, "floor_slope": None}, name="one")
    two = one.with_effects({"actuator_lag": 0.05})
    assert (base.effects, one.name, two.name) == ((), "one", "one")
    assert [active.identifier for active in one.effects] == ["actuator_lag", "floor_slope"]
    assert {active.identifier: active.values for active in two.effects} == {
        "floor_slope": {"sx": 0.01, "sy": 0.01},
        "actuator_lag": {"T": 0.05},
    }
    with pytest.raises(ValueError, match="twice"):
        replace(two, effects=two.effects + two.effects)
    with pytest.raises(ValueError, match="did you mean 'actuator_lag'"):
        base.with_effects({"actuator_lags": 0.03})


def test_values_and_names_stand_in_the_same_order():
    model = Model(youbot(), PAPER).with_effects({"torque_gain": {"e_rl": 0.2}, "floor_slope": 0.02})
    named = dict(zip(model.names(), model.values(), strict=True))
    assert list(named)[:7] == ["m0", "I0", "I1", "max", "may", "mu1", "mu2"]
    assert named["max"] == pytest.approx((35.3 - 4 * 1.4) * 0.016)
    assert named["torque_gain.e_rl"] == 0.2
    assert named["floor_slope.sx"] == 0.02
    changed = model.with_values([2 * value for value in model.values()])
    assert changed.parameters.mu1 == 0.22
    np.testing.assert_allclose(changed.values(), 2 * np.array(model.values()), rtol=1e-14)
    assert changed.names() == model.names()
    assert model.with_values(model.values()).parameters.a_y == pytest.approx(PAPER.a_y)


def test_estimates_may_be_impossible_until_they_are_checked():
    model = Model(youbot(), PAPER)
    values = list(model.values())
    values[0] = -10.0
    estimate = model.with_values(values)
    assert math.isfinite(estimate.parameters.a_x)
    with pytest.raises(ImpossibleParameters, match="m0 = -10 kg must be positive"):
        estimate.check()
    assert model.check() is model
