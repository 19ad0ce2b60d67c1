"""What every effect of the library must do, also one that a user has added as a file."""

import math
from pathlib import Path

import numpy as np
import pytest

from youbot_env import stepping
from youbot_env.backend import FLOAT, NUMPY
from youbot_env.compiled import Stepper, advance_function
from youbot_env.effect_table import effect_table
from youbot_env.effects import HOOKS, LINKS, Effect, Signals, effect_names, get_effect
from youbot_env.model import Model
from youbot_env.parameters import Parameters
from youbot_env.plant import ModelStructure
from youbot_env.platform import omni3, youbot

PLATFORM = youbot()
PAPER = Parameters(m0=35.3, I0=4.4, I1=6e-3, a_x=0.016, a_y=-0.026, mu1=0.11, mu2=5.78e-3)
NAMES = effect_names()
# Those of the robot; effects of the recording are tested in test_sensor_effects.py.
LAWS = [name for name in NAMES if get_effect(name).link != "sensor"]
DT, SUBSTEPS = 0.01, 2
# A record under way: what drifts has drifted, and a payload changes during five seconds.
START = 58.0
DISSIPATIVE = (
    "wheel_coulomb_friction",
    "stribeck_friction",
    "wheel_friction_asymmetry",
    "load_dependent_friction",
    "roller_coulomb_friction",
    "rolling_resistance",
    "yaw_scrub_friction",
    "quadratic_drag",
    "body_dry_friction",
)


def model_with(name, values=None, platform=PLATFORM):
    return Model(platform, PAPER).with_effects({name: values})


def signals(rng, platform=PLATFORM, **fixed):
    """Signals at a random instant; ``fixed`` sets some of them."""
    n = len(platform.wheels)
    chosen = {
        "t": rng.uniform(0, 100),
        "v": tuple(rng.uniform(-1, 1, 3)),
        "pose": tuple(rng.uniform(-3, 3, 3)),
        "wheel_angle": tuple(rng.uniform(-50, 50, n)),
        "command": tuple(rng.uniform(-5, 5, n)),
    } | fixed
    return Signals(platform, platform.geometry, PAPER.theta(platform), **chosen)


def law(effect, values, s):
    """Everything the effect adds in the equations of motion, as one array."""
    p, added = effect.arrange(values, s.platform), []
    s.state = (0.3,) * effect.state_size(s.platform)
    if effect.acts("kinematics"):
        s.geometry = effect.kinematics(p, s.geometry, s, FLOAT)
        added += [entry for rows in s.geometry[:2] for row in rows for entry in row]
    if effect.acts("drive"):
        delivered = effect.drive(p, s.command, s, FLOAT)
        added += [m - c for m, c in zip(delivered, s.command, strict=True)]
    for hook in ("shaft", "roller", "body", "inertial", "slip"):
        if effect.acts(hook):
            added += getattr(effect, hook)(p, s, FLOAT)
    return np.array(added, float)


def history_for(structure, model):
    return math.ceil(structure.bind(model.values()).delay() / DT - 1e-9) + 1


@pytest.mark.parametrize("name", NAMES)
def test_what_an_effect_states_about_itself(name):
    effect = get_effect(name)
    assert effect.identifier == name
    assert all((effect.title, effect.equation, effect.regime, effect.experiments))
    assert "|" not in effect.equation, "a bar ends the cell of a Markdown table; write \\lvert"
    assert effect.link in LINKS
    assert any(effect.acts(hook) for hook in HOOKS)
    unknown = set(effect.confusables) - set(NAMES)
    assert not unknown, f"{name} names effects that do not exist: {unknown}"
    assert name not in effect.confusables
    for parameter in effect.parameters:
        low, high = parameter.bounds
        assert low <= parameter.default <= high
        assert parameter.meaning
        assert parameter.scope == ("record" if effect.link == "sensor" else parameter.scope)


@pytest.mark.parametrize("name", NAMES)
def test_only_declared_signals_are_read(name):
    effect = get_effect(name)
    values = effect.complete(None, PLATFORM)
    for flag, other in (
        (effect.needs_pose, {"pose": (1.0, -2.0, 0.7)}),
        (effect.needs_wheel_angle, {"wheel_angle": (0.3, -0.2, 0.1, 0.4)}),
        (effect.needs_time, {"t": 200.0}),
    ):
        drawn = [signals(np.random.default_rng(2), **extra) for extra in ({}, other)]
        same = np.array_equal(*(law(effect, values, s) for s in drawn))
        assert same is not flag, f"{name} against {sorted(other)}"


@pytest.mark.parametrize("platform", [PLATFORM, omni3()], ids=lambda platform: platform.name)
@pytest.mark.parametrize("name", NAMES)
def test_same_on_floats_batches_and_symbols(name, platform):
    model = model_with(name, platform=platform)
    structure = ModelStructure.of(model, track_wheels=True)
    history, count = history_for(structure, model), 5
    n = len(platform.wheels)
    rng = np.random.default_rng(3)
    size = len(structure.flatten(structure.rest()))
    flat, commands = rng.uniform(-1, 1, (size, count)), rng.uniform(-4, 4, (history, n, count))
    times, values = START + rng.uniform(0, 4, count), np.array(model.values())

    def run(values, state, torques, t, ops):
        after = stepping.advance(
            structure.bind(values), structure.unflatten(state), torques, DT, SUBSTEPS, t, ops
        )
        return structure.flatten(after)

    spread = np.repeat(values[:, None], count, axis=1)
    batch = np.array(run(tuple(spread), flat, [tuple(row) for row in commands], times, NUMPY))
    shared = np.array(run(values, flat, [tuple(row) for row in commands], times, NUMPY))
    np.testing.assert_allclose(shared, batch, rtol=1e-12, atol=1e-12)
    function = advance_function(structure, SUBSTEPS, history)
    for k in range(count):
        past = commands[:, :, k]
        single = run(values.tolist(), flat[:, k].tolist(), past.tolist(), float(times[k]), FLOAT)
        symbolic = np.array(function(flat[:, k], past.T, values, times[k], DT)).ravel()
        np.testing.assert_allclose(single, batch[:, k], rtol=1e-12, atol=1e-12)
        np.testing.assert_allclose(symbolic, batch[:, k], rtol=1e-12, atol=1e-12)


