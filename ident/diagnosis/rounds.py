"""One round: what could be added to a model, whether anything passes, and what fits best."""

from __future__ import annotations

from dataclasses import dataclass
from functools import cached_property
from itertools import combinations, compress

import numpy as np

from ident.contradiction import rolling_variance, wheels_agree
from ident.diagnosis.forces import feigned
from ident.diagnosis.lack_of_fit import Dependence
from ident.diagnosis.refit import Candidate, beside, candidate, ranked, window_losses
from ident.diagnosis.score_table import ScoreTable
from ident.diagnosis.screening import Shortlist, best_pair, gain_of
from ident.diagnosis.settings import SETTINGS
from ident.diagnosis.splits import FIT, SELECT, Part, by_axis, judges
from ident.diagnosis.trials import Trial, trials
from ident.distributions import rank_correlation_chance
from ident.free_run import cut_windows
from ident.log import Log
from ident.noise_floor import noise_floor
from ident.residuals import independent
from ident.sensitivity import Linearised, window_length
from ident.unexplained import UNEXPLAINED
from youbot_env.effects import get_effect
from youbot_env.model import Model


@dataclass(frozen=True, eq=False)
class Round:
    """What the logs say on top of one model.

    Attributes:
        parts: the logs.
        judged: the same, weighed so that gains on one axis count whatever is left on the others.
        simulations: each simulated with the model.
        table: about every trial.
        generic: dependences that compete with them.
        gains, p: of each.
        origin: mean squared scaled error, with what every robot has explained, of which an effect
            must remove a part.
        unexplained: the same before anything was explained, for generic dependences.
        noise, rolling: mean squared scaled error that noise explains, and that rolling may.
        loss: (W,) mean squared scaled error of each window.
    """

    parts: list[Part]
    judged: list[Part]
    simulations: tuple[Linearised, ...]
    table: ScoreTable
    generic: list[Dependence]
    gains: np.ndarray
    p: np.ndarray
    noise: float
    rolling: float
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
        model, logs = simulations[0].model, [part.log for part in parts]
        with np.errstate(all="ignore"):
            judged = by_axis(parts, simulations)
            table = ScoreTable.of(judged, list(simulations), trials(model, logs), [])
        gains = np.array([gain_of(table, k) for k in range(len(table.columns))])
        weights = parts[0].weights
        noise = noise_floor(simulations[0]).of(weights)
        p = table.p_values(seed)[1]
        loss = window_losses(parts, simulations)
        error = float(loss[table.role == FIT].mean())
        rolling = float(np.mean(rolling_variance(parts[0].log) * weights**2))
        return cls(parts, judged, simulations, table, generic, gains, p, noise, rolling, loss,
                   origin or error, unexplained or error)  # fmt: skip

    @cached_property
    def wheels_agree(self) -> bool:
        """Whether the wheels rule out that rollers and slip leave an error."""
        return wheels_agree(self.parts[0].log)

    @cached_property
    def shortlist(self) -> Shortlist:
        """The trials, judged."""
        # What rollers leave within a turn is gone from the means that forces are judged by.
        agree = self.wheels_agree or self.parts[0].log.window is not None
        return Shortlist(self.table, self.gains, self.p, self.error, self.noise, self.origin,
                         agree)  # fmt: skip

    @property
    def logs(self) -> list[Log]:
        """The logs."""
        return [part.log for part in self.parts]

    @property
    def steady(self) -> bool:
        """Whether the error of the fitted windows has nothing to do with how the robot moves.

        Windows in which the robot moves faster, or is driven harder, then have no more of it.
        """
        squares = []
        for part in self.parts:
            index = cut_windows(part.log, self.model, window_length(part.log)).index
            motion = part.log.velocity() / part.log.velocity().std(axis=0)
            drive = part.log.command / part.log.command.std()
            squares += [[np.mean(x[rows] ** 2) for x in (motion, drive)] for rows in index]
        fitted = self.table.role == FIT
        loss, squares = self.loss[fitted], np.array(squares)[fitted]
        chances = [rank_correlation_chance(loss, column) for column in squares.T]
        return bool(min(chances) > SETTINGS.uneven_chance and loss.std() < loss.mean())

    @property
    def model(self) -> Model:
        """The model of this round."""
        return self.table.model

    @property
    def floor(self) -> float:
        """Mean squared scaled error that is no fault of a model."""
        return self.noise + self.rolling

    @property
    def error(self) -> float:
        """Mean squared scaled error of the fitted windows."""
        return float(self.loss[self.table.role == FIT].mean())

    @property
    def excess(self) -> float:
        """Mean squared scaled error of the fitted windows beyond ``floor``."""
        return max(self.error - self.floor, 0.0)

    def trial(self, number: int) -> Trial:
        """The trial of a number."""
        return self.table.trials[number]

    def choose(self, present: Candidate | None = None) -> list[Candidate]:
        """The group that fits best, refined; empty where nothing passes.

        Args:
            present: an effect that was chosen before and has to be beaten.
        """
        found = [candidate(self.parts, self.table, k) for k in self.shortlist.worth_refining()]
        found = [c for c in found if c is not None and self.helps(c)]
        if present is not None and present.identifier not in {c.identifier for c in found}:
            found.append(present)
        return self.group(found)

    def group(self, found: list[Candidate]) -> list[Candidate]:
        """Those of some refined effects that fit best and cannot be told apart, best first."""
        if not found:
            return []
        losses = [self._judge(c) for c in found]
        return ranked(found, losses, self.table.role, self._before, self._independent)

    @cached_property
    def _before(self) -> np.ndarray:
        """(W,) losses without any effect, as candidates are judged."""
        return window_losses(self.judged, self.simulations)

    def _judge(self, found: Candidate) -> np.ndarray:
        """(W,) losses with a candidate, as candidates are judged."""
        return window_losses(self.judged, found.simulations)

    @property
    def _independent(self) -> np.ndarray:
        """(W,) number of what is independent, windows or whole runs, that each belongs to."""
        numbers, count = [], 0
        for part in self.parts:
            numbers.append(count + independent(part.log, part.begin))
            count = int(numbers[-1][-1]) + 1
        return np.concatenate(numbers)

    def pair(self, group: list[Candidate]) -> tuple[int, int] | None:
        """Two effects that explain far more than the best one; None where one is enough.

        Only errors that are neither noise nor rolling are worth two effects at once.
        """
        left = max(self._left(group), 0.0)
        if not self.wheels_agree or left < UNEXPLAINED * self.floor:
            return None
        if left < SETTINGS.remainder * self.excess:
            return None
        return best_pair(self.table, self._gain_of(group[0]) if group else 0.0)

    def _left(self, group: list[Candidate]) -> float:
        """Excess that the best of a group leaves."""
        left = 1.0 - self._gain_of(group[0]) if group else 1.0
        return left * self.error - self.floor

    def dependences(self) -> list[tuple[str, float]]:
        """Signals that a generic dependence is found on, and its gain, strongest first."""
        best: dict[str, float] = {}
        if (
            self.error < (1.0 + SETTINGS.clear_excess) * self.noise
        ):  # measured torques depend on their own noise
            return []
        gains, p = self._general
        for dependence, share, chance in zip(self.generic, gains, p, strict=True):
            gain = share * min(1.0, self.error / self.unexplained)
            if gain > SETTINGS.least_gain and chance < SETTINGS.significant:
                signal = dependence.signal
                best[signal] = max(best.get(signal, 0.0), float(gain))
        return sorted(best.items(), key=lambda item: -item[1])

    @cached_property
    def _general(self) -> tuple[np.ndarray, np.ndarray]:
        """Gain and p value of every dependence; made only where somebody asks."""
        with np.errstate(all="ignore"):
            table = ScoreTable.of(self.parts, list(self.simulations), [], self.generic)
        gains = np.array([table.gain(k) for k in range(len(self.generic))])
        return gains, table.p_values()[0]

    def outside(self, best: Candidate | None) -> bool:
        """Tell whether a generic dependence explains the logs far better than the best effect."""
        found = self.dependences()
        if not found or found[0][1] < SETTINGS.dependence_gain:
            return False
        if best is None:
            return True
        left = 1.0 - max(self.gains[best.number], self._gain_of(best))
        share = min(1.0, self.error / self.unexplained)
        return 1.0 - found[0][1] / share < SETTINGS.dependence_left * left

    def helps(self, found: Candidate) -> bool:
        """Tell whether the refined effect still lowers the error of every kind of window.

        The forces at the measured motion must not speak against it.
        """
        least, asked = min(self.gains_of(found)), compress(found.simulations, self._asked(found))
        return least > 0.5 * SETTINGS.least_gain and not feigned(list(asked), found.identifier)

    def hoped(self) -> list[Candidate]:
        """One effect or two that gain when refined what linear traces do not foretell.

        Friction that stops a robot hides what happens on another axis, so that two may show that
        neither shows alone.  Windows decide that nothing was fitted to; without any there is no
        hope, nor in errors that noise or rolling may leave: these feign such gains.

        Returns:
            None, one, or two, the second refined beside the first.
        """
        if not np.any(self.table.role == SELECT) or self.excess < UNEXPLAINED * self.floor:
            return []
        tried = [candidate(self.parts, self.table, k) for k in self.shortlist.hopeful()]
        alone = [c for c in tried if c is not None and self.helps(c)]
        gains = {c.identifier: self.gains_of(c) for c in alone}
        alone.sort(key=lambda c: -gains[c.identifier][-1])
        best = [c for c in alone if self._enough(c)][:1]
        most = gains[best[0].identifier][-1] if best else 0.0
        for first, second in combinations(alone, 2):
            both = beside(self.parts, first, second)
            # On windows that may judge both: what happens once need not happen in another log.
            now, *halves = (self.gains_of(c, first, second) for c in (both, first, second))
            needed = min(
                (_further(gain, max(half)) for gain, *half in zip(now, *halves, strict=True)),
                default=0.0,
            )
            if (
                needed > 0.5 * SETTINGS.least_gain
                and _further(now[-1], most) > SETTINGS.least_gain
                and self._enough(both)
                and self.helps(both)
            ):
                best, most = [first, both], now[-1]
        return best

    def _enough(self, found: Candidate) -> bool:
        return all(map(self.shortlist.enough, self.gains_of(found)))

    def gains_of(self, found: Candidate, *judged: Candidate) -> list[float]:
        """Shares of squared error that a refined effect removes, of every kind of window.

        Args:
            found: the effect.
            judged: effects that the windows may judge; the effect itself if left.
        """
        now, before, roles = self._judge(found), self._before, self.table.role
        logs = np.all([self._asked(one) for one in judged or (found,)], axis=0)
        asked = np.repeat(logs, [len(part.role) for part in self.parts])
        kinds = [(roles == role) & asked for role in (FIT, SELECT)]
        return [1.0 - float(now[k].mean() / before[k].mean()) for k in kinds if k.any()]

    def _asked(self, found: Candidate) -> list[bool]:
        """Which logs may judge an effect."""
        return [judges(part, get_effect(found.identifier)) for part in self.parts]

    def _gain_of(self, found: Candidate) -> float:
        return self.gains_of(found)[0]


def _further(gain: float, before: float) -> float:
    """Share of what one gain leaves that a larger one removes."""
    return 1.0 - (1.0 - gain) / (1.0 - before)
