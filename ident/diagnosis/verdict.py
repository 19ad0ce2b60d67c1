"""Which effect is missing: the verdict over all candidates, and when to stay silent.

A candidate counts only if it lowers both errors on a record it was not fitted to, that of the
equations and that of the free run, by more than robots with nothing hidden but real rollers feign.
Rivals that the record cannot tell from the best are named with it.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import stdtr

from ident.diagnosis.candidates import Candidate, Loss, fit_base, fit_candidates, measure_loss
from ident.log import Log
from ident.quantities import Quantity
from youbot_env.effects import get_effect
from youbot_env.model import Model

# Both errors must fall by this share.  Twelve robots with real rollers and nothing hidden reach at
# most 5 % in the smaller of the two drops.
LEAST_DROP = 0.06
MOST_EFFECTS = 3
# A rival with a chance above this to be as good as the best belongs to the group.
CHANCE = 0.05
# A simpler law may leave this much more error than a richer one with a parameter it does not need.
NEARLY = 0.03
# What a record must offer before anything is named.
LEAST_SECONDS, LEAST_SPEED, MOST_CLIPPED = 20.0, 0.03, 0.2


@dataclass(frozen=True)
class Step:
    """One effect added on the way.

    Attributes:
        best: the candidate that was added.
        group: identifiers that fit as well, best first.
        before: losses on the held-out record without it.
    """

    best: Candidate
    group: tuple[str, ...]
    before: Loss

    @property
    def drop(self) -> float:
        """Share by which the free-run error on the held-out record fell."""
        return 1.0 - self.best.loss.free_run / self.before.free_run


@dataclass(frozen=True)
class Diagnosis:
    """What is missing from a model.

    Attributes:
        log: name of the record.
        verdict: ``named``, ``ambiguous``, ``nothing_missing`` or ``cannot_say``.
        reason: why, in a sentence.
        steps: effects in the order added.
        model: the base with these effects.
        before, after: losses on the held-out record.
    """

    log: str
    verdict: str
    reason: str
    steps: tuple[Step, ...]
    model: Model
    before: Loss | None
    after: Loss | None

    def as_dict(self) -> dict[str, Any]:
        """Return what JSON shows."""
        return {
            "log": self.log,
            "verdict": self.verdict,
            "reason": self.reason,
            "named": [
                {
                    "effect": step.best.identifier,
                    "group": list(step.group),
                    "size": {k: q.as_dict() for k, q in sizes(step.best).items()},
                    "error_drop": step.drop,
                }
                for step in self.steps
            ],
            "free_run": {
                "before": self.before.free_run if self.before else None,
                "after": self.after.free_run if self.after else None,
            },
        }


def diagnose(
    log: Log,
    held_out: Log,
    model: Model,
    progress: Callable[[int], None] | None = None,
) -> Diagnosis:
    """Look for effects that are missing from a model.

    Args:
        log: record that everything is fitted to.
        held_out: record of the same robot that decides.
        model: platform, known effects and start values.
        progress: called with the number of effects tried in the present round.
    """
    weak = unfit(log) or unfit(held_out)
    if weak:
        return Diagnosis(log.name, "cannot_say", weak, (), model, None, None)
    base = fit_base(log, model)
    first = before = measure_loss(held_out, base)
    steps: list[Step] = []
    while len(steps) < MOST_EFFECTS:
        found = fit_candidates(log, held_out, base, before, progress)
        passing = [c for c in found if smaller_drop(c, before) > LEAST_DROP and plausible(c)]
        if not passing:
            break
        passing.sort(key=lambda candidate: candidate.loss.total)
        group = rivals(leaner(passing))
        best = simplest(group)
        steps.append(
            Step(best, tuple(c.identifier for c in sorted(group, key=_first(best))), before)
        )
        if len(group) > 1:
            break
        base, before = fit_base(log, best.model), best.loss
    after = steps[-1].best.loss if steps else first
    chosen = steps[-1].best.model if steps else base
    verdict, reason = judge(steps, first, after)
    return Diagnosis(log.name, verdict, reason, tuple(steps), chosen, first, after)


def judge(steps: list[Step], first: Loss, after: Loss) -> tuple[str, str]:
    """Return verdict and reason."""
    if not steps:
        return "nothing_missing", (
            f"no effect of the library lowers both errors by {100 * LEAST_DROP:.0f} %"
        )
    fall = f"free-run error {100 * first.free_run:.3g} % to {100 * after.free_run:.3g} %"
    if len(steps[-1].group) > 1:
        return "ambiguous", f"{', '.join(steps[-1].group)} explain the record alike; {fall}"
    return "named", f"{', '.join(step.best.identifier for step in steps)}; {fall}"


def smaller_drop(candidate: Candidate, before: Loss) -> float:
    """The smaller of the two shares by which the errors fell."""
    equation = 1.0 - candidate.loss.equation / before.equation
    return min(equation, 1.0 - candidate.loss.free_run / before.free_run)


def plausible(candidate: Candidate) -> bool:
    """Tell whether all sizes are physically possible and at least one is not zero by chance."""
    effect, sure = get_effect(candidate.identifier), not candidate.errors
    for name, size in candidate.sizes.items():
        low, high = effect.parameter_of(name).bounds
        error = candidate.errors.get(name, 0.0)
        if size + 2 * error < low or size - 2 * error > high:
            return False
        sure = sure or abs(size) > 3 * error > 0
    return sure


def leaner(passing: list[Candidate]) -> list[Candidate]:
    """Move a simpler relative to the front where the best has a parameter it does not need.

    A cable whose stiffness may be zero is a slope: the richer law fits a little better always.
    """
    best = passing[0]
    needless = [n for n, error in best.errors.items() if abs(best.sizes[n]) < 3 * error]
    for other in passing[1:] if needless else ():
        if (
            other.count < best.count
            and related(other, best)
            and other.loss.total < (1.0 + NEARLY) * best.loss.total
        ):
            return [other, *(c for c in passing if c is not other and c is not best)]
    return passing


def related(one: Candidate, other: Candidate) -> bool:
    """Tell whether the library lists either effect among those that look like the other."""
    return (
        one.identifier in get_effect(other.identifier).confusables
        or other.identifier in get_effect(one.identifier).confusables
    )


def rivals(passing: list[Candidate]) -> list[Candidate]:
    """The best, and those whose losses by stretch do not differ from its by more than chance."""
    best = passing[0]
    others = (c for c in passing[1:] if related(c, best) and as_good(c.loss, best.loss))
    return [best, *others]


def as_good(other: Loss, best: Loss) -> bool:
    """Tell by a paired test over stretches whether a loss exceeds the best by chance alone."""
    scale = best.stretches.mean(axis=1, keepdims=True)
    gap = ((other.stretches - best.stretches) / scale).mean(axis=0)
    spread = gap.std(ddof=1) / np.sqrt(len(gap))
    return bool(stdtr(len(gap) - 1, -gap.mean() / max(spread, 1e-12)) > CHANCE)


def simplest(group: list[Candidate]) -> Candidate:
    """Among equals, the one with fewest parameters; among those, the best."""
    return min(group, key=lambda c: (c.count, c.loss.total))


def sizes(candidate: Candidate) -> dict[str, Quantity]:
    """Sizes with intervals where the parameter enters linearly."""
    effect, found = get_effect(candidate.identifier), {}
    for name, value in candidate.sizes.items():
        error = candidate.errors.get(name)
        interval = None if error is None else (value - 2.02 * error, value + 2.02 * error)
        unit = effect.parameter_of(name).unit
        found[name] = Quantity(float(value), unit, error, interval, "diagnosis")
    return found


def unfit(log: Log) -> str:
    """Say why a record can decide nothing; empty when it can."""
    velocity, command = log.velocity(), log.command
    lever = log.platform.lever
    speed = float(np.sqrt(np.mean((velocity * (1.0, 1.0, lever)) ** 2) * 3))
    if log.duration < LEAST_SECONDS:
        return f"{log.name} lasts {log.duration:.3g} s; record at least {LEAST_SECONDS:g} s"
    if speed < LEAST_SPEED:
        return (
            f"{log.name} hardly moves ({speed:.3g} m/s rms); drive it along "
            "`record.py --motion calibration`"
        )
    limit = np.abs(command).max(axis=0)
    clipped = float(np.mean(np.abs(command) > 0.999 * limit))
    if clipped > MOST_CLIPPED:
        return (
            f"{100 * clipped:.0f} % of the torques of {log.name} are at their limit; drive slower"
        )
    return ""


def _first(best: Candidate):
    return lambda candidate: (candidate is not best, candidate.loss.total)
