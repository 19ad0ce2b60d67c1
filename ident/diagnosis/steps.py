"""Effects added one after the other: their sizes, their groups, and the way from base to last."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtrit

from ident.diagnosis.parts import FIT, SELECT
from ident.diagnosis.rivals import Candidate, Refits, window_losses
from ident.diagnosis.shortlist import LEAST_GAIN
from ident.results import Quantity
from youbot_env.effects import get_effect
from youbot_env.model import Model


@dataclass(frozen=True, eq=False)
class Step:
    """One effect added on the way.

    Attributes:
        best: what was added.
        p: adjusted p value.
        background: whether every robot has some of it.
        rivals: the others of the group, refined.
    """

    best: Candidate
    p: float
    background: bool
    rivals: tuple[Candidate, ...] = ()

    @property
    def group(self) -> tuple[str, ...]:
        """Identifiers that fit as well, best first."""
        return tuple(c.identifier for c in (self.best, *self.rivals))

    @property
    def recording(self) -> bool:
        """Whether it is the recording's, not the robot's."""
        return get_effect(self.best.identifier).link == "sensor"

    @property
    def beside(self) -> set[str]:
        """Effects that were in the model when this one was chosen."""
        return {a.identifier for a in self.best.model.effects} - {self.best.identifier}

    def sizes(self, model: Model) -> dict[str, Quantity]:
        """Sizes with 95 % intervals in a model that was refined with the effect."""
        return sizes(model, self.best.identifier, self.best.refined.windows)


def sizes(model: Model, identifier: str, windows: int) -> dict[str, Quantity]:
    """Parameters of one effect of a refined model, with 95 % intervals where they were fitted."""
    factor = float(stdtrit(max(windows - 1, 1), 0.975))
    covariance = np.array(model.covariance)
    effect, found = get_effect(identifier), {}
    pairs = zip(model.names(), model.values(), strict=True)
    for k, (name, value) in enumerate(pairs):
        if not name.startswith(f"{identifier}."):
            continue
        flat, error = name.split(".")[1], float(np.sqrt(max(covariance[k, k], 0.0)))
        known = error > 0
        interval = (value - factor * error, value + factor * error) if known else None
        unit = effect.parameter_of(flat).unit
        found[flat] = Quantity(value, unit, error if known else None, interval, "diagnosis")
    return found


def with_steps(base: Model, steps: list[Step]) -> Model:
    """The base model with the effects of all steps, at the sizes found last."""
    if not steps:
        return base
    wanted = {active.identifier: active.values for active in base.effects}
    for step in steps:
        for active in step.best.model.effects:
            wanted[active.identifier] = active.values
    known = {a.identifier for a in base.effects} | {s.best.identifier for s in steps}
    kept = {name: values for name, values in wanted.items() if name in known}
    latest = replace(steps[-1].best.model, covariance=None, effects=())
    return latest.with_effects(kept)


def without_idle(fits: Refits, base: Model, steps: list[Step]) -> list[Step]:
    """Leave out effects that later ones have made superfluous."""
    if len(steps) < 2:
        return steps
    role = np.concatenate([part.role for part in fits.parts])
    deciding = role == SELECT if np.any(role == SELECT) else role == FIT

    def loss(model: Model) -> float:
        return float(window_losses(fits.parts, fits.of(model)[1])[deciding].mean())

    kept = list(steps)
    for step in steps[:-1]:
        full = with_steps(base, kept)
        idle = loss(without(full, step.best.identifier)) < loss(full) / (1.0 - 0.5 * LEAST_GAIN)
        if idle:
            kept = [other for other in kept if other is not step]
    return kept


def chain_of(fits: Refits, base: Model, steps: list[Step]) -> list[tuple[str, Model]]:
    """Names and models from the base to the final one, one effect more each time."""
    chain = [("", fits.with_intervals(base))]
    for count in range(1, len(steps) + 1):
        model = with_steps(base, steps)
        for later in steps[count:]:
            model = without(model, later.best.identifier)
        chain.append((steps[count - 1].best.identifier, fits.with_intervals(model)))
    return chain


def without(model: Model, identifier: str) -> Model:
    """The model less one effect."""
    return replace(model, effects=tuple(a for a in model.effects if a.identifier != identifier))
