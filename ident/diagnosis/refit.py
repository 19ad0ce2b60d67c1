"""Effects refined one by one on top of a model, and which of them the logs cannot tell apart."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.optimize import minimize_scalar

from ident.diagnosis.score_table import ScoreTable
from ident.diagnosis.settings import SETTINGS
from ident.diagnosis.splits import FIT, SELECT, VERIFY, Part
from ident.diagnosis.trials import brackets, profile
from ident.distributions import student_above
from ident.instruments import adapted, stated
from ident.output_error import OutputError, refine
from ident.parameter_space import smooth_names
from ident.residuals import scaled_error
from ident.scopes import parameter_scope
from ident.sensitivity import Linearised
from youbot_env.effects import get_effect
from youbot_env.model import Model


@dataclass(frozen=True, eq=False)
class Candidate:
    """One effect refined with the base parameters.

    Attributes:
        identifier: the effect.
        number: its trial.
        refined: the model with it.
        simulations: every log simulated with that model.
        loss: (W,) mean squared scaled error of each window.
        count: number of its parameters.
    """

    identifier: str
    number: int
    refined: OutputError
    simulations: tuple[Linearised, ...]
    loss: np.ndarray
    count: int

    @property
    def late(self) -> bool:
        """Whether the effect makes the robot answer late to its drive."""
        return get_effect(self.identifier).late

    @property
    def at_bound(self) -> bool:
        """Whether a value in which the law is not linear has run into its bound."""
        effect = get_effect(self.identifier)
        curved = [(effect.parameter_of(n), v) for n, v in self.values.items()]
        return any(
            not p.linear
            and min(v - p.bounds[0], p.bounds[1] - v) < SETTINGS.at_bound * abs(p.default)
            for p, v in curved
        )

    @property
    def model(self) -> Model:
        """The model with the effect."""
        return self.refined.model

    @property
    def values(self) -> dict[str, float]:
        """Values of the effect."""
        return next(a.values for a in self.model.effects if a.identifier == self.identifier)


def window_losses(parts: list[Part], simulations) -> np.ndarray:
    """(W,) mean squared scaled error of each window of all logs."""
    pairs = zip(parts, simulations, strict=True)
    return np.concatenate([np.mean(scaled_error(s, p.weights) ** 2, axis=(1, 2)) for p, s in pairs])


def refit(
    parts: list[Part],
    model: Model | list[Model],
    steps: int = SETTINGS.refine_steps,
    intervals: bool = False,
    tolerance: float = SETTINGS.refine_tolerance,
    prior: Model | None = None,
) -> tuple[OutputError, tuple]:
    """Refine a model on the windows for fitting; also simulate the other logs with it.

    Another log keeps the robot and gets its own record (floor, load, battery) from its first part.
    """
    fitted = [part for part in parts if part.windows(FIT).any()]
    keep = [part.windows(FIT) for part in fitted]
    weights = [part.weights for part in fitted]
    logs = [part.log for part in fitted]
    refined = refine(
        logs,
        model,
        fitted[0].free(model if isinstance(model, Model) else model[0]),
        iterations=steps,
        keep=keep,
        weights=weights,
        tolerance=tolerance,
        intervals=intervals,
        ends=[part.ends for part in fitted],
        prior=prior,
    )
    simulated = iter(refined.simulations)
    return refined, tuple(
        next(simulated)
        if part.windows(FIT).any()
        else Linearised.of(part.log, adopted(part, refined.model))
        for part in parts
    )


def adopted(part: Part, model: Model) -> Model:
    """A robot's model with what belongs to the record fitted to the windows for choosing.

    The robot's own values stay; so does everything where there are no such windows, or where they
    do not show that this record differs from the fitted one.
    """
    model, choosing = adapted(model, part.log), part.windows(SELECT)
    own = {
        name
        for name in model.names()
        if parameter_scope(model, name) == "record" and name not in stated(model, part.log)
    }
    if not own or not choosing.any():
        return model
    smooth = tuple(own.intersection(smooth_names(model)))
    placed = model
    for name in sorted(own.difference(smooth)):
        placed = _best_of_profile(part, placed, name)
    options = {"keep": [choosing], "weights": [part.weights], "intervals": False}
    fitted = refine(
        [part.log],
        placed,
        smooth,
        iterations=SETTINGS.refine_steps,
        tolerance=SETTINGS.refine_rough,
        **options,
    )
    before = refine([part.log], model, smooth, iterations=0, **options)
    return (
        fitted.model
        if fitted.cost[1] < (1.0 - SETTINGS.own_values_share) * before.cost[1]
        else model
    )


def _best_of_profile(part: Part, model: Model, name: str) -> Model:
    """The model with one value, in which no law has a derivative, where it fits a record best."""
    identifier, flat = name.split(".")
    active = next(a for a in model.effects if a.identifier == identifier)
    values = list(model.values())
    at = model.names().index(name)

    def moved(value: float) -> Model:
        return model.with_values([*values[:at], value, *values[at + 1 :]])

    def loss(value: float) -> float:
        error = scaled_error(Linearised.of(part.log, moved(value)), part.weights)
        return float(np.sum(error[part.windows(SELECT)] ** 2))

    best = min(profile(active.effect.parameter_of(flat), part.log), key=loss)
    low, high = brackets(replace(active, values={**active.values, flat: best}), part.log)[flat]
    options = {"maxiter": SETTINGS.looks, "xatol": SETTINGS.looks_close * (high - low)}
    return moved(float(minimize_scalar(loss, bounds=(low, high), options=options).x))


class Refits:
    """Models refined on the same logs; equal effects are refined once.

    Args:
        parts: the logs.
        prior: what is known before any log, to which directions that these hardly see are held
            where intervals are wanted.
    """

    def __init__(self, parts: list[Part], prior: Model | None = None):
        self.parts, self.prior = parts, prior
        self._known: dict[frozenset, tuple[OutputError, tuple]] = {}

    def of(self, model: Model) -> tuple[OutputError, tuple]:
        """As ``refit``; the values of ``model`` only matter where they are not refined."""
        key = self._key(model)
        if key not in self._known:
            self._known[key] = refit(self.parts, model, SETTINGS.refine_patient)
        return self._known[key]

    def models(self, model: Model) -> tuple[Model, ...]:
        """The refined model of every log."""
        return tuple(simulation.model for simulation in self.of(model)[1])

    def remember(self, found: Candidate) -> None:
        """Keep what was refined to compare a candidate."""
        self._known[self._key(found.refined.model)] = found.refined, found.simulations

    def with_intervals(self, model: Model) -> Model:
        """The refined model with its covariance."""
        refined, key = self.of(model)[0], self._key(model)
        if refined.covariance is None:
            self._known[key] = refit(
                self.parts,
                refined.model,
                SETTINGS.refine_patient,
                True,
                SETTINGS.refine_fine,
                self.prior,
            )
        return self._known[key][0].model

    def _key(self, model: Model) -> frozenset:
        return frozenset(
            (a.identifier, tuple(a.values), tuple(v for n, v in a.values.items()
             if not a.effect.parameter_of(n).smooth))
            for a in model.effects
        )  # fmt: skip


def _located(parts: list[Part], model: Model) -> Model | None:
    """The model with its last effect where it fits best in values without a derivative.

    They are searched between their neighbours in the profile, all other values held.
    """
    active, fitted = model.effects[-1], [part for part in parts if part.windows(FIT).any()]
    ends = brackets(active, fitted[0].log)

    def moved(name: str, value: float) -> Model:
        values = list(model.values())
        values[model.names().index(f"{active.identifier}.{name}")] = value
        return model.with_values(values)

    for name, (low, high) in ends.items():
        options = {"maxiter": SETTINGS.looks, "xatol": SETTINGS.looks_close * (high - low)}
        found = minimize_scalar(
            lambda value, name=name: _squared(fitted, moved(name, value)),
            bounds=(low, high),
            options=options,
        )
        model = moved(name, float(found.x))
    return model if ends else None


def _squared(parts: list[Part], model: Model) -> float:
    """Sum of squared scaled errors over the windows for fitting."""
    total = 0.0
    for part in parts:
        fitted = part.windows(FIT)
        if fitted.any():
            error = scaled_error(Linearised.of(part.log, model), part.weights)[fitted]
            total += float(np.sum(error**2))
    return total


def candidate(parts: list[Part], table: ScoreTable, number: int) -> Candidate | None:
    """Refine a trial; None where its sizes make no sense together."""
    trial = table.trials[number]
    with np.errstate(all="ignore"):
        # A linear step of everything may go too far where a robot is far from linear.
        sizes, present = table.coefficients(number), np.array(table.model.values())
        starts = [trial.start(sizes, v) for v in (table.base_values(number), present)]
        refined, simulations = refit(parts, starts, tolerance=SETTINGS.refine_rough)
        located = _located(parts, refined.model)
        if located is not None:
            refined, simulations = refit(parts, located, tolerance=SETTINGS.refine_rough)
    active = refined.model.effects[-1]
    if not active.effect.plausible(active.values):
        return None
    count = trial.mix.shape[1] + sum(not p.linear and p.smooth for p in active.effect.parameters)
    loss = window_losses(parts, simulations)
    return Candidate(trial.identifier, number, refined, simulations, loss, count)


def beside(parts: list[Part], first: Candidate, second: Candidate) -> Candidate:
    """The second effect refined together with the first, from where each was alone."""
    kept = {a.identifier: a.values for a in first.model.effects}
    both = first.model.with_effects({**kept, second.identifier: second.values})
    refined, simulations = refit(parts, both, SETTINGS.refine_few, tolerance=SETTINGS.refine_rough)
    loss = window_losses(parts, simulations)
    return replace(second, refined=refined, simulations=simulations, loss=loss)


def ranked(
    found: list[Candidate],
    loss: list[np.ndarray],
    role: np.ndarray,
    before: np.ndarray,
    group: np.ndarray,
) -> list[Candidate]:
    """The group that cannot be told apart, best first.

    The windows for choosing decide, which no candidate was fitted to; what they leave open the
    fitted ones may settle.  Parameters count as in Schwarz's criterion.

    Args:
        found: candidates.
        loss: (W,) mean squared scaled error of each window, of every candidate.
        role: (W,) roles of the windows.
        before: (W,) losses without any of them.
        group: (W,) number of what is independent, windows or whole runs, that each belongs to.
    """
    scale = np.ones(len(role))
    for kind in (FIT, SELECT):
        if np.any(role == kind):
            scale[role == kind] = before[role == kind].mean()

    losses, chosen = {id(c): one / scale for c, one in zip(found, loss, strict=True)}, found
    if np.any(role == SELECT):
        chosen = _alike(chosen, losses, role == SELECT, group)
    chosen = _alike(chosen, losses, role != VERIFY, group)
    # A law with a spare parameter that is not needed is the law without it; one that lies at its
    # bound may stand for something else about that.
    best = chosen[0].identifier
    if chosen[0].at_bound:
        special = get_effect(best).contains
        chosen = chosen + [c for c in found if c.identifier in special and c not in chosen]
    chosen = [c for c in chosen if best not in get_effect(c.identifier).contains]
    # Where the spare parameter is not certain the simplest law of the family comes first.
    simpler = get_effect(best).contains
    return sorted(chosen, key=lambda c: c.identifier not in simpler)


def _alike(
    found: list[Candidate], loss: dict[int, np.ndarray], windows: np.ndarray, group: np.ndarray
) -> list[Candidate]:
    """Those within chance of the best on some windows, best first.

    Losses are in units of the mean loss without any of them.
    """
    number = np.unique(group[windows], return_inverse=True)[1]
    size = np.bincount(number)
    losses = [np.bincount(number, loss[id(c)][windows]) / size for c in found]
    count = len(size)
    score = [
        SETTINGS.errors_each_window * count * np.log(one.mean())
        + c.count * np.log(SETTINGS.errors_each_window * count)
        for c, one in zip(found, losses, strict=True)
    ]
    order = np.argsort(score)
    best = losses[order[0]]
    kept = [found[order[0]]]
    for k in order[1:]:
        gap = losses[k] - best
        spread = gap.std(ddof=1) / np.sqrt(count)
        chance = student_above(gap.mean() / max(spread, 1e-15), count - 1)
        feigned = max(
            SETTINGS.late_feigned[0] * (1.0 - best.mean()), SETTINGS.late_feigned[1] * best.mean()
        )
        if chance > SETTINGS.rival_chance or (
            found[k].late and kept[0].late and gap.mean() < feigned
        ):
            kept.append(found[k])
    return kept


def without(model: Model, identifier: str) -> Model:
    """The model less one effect."""
    return replace(model, effects=tuple(a for a in model.effects if a.identifier != identifier))
