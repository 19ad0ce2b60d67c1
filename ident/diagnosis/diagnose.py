"""Which effect is missing: what the search found, judged by windows that were never touched."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, field, replace
from itertools import compress
from typing import Any

from ident.comparison import Regime, compare
from ident.decimate import SEARCHED
from ident.diagnosis.excitation import unfit
from ident.diagnosis.experiments import CALIBRATION, Experiment, separating
from ident.diagnosis.forces import ForceShare, confirmations
from ident.diagnosis.holdout import FreeRunErrors, confirmed, free_run_errors
from ident.diagnosis.judge import inertia_is_seen, judged_by_force
from ident.diagnosis.lack_of_fit import Dependence, dependences
from ident.diagnosis.minimum_detectable import MinimumDetectable, minimum_detectable
from ident.diagnosis.records import (
    freed,
    of_other_robots,
    ready,
    recordings,
    told,
    with_differences,
    with_unknown_hold,
)
from ident.diagnosis.refit import Refits, refit
from ident.diagnosis.rounds import Round
from ident.diagnosis.selection import Search, Step, chain_of, search, with_steps
from ident.diagnosis.settings import SETTINGS
from ident.diagnosis.splits import Part, divide, weigh
from ident.diagnosis.trials import untried
from ident.diagnosis.verdict import decide
from ident.disagreement import disagreements, may_judge, not_used
from ident.doctor.finding import Finding
from ident.excerpt import cut_told, excerpts
from ident.instruments import without_instruments, without_late
from ident.kinematics.ripple import with_phases_of
from ident.log import Log
from ident.output_error import OutputError
from ident.pooling import as_list, pooled
from ident.recording import Recording
from ident.recording_words import Instrument
from ident.repeats import Repeat, repeats
from ident.results import Shown
from ident.sensitivity import Linearised
from ident.threads import one_thread
from youbot_env.model import Model
from youbot_env.model_file import load_model


@dataclass(frozen=True, eq=False, repr=False)
class Diagnosis(Shown):
    """What is missing from a model.

    Attributes:
        log: name of the record.
        verdict: ``named``, ``ambiguous``, ``nothing_missing``, ``outside_library`` or
            ``cannot_say``.
        reason: why, in a sentence.
        steps: effects in the order of their importance, background last.
        model: base and effects, refined, with covariance.
        base: the model without the effects, refined.
        minimum_detectable: what the log would have shown of every effect.
        depends_on: signals that the remaining error depends on, strongest first.
        errors: free-run errors of base, of every step and of the model on held-out windows.
        first, last: the first and the last round; None where the log decides nothing.
        experiment: what to record next, where that would tell more.
        chain: models from the base to the last, each with the effect that it has more.
        models: for each of them the model of every log, with its own record and instruments.
        recording: how the rows of every log came to be.
        forces: by effect, for every log the share of it that forces at the measured motion confirm,
            with its standard error, where they can.
        untried: effects that the logs cannot show, by name, with the reason and what to record.
        repeats: motion across equal strokes, and what of it repeats.
        differs: logs to judge by that are not of the robot of the fitted ones, by name.
    """

    log: str
    verdict: str
    reason: str
    steps: tuple[Step, ...]
    model: Model
    base: Model
    minimum_detectable: tuple[MinimumDetectable, ...] = ()
    depends_on: tuple[tuple[str, float], ...] = ()
    errors: FreeRunErrors | None = None
    first: Round | None = None
    last: Round | None = None
    experiment: Experiment | None = None
    chain: tuple[tuple[str, Model], ...] = ()
    models: tuple[tuple[Model, ...], ...] = ()
    recording: tuple[Instrument, ...] = ()
    forces: dict[str, list[ForceShare]] = field(default_factory=dict)
    untried: dict[str, str] = field(default_factory=dict)
    repeats: tuple[Repeat, ...] = ()
    differs: dict[str, Finding] = field(default_factory=dict)

    @property
    def named(self) -> tuple[Step, ...]:
        """Steps that count as an answer; what is the recording's is not the robot's."""
        if self.verdict not in ("named", "ambiguous"):
            return ()
        return tuple(step for step in self.steps if not step.recording)

    def where(self) -> tuple[Regime, ...]:
        """Regimes in which the base model fails, those with most error for their time first."""
        if self.first is None:
            return ()
        return compare(self.first.parts[0].log, [self.base])[0].where

    def headline(self) -> str:
        """See the base class."""
        return f"{self.log}: {self.verdict}: {self.reason}"

    def table(self) -> dict[str, list[Any]]:
        """The effects that were added, with sizes, intervals and the error after each."""
        drops = self.errors.drops if self.errors else {}
        rows = [
            (step.best.identifier, "/".join(step.group), flat, q.value, *(q.ci95 or (None, None)),
             q.unit, drops.get(step.best.identifier))
            for step in self.steps
            for flat, q in step.sizes(self.model).items()
        ]  # fmt: skip
        head = ("effect", "group", "size", "value", "low", "high", "unit", "error drop")
        return {name: [row[k] for row in rows] for k, name in enumerate(head)}

    def plot(self):
        """The error on held-out windows with every effect that was added.

        Raises:
            ValueError: the logs decide nothing, so that there is no error.
        """
        from ident.report.diagnose_figures import error_steps_figure

        if self.errors is None:
            raise ValueError(f"nothing to draw: {self.reason}")
        return error_steps_figure.on_canvas(self.errors)

    def as_dict(self) -> dict[str, Any]:
        """Return what ``diagnose.py --json`` writes."""
        drops = self.errors.drops if self.errors else {}
        return {
            "log": self.log,
            "verdict": self.verdict,
            "reason": self.reason,
            "named": [
                {
                    "effect": step.best.identifier,
                    "group": list(step.group),
                    "size": {k: q.as_dict() for k, q in step.sizes(self.model).items()},
                    "p_adjusted": step.p,
                    "error_drop": drops.get(step.best.identifier),
                    "forces": self.forces.get(step.best.identifier, []),
                }
                for step in self.named
            ],
            "recording": [one.as_dict() for one in self.recording],
            "candidates": [one.as_dict() for one in self.minimum_detectable],
            "untried": self.untried,
            "repeats": [one.as_dict() for one in self.repeats],
            "where": [regime.as_dict() for regime in self.where()],
            "experiment": self.experiment.as_dict() if self.experiment else None,
            "depends_on": [signal for signal, _ in self.depends_on],
            "free_run": self.errors.as_dict() if self.errors else
                        {"before": None, "after": None, "noise_floor": None},
        }  # fmt: skip


@one_thread
def diagnose(
    logs: Log | Sequence[Log],
    model: str | Model = "nominal",
    test: Log | Sequence[Log] | None = None,
    seed: int = 0,
    progress: Callable[[str], None] | None = None,
) -> Diagnosis:
    """Look for effects that are missing from a model.

    Args:
        logs: records of one robot to fit.
        model: platform, known effects and start values.
        test: other records of the same robot, best of other motions.  Their first part helps to
            choose between rivals, their last part has the last word.  Without them windows of the
            logs, or of many logs whole ones, are kept for that.  Of all records that together last
            longer than ``SETTINGS.most_seconds`` the liveliest stretches are used, see
            ``ident.excerpt``; the reason says so.
        seed: of the bootstrap.
        progress: called with what is being done.

    Raises:
        ValueError: a log without drive input, or of another platform.
    """
    tell = progress or (lambda what: None)
    ground = Ground.of(logs, model, test, tell)
    name, logs, tests, model = ground.name, ground.logs, ground.tests, ground.model
    records, differs = ground.records, ground.differs
    if ground.weak:
        return Diagnosis(name, "cannot_say", ground.weak, (), model, model, experiment=CALIBRATION)
    found, refined = _searched(records, model, len(tests), seed, tell)
    if found.steps:
        # An effect that was missing may have hidden that a log to judge by is of another robot.
        known, there = [r.log for r in records], with_steps(refined.model, found.steps)
        differs |= disagreements(known[: len(logs)], known[len(logs) :], there)
        agree = [may_judge(test, differs) for test in tests]
        if not all(agree):
            tests = list(compress(tests, agree))
            records = [*records[: len(logs)], *compress(records[len(logs) :], agree)]
            found, refined = _searched(records, model, len(tests), seed, tell)
    if found.steps and found.first.wheels_agree and not all(one.known for one in records):
        # What was found may tell more of a clock than the usual nuisances did; where that changes
        # it, what was found rests on a wrong one.  Rolling leaves too much for that.
        tell("finding out again how the logs were recorded")
        again = recordings(logs, tests, without_late(with_steps(refined.model, found.steps)))
        if any(new.moved_from(old) for new, old in zip(again, records, strict=True)):
            records = again
            found, refined = _searched(records, model, len(tests), seed, tell)
    first, now, outside = found.first, found.last, found.outside
    tell("measuring errors on held-out windows")
    steps = confirmed(found.fits, refined, found.steps, first.simulations[-1])
    fits, start = freed(found.fits, records, refined.model, len(tests), model)
    chain, errors = _with_errors(fits, start, steps)
    fitting = ""
    real = [step for step in steps if step.real]
    if errors.before <= errors.white and (real or outside):
        # White noise of the sensors alone leaves as much without any of them.  Noise of the drive
        # that lasts does not count here: an effect that is missing passes for some of it.
        fitting = ", ".join(step.best.identifier for step in real) or "a dependence"
        fitting = f"; {fitting} fits, but no more than noise was left without it"
        steps, outside = [step for step in steps if not step.real], False
        chain, errors = _with_errors(fits, start, steps)
    last = chain[-1][1]
    steps.sort(key=lambda step: step.background)
    recording = told(records, fits, last)
    last = with_unknown_hold(last, recording, records[0].original)
    forces = confirmations(fits, last, [step.best.identifier for step in steps])
    verdict, reason = decide(steps, errors, outside, first, now, forces)
    across = tuple(repeats(logs))
    if verdict == "ambiguous":
        tell("looking for a motion that separates them")
    return Diagnosis(
        log=name,
        verdict=verdict,
        reason=reason + fitting + _repeated(verdict, across) + not_used(differs) + ground.shortened,
        steps=tuple(steps),
        model=replace(without_instruments(last), name="diagnosed"),
        base=without_instruments(chain[0][1]),
        recording=recording,
        untried=untried(first.model, first.logs),
        minimum_detectable=minimum_detectable(first),
        depends_on=tuple(now.dependences()),
        errors=errors,
        first=first,
        last=now,
        experiment=next_record(verdict, steps, now),
        chain=tuple((name, without_instruments(model)) for name, model in chain),
        models=tuple(fits.models(model) for _, model in chain),
        repeats=across,
        forces=forces,
        differs=differs,
    )


@dataclass(frozen=True, eq=False)
class Ground:
    """What a search for missing effects stands on: logs whose recording is known.

    Attributes:
        name: of the fitted logs.
        logs, tests: records to fit and to judge by, of the same robot.
        model: the one to start from, on their platform and without instruments.
        records: the recording of every log, those to judge by last.
        differs: logs to judge by that are of another robot, by name, with what differs.
        weak: why the logs decide nothing; empty where they do.
        shortened: what of long logs was used, in words.
    """

    name: str
    logs: list[Log]
    tests: list[Log]
    model: Model
    records: list[Recording] = field(default_factory=list)
    differs: dict[str, Finding] = field(default_factory=dict)
    weak: str = ""
    shortened: str = ""

    @classmethod
    def of(
        cls,
        logs: Log | Sequence[Log],
        model: str | Model,
        test: Log | Sequence[Log] | None,
        tell: Callable[[str], None],
    ) -> Ground:
        """Find out how logs were recorded; arguments are those of ``diagnose``."""
        whole = pooled(as_list(logs)), pooled(as_list(test))
        model = load_model(model)
        logs, tests = excerpts(*whole)
        shortened = "".join(map(cut_told, whole, (logs, tests)))
        for log in (*logs, *tests):
            if log.platform != model.platform:
                model = replace(model, platform=log.platform)
        name = " + ".join(log.name for log in logs)
        weak = unfit(logs)
        if weak:
            return cls(name, logs, tests, model, weak=weak)
        model = without_instruments(model)
        if not inertia_is_seen(logs, model):
            logs, tests = ([judged_by_force(log) for log in some] for some in (logs, tests))
        tests = [with_phases_of(logs[0], test) for test in tests]
        logs = [logs[0], *(with_phases_of(logs[0], log) for log in logs[1:])]
        tell("finding out how the logs were recorded")
        records = recordings(logs, tests, model)
        differs = of_other_robots(logs, tests, records, model)
        if differs:
            tests = [test for test in tests if may_judge(test, differs)]
            records = recordings(logs, tests, model)
        return cls(name, logs, tests, model, records, differs, shortened=shortened)


def based(
    records: list[Recording], model: Model, tested: int, tell: Callable[[str], None]
) -> tuple[list[Part], OutputError, tuple[Linearised, ...], list[Dependence]]:
    """The base model on logs whose recording is known.

    Args:
        records: the logs, those to judge by last.
        model: to start from.
        tested: how many of the logs judge.
        tell: called with what is being done.

    Returns:
        The logs with the roles of their windows, the refined base model, each log simulated with
        it, and the dependences that compete with the library.
    """
    logs = [ready(record, model, SEARCHED) for record in records]
    parts = divide(logs[: len(logs) - tested], logs[len(logs) - tested :], model)
    tell("fitting the base model")
    refined, simulations = refit(parts, model, steps=30)
    weighed = weigh(parts, simulations)
    if weighed is not parts:
        parts = weighed
        refined, simulations = refit(parts, refined.model)
    differing = with_differences(parts, simulations)
    if differing is not simulations[0].model:
        tell("taking in what differs between the logs")
        refined, simulations = refit(parts, differing)
    return parts, refined, simulations, dependences(logs)


def _searched(
    records: list[Recording], model: Model, tested: int, seed: int, tell: Callable[[str], None]
) -> tuple[Search, OutputError]:
    """Look for what is missing in logs whose recording is known, and the base model for that."""
    parts, refined, simulations, generic = based(records, model, tested, tell)
    return search(parts, refined, simulations, generic, seed, tell), refined


def _with_errors(
    fits: Refits, start: Model, steps: list[Step]
) -> tuple[list[tuple[str, Model]], FreeRunErrors]:
    """Models from the base to the last, and their errors on held-out windows."""
    chain = chain_of(fits, start, steps)
    last = chain[-1][1]
    simulation = fits.of(last)[1][-1]
    simulation = replace(simulation, model=replace(simulation.model, covariance=last.covariance))
    return chain, free_run_errors(fits, chain, simulation)


def _repeated(verdict: str, across: tuple[Repeat, ...]) -> str:
    """How much of what stays unexplained a law of the motion could explain at all."""
    if verdict not in ("outside_library", "cannot_say"):
        return ""
    return "".join(f"; {one}" for one in across[: SETTINGS.strokes_told])


def next_record(verdict: str, steps: list[Step], last: Round) -> Experiment | None:
    """What to record next."""
    if verdict == "cannot_say":
        return CALIBRATION
    doubtful = [step for step in steps if len(step.group) > 1]
    if verdict != "ambiguous" or not doubtful:
        return None
    step = doubtful[0]
    rivals = {c.identifier: c.model for c in (step.best, *step.rivals)[:2]}
    if any(part.log.drive == "voltage" for part in last.parts):
        return None
    return separating(rivals, last.error)
