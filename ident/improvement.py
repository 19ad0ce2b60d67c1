"""The loop: compare, diagnose, add, refit, until nothing is missing; what it did, step by step."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.special import stdtrit

from ident.diagnosis.parts import FIT
from ident.diagnosis.verdict import Diagnosis, diagnose
from ident.log import Log
from ident.observability import observe_regression
from ident.quantities import Quantity, annotated, quantities
from ident.regression import Regression, build_regression
from ident.seen import Seen
from youbot_env.model import Model

# Combinations that are known better than single inertias; the frictions stand for themselves.
LUMPS = ("x1+x3", "x2+x3")
# Verdicts whose additions the final model keeps.
KEPT = ("named", "ambiguous", "nothing_missing")
METHOD = "free run"


@dataclass(frozen=True)
class Stage:
    """A model on the way.

    Attributes:
        added: the effect that it has more than the one before; empty for the base.
        model: refined, with covariance.
        nrmse: free-run error on untouched windows, as a share of the motion's rms.
        axes: (3,) rms errors there, m/s, m/s, rad/s.
        covered: share of the way from the base's error to what the noise of the sensors leaves.
        base: the seven parameters and two lumps, by name.
        shifts: of each of them from the stage before, in standard errors of this stage; None where
            the logs do not determine it, and of the base.
    """

    added: str
    model: Model
    nrmse: float
    axes: np.ndarray
    covered: float
    base: dict[str, Quantity]
    shifts: dict[str, float | None]

    def as_dict(self) -> dict[str, Any]:
        """Return what JSON shows."""
        return {
            "added": self.added or None,
            "free_run": dict(zip(("vx", "vy", "yaw_rate"), self.axes.tolist(), strict=True))
            | {"nrmse": self.nrmse},
            "covered": self.covered,
            "base": {
                name: q.as_dict() | {"shift_in_se": self.shifts[name]}
                for name, q in self.base.items()
            },
        }


@dataclass(frozen=True)
class Improvement:
    """What the loop did.

    Attributes:
        found: the diagnosis that each addition rests on.
        stages: models from the base to the last; empty where the logs decide nothing.
        model: the final model, with sources, standard errors and covariance, ready for a file.
    """

    found: Diagnosis
    stages: tuple[Stage, ...]
    model: Model

    @property
    def problems(self) -> list[str]:
        """What makes the final parameters impossible; empty when nothing does."""
        return self.model.parameters.problems(self.model.platform)

    def as_dict(self) -> dict[str, Any]:
        """Return what ``improve.py --json`` writes."""
        return self.found.as_dict() | {"stages": [stage.as_dict() for stage in self.stages]}


def improve(
    logs: Log | list[Log],
    model: str | Model = "nominal",
    test: Log | None = None,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
    name: str = "improved",
) -> Improvement:
    """Add what is missing to a model until nothing is.

    Args:
        logs: records of one robot to fit.
        model: platform, known effects and start values.
        test: another record of the same robot; its last part is not looked at before the end.
        seed: of the bootstrap.
        progress: called with what is being done.
        name: of the final model.

    Returns:
        With the refitted base as final model where no addition can be relied on.

    Raises:
        ValueError: a log without drive input.
    """
    logs = [logs] if isinstance(logs, Log) else list(logs)
    found = diagnose(logs, model, test, seed, progress)
    if found.errors is None:
        return Improvement(found, (), found.model)
    windows = sum(int(part.windows(FIT).sum()) for part in found.first.parts)
    factor, errors = float(stdtrit(max(windows - 1, 1), 0.975)), found.errors
    way = max(errors.before - errors.floor, 1e-12)
    stages: list[Stage] = []
    chain = found.chain if found.verdict in KEPT else found.chain[:1]
    for number, (added, refined) in enumerate(chain):
        base = _base(logs, refined, factor)
        nrmse, covered = errors.nrmse[number], (errors.before - errors.nrmse[number]) / way
        shifts = _shifts(stages[-1].base if stages else None, base)
        stages.append(Stage(added, refined, nrmse, errors.axes[number], covered, base, shifts))
    last = stages[-1]
    parameters = {key: q for key, q in last.base.items() if key not in LUMPS}
    final = annotated(replace(last.model, name=name), parameters, METHOD, logs)
    return Improvement(found, tuple(stages), final)


def _base(logs: list[Log], model: Model, factor: float) -> dict[str, Quantity]:
    """Base parameters and lumps with half widths of ``factor`` standard errors."""
    regression = Regression.join([build_regression(log, model) for log in logs])
    values = dict(zip(model.names(), model.values(), strict=True))
    start = np.array([values[name] for name in regression.names])
    seen = Seen.of(observe_regression(regression, model), regression, start, model)
    parameters, lumps, _ = quantities(model, seen, factor, METHOD)
    return parameters | {name: lumps[name] for name in LUMPS}


def _shifts(
    before: dict[str, Quantity] | None, now: dict[str, Quantity]
) -> dict[str, float | None]:
    known = before is not None
    return {
        name: (q.value - before[name].value) / q.se if known and q.se else None
        for name, q in now.items()
    }
