"""What a log states about its own recording, and what a fit may move of it.

Rows of a drive input act some time ahead of being held from their own time on: the lead.  Held rows
have none, sampled rows half a row, means over the time before a whole row; a late clock or a filter
adds to it.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ident.log import Log
from youbot_env.effects import get_effect
from youbot_env.measurement import AVERAGED, HELD, HOLDS, SAMPLED
from youbot_env.model import Model

HOLD, OFFSET, FILTER = "drive_hold", "drive_offset", "velocity_filter"
SHIFT = f"{OFFSET}.d"


def lead_of(hold: str, dt: float) -> float:
    """Time by which rows of a hold act ahead of held ones, s."""
    return {HELD: 0.0, SAMPLED: 0.5 * dt, AVERAGED: dt}[hold]


def hold_of(log: Log, model: Model) -> str:
    """What a row of the drive input stands for, by the log or else by the model."""
    kind = log.recording.get(HOLD, {}).get("kind")
    if kind is None:
        kind = next((a.values["kind"] for a in model.effects if a.identifier == HOLD), 0.0)
    return HOLDS[round(kind)]


def with_instruments(model: Model, logs: list[Log]) -> Model:
    """The model with the sensor effects that every log has, and those that one of them declares."""
    present = {active.identifier for active in model.effects}
    wanted = {name for log in logs for name in log.recording} | {HOLD, OFFSET}
    neutral = {
        name: {parameter.name: 0.0 for parameter in get_effect(name).parameters}
        for name in sorted(wanted - present)
    }
    return model.with_effects(neutral) if neutral else model


def without_instruments(model: Model) -> Model:
    """The robot alone: a model less its sensor effects, with the covariance of what is left."""
    kept = tuple(a for a in model.effects if a.effect.link != "sensor")
    names, robot = model.names(), replace(model, effects=kept, covariance=None)
    if model.covariance is None:
        return robot
    at = [names.index(name) for name in robot.names()]
    covariance = np.array(model.covariance)[np.ix_(at, at)]
    return replace(robot, covariance=covariance.tolist())


def without_late(model: Model) -> Model:
    """The model less what makes the robot answer late to its drive, as a clock could."""
    return replace(model, effects=tuple(a for a in model.effects if not a.effect.late))


def stating(log: Log, effect: str, **values: float) -> Log:
    """The log with values of a sensor effect stated."""
    return replace(log, recording={**log.recording, effect: values})


def stated(model: Model, log: Log) -> dict[str, float]:
    """Values of a model, by flat name, that are not to be estimated from a log.

    What the log states about its recording; and its clock where the model has an effect that
    makes the robot answer late, because one cannot be told from the other.
    """
    names = model.names()
    known = {f"{e}.{n}": v for e, values in log.recording.items() for n, v in values.items()}
    late = [a.identifier for a in model.effects if a.effect.late]
    if SHIFT in names and any(identifier not in log.recording for identifier in late):
        known = {SHIFT: 0.0} | known
    return {name: value for name, value in known.items() if name in names}


def adapted(model: Model, log: Log) -> Model:
    """The model with what is known of a log's recording in place of its own values."""
    names, values = model.names(), list(model.values())
    for name, value in stated(model, log).items():
        values[names.index(name)] = value
    return model.with_values(values)
