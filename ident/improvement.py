"""The loop: compare, diagnose, add, refit, until nothing is missing; what it did, step by step."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.special import stdtrit

from ident.diagnosis.diagnose import Diagnosis, diagnose
from ident.diagnosis.splits import FIT, Part
from ident.identifiability import SMALL, Seen, parameter_sizes
from ident.log import Log
from ident.parameter_space import free_directions
from ident.pooling import as_list
from ident.prior import prior_spreads
from ident.residuals import settled
from ident.results import Quantity, Shown, annotated, quantities
from ident.sensitivity import Linearised
from ident.threads import one_thread
from youbot_env.dynamics import Theta
from youbot_env.model import Model
from youbot_env.model_file import load_model

# Combinations that are known better than single inertias; the frictions stand for themselves.
LUMPS = ("x1+x3", "x2+x3")
# Verdicts whose additions the final model keeps.
KEPT = ("named", "ambiguous", "nothing_missing")
METHOD = "free run"
# Directions of weaker trace than this share of the strongest, in equally long columns, were not
# fitted: the covariance of a refinement leaves them out.
BLIND = 1e-5
ROUNDING = 1e-6
# Variance of a direction, in those before any log, from which on the logs have not determined it.
NO_BETTER = 0.5


@dataclass(frozen=True)
class Stage:
    """A model on the way.

    Attributes:
        added: the effect that it has more than the one before; empty for the base.
        model: refined, with covariance.
        nrmse: free-run error on held-out windows, as a share of the motion's rms.
        axes: (3,) rms errors there, m/s, m/s, rad/s.
        covered: share of the way from the base's error to what noise leaves.
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


@dataclass(frozen=True, repr=False)
class Improvement(Shown):
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

    def headline(self) -> str:
        """See the base class."""
        if not self.stages:
            return self.found.headline()
        first, last = self.stages[0].nrmse, self.stages[-1].nrmse
        added = ", ".join(stage.added for stage in self.stages[1:]) or "nothing"
        return f"added {added}; free-run error {100 * first:.3g} % to {100 * last:.3g} %"

    def table(self) -> dict[str, list[Any]]:
        """The stages: what was added, the error, and the base parameters."""
        names = self.stages[0].base if self.stages else {}
        return {
            "added": [stage.added for stage in self.stages],
            "free-run error": [float(stage.nrmse) for stage in self.stages],
        } | {name: [float(stage.base[name].value) for stage in self.stages] for name in names}

    def plot(self):
        """The error on held-out windows with every effect that was added."""
        return self.found.plot()

    def as_dict(self) -> dict[str, Any]:
        """Return what ``improve.py --json`` writes."""
        return self.found.as_dict() | {"stages": [stage.as_dict() for stage in self.stages]}


@one_thread
def improve(
    logs: Log | Sequence[Log],
    model: str | Model = "nominal",
    test: Log | Sequence[Log] | None = None,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
    name: str = "improved",
) -> Improvement:
    """Add what is missing to a model until nothing is.

    Args:
        logs: records of one robot to fit.
        model: platform, known effects and start values.
        test: other records of the same robot; their last part is not looked at before the end.
        seed: of the bootstrap.
        progress: called with what is being done.
        name: of the final model.

    Returns:
        With the refitted base as final model where no addition can be relied on.

    Raises:
        ValueError: a log without drive input.
    """
    logs, start = as_list(logs), load_model(model)
    start = replace(start, platform=logs[0].platform)
    found = diagnose(logs, model, test, seed, progress)
    if found.errors is None:
        return Improvement(found, (), found.model)
    windows = sum(part.fitted for part in found.first.parts)
    factor, errors = float(stdtrit(max(windows - 1, 1), 0.975)), found.errors
    way = max(errors.before - errors.floor, 1e-12)
    stages: list[Stage] = []
    chain = found.chain if _kept(found) else found.chain[:1]
    for number, (added, refined) in enumerate(chain):
        base = base_quantities(found.first.parts, refined, factor, start)
        nrmse, covered = errors.nrmse[number], (errors.before - errors.nrmse[number]) / way
        moved = shifts(stages[-1].base if stages else None, base)
        stages.append(Stage(added, refined, nrmse, errors.axes[number], covered, base, moved))
    last = stages[-1]
    parameters = {key: q for key, q in last.base.items() if key not in LUMPS}
    final = annotated(replace(last.model, name=name), parameters, METHOD, logs)
    return Improvement(found, tuple(stages), final)


