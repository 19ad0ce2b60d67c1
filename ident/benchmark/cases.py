"""The cases of the benchmark: what is hidden, in which robot, recorded how.

A case is a name; everything random about it comes from a child of the benchmark's seed that the
name picks.  The three sizes of an effect share robot, motion and noise, so they differ in nothing
but the size.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from ident.benchmark.conditions import FIT_SECONDS, VERIFY_SECONDS, Conditions, record
from ident.benchmark.foreign import Foreign
from ident.benchmark.hidden import (
    EFFECTS,
    SLOW_DRIVE,
    Hidden,
    draw_hidden,
    hide,
)
from ident.benchmark.laws import LAWS
from ident.benchmark.outside import OUTSIDE
from ident.benchmark.robots import draw_robots
from ident.benchmark.scaling import amount_for
from ident.diagnosis.experiments import menu
from ident.diagnosis.settings import SETTINGS
from ident.log import Log
from youbot_env.effects import get_effect
from youbot_env.model import Model
from youbot_env.simulation import IDEAL, Sensors

PARTS = ("nothing", "single", "outside", "laws", "pairs", "rollers")
# Share of the rms wheel torque that an effect of size 1 adds or takes.
FULL = 0.08
# Effects hidden in robots with real rollers.
ROLLER_EFFECTS = (
    "wheel_coulomb_friction", "floor_slope", "torque_gain", "torque_offset", "cable_tether",
    "quadratic_drag", "actuator_delay",
)  # fmt: skip


@dataclass(frozen=True)
class Case:
    """One robot with what is hidden in it.

    Attributes:
        part: one of ``PARTS``.
        hidden: identifiers of the hidden effects.
        size: of each, 1 being ``FULL``.
        number: tells robots with the same secret apart.
        seed: of the benchmark.
        foreign: whether it is recorded as another laboratory might.
    """

    part: str
    hidden: tuple[str, ...]
    size: float
    number: int
    seed: int
    foreign: bool = False

    @property
    def key(self) -> str:
        """What picks the chance of the case: all but its size."""
        key = f"{self.part}/{'+'.join(self.hidden) or 'none'}/{self.number:03d}"
        return f"foreign/{key}" if self.foreign else key

    @property
    def id(self) -> str:
        """Name of the case."""
        return f"{self.key}@{self.size:g}" if self.hidden else self.key

    def children(self, count: int) -> list[np.random.SeedSequence]:
        """Independent sources of chance of the case."""
        return np.random.SeedSequence(self.seed, spawn_key=tuple(self.key.encode())).spawn(count)


@dataclass(frozen=True)
class Recorded:
    """The two records of a case, and the truth about them.

    Attributes:
        fit: record that the diagnosis gets, 112 s.
        verify: another record of the same robot, 48 s, that only verifies.
        truth: the robot with what is hidden in it.
        measured: the same with how its rows came to be; what an answer can reach on ``verify``.
        exact: whether ``truth`` is all there is; a robot with real rollers is more.
        share: of the rms torque that each hidden effect is worth.
        conditions: how both were recorded.
    """

    fit: Log
    verify: Log
    truth: Model
    measured: Model
    exact: bool
    share: dict[str, float]
    conditions: Conditions


@dataclass(frozen=True)
class Plan:
    """How many cases of each kind.

    Attributes:
        seeds: robots for each effect and size, of the parts single, outside and laws.
        sizes, other_sizes: sizes of library effects, and of those outside and under other laws.
        nothing: robots with nothing hidden.
        pairs: robots with two effects.
        rollers: robots with real rollers; three in eight hide nothing.
        roller_sizes: sizes of what is hidden in them.
        roller_outside: robots with real rollers and something outside the library.
        foreign: whether all are recorded as another laboratory might.
    """

    seeds: int = 20
    sizes: tuple[float, ...] = (1.0, 0.5, 0.25)
    other_sizes: tuple[float, ...] = (1.0, 0.5)
    nothing: int = 400
    pairs: int = 100
    rollers: int = 40
    roller_sizes: tuple[float, ...] = (1.0,)
    roller_outside: int = 0
    foreign: bool = False

    def cases(self, seed: int) -> list[Case]:
        """All cases, those of one structure next to each other."""
        return [replace(case, foreign=self.foreign) for case in self._cases(seed)]

    def _cases(self, seed: int) -> list[Case]:
        found = [Case("nothing", (), 0.0, k, seed) for k in range(self.nothing)]
        found += self._grid("single", EFFECTS, self.sizes, seed)
        found += self._grid("outside", [e.identifier for e in OUTSIDE], self.other_sizes, seed)
        found += self._grid("laws", [e.identifier for e in LAWS], self.other_sizes, seed)
        chosen = draw_pairs(self.pairs, seed)
        found += [Case("pairs", pair, 1.0, k, seed) for k, pair in enumerate(chosen)]
        quiet = -(-3 * self.rollers // 8)
        found += [Case("rollers", (), 0.0, k, seed) for k in range(quiet)]
        for k in range(self.rollers - quiet):
            hidden = (ROLLER_EFFECTS[k % len(ROLLER_EFFECTS)],)
            found += [Case("rollers", hidden, s, k, seed) for s in self.roller_sizes]
        strange = [e.identifier for e in OUTSIDE]
        for k in range(self.roller_outside):
            found.append(Case("rollers", (strange[k % len(strange)],), 1.0, k, seed))
        return found

    def _grid(self, part, effects, sizes, seed) -> Iterator[Case]:
        for effect in effects:
            for number in range(self.seeds):
                for size in sizes:
                    yield Case(part, (effect,), size, number, seed)


FULL_PLAN = Plan()
FOREIGN_PLAN = Plan(seeds=4, nothing=100, pairs=20, rollers=48, roller_outside=24, foreign=True)
QUICK_PLAN = Plan(seeds=1, sizes=(1.0,), other_sizes=(1.0,), nothing=6, pairs=2, rollers=2)


def draw_pairs(count: int, seed: int) -> list[tuple[str, str]]:
    """Pairs of library effects of which neither is listed as looking like the other."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=tuple(b"pairs")))
    pairs = []
    while len(pairs) < count:
        one, other = (str(name) for name in rng.choice(EFFECTS, 2, replace=False))
        if not alike(one, other):
            pairs.append((one, other))
    return pairs


