"""Diagnosis of floors, casters and gears: named with their sizes, refused where unknown."""

import numpy as np
import pytest
from long_cases import long
from shared_data import shared

from ident import diagnose
from ident.log import Log
from youbot_env.effects import left_out
from youbot_env.model_file import load_model
from youbot_env.references import SmoothRandom, calibration_sequence
from youbot_env.simulation import Sensors, record_closed_loop

PAPER, NOMINAL = load_model("paper"), load_model("nominal")
CASTER = {"caster_drag": {"fc": 8.0, "px": -0.25, "py": 0.05}}
RIBS = {"carpet": {"cx": 70.0, "cy": 0.0, "nx": 0.0}}
NAP = {"carpet": {"cx": 40.0, "cy": 40.0, "nx": 20.0, "ny": 20.0}}
PATCH = {"floor_patch": {"dmu": 0.12, "angle": 0.2, "dist": 0.1}}
RAMP = {"ramp": {"s": 0.02, "angle": 1.5, "dist": 0.1}}
BRISTLES = {"presliding_friction": {"fc": 0.15, "bend": 0.05}}
WORM = {"direction_dependent_friction": {"forward": 0.1, "backward": 0.2}}


def record(effects):
    """A calibration and a random motion of a robot with effects."""
    model, logs = PAPER.with_effects(effects), []
    motions = ((calibration_sequence(seconds=80.0), 80.0), (SmoothRandom(0.35, 1.5), 40.0))
    for seed, (motion, seconds) in enumerate(motions):
        times = np.arange(round(seconds * 100)) / 100
        channels = record_closed_loop(model, motion, times, Sensors(), seed=seed + 1)
        logs.append(Log(f"log{seed}", model.platform, **channels))
    return logs


@pytest.mark.parametrize(
    "effects", [long(CASTER), long(RIBS), NAP, long(PATCH), RAMP, long(WORM), long(BRISTLES)]
)
def test_floors_casters_and_gears_are_named_with_their_sizes(effects):
    fit, test = record(effects)
    found = diagnose(fit, NOMINAL, test)
    assert found.verdict == "named"
    (step,) = found.named
    ((identifier, values),) = effects.items()
    assert step.group == (identifier,)
    scale = max(abs(value) for value in values.values())
    sizes = step.sizes(found.model)
    for name, value in values.items():
        assert sizes[name].value == pytest.approx(value, rel=0.05, abs=0.03 * scale)
    assert found.errors.after < 1.5 * found.errors.floor


@pytest.mark.long
def test_two_orders_of_ripple_are_found_one_after_the_other():
    orders = {"torque_ripple": {"a": 0.2, "b": 0.0, "k": 5.0},
              "torque_ripple_second": {"a": 0.1, "b": 0.1, "k": 11.0}}  # fmt: skip
    fit, test = record(orders)
    found = diagnose(fit, NOMINAL, test)
    assert [step.best.identifier for step in found.named] == list(orders)
    told = sorted(step.best.values["k"] for step in found.named)
    assert told == pytest.approx([5.0, 11.0], abs=0.02)


@pytest.mark.parametrize(("effects", "unknown"), [(RIBS, "carpet"), long(PATCH, "floor_patch")])
def test_what_is_left_out_of_the_library_is_refused(effects, unknown):
    fit, test = record(effects)
    with left_out(unknown):
        found = diagnose(fit, NOMINAL, test)
    assert found.verdict in ("outside_library", "cannot_say")
    assert found.as_dict()["named"] == []


@pytest.mark.parametrize(
    ("special", "general"),
    [
        long({"body_dry_friction": 8.0}, "caster_drag"),
        ({"floor_slope": {"sx": 0.012, "sy": -0.008}}, "ramp"),
        long({"wheel_coulomb_friction": 0.12}, "direction_dependent_friction"),
        ({"torque_offset": {"b_fl": 0.1}}, "direction_dependent_friction"),
        long({"quadratic_drag": 80.0}, "carpet"),
    ],
)
def test_the_simpler_lookalike_is_not_named_as_the_general_one(special, general):
    fit, test = record(special)
    found = diagnose(fit, NOMINAL, test)
    assert found.verdict in ("named", "ambiguous")
    (step,) = found.named
    assert step.best.identifier in special
    assert general not in step.group


@pytest.mark.parametrize(
    ("name", "effect"),
    [("f11", "caster_drag"), long("f12", "carpet"), long("f18", "torque_ripple")],
)
def test_robots_of_another_simulator(name, effect):
    fit, test = (Log.load(shared("foreign-robot", f"{name}.{k}.parquet"))
                 for k in ("train", "test"))  # fmt: skip
    found = diagnose(fit, NOMINAL, test)
    assert found.verdict in ("named", "ambiguous")
    assert found.named[0].best.identifier == effect