def _kept(found: Diagnosis) -> bool:
    """Tell whether the final model keeps what was added.

    So it does where something else is missing as well, if the error certainly falls: such a model
    foretells the robot better, whatever the right name of what it lacks.
    """
    e = found.errors
    certain = e is not None and e.drop_ci95[0] > 0.0 and e.after < e.before
    return found.verdict in KEPT or (found.verdict == "outside_library" and certain)


def base_quantities(
    parts: list[Part], model: Model, factor: float, prior: Model
) -> dict[str, Quantity]:
    """Base parameters and lumps with half widths of ``factor`` standard errors."""
    seen = _seen(parts, model)
    seen = replace(seen, null=np.concatenate([seen.null, _no_better(parts, model, prior)]))
    parameters, lumps, _ = quantities(model, seen, factor, METHOD)
    return parameters | {name: lumps[name] for name in LUMPS}


def _seen(parts: list[Part], model: Model) -> Seen:
    """What free runs over the fitted windows determine; the covariance has no word for the rest.

    Directions that leave no trace, and pairs that leave the same one, keep their start values.
    """
    directions, rows = free_directions(model, parts[0].free(model)), []
    moving = np.any(directions != 0, axis=1)
    for part in parts:
        fitted = part.windows(FIT)
        if fitted.any():
            sim = Linearised.of(part.log, model)
            columns = settled(sim, sim.value_columns(moving) * part.weights[:, None])[fitted]
            rows.append(np.nan_to_num(columns.reshape(-1, columns.shape[-1])))
    traces = np.concatenate(rows) @ directions[moving]
    length = np.linalg.norm(traces, axis=0)
    # Rounding of a trace that is not there would look like one when it is scaled.
    worth = np.abs(directions).T @ parameter_sizes(model.names(), model)
    present = length * worth > ROUNDING * np.sqrt(len(traces))
    traces, length = traces * present, np.where(present, length, 1.0)
    _, strength, right = np.linalg.svd(traces / length, full_matrices=False)
    turned = directions @ (np.where(np.abs(right) < ROUNDING, 0.0, right) / length).T
    known = strength > BLIND * strength[0]
    names, start = model.names(), np.array(model.values())
    fixed = np.eye(len(names))[[name in parts[0].fixed for name in names]]
    null = np.concatenate([turned[:, ~known].T, fixed])
    return Seen(names, start, np.ones(len(names)), turned[:, known], null)


def _no_better(parts: list[Part], model: Model, prior: Model) -> np.ndarray:
    """(k, P) directions of which the logs say no more than was known before them.

    Where the drive is a voltage nothing was known.
    """
    if any(part.log.drive == "voltage" for part in parts):
        return np.zeros((0, len(model.names())))
    names = tuple(Theta._fields)
    spread = prior_spreads(names, prior)
    covariance = np.array(model.covariance)[: len(names), : len(names)]
    strength, turn = np.linalg.eigh(covariance / np.outer(spread, spread))
    found = turn[:, strength > NO_BETTER].T
    found = np.where(np.abs(found) < SMALL, 0.0, found) * spread
    return np.pad(found, ((0, 0), (0, len(model.names()) - len(names))))


def shifts(before: dict[str, Quantity] | None, now: dict[str, Quantity]) -> dict[str, float | None]:
    """How far base parameters moved between stages, in standard errors of the later one."""
    return {
        name: (q.value - before[name].value) / q.se if before is not None and q.se else None
        for name, q in now.items()
    }
