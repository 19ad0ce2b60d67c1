"""What of its own another record has: a floor that slopes there and not where the robot was fitted.

Such a record would otherwise count against every effect that the fitted one shows.
"""

from __future__ import annotations

from ident.diagnosis.evidence import Evidence
from ident.diagnosis.parts import SELECT, Part
from ident.diagnosis.shortlist import LEAST_GAIN, SLACK
from ident.diagnosis.trials import trials
from ident.sensitivity import Linearised
from youbot_env.model import Model

# Share of the squared error of another record, beside effects that the search has yet to find, that
# a slope of 0.7 degrees there removes where it was not fitted; a few windows allow no less.
DIFFERENT = 0.3


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
    evidence = Evidence.of(parts, list(simulations), found, [])
    best, share = None, DIFFERENT
    for number, trial in enumerate(found):
        gains = evidence.gains_by_record(number)
        if len(gains) > 1 and gains[0] > LEAST_GAIN and gains[1] > DIFFERENT:
            return model  # all records have that, and it may look like something else in one
        absent = evidence.explained(number) < LEAST_GAIN
        possible = trial.possible(evidence.coefficients(number), SLACK)
        if len(gains) > 1 and absent and gains[1] > share and possible:
            best, share = trial, gains[1]
    if best is None:
        return model
    return model.with_effects({best.identifier: dict.fromkeys(best.names, 0.0)})
