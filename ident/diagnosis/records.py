"""How the logs of a diagnosis were recorded: found before, freed at the end, then told.

Besides what another record has of its own: a floor that slopes there and not where the robot was
fitted.

A record with something of its own would otherwise count against every effect that the fitted one
shows.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ident.decimate import DENSE, decimated
from ident.diagnosis.refit import Refits
from ident.diagnosis.score_table import ScoreTable
from ident.diagnosis.settings import SETTINGS
from ident.diagnosis.splits import FIT, SELECT, Part, choosing_until, divide
from ident.diagnosis.trials import trials
from ident.disagreement import disagreements, may_disagree
from ident.doctor.finding import Finding
from ident.drive_clock import lead
from ident.instruments import HOLD, OFFSET, SHIFT, stated
from ident.log import Log
from ident.recording import Recording, find_recordings, with_free_clocks
from ident.recording_words import CLOSE, SURE, Instrument, clock, plain
from ident.restored import restored
from ident.sensitivity import Linearised
from youbot_env.effects import get_effect
from youbot_env.measurement import HELD, HOLDS
from youbot_env.model import Model


def recordings(logs: list[Log], tests: list[Log], model: Model) -> list[Recording]:
    """What every log needs of the measurement model, of those for choosing from their first part.

    What makes the robot answer late is left to be found by the search.
    """
    first = [test.part(test.time[0], choosing_until(test)) for test in tests]
    found = find_recordings([*logs, *first], model, signed=False)
    last = [
        replace(one, log=replace(test, recording=one.log.recording))
        for one, test in zip(found[len(logs) :], tests, strict=True)
    ]
    return [*found[: len(logs)], *last]


def of_other_robots(
    logs: list[Log], tests: list[Log], records: list[Recording], model: Model
) -> dict[str, Finding]:
    """Logs to judge by that are not of the robot of the others, by name, with what differs.

    Args:
        logs, tests: as they were read.
        records: what was found of their recording together, where a load may have become a part of
            a clock; clocks are found again, without each other, where that might be so.
        model: with what is known of the robot.
    """
    if not tests:
        return {}
    known = [record.log for record in records]
    known = known[: len(logs)], known[len(logs) :]
    if not (_apart(records) or may_disagree(*known, model)):
        return {}
    alone = ([record.log for record in find_recordings(some, model)] for some in (logs, tests))
    return disagreements(*alone, model)


def _apart(records: list[Recording]) -> bool:
    """Whether rows of some logs certainly act at other times than those of others."""
    first, *others = records
    return any(
        abs(one.lead - first.lead) > max(CLOSE, SURE * float(np.hypot(one.error, first.error)))
        for one in others
    )


def ready(record: Recording, model: Model, interval: float) -> Log:
    """A log for a fit: its instruments undone, and decimated to an interval, s, where it is denser.

    It states its clock, which a fit may then move, and that the rest is known.
    """
    log = decimated(restored(record.log, model), interval)
    undone = {
        name: {parameter.name: 0.0 for parameter in get_effect(name).parameters}
        for name in record.log.recording
    }
    return replace(log, recording=undone | {HOLD: {"kind": float(HOLDS.index(HELD))}})


def freed(
    fits: Refits, records: list[Recording], base: Model, tested: int, prior: Model
) -> tuple[Refits, Model]:
    """Fits to all rows, in which the clocks of the fitted logs move with the robot.

    Args:
        fits: those of the search.
        records: the logs.
        base: the model that the search began with.
        tested: how many logs, the last ones, are for choosing.
        prior: what was known before any log; where the drive is a voltage that is nothing, as
            parameters have another unit then.

    Returns:
        The fits, and the base for them.
    """
    whole = [replace(record, log=ready(record, base, DENSE)) for record in records]
    logs, model, ends = with_free_clocks(whole, base)
    parts = divide(logs[: len(logs) - tested], logs[len(logs) - tested :], base)
    chosen = []
    for part, coarse, record, end in zip(parts, fits.parts, whole, ends, strict=True):
        fitted = part.windows(FIT).any()
        log = part.log if fitted else record.log
        chosen.append(replace(part, log=log, weights=coarse.weights, ends=end if fitted else {}))
    known = all(record.log.drive == "torque" for record in records)
    return Refits(chosen, prior if known else None), model


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
        moved, error = lead(refined, number)
        found += clock(record.original, record.lead + moved, error)
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


def with_differences(parts: list[Part], simulations: tuple[Linearised, ...]) -> Model:
    """The base model with what lasts through another record and is absent from the fitted ones.

    An effect counts that belongs to a record, removes much of the error of the other one in windows
    to which it was not fitted, and none of the fitted ones.  Each record then has its own size.
    """
    model = simulations[0].model
    found = [
        trial
        for trial in trials(model, [part.log for part in parts])
        if trial.effect.scope() == "record"
        and not trial.effect.needs_time
        and trial.effect.link != "sensor"
    ]
    if not found or not any(part.windows(SELECT).any() for part in parts):
        return model
    table = ScoreTable.of(parts, list(simulations), found, [])
    best, share = None, SETTINGS.different_record
    for number, trial in enumerate(found):
        gains = table.gains_by_record(number)
        if (
            len(gains) > 1
            and gains[0] > SETTINGS.least_gain
            and gains[1] > SETTINGS.different_record
        ):
            return model  # all records have that, and it may look like something else in one
        absent = table.explained(number) < SETTINGS.least_gain
        possible = trial.possible(table.coefficients(number), SETTINGS.bound_slack)
        if len(gains) > 1 and absent and gains[1] > share and possible:
            best, share = trial, gains[1]
    if best is None:
        return model
    return model.with_effects({best.identifier: dict.fromkeys(best.names, 0.0)})