def alike(one: str, other: str) -> bool:
    """Tell whether the library lists either effect among those that look like the other."""
    return (
        one == other or one in get_effect(other).confusables or other in get_effect(one).confusables
    )


def record_case(case: Case) -> Recorded:
    """Draw the robot and what is hidden in it, scale that, and record twice."""
    body, how, secret, first, second = case.children(5)
    drawn_from = Foreign if case.foreign else Conditions
    conditions = drawn_from.draw(np.random.default_rng(how), fast=_needs_speed(case))
    if case.part == "rollers":
        from ident.benchmark.rolling import draw_rolling_robot

        if not case.foreign:
            conditions = replace(conditions, rate=100.0, jitter=0.0)
        robot = draw_rolling_robot(body)
    else:
        (robot,) = draw_robots(1, body)
    drawn = [
        draw_hidden(identifier, np.random.default_rng(child), robot.platform)
        for identifier, child in zip(case.hidden, secret.spawn(len(case.hidden)), strict=True)
    ]
    found = [scale(hidden, case.size, robot, conditions, first) for hidden in drawn]
    amounts = [(hidden, amount) for hidden, (amount, _) in zip(drawn, found, strict=True)]
    truth = replace(hide(robot, amounts), name="truth")
    share = {name: part for name, (_, part) in zip(case.hidden, found, strict=True)}
    motions = (("fit", conditions.fitting(), FIT_SECONDS, first),
               ("verify", conditions.verifying(), VERIFY_SECONDS, second))  # fmt: skip
    fit, verify = (_record(case, truth, conditions, *motion) for motion in motions)
    measured = conditions.driven(truth, second=True).with_effects(conditions.of_recording())
    return Recorded(fit, verify, truth, measured, case.part != "rollers", share, conditions)


def record_experiment(case: Case, recorded: Recorded, motion: str) -> Log:
    """Record the robot of a case once more, in a motion that a diagnosis asked for.

    Args:
        case: the case.
        recorded: what was recorded of it before.
        motion: name in ``ident.diagnosis.experiments``.
    """
    child = case.children(7)[6]
    conditions = recorded.conditions
    times = conditions.times(SETTINGS.experiment_seconds, np.random.default_rng(child))
    robot = conditions.driven(recorded.truth, second=False)
    log = record("experiment", robot, menu()[motion], times, Sensors(), child, conditions)
    return conditions.kept(log, np.random.default_rng(child.spawn(1)[0]))


def scale(
    hidden: Hidden,
    size: float,
    robot: Model,
    conditions: Conditions,
    seed: np.random.SeedSequence,
) -> tuple[float, float]:
    """Amount of an effect of some size, and the share of the rms torque that it is worth.

    Where a bound keeps the effect below ``FULL``, sizes are parts of what it reaches.  Torques are
    held from row to row here, so that the equations leave nothing but the effect.
    """
    even = replace(conditions, jitter=0.0)  # says the same, and the filters are faster on it
    times = even.times(FIT_SECONDS, np.random.default_rng(seed))

    def drive(model: Model) -> Log:
        return record("exact", model, conditions.fitting(), times, IDEAL, seed)

    amount, share = amount_for(FULL, hidden, robot, drive)
    return (amount, share) if size == 1.0 else amount_for(size * share, hidden, robot, drive)


def _needs_speed(case: Case) -> bool:
    return bool(set(case.hidden) & set(SLOW_DRIVE))


def _record(case, truth, conditions, name, motion, seconds, seed) -> Log:
    robot = conditions.driven(truth, second=name == "verify")
    if case.part == "rollers":
        from ident.benchmark.rolling import record_rolling

        log = record_rolling(name, robot, motion, seconds, seed, conditions)
    else:
        times = conditions.times(seconds, np.random.default_rng(seed))
        log = record(name, robot, motion, times, Sensors(), seed, conditions)
    return conditions.kept(log, np.random.default_rng(seed.spawn(1)[0]))