@pytest.mark.parametrize(
    "name", [n for n in LAWS if any(p.linear for p in get_effect(n).parameters)]
)
def test_linear_parameters_are_linear(name):
    effect, rng = get_effect(name), np.random.default_rng(4)
    kind = {split: p for p in effect.parameters for split in (
        [f"{p.name}_{w}" for w in PLATFORM.wheel_names] if p.per_wheel else [p.name])}  # fmt: skip
    seed = iter(range(100))

    def with_linear(draw):
        return {name: draw() if p.linear else p.default for name, p in kind.items()}

    for _ in range(10):
        at = next(seed)
        first, second = with_linear(rng.standard_normal), with_linear(rng.standard_normal)
        a, b = 3.0 * rng.standard_normal(2)
        mixed = {
            name: a * first[name] + b * second[name] if p.linear else p.default
            for name, p in kind.items()
        }
        one, two, both, none = (
            law(effect, values, signals(np.random.default_rng(at)))
            for values in (first, second, mixed, with_linear(lambda: 0.0))
        )
        scale = 1 + np.abs(one).max() + np.abs(two).max()
        np.testing.assert_allclose(both, a * one + b * two, rtol=0, atol=1e-11 * scale)
        np.testing.assert_allclose(none, 0.0, atol=1e-15)


@pytest.mark.parametrize("name", DISSIPATIVE)
def test_friction_takes_energy(name):
    effect, rng, taken = get_effect(name), np.random.default_rng(5), 0.0
    for _ in range(200):
        s = signals(rng)
        p = effect.arrange(effect.complete(None, PLATFORM), PLATFORM)
        power = 0.0
        for hook, rate in (
            ("shaft", s.wheel_velocity),
            ("roller", s.roller_velocity),
            ("body", s.v),
        ):
            if effect.acts(hook):
                power += np.dot(getattr(effect, hook)(p, s, FLOAT), rate)
        assert power <= 0.0
        taken += power
    assert taken < 0.0


@pytest.mark.parametrize("name", NAMES)
def test_wrong_values_are_refused(name):
    effect = get_effect(name)
    first = effect.parameters[0]
    low, high = first.bounds
    with pytest.raises(ValueError, match="no_such_parameter"):
        effect.complete({"no_such_parameter": 1.0}, PLATFORM)
    for value in (low - 1e-3, high + 1e-3, math.nan, math.inf):
        with pytest.raises(ValueError, match="outside"):
            effect.complete({first.name: value}, PLATFORM)
    for value in ("1", True):
        with pytest.raises(ValueError, match="not a number"):
            effect.complete({first.name: value}, PLATFORM)
    assert first.default in effect.complete(first.default, PLATFORM).values()


def drive_five_seconds(model):
    """States (500, 10) of a robot at rest that strong torques move on all axes."""
    structure = ModelStructure.of(model, track_wheels=True)
    stepper = Stepper(structure, DT, SUBSTEPS, history_for(structure, model))
    stepper.values[:] = model.values()
    stepper.state[:] = structure.flatten(structure.rest())
    forward, left, turn = np.array([1, 1, 1, 1]), np.array([-1, 1, 1, -1]), np.array([-1, 1, -1, 1])
    states = []
    for k in range(500):
        t = k * DT
        stepper.commands[1:] = stepper.commands[:-1].copy()
        stepper.commands[0] = (
            1.5 * math.sin(2.1 * t) * forward
            + (2.0 + 1.2 * math.sin(1.3 * t)) * left
            + 0.8 * math.sin(3.7 * t) * turn
        )
        states.append(stepper.step(START + t)[:10].copy())
    return np.array(states)


@pytest.fixture(scope="module")
def undisturbed():
    return drive_five_seconds(Model(PLATFORM, PAPER))


@pytest.mark.parametrize("name", LAWS)
def test_typical_size_is_felt_and_stays_finite(name, undisturbed):
    states = drive_five_seconds(model_with(name))
    assert np.isfinite(states).all()
    assert np.abs(states[:, 3:6]).max() < 5.0
    assert np.abs(states - undisturbed)[:, :6].max() > 2e-3  # m, rad, m/s, rad/s


def test_names_of_the_catalogue_are_all_there():
    expected = set(DISSIPATIVE) | {
        "floor_slope", "cable_tether", "torque_gain", "torque_offset", "torque_dead_zone",
        "torque_saturation", "actuator_delay", "actuator_lag", "battery_sag", "friction_warmup",
        "payload_change", "torque_ripple", "roller_ripple", "wheel_slip", "wheel_radius_error",
        "roller_angle_error", "base_geometry_error",
    }  # fmt: skip
    assert expected <= set(NAMES)
    assert all(isinstance(get_effect(name), Effect) for name in NAMES)


def test_documented_table_is_in_step_with_the_library():
    page = Path(__file__).parents[1] / "docs" / "effects.md"
    assert page.read_text(encoding="utf-8") == effect_table(), (
        "docs/effects.md is old; run: python -m youbot_env.effect_table > docs/effects.md"
    )
