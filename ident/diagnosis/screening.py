"""Which of the trials, alone or two at once, pass, and which of them are worth refining.

Alone each of two missing effects is judged by errors that the other one causes: its size comes out
wrong, and on another motion it may help nothing.  On inner products a pair costs no more than a
single effect, so all pairs are tried.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.diagnosis.score_table import ScoreTable
from ident.diagnosis.settings import SETTINGS
from ident.diagnosis.trials import Trial


@dataclass(frozen=True, eq=False)
class Shortlist:
    """Trials judged by what they gain.

    Attributes:
        table: about every trial.
        gains, p: of each.
        error: mean squared scaled error of the fitted windows.
        floor: what noise explains of it.
        origin: the error of which an effect must remove a part.
        wheels_agree: whether the wheels rule out that rollers and slip leave an error.
    """

    table: ScoreTable
    gains: np.ndarray
    p: np.ndarray
    error: float
    floor: float
    origin: float
    wheels_agree: bool

    def background(self) -> int | None:
        """The best trial of an effect that every robot has some of, if one passes.

        Nothing feigns it, so a part of what is left suffices, however little that is.
        """
        if self.wheels_agree:
            return None
        passing = [
            k
            for k in self._admissible()
            if self.trial(k).effect.background
            and (self._gained(k) or self.gains[k] > SETTINGS.some_elsewhere)
        ]
        return max(passing, key=lambda k: self.gains[k]) if passing else None

    def worth_refining(self) -> list[int]:
        """Trials that pass, and those that fit as well as the best of them; best first.

        That something is missing is certain then, so a rival that gains need not be certain itself.
        """
        passing = [k for k in self._admissible() if self._gained(k) and self._named(k)]
        found = self._best_forms(passing)
        if not found:
            return []
        explained = self.table.explained
        least = SETTINGS.as_well * explained(found[0])
        known = {self.trial(k).identifier for k in found}
        rivals = [
            k
            for k in range(len(self.table.trials))
            if self.trial(k).identifier not in known
            and explained(k) > least
            and (self._sure(k) or self._gained(k))
            and self._possible(k)
            and self._named(k)
        ]
        worth = [
            k for k in found if self.gains[k] >= SETTINGS.worth_refining * self.gains[found[0]]
        ]
        return (worth + self._best_forms(rivals))[: SETTINGS.most_refined]

    def hopeful(self) -> list[int]:
        """Trials that may pass when refined though their linear traces do not; best forms."""
        explained = self.table.explained
        found = [
            k
            for k in self._admissible()
            if self.enough(explained(k), SETTINGS.hope * SETTINGS.least_gain) and self._named(k)
        ]
        return self._best_forms(found)

    def _best_forms(self, numbers: list[int]) -> list[int]:
        """The best form of each effect, best first."""
        best: dict[str, int] = {}
        for k in numbers:
            old = best.get(self.trial(k).identifier)
            if old is None or self._better_form(k, old):
                best[self.trial(k).identifier] = k
        return sorted(best.values(), key=lambda k: -self.gains[k])

    def _better_form(self, number: int, old: int) -> bool:
        """Compare two forms of an effect that pass.

        Equally many parameters are judged by what they explain where they are fitted, unless
        rollers may feign it.  Otherwise the gain elsewhere counts, unless one fits incomparably
        better.
        """
        left = [1.0 - self.table.explained(k) for k in (number, old)]
        split = self.trial(number).per_wheel - self.trial(old).per_wheel
        if (self.wheels_agree and not split) or min(left) < SETTINGS.incomparably * max(left):
            return left[0] < left[1]
        return bool(self.gains[number] > self.gains[old] + SETTINGS.split_gain * split)

    def _credible(self, number: int) -> bool:
        """Tell whether a trial is large enough for what would still be unexplained with it."""
        unexplained = self.error - self.floor
        left = (1.0 - self.table.explained(number)) * self.error - self.floor
        if left <= SETTINGS.prevailing * unexplained:
            return True
        return self._relative_size(number) >= SETTINGS.sizeable

    def _relative_size(self, number: int) -> float:
        """Largest estimated size of a trial in units of the typical one."""
        trial = self.trial(number)
        values = trial.values(self.table.coefficients(number))
        return max(
            abs(value / trial.effect.parameter_of(name).default)
            for name, value in values.items()
            if trial.effect.parameter_of(name).default
        )

    def _admissible(self) -> list[int]:
        """Trials that are significant with sizes that are possible."""
        return [k for k in range(len(self.table.trials)) if self._sure(k) and self._possible(k)]

    def _sure(self, number: int) -> bool:
        gain = self.gains[number]
        if self.p[number] < SETTINGS.significant or gain > SETTINGS.overwhelming:
            return True
        return bool(
            gain > SETTINGS.some_elsewhere and self.table.explained(number) > SETTINGS.nearly_all
        )

    def _possible(self, number: int) -> bool:
        return self.trial(number).possible(self.table.coefficients(number), SETTINGS.bound_slack)

    def enough(self, gain: float, least: float = SETTINGS.least_gain) -> bool:
        """Tell whether a gain is enough: of what is left, or of all where rollers may feign it."""
        share = 1.0 if self.wheels_agree else min(1.0, self.error / self.origin)
        return gain * share > least

    def _gained(self, number: int) -> bool:
        return self.enough(self.gains[number])

    def _named(self, number: int) -> bool:
        return not self.trial(number).effect.background and self._credible(number)

    def trial(self, number: int) -> Trial:
        """The trial of a number."""
        return self.table.trials[number]


def gain_of(table: ScoreTable, number: int) -> float:
    """Share of the squared error that a trial removes where it was not fitted.

    Of what changes with time see ``SETTINGS.changing``.
    """
    gain = table.gain(number)
    if not table.trials[number].effect.needs_time:
        return gain
    explained = table.explained(number)
    return max(gain, explained) if explained > SETTINGS.changing else gain


def best_pair(table: ScoreTable, alone: float) -> tuple[int, int] | None:
    """The two trials that explain the logs far better than any one.

    Args:
        table: about all trials.
        alone: share of the squared error that the best single effect removes where it was not
            fitted, 0 where none does.

    Returns:
        Trials, the one first that explains more by itself; None where no pair is that good.
    """
    found, best, judged = None, alone, set()
    for first, second in _promising(table):
        pair = frozenset((table.trials[first].identifier, table.trials[second].identifier))
        if len(judged | {pair}) > SETTINGS.pairs_judged:
            break
        judged.add(pair)
        gain = table.gain(second, beside=first)
        if gain > best and _sensible(table, first, second):
            found, best = (first, second), gain
    if found is None or 1.0 - best > SETTINGS.pair_clearly * (1.0 - alone):
        return None
    return tuple(sorted(found, key=lambda k: -table.explained(k)))


def _promising(table: ScoreTable) -> list[tuple[int, int]]:
    """Pairs of trials by what they explain together where they are fitted, best first."""
    count = len(table.trials)
    alone = np.array([table.explained(k) for k in range(count)])
    sizes = np.array([len(columns) for columns in table.columns[:count]])
    starts, seen = [], {}
    for k in np.argsort(-alone):
        name = table.trials[k].identifier
        seen[name] = seen.get(name, 0) + 1
        if seen[name] <= SETTINGS.pair_forms and not table.trials[k].effect.background:
            starts.append(int(k))
    pairs = []
    for first in starts:
        effect = table.trials[first].identifier
        for second in range(count):
            trial = table.trials[second]
            if trial.identifier == effect or trial.effect.background:
                continue
            # Coefficients that must stay near one are those of the second.
            if trial.linear <= table.trials[first].linear:
                left = 1.0 - table.explained(second, beside=first)
                pairs.append(
                    (left * (1 + SETTINGS.price * (sizes[first] + sizes[second])), first, second)
                )
    return [(first, second) for _, first, second in sorted(pairs)]


def _sensible(table: ScoreTable, *pair: int) -> bool:
    return all(
        table.trials[one].possible(table.coefficients(one, beside=other), SETTINGS.bound_slack)
        for one, other in (pair, pair[::-1])
    )
