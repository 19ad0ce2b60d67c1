"""What models make of logs beside the one they are compared on: those that they were fitted to."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass

from ident.disagreement import disagreements
from ident.doctor.finding import Finding
from ident.free_run import WINDOW, free_run
from ident.instruments import without_instruments
from ident.log import Log
from ident.pooling import as_list, as_one
from ident.recording import find_recordings
from youbot_env.model import Model


@dataclass(frozen=True)
class Beside:
    """Models on fitted logs, beside logs that were kept out.

    Attributes:
        log: name of the fitted record.
        errors: free-run error there, as a share of the motion's rms, by name of the model.
        differs: logs that were kept out and are not of the same robot, by name.
    """

    log: str
    errors: dict[str, float]
    differs: dict[str, Finding]


def beside(
    fitted: Log | Sequence[Log],
    judging: Log,
    models: Iterable[Model],
    window: float = WINDOW,
) -> Beside:
    """Look at the logs that models were fitted to, beside the record that judges.

    Args:
        fitted: measured records with a drive input; several count as runs of one.
        judging: what the models were compared on; states what was found of its recording.
        models: any number of models on their platform.
        window: length of the free runs, s.

    Raises:
        ValueError: logs that are not of one kind, or too short.
    """
    models = [without_instruments(model) for model in models]
    most = max(models, key=lambda model: len(model.effects))
    late = any(active.effect.late for model in models for active in model.effects)
    (record,) = find_recordings([as_one(as_list(fitted))], most, signed=not late)
    errors = {model.name: free_run(record.log, model, window).nrmse for model in models}
    differs = disagreements([record.log], [judging], most)
    return Beside(record.log.name, errors, differs)
