"""How the logs of a diagnosis were recorded: found before, freed at the end, then told."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ident.diagnosis.parts import CHOOSING, FIT
from ident.diagnosis.rivals import Refits
from ident.instruments import HOLD, OFFSET, SHIFT, stated
from ident.log import Log
from ident.recording import (
    Instrument,
    Recording,
    clock,
    find_recordings,
    lead,
    plain,
    with_free_clocks,
)
from youbot_env.model import Model


def recordings(logs: list[Log], test: Log | None, model: Model) -> list[Recording]:
    """What every log needs of the measurement model, that for choosing from its first part.

    What makes the robot answer late is left to be found by the search.
    """
    if test is None:
        return find_recordings(logs, model, signed=False)
    first = test.part(test.time[0], test.time[0] + CHOOSING * test.duration)
    found = find_recordings([*logs, first], model, signed=False)
    last = found[-1]
    return [*found[:-1], replace(last, log=replace(test, recording=last.log.recording))]


def freed(fits: Refits, records: list[Recording], base: Model) -> tuple[Refits, Model]:
    """Fits in which the clocks of the fitted logs move with the robot, and the base for them."""
    logs, model, ends = with_free_clocks(
        [replace(record, log=part.log) for record, part in zip(records, fits.parts, strict=True)],
        base,
    )
    parts = [
        replace(part, log=log, ends=end) if part.windows(FIT).any() else part
        for part, log, end in zip(fits.parts, logs, ends, strict=True)
    ]
    return Refits(parts), model


def told(records: list[Recording], fits: Refits, model: Model) -> tuple[Instrument, ...]:
    """The recording of every log as the final model has it.

    Args:
        records: what was found at first.
        fits: with free clocks.
        model: the final one.
    """
    refined, found = fits.of(model)[0], []
    for number, record in enumerate(records):
        if number >= len(refined.models) or SHIFT in stated(model, fits.parts[number].log):
            found += record.instruments
            continue
        found += clock(record.original, *lead(refined, number))
        found += record.others
    return (*found, *_sensors(records[0].log, model))


def with_unknown_hold(model: Model, instruments: tuple[Instrument, ...], log: Log) -> Model:
    """The model with what an unknown hold does to a time by which the robot is late.

    Held instead of sampled rows, or means instead, make it half a row shorter or longer; that
    counts as two standard errors.
    """
    assumed = any(one.what == HOLD and one.status == "assumed" for one in instruments)
    if not assumed or model.covariance is None:
        return model
    covariance = np.array(model.covariance)
    for active in model.effects:
        if active.effect.late:
            at = model.names().index(f"{active.identifier}.{next(iter(active.values))}")
            covariance[at, at] += (0.25 * log.dt) ** 2
    return replace(model, covariance=covariance.tolist())


def _sensors(log: Log, model: Model) -> list[Instrument]:
    """Sensor effects that the search added."""
    names, covariance, found = model.names(), np.array(model.covariance), []
    for active in model.effects:
        known = active.identifier in (HOLD, OFFSET) or active.identifier in log.recording
        if active.effect.link != "sensor" or known:
            continue
        for name, value in active.values.items():
            at = names.index(f"{active.identifier}.{name}")
            found.append(plain(log, active.effect, name, value, float(covariance[at, at]) ** 0.5))
    return found
