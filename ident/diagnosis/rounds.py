"""One round: what could be added to a model, whether anything passes, and what fits best."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ident.diagnosis.dependence import Dependence
from ident.diagnosis.evidence import Evidence
from ident.diagnosis.floor import noise_floor, wheels_agree
from ident.diagnosis.pairs import best_pair
from ident.diagnosis.parts import FIT, SELECT, Part
from ident.diagnosis.rivals import Candidate, candidate, ranked, window_losses
from ident.diagnosis.trials import Trial, trials
from ident.sensitivity import Linearised
from youbot_env.model import Model

# Share of the squared free-run error that an effect must remove where it was not fitted.  Robots
# with real rollers and nothing hidden feign up to 4 %.
LEAST_GAIN = 0.06
SIGNIFICANT = 0.05
# What acts in a few moments only cannot be significant by the signs of many; removing this share of
# the squared error where it was not fitted is evidence enough.
OVERWHELMING = 0.5
# Times that were left out do not foretell what changes with time: where that removes this share of
# the squared error that it is fitted to, the share counts as its gain.
CHANGING = 0.2
# Estimates may miss a bound by this share of the typical size.
SLACK = 0.25
# Where more than this share of the error that noise does not explain would be left, something
# unknown prevails, and only effects of at least this share of their typical size are believed.
PREVAILING, SIZEABLE = 0.5, 0.5
# Refined are trials with at least this share of the best gain, and at most so many effects.
WORTH, MOST = 0.4, 5
# Also refined are trials that explain this share of what the best explains where it is fitted.
AS_WELL = 0.85
# A dependence that removes this share of the error while no effect passes, or that leaves less
# than this share of what the best effect leaves, shows that something else is missing.
TELLING, OUTSIDE = 0.15, 0.6
# Where the wheels agree with each other: errors from this many times the noise on are not noise,
# and effects that leave more than this share of such an error are not what is missing.
UNEXPLAINED, REMAINDER = 3.0, 0.3
# A trial of single wheels must gain this much more than one of all alike.
SPLIT = 0.02
# A form that leaves less than this share of what another one leaves is the better one anyway.
INCOMPARABLY = 0.5


@dataclass(frozen=True, eq=False)
class Round:
    """What the logs say on top of one model.

    Attributes:
        parts: the logs.
        simulations: each simulated with the model.
        evidence: about every trial.
        generic: dependences that compete with them.
        gains: share of the squared error that each removes where it was not fitted; of what changes
            with time see ``CHANGING``.
        p: of each.
        origin: mean squared scaled error, with what every robot has explained, of which an effect
            must remove a part.
        unexplained: the same before anything was explained, for generic dependences.
        floor: mean squared scaled error that noise explains.
        loss: (W,) mean squared scaled error of each window.
    """

    parts: list[Part]
    simulations: tuple[Linearised, ...]
    evidence: Evidence
    generic: list[Dependence]
    gains: np.ndarray
    p: np.ndarray
    floor: float
    loss: np.ndarray
    origin: float
    unexplained: float

    @classmethod
    def of(
        cls,
        parts: list[Part],
        simulations: tuple,
        generic: list[Dependence],
        seed: int,
        origin: float | None = None,
        unexplained: float | None = None,
    ) -> Round:
        """Try everything on top of the model that the logs are simulated with."""
        model, log = simulations[0].model, parts[0].log
        with np.errstate(all="ignore"):
            evidence = Evidence.of(parts, list(simulations), trials(model, log), [])
        gains = np.array([_gain(evidence, k) for k in range(len(evidence.columns))])
        floor = noise_floor(simulations[0], parts[0].weights)[0]
        p = evidence.p_values(seed)[1]
        loss = window_losses(parts, simulations)
        error = float(loss[evidence.role == FIT].mean())
        return cls(parts, simulations, evidence, generic, gains, p, floor, loss, origin or error,
                   unexplained or error)  # fmt: skip

    @cached_property
    def wheels_agree(self) -> bool:
        """Whether the wheels rule out that rollers and slip leave an error."""
        return wheels_agree(self.parts[0].log)

    @property
    def model(self) -> Model:
        """The model of this round."""
        return self.evidence.model

    @property
    def error(self) -> float:
        """Mean squared scaled error of the fitted windows."""
        return float(self.loss[self.evidence.role == FIT].mean())

    @property
    def excess(self) -> float:
        """Mean squared scaled error of the fitted windows beyond what noise explains."""
        return max(self.error - self.floor, 0.0)

    def trial(self, number: int) -> Trial:
        """The trial of a number."""
        return self.evidence.trials[number]

    def background(self) -> int | None:
        """The best trial of an effect that every robot has some of, if one passes."""
        if self.wheels_agree:
            return None
        passing = [
            k for k in self._admissible() if self._gained(k) and self.trial(k).effect.background
        ]
        return max(passing, key=lambda k: self.gains[k]) if passing else None

    def worth_refining(self) -> list[int]:
        """Trials that pass, and those that fit as well as the best of them; best first."""
        passing = [k for k in self._admissible() if self._gained(k) and self._named(k)]
        found = self._best_forms(passing)
        if not found:
            return []
        explained = self.evidence.explained
        least = AS_WELL * explained(found[0])
        known = {self.trial(k).identifier for k in found}
        rivals = [
            k
            for k in self._admissible()
            if self._named(k) and self.trial(k).identifier not in known and explained(k) > least
        ]
        worth = [k for k in found if self.gains[k] >= WORTH * self.gains[found[0]]]
        return (worth + self._best_forms(rivals))[:MOST]

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
        left = [1.0 - self.evidence.explained(k) for k in (number, old)]
        split = self.trial(number).per_wheel - self.trial(old).per_wheel
        if (self.wheels_agree and not split) or min(left) < INCOMPARABLY * max(left):
            return left[0] < left[1]
        return bool(self.gains[number] > self.gains[old] + SPLIT * split)

    def choose(self, present: Candidate | None = None) -> list[Candidate]:
        """The group that fits best, refined; empty where nothing passes.

        Args:
            present: an effect that was chosen before and has to be beaten.
        """
        found = [candidate(self.parts, self.evidence, k) for k in self.worth_refining()]
        found = [c for c in found if c is not None and self.helps(c)]
        if present is not None and present.identifier not in {c.identifier for c in found}:
            found.append(present)
        return ranked(found, self.evidence.role, self.loss) if found else []

    def pair(self, group: list[Candidate]) -> tuple[int, int] | None:
        """Two effects that explain far more than the best one; None where one is enough.

        Only errors that are neither noise nor rolling are worth two effects at once.
        """
        left = max(self._left(group), 0.0)
        if not self.wheels_agree or left < UNEXPLAINED * self.floor:
            return None
        if left < REMAINDER * self.excess:
            return None
        return best_pair(self.evidence, self._gain_of(group[0]) if group else 0.0)

    def _left(self, group: list[Candidate]) -> float:
        """Excess that the best of a group leaves."""
        if not group:
            return self.excess
        return float(group[0].loss[self.evidence.role == FIT].mean()) - self.floor

    def credible(self, number: int) -> bool:
        """Tell whether a trial is large enough for what would still be unexplained with it."""
        unexplained = self.error - self.floor
        left = (1.0 - self.evidence.explained(number)) * self.error - self.floor
        if left <= PREVAILING * unexplained:
            return True
        return self.relative_size(number) >= SIZEABLE

    def relative_size(self, number: int) -> float:
        """Largest estimated size of a trial in units of the typical one."""
        trial = self.trial(number)
        values = trial.values(self.evidence.coefficients(number))
        return max(
            abs(value / trial.effect.parameter_of(name).default)
            for name, value in values.items()
            if trial.effect.parameter_of(name).default
        )

    def dependences(self) -> list[tuple[str, float]]:
        """Signals that a generic dependence is found on, and its gain, strongest first."""
        best: dict[str, float] = {}
        gains, p = self._general
        for dependence, share, chance in zip(self.generic, gains, p, strict=True):
            gain = share * min(1.0, self.error / self.unexplained)
            if gain > LEAST_GAIN and chance < SIGNIFICANT:
                signal = dependence.signal
                best[signal] = max(best.get(signal, 0.0), float(gain))
        return sorted(best.items(), key=lambda item: -item[1])

    @cached_property
    def _general(self) -> tuple[np.ndarray, np.ndarray]:
        """Gain and p value of every dependence; made only where somebody asks."""
        with np.errstate(all="ignore"):
            evidence = Evidence.of(self.parts, list(self.simulations), [], self.generic)
        gains = np.array([evidence.gain(k) for k in range(len(self.generic))])
        return gains, evidence.p_values()[0]

    def outside(self, best: Candidate | None) -> bool:
        """Tell whether a generic dependence explains the logs far better than the best effect."""
        found = self.dependences()
        if not found or found[0][1] < TELLING:
            return False
        if best is None:
            return True
        left = 1.0 - max(self.gains[best.number], self._gain_of(best))
        share = min(1.0, self.error / self.unexplained)
        return 1.0 - found[0][1] / share < OUTSIDE * left

    def helps(self, found: Candidate) -> bool:
        """Tell whether the refined effect still lowers the error of every kind of window."""
        roles = self.evidence.role
        kinds = [roles == role for role in (FIT, SELECT) if np.any(roles == role)]
        return all(
            found.loss[k].mean() < (1 - 0.5 * LEAST_GAIN) * self.loss[k].mean() for k in kinds
        )

    def _admissible(self) -> list[int]:
        """Trials that are significant with sizes that are possible."""
        return [
            k
            for k, trial in enumerate(self.evidence.trials)
            if (self.p[k] < SIGNIFICANT or self.gains[k] > OVERWHELMING)
            and trial.possible(self.evidence.coefficients(k), SLACK)
        ]

    def _gained(self, number: int) -> bool:
        """Tell whether it removes enough: of what is left, or of all where rollers may feign it."""
        share = 1.0 if self.wheels_agree else min(1.0, self.error / self.origin)
        return self.gains[number] * share > LEAST_GAIN

    def _named(self, number: int) -> bool:
        return not self.trial(number).effect.background and self.credible(number)

    def _gain_of(self, found: Candidate) -> float:
        fitted = self.evidence.role == FIT
        return 1.0 - found.loss[fitted].mean() / self.error


def _gain(evidence: Evidence, number: int) -> float:
    gain = evidence.gain(number)
    if not evidence.trials[number].effect.needs_time:
        return gain
    explained = evidence.explained(number)
    return max(gain, explained) if explained > CHANGING else gain
