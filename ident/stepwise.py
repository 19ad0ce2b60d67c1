"""The loop of ``improve`` one step at a time: what may be added next, and the model with it.

``improve`` decides by itself.  Here somebody looks at what may be added, chooses, and may go back;
models, errors and verdicts are those of a diagnosis.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace

import numpy as np
from scipy.special import stdtrit

from ident.diagnosis.diagnose import Ground, based, next_record
from ident.diagnosis.experiments import Experiment
from ident.diagnosis.forces import confirmations
from ident.diagnosis.holdout import FreeRunErrors, free_run_errors, held_out_error
from ident.diagnosis.minimum_detectable import MinimumDetectable, minimum_detectable
from ident.diagnosis.refit import Candidate, Refits, candidate, window_losses
from ident.diagnosis.rounds import Round
from ident.diagnosis.selection import Search, Step, sizes, with_steps
from ident.diagnosis.splits import FIT, VERIFY
from ident.diagnosis.verdict import decide
from ident.improvement import base_quantities, shifts
from ident.instruments import adapted, without_instruments
from ident.log import Log
from ident.results import Quantity
from ident.sensitivity import window_length
from ident.threads import one_thread
from youbot_env.model import Model

# Effects that are refined although they do not pass, so that people see how far they fall short.
ALSO_REFINED = 3


@dataclass(frozen=True, eq=False)
class Tried:
    """One effect on top of a stage.

    Attributes:
        effect: identifier.
        traced: size, interval, p value, power and smallest size that would show, before a refit.
        after: share of the squared free-run error that it removes from windows that it was not
            fitted to, once it is refined with all other parameters; None where it was not refined.
        passes: whether it may be added: significant, large enough, and not denied by the forces at
            the measured motion.
        background: whether every robot has some of it.
        rivals: others that fit as well, where it is among the best.
        refined: the model with it; None where it was not refined.
    """

    effect: str
    traced: MinimumDetectable
    after: float | None
    passes: bool
    background: bool
    rivals: tuple[str, ...]
    refined: Candidate | None

    @property
    def gain(self) -> float:
        """Share of the squared error removed: after a refit where there was one."""
        return self.traced.gain if self.after is None else self.after


@dataclass(frozen=True, eq=False)
class ChainStage:
    """A model on the way.

    Attributes:
        added: the effect that it has more than the one before; empty for the two first.
        name: ``start``, ``refit``, or ``+`` and the effect.
        models: of every log, with its own record.
        nrmse: free-run error on held-out windows, as a share of the motion's rms.
        axes: (3,) rms errors there, m/s, m/s, rad/s.
        base: the seven parameters and two identifiable combinations by name, from ``refit`` on.
        sizes: parameters of its effects by identifier and flat name.
        shifts: of the base from the stage before, in standard errors; None where unknown.
    """

    added: str
    name: str
    models: tuple[Model, ...]
    nrmse: float
    axes: np.ndarray
    base: dict[str, Quantity] = field(default_factory=dict)
    sizes: dict[str, dict[str, Quantity]] = field(default_factory=dict)
    shifts: dict[str, float | None] = field(default_factory=dict)

    @property
    def model(self) -> Model:
        """Of the first log, without what belongs to its recording."""
        return without_instruments(self.models[0])


class Stepwise:
    """A model that is improved step by step.

    Args:
        logs, model, test, seed, progress: as for ``ident.diagnose``.

    Attributes:
        parts: the logs with the roles of their windows.
        stages: models from the start to the last.
        ground: the logs as they were given, and how they were recorded.

    Raises:
        ValueError: the logs decide nothing (says why), or have no drive input.
    """

    @one_thread
    def __init__(
        self,
        logs: Log | Sequence[Log],
        model: str | Model = "nominal",
        test: Log | Sequence[Log] | None = None,
        seed: int = 0,
        progress: Callable[[str], None] | None = None,
    ):
        self.tell = progress or (lambda what: None)
        self.ground = Ground.of(logs, model, test, self.tell)
        if self.ground.weak:
            raise ValueError(self.ground.weak)
        start, seed_of = self.ground.model, np.random.SeedSequence(seed)
        self.parts, self.base, self._simulated, self._generic = based(
            self.ground.records, start, len(self.ground.tests), self.tell
        )
        self.fits = Refits(self.parts)
        self._seeds = [int(child.generate_state(1)[0]) for child in seed_of.spawn(16)]
        self._steps: list[Step] = []
        self._rounds: dict[tuple[str, ...], Round] = {}
        self._tried: dict[tuple[str, ...], list[Tried]] = {}
        self._all: dict[tuple[str, ...], FreeRunErrors] = {}
        self._known: set[tuple[str, ...]] = set()  # whose rivals were judged beside the others
        self.tell("measuring errors on held-out windows")
        self.stages = self._stages()

    @property
    def added(self) -> tuple[str, ...]:
        """Effects added so far, in that order."""
        return tuple(step.best.identifier for step in self._steps)

    @property
    def steps(self) -> tuple[Step, ...]:
        """What was added, each with the rivals that it cannot be told from."""
        return tuple(self._steps)

    @property
    def looked(self) -> bool:
        """Whether everything was tried on top of the last stage."""
        return self.added in self._tried

    @property
    def errors(self) -> FreeRunErrors:
        """Errors on held-out windows from the refit base on, and what noise and rolling leave."""
        if self.added not in self._all:
            chain = self._chain()
            simulation = self.fits.of(chain[-1][1])[1][-1]
            told = replace(simulation.model, covariance=chain[-1][1].covariance)
            simulation = replace(simulation, model=told)
            self._all[self.added] = free_run_errors(self.fits, chain, simulation)
        return self._all[self.added]

    @property
    def round(self) -> Round:
        """What the logs say on top of the last stage."""
        if self.added not in self._rounds:
            first, background = self._rounds.get(()), [s for s in self._steps if s.background]
            origin = None
            if background and len(background) < len(self._steps):
                origin = self._loss(with_steps(self.base.model, background))
            elif self._steps and not background:
                origin = first.error if first else None
            self._rounds[self.added] = Round.of(
                self.parts,
                self.fits.of(with_steps(self.base.model, self._steps))[1]
                if self._steps
                else self._simulated,
                self._generic,
                self._seeds[min(len(self._steps), len(self._seeds) - 1)],
                origin,
                first.error if first else None,
            )
        return self._rounds[self.added]

    @one_thread
    def tried(self) -> list[Tried]:
        """Every effect on top of the last stage, the best first; takes seconds once a stage."""
        if self.added not in self._tried:
            if self.added:
                self._first()
            self.tell("trying every effect")
            self._tried[self.added] = self._try(self.round)
        return self._tried[self.added]

    @property
    def best(self) -> Tried | None:
        """What to add next; None where nothing passes."""
        passing = [one for one in self.tried() if one.passes]
        return passing[0] if passing else None

    @one_thread
    def add(self, effect: str) -> ChainStage:
        """Add an effect and fit everything again.

        Raises:
            ValueError: it is in the model already, or cannot be fitted to these logs.
        """
        if effect in self.added:
            raise ValueError(f"{effect} is in the model already")
        known = next((one for one in self.tried() if one.effect == effect), None)
        if known is None:
            raise ValueError(f"{effect} cannot be tried on these logs")
        self.tell(f"adding {effect}")
        found = known.refined or candidate(self.parts, self.round.table, self._number(effect))
        if found is None:
            raise ValueError(f"{effect} fits these logs with no size that is possible")
        rivals = {c.effect: c.refined for c in self.tried() if c.effect in known.rivals}
        group = tuple(rival for rival in rivals.values() if rival is not None)
        self.fits.remember(found)
        self._steps.append(Step(found, known.traced.p, known.background, group))
        self.tell("measuring errors on held-out windows")
        self.stages = self._stages()
        return self.stages[-1]

    def back(self, stage: int) -> None:
        """Step back to a stage, 1 being the refit base."""
        self._steps = self._steps[: max(stage - 1, 0)]
        self.stages = self._stages()

    @one_thread
    def verdict(self) -> tuple[str, str, Experiment | None]:
        """What a diagnosis would say of the stages so far, why, and what to record next."""
        self._first()
        last, shares = self.round, {}
        if self._steps:
            shares = confirmations(self.fits, self._chain()[-1][1], self.added)
        best = self.best
        outside = best is None and last.outside(None)
        if best is not None:
            told = f"{best.effect} passes: add it, or look at its rivals first"
            return "more_to_add", told, None
        beside = self._settled(last)
        if beside:
            return "more_to_add", beside, None
        verdict, reason = decide(self._steps, self.errors, outside, self._first(), last, shares)
        self.tell("looking for a motion that separates rivals")
        return verdict, reason, next_record(verdict, self._steps, last)

    @property
    def judging(self) -> int:
        """Number of the log that has most held-out windows."""
        held = [int(part.windows(VERIFY).sum()) for part in self.parts]
        return held.index(max(held))

    def held_out(self, number: int) -> list[tuple[float, float]]:
        """Stretches of a log, s from its start, that nothing is fitted to or chosen by."""
        part = self.parts[number]
        length, spans = window_length(part.log), []
        for begin in part.begin[part.windows(VERIFY)] - part.log.time[0]:
            if spans and begin <= spans[-1][1] + 2 * part.log.dt:
                spans[-1][1] = begin + length
            else:
                spans.append([begin, begin + length])
        return [(float(begin), float(end)) for begin, end in spans]

    def _settled(self, last: Round) -> str:
        """Judge rivals of every effect again beside the others; says where another one fits better.

        What looked alike alone need not do so beside what was added later.
        """
        if self.added in self._known:
            return ""
        at = Search(self.fits, self.base, self._generic, self._seeds, self.tell, self._first(),
                    last, list(self._steps))  # fmt: skip
        at.settle()
        for old, new in zip(self._steps, at.steps, strict=True):
            if old.best.identifier != new.best.identifier:
                return (
                    f"beside the others {new.best.identifier} fits better than "
                    f"{old.best.identifier}: step back and add it instead"
                )
        self._steps = at.steps
        self._known.add(self.added)
        return ""

    def _first(self) -> Round:
        if () not in self._rounds:
            steps, self._steps = self._steps, []
            self._rounds[()] = self.round
            self._steps = steps
        return self._rounds[()]

    def _loss(self, model: Model) -> float:
        fitted = np.concatenate([part.role for part in self.parts]) == FIT
        return float(window_losses(self.parts, self.fits.of(model)[1])[fitted].mean())

    def _chain(self) -> list[tuple[str, Model]]:
        """Names and refined models from the base on, with covariances."""
        steps = self._steps
        models = [with_steps(self.base.model, steps[:k]) for k in range(len(steps) + 1)]
        return [
            (name, self.fits.with_intervals(model))
            for name, model in zip(("", *self.added), models, strict=True)
        ]

    def _stages(self) -> list[ChainStage]:
        chain, errors, start = self._chain(), self.errors, self.ground.model
        begin = tuple(self._started(part.log) for part in self.parts)
        nrmse, axes = held_out_error(self.parts, begin, chain[0][1])
        found = [ChainStage("", "start", begin, nrmse, axes)]
        windows = sum(part.fitted for part in self.parts)
        factor = float(stdtrit(max(windows - 1, 1), 0.975))
        for k, (added, model) in enumerate(chain):
            base = base_quantities(self.parts, model, factor, start)
            own = {
                active.identifier: sizes(model, active.identifier, windows)
                for active in without_instruments(model).effects
            }
            moved = shifts(found[-1].base or None, base)
            name = f"+ {added}" if added else "refit"
            found.append(
                ChainStage(added, name, self.fits.models(model), errors.nrmse[k], errors.axes[k],
                           base, own, moved)
            )  # fmt: skip
        return found

    def _started(self, log: Log) -> Model:
        """The model to start from on a log, with what that states of its recording."""
        return adapted(self.ground.model, log)

    def _number(self, effect: str) -> int:
        """The best form of an effect."""
        table, gains = self.round.table, self.round.gains
        mine = [k for k, trial in enumerate(table.trials) if trial.identifier == effect]
        return max(mine, key=lambda k: gains[k])

    def _try(self, now: Round) -> list[Tried]:
        traced = {one.effect: one for one in minimum_detectable(now)}
        worth = now.shortlist.worth_refining()
        numbers = {now.trial(k).identifier: k for k in worth[::-1]}
        background = now.shortlist.background()
        if background is not None:
            numbers.setdefault(now.trial(background).identifier, background)
        near = sorted(
            (one for one in traced.values() if one.effect not in numbers and one.gain > 0.0),
            key=lambda one: -one.gain,
        )
        numbers |= {one.effect: self._number(one.effect) for one in near[:ALSO_REFINED]}
        refined: dict[str, Candidate] = {}
        for effect, number in numbers.items():
            self.tell(f"refining {effect}")
            found = candidate(self.parts, now.table, number)
            if found is not None and np.isfinite(found.loss).all():
                refined[effect] = found
        passing = {
            effect
            for effect, found in refined.items()
            if (found.number in worth or found.number == background) and now.helps(found)
        }
        named = [refined[e] for e in passing if refined[e].number != background]
        group = [one.identifier for one in now.group(named)]
        tried = []
        for effect, one in traced.items():
            found = refined.get(effect)
            after = None if found is None else now.gains_of(found)[-1]
            rivals = tuple(e for e in group if e != effect) if effect in group else ()
            own = background is not None and now.trial(background).identifier == effect
            tried.append(Tried(effect, one, after, effect in passing, own, rivals, found))

        def place(one: Tried) -> tuple:
            rank = group.index(one.effect) if one.effect in group else len(group)
            return (not one.passes, rank, one.after is None, -one.gain)

        return sorted(tried, key=place)
