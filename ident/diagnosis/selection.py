"""The search for what is missing: round by round, what passes and fits best is added."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from scipy.special import stdtrit

from ident.diagnosis.lack_of_fit import Dependence
from ident.diagnosis.refit import Candidate, Refits, candidate, window_losses, without
from ident.diagnosis.rounds import Round
from ident.diagnosis.settings import SETTINGS
from ident.diagnosis.splits import FIT, SELECT, Part
from ident.output_error import OutputError
from ident.results import Quantity
from ident.sensitivity import Linearised
from youbot_env.effects import get_effect
from youbot_env.model import Model


@dataclass
class Search:
    """One search and how far it has come.

    Attributes:
        fits: the logs, and what was refined on them.
        base: the model to which effects are added.
        generic: dependences that compete with the library.
        seeds: of the bootstraps.
        tell: called with what is being done.
        first, last: rounds on top of the base and on top of everything added.
        steps: effects added.
        outside: whether a dependence explains more than the library does.
    """

    fits: Refits
    base: OutputError
    generic: list[Dependence]
    seeds: list[int]
    tell: Callable[[str], None]
    first: Round
    last: Round
    steps: list[Step]
    outside: bool = False

    @property
    def parts(self) -> list[Part]:
        """The logs."""
        return self.fits.parts

    @property
    def real(self) -> list[Step]:
        """Effects added, but for what every robot has."""
        return [step for step in self.steps if step.real]

    def after(self, simulations: tuple[Linearised, ...], origin: float | None) -> Round:
        """A round on top of a simulated model."""
        seed = self.seeds[min(len(self.steps), len(self.seeds) - 1)]
        return Round.of(self.parts, simulations, self.generic, seed, origin, self.first.error)

    def add(self, group: list[Candidate], p: float, background: bool = False) -> None:
        """Add the best of a group."""
        self.tell(f"adding {group[0].identifier}")
        self.fits.remember(group[0])
        self.steps.append(Step(group[0], p, background, tuple(group[1:])))

    def add_background(self) -> None:
        """Explain what every robot has some of, if the logs show it and nothing does it yet.

        A larger effect may hide it, so it is asked for again after each.  From then on effects must
        remove a part of what it leaves.
        """
        if any(step.background for step in self.steps):
            return
        number = self.last.shortlist.background()
        found = None if number is None else candidate(self.parts, self.last.table, number)
        if found is not None and self.last.helps(found):
            self.add([found], float(self.last.p[number]), True)
            if not self.real:
                self.last = self.after(found.simulations, None)
                return
            alone = with_steps(self.base.model, [self.steps[-1]])
            losses = window_losses(self.parts, self.fits.of(alone)[1])
            origin = float(losses[self.last.table.role == FIT].mean())
            self.last = self.after(found.simulations, origin)

    def prune(self) -> bool:
        """Drop what came late has made superfluous; tell whether that made room."""
        needed = without_idle(self.fits, self.base.model, self.steps)
        if len(needed) == len(self.steps):
            return False
        self.steps = needed
        _, simulations = self.fits.of(with_steps(self.base.model, needed))
        self.last = self.after(simulations, self.last.origin)
        return True

    def add_one_of_two(self, group: list[Candidate]) -> list[Candidate]:
        """Add the half of a pair that shows only beside the other half.

        Each half is tested like every effect: the first with the other in the model, the other
        afterwards with the first.

        Args:
            group: the best single effects.

        Returns:
            What to add next: the other half, or ``group`` where no pair is better.
        """
        pair = self.last.pair(group)
        if pair is None:
            return group
        self.tell("trying two effects at once")
        given = candidate(self.parts, self.last.table, pair[0])
        if given is None:
            return group
        beside = self.after(given.simulations, self.last.origin)
        shown = beside.choose()
        if not shown:
            return group
        alone = without(shown[0].model, given.identifier)
        third = self.after(self.fits.of(alone)[1], self.last.origin)
        other = third.choose()
        if not other:
            return group
        self.add(shown, float(beside.p[shown[0].number]))
        self.last = third
        return other

    def _again(self, step: Step, rest: Model) -> Candidate:
        """The effect of a step refined once more, on top of all the others."""
        best, kept = step.best, {a.identifier: a.values for a in rest.effects}
        both = rest.with_effects({**kept, best.identifier: best.values})
        refined, simulations = self.fits.of(both)
        loss = window_losses(self.parts, simulations)
        return replace(best, refined=refined, simulations=simulations, loss=loss)

    def settle(self) -> None:
        """Choose every step again that was not chosen beside all the others."""
        before = [step.best.identifier for step in self.steps]
        for number, step in enumerate(self.steps):
            others = {other.best.identifier for other in self.steps if other is not step}
            if step.background or step.beside == others:
                continue
            self.tell(f"comparing rivals of {step.best.identifier} again")
            rest = without(with_steps(self.base.model, self.steps), step.best.identifier)
            now = self.after(self.fits.of(rest)[1], self.last.origin)
            group = now.choose(self._again(step, rest))
            kept = group[0].identifier == step.best.identifier
            p = step.p if kept else float(now.p[group[0].number])
            self.steps[number] = Step(group[0], p, False, tuple(group[1:]))
        if before != [step.best.identifier for step in self.steps]:
            _, simulations = self.fits.of(with_steps(self.base.model, self.steps))
            self.last = self.after(simulations, self.last.origin)


def search(
    parts: list[Part],
    base: OutputError,
    simulations: tuple[Linearised, ...],
    generic: list[Dependence],
    seed: int,
    tell: Callable[[str], None],
) -> Search:
    """Look for effects on top of a refined model.

    Args:
        parts: the logs.
        base: the model.
        simulations: the logs simulated with it.
        generic: dependences that compete with the library.
        seed: of the bootstraps.
        tell: called with what is being done.
    """
    sources = np.random.SeedSequence(seed).spawn(SETTINGS.most_effects + 2)
    seeds = [int(source.generate_state(1)[0]) for source in sources]
    tell("trying every effect")
    first = Round.of(parts, simulations, generic, seeds[0])
    at = Search(Refits(parts), base, generic, seeds, tell, first, first, [])
    at.add_background()
    for _ in range(SETTINGS.most_rounds):
        if len(at.real) == SETTINGS.most_effects and not at.prune():
            break
        tell("comparing rivals")
        group = at.last.choose()
        if not at.real:
            group = at.add_one_of_two(group)
        at.outside = not at.real and at.last.outside(group[0] if group else None)
        # Where the wheels agree the end shows better whether effects leave too much: two effects
        # may look like one that is not in the library.
        room = len(at.real) <= SETTINGS.most_effects - 2  # for two at once
        hoped = at.last.hoped() if room and not (group or at.outside) else []
        for found in hoped[:-1]:
            at.add([found], float(at.last.p[found.number]))
        group = group or hoped[-1:]
        if not group or (at.outside and not at.last.wheels_agree):
            break
        at.outside = False
        at.add(group, float(at.last.p[group[0].number]))
        at.last = at.after(group[0].simulations, at.last.origin)
        at.add_background()
    at.steps = without_idle(at.fits, base.model, at.steps)
    for _ in range(SETTINGS.passes):
        at.settle()
    return at


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
    def real(self) -> bool:
        """Whether it is an effect of the robot that not every robot has."""
        return not (self.background or self.recording)

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
        idle = loss(without(full, step.best.identifier)) < loss(full) / (
            1.0 - 0.5 * SETTINGS.least_gain
        )
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
