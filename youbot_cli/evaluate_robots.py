"""Robots of a comparison with what their owners know: each records a log and identifies it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from controllers.evaluation.subjects import IDENTIFIED, INFORMED, NOMINAL, Subject
from ident.identification import Identification, identify
from ident.log import Log
from youbot_env.channels import channel_columns
from youbot_env.model import Model
from youbot_env.model_file import model_from_dict, model_to_dict
from youbot_env.platform import Platform
from youbot_env.recording import record_motion
from youbot_env.references import calibration_sequence
from youbot_env.simulation import AnalyticPlant, Sensors

SPEED, FREQUENCY, DT = 0.35, 1.0, 0.01
LOOP_RATE = 1000.0  # Hz, as on a robot; the log shows every tenth step


def record(subject: Subject, seconds: float, platform: Platform) -> Log:
    """Drive calibration motions I, III, II, IV under the wheel loops, with noisy sensors."""
    motion = calibration_sequence(seconds=seconds, speed=SPEED, frequency=FREQUENCY)
    if subject.plant == "rollers":
        from youbot_env.rollers import RollersPlant as Plant
    else:
        Plant = AnalyticPlant
    seed = int(np.random.SeedSequence(subject.seed).spawn(1)[0].generate_state(1)[0])
    columns = record_motion(
        Plant(subject.truth, DT), motion, seconds, None, Sensors(), seed, loop_rate=LOOP_RATE
    )
    names = channel_columns(subject.truth.platform)
    channels = {
        channel: np.column_stack([columns[name] for name in names[channel]])
        for channel in ("wheel_velocity", "wheel_torque", "pose", "reference")
    }
    return Log(f"calibration of robot {subject.number}", platform, columns["time"], **channels)


def calibrated(subject: Subject, seconds: float, nominal: Model) -> Subject:
    """The subject with its models: nominal, and two identified from one log.

    The identifiers get the log and the nominal model.  ``identified`` has the seven parameters of
    the equations; ``identified + effects`` is told which effects to look for, as after a diagnosis
    that named them, and finds their sizes.  Where rollers are real, ``roller_ripple`` is one of
    them: every such robot has it, and diagnosis asks for it before anything else.
    """
    log, nominal = record(subject, seconds, nominal.platform), replace(nominal, name=NOMINAL)
    effects = tuple(active.identifier for active in subject.truth.effects)
    effects += ("roller_ripple",) if subject.plant == "rollers" else ()
    plain = identify(log, nominal, name=IDENTIFIED)
    informed = identify(log, nominal, add=effects, name=INFORMED)
    beliefs = {NOMINAL: nominal, IDENTIFIED: plain.model, INFORMED: informed.model}
    return replace(subject, beliefs=beliefs, half_widths=half_widths(informed))


def pack(subject: Subject) -> dict:
    """What ``calibrated`` has found, in types that JSON has."""
    beliefs = {
        name: model_to_dict(replace(model, covariance=None, provenance={}))
        for name, model in subject.beliefs.items()
    }
    return {"beliefs": beliefs, "half_widths": subject.half_widths}


def unpack(subject: Subject, kept: dict) -> Subject:
    """The subject with what ``pack`` says: values of models, without their intervals."""
    beliefs = {name: model_from_dict(entry) for name, entry in kept["beliefs"].items()}
    return replace(subject, beliefs=beliefs, half_widths=kept["half_widths"])


def half_widths(found: Identification) -> dict[str, float]:
    """Half widths of the 95 % intervals, by name; what the log left open is missing."""
    named = dict(found.parameters)
    for identifier, values in found.effects.items():
        named |= {f"{identifier}.{name}": quantity for name, quantity in values.items()}
    return {
        name: (quantity.ci95[1] - quantity.ci95[0]) / 2
        for name, quantity in named.items()
        if quantity.ci95
    }
