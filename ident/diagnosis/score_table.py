"""What the logs say about every trial, from one table of inner products by window.

Rows are free-run errors of a base model, columns the traces of its own parameters and of all
trials.  Once their inner products are known window by window, any fit to any set of windows is a
small linear system: errors on windows that were left out, on other motions, and the scatter between
windows from which significance is judged, cost microseconds each.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from ident.diagnosis.lack_of_fit import Dependence
from ident.diagnosis.partial_regression import Reduced, wild_p_values
from ident.diagnosis.settings import SETTINGS
from ident.diagnosis.splits import FIT, SELECT, Part
from ident.diagnosis.trials import Trial
from ident.parameter_space import free_directions, value_bounds
from ident.residuals import independent, settled
from ident.scopes import parameter_scope
from ident.sensitivity import Linearised
from youbot_env.model import Model


@dataclass(frozen=True, eq=False)
class ScoreTable:
    """Inner products of errors and traces.

    Attributes:
        model: the base model of the first log.
        trials: effects that were tried; a number below counts them and, after them, dependences.
        dependences: generic functions that compete with them.
        columns: column numbers of each trial and dependence; what belongs to a record has columns
            of its own for every log, those of the first log first.
        directions: (P, base) what a base column moves of the first log's model.
        grams: (W, n, n) inner products in every window; the base parameters' columns come first,
            the error last.  Columns are scaled to equal length.
        scale: (n - 1,) lengths before scaling.
        role: (W,) role of each window.
        log: (W,) number of its log.
        run: (W,) number of the run of that log.
        base: number of base columns.
    """

    model: Model
    trials: tuple[Trial, ...]
    dependences: tuple[Dependence, ...]
    columns: tuple[np.ndarray, ...]
    directions: np.ndarray
    grams: np.ndarray
    scores: np.ndarray
    scale: np.ndarray
    role: np.ndarray
    log: np.ndarray
    run: np.ndarray
    base: int

    @classmethod
    def of(
        cls,
        parts: list[Part],
        simulations: list[Linearised],
        found: list[Trial],
        generic: list[Dependence],
    ) -> ScoreTable:
        """Evaluate trials along simulated logs.

        Args:
            parts: the logs and the roles of their windows.
            simulations: each log simulated with the base model.
            found: the trials.
            generic: the dependences.
        """
        model, count = simulations[0].model, len(parts)
        directions = free_directions(model, parts[0].free(model))
        moving = np.any(directions != 0, axis=1)
        of_record = np.array([parameter_scope(model, name) == "record" for name in model.names()])
        own_columns = np.any(directions[of_record] != 0, axis=0)
        grams, role, log, tested = [], [], [], []
        for number, (part, sim) in enumerate(zip(parts, simulations, strict=True)):
            values = averaged(sim, sim.value_columns(moving)) @ directions[moving]
            own = np.concatenate(
                [values[..., ~own_columns], _placed(values[..., own_columns], number, count)], -1
            )
            made = [dependence.make(sim) for dependence in generic]
            wrenches = [wrench for wrenches in made for wrench in wrenches]
            error = averaged(sim, sim.residual[..., None])
            sizes = [trial.mix.shape[1] * (count if trial.effect.scope() == "record" else 1)
                     for trial in found]  # fmt: skip
            base = own.shape[-1]
            rows = np.empty((*error.shape[:-1], base + sum(sizes) + len(wrenches) + 1))
            rows[..., :base], rows[..., -1:], at = own, error, base
            for group in _groups(sim, found, [len(trial.pairs) for trial in found]):
                pairs = [pair for trial in group for pair in trial.on(sim.model)]
                traces = averaged(sim, sim.model_columns(pairs))
                for trial in group:
                    trace, traces = traces[..., : len(trial.pairs)], traces[..., len(trial.pairs) :]
                    trace = trace @ trial.mix
                    if trial.effect.scope() == "record":
                        trace = _placed(trace, number, count)
                    rows[..., at : at + trace.shape[-1]] = trace
                    at += trace.shape[-1]
            for group in _groups(sim, wrenches, [1] * len(wrenches)):
                rows[..., at : at + len(group)] = averaged(sim, sim.force_columns(group))
                at += len(group)
            rows *= part.weights[:, None]
            flat = rows.reshape(len(rows), -1, rows.shape[-1])
            grams.append(flat.transpose(0, 2, 1) @ flat)
            if part.windows(FIT).any():
                fitted = np.flatnonzero(part.windows(FIT))
                group = independent(part.log, part.begin[fitted])
                each = len(fitted) * parts_of(rows, sim)
                together = np.repeat(group, each // len(group))
                if group[-1] + 1 == len(group):  # windows hold several independent stretches
                    together = np.arange(each)
                tested.append((rows, fitted, sim, together))
            role.append(part.role)
            log.append(np.full(len(part.role), number))
        grams = np.concatenate(grams)
        sizes, columns = sizes + [len(w) for w in made], []
        start = base
        for size in sizes:
            columns.append(np.arange(start, start + size))
            start += size
        scale = np.sqrt(np.diagonal(grams.sum(axis=0)))[:-1]
        scale = np.where(scale > 0, scale, 1.0)
        by = np.append(scale, 1.0)
        grams = grams / np.outer(by, by)
        role, log = np.concatenate(role), np.concatenate(log)
        everything = grams[role == FIT].sum(axis=0)
        share = Reduced.of(everything, everything, base).share
        scores = np.concatenate(
            [
                summed(_scores(rows, fitted, sim, by, share), together)
                for rows, fitted, sim, together in tested
            ]
        )
        return cls(
            model,
            tuple(found),
            tuple(generic),
            tuple(columns),
            np.concatenate(
                [directions[:, ~own_columns], _placed(directions[:, own_columns], 0, count)], 1
            ),
            grams,
            scores,
            scale,
            role,
            log,
            np.concatenate([part.run for part in parts]),
            base,
        )

    def total(self, windows: np.ndarray) -> np.ndarray:
        """Inner products summed over windows (W,) bool."""
        return self.grams[windows].sum(axis=0)

    @cached_property
    def _fitted(self) -> Reduced:
        """Fit and errors on the windows for fitting."""
        everything = self.total(self.role == FIT)
        return Reduced.of(everything, everything, self.base)

    @cached_property
    def _blocks(self) -> list[Reduced]:
        """Fits that leave out one block of consecutive windows each, and errors on that block."""
        return self._left_out(FIT, _in_blocks)

    @cached_property
    def _transfer(self) -> list[Reduced]:
        """Fit to all windows for fitting, errors on those for choosing; empty without such."""
        choosing = self.role == SELECT
        if not choosing.any():
            return []
        return [Reduced.of(self.total(self.role == FIT), self.total(choosing), self.base)]

    @cached_property
    def _inside(self) -> list[list[Reduced]]:
        """Fits within single logs that leave out windows here and there, for what does not last.

        A drift in time, or a patch of floor, is no business of another log or of another quarter.
        """
        every = [self._left_out(FIT, _here_and_there)]
        if np.count_nonzero(self.role == SELECT) >= 2 * SETTINGS.table_blocks:
            every.append(self._left_out(SELECT, _here_and_there))
        return every

    @cached_property
    def _each(self) -> list[list[Reduced]]:
        """Fits that leave out blocks of the fitted logs, and some windows of the other one."""
        return [self._blocks, *self._inside[1:]]

    def _left_out(self, role: int, number: Callable[[np.ndarray], np.ndarray]) -> list[Reduced]:
        found = []
        for log in np.unique(self.log[self.role == role]):
            inside = np.flatnonzero((self.log == log) & (self.role == role))
            block = number(self.run[inside])
            for k in np.unique(block):
                out = np.zeros(len(self.log), bool)
                out[inside[block == k]] = True
                rest = (self.role == role) & ~out
                found.append(Reduced.of(self.total(rest), self.total(out), self.base))
        return found

    def gain(self, number: int, beside: int | None = None) -> float:
        """Share of squared error that a trial or dependence removes where it was not fitted.

        Of an effect the smaller of two: on blocks left out of the fit, and on another motion if
        there is one.  Dependences of one place or time are judged within each log.

        Args:
            number: the trial or dependence.
            beside: a trial that is fitted with it; the share is then what both remove.
        """
        local = self.dependence(number) is not None and self.dependence(number).local
        ways = self._inside if local else [self._blocks, self._transfer]
        if number < len(self.trials) and self.trials[number].effect.scope() == "record":
            # What belongs to a record is no business of another one: each has its own size.
            ways = self._inside if self.trials[number].effect.needs_time else self._each
        ridge = 0.0 if self.dependence(number) is None else SETTINGS.ridge
        mine, ends = self.columns[number] - self.base, self.ends(number)
        gains = []
        for way in filter(None, ways):
            after = sum(self._beyond(part, beside).loss(mine, ridge, ends) for part in way)
            gains.append(1.0 - after / sum(part.before for part in way))
        # A generic function that explains most of a motion it was not fitted to need not hold in
        # size on another one; that it does not spoil that is enough.
        if (
            self.dependence(number) is not None
            and gains[0] > SETTINGS.plain_share
            and gains[-1] > 0.0
        ):
            return gains[0]
        return min(gains)

    def gains_by_record(self, number: int) -> list[float]:
        """Share of squared error that a trial removes in left-out windows of the fitted records.

        And, where another record has windows enough for choosing, of that one.
        """
        mine, ends = self.columns[number] - self.base, self.ends(number)
        return [
            1.0 - sum(part.loss(mine, ends=ends) for part in way) / sum(part.before for part in way)
            for way in self._each
        ]

    def ends(self, number: int) -> tuple[float, float]:
        """Ends of the coefficients, as columns are scaled here.

        The trace of a law that is not linear holds near the size it was made for, and where few
        windows show it the others must not choose a size far from that.
        """
        if number >= len(self.trials) or self.trials[number].linear:
            return -np.inf, np.inf
        low, high = SETTINGS.near_sizes
        scale = float(self.scale[self.columns[number][0]])
        return low * scale, high * scale

    def dependence(self, number: int) -> Dependence | None:
        """The dependence of a number; None where it stands for an effect."""
        behind = number - len(self.trials)
        return self.dependences[behind] if behind >= 0 else None

    def _beyond(self, table: Reduced, beside: int | None) -> Reduced:
        """A table with the columns of one more trial always fitted."""
        if beside is None:
            return table
        return table.beyond(self.columns[beside] - self.base)

    def _with(self, beside: int | None) -> Reduced:
        """Fit and errors on the windows for fitting, beside a trial that is always fitted."""
        if beside not in self._known:
            self._known[beside] = self._beyond(self._fitted, beside)
        return self._known[beside]

    @cached_property
    def _known(self) -> dict[int | None, Reduced]:
        return {}

    def explained(self, number: int, beside: int | None = None) -> float:
        """Share of squared error that a trial removes on the windows that it is fitted to.

        With another one beside it, the share that both remove.
        """
        mine = self.columns[number] - self.base
        loss = self._with(beside).loss(mine, ends=self.ends(number))
        return 1.0 - loss / self._fitted.before

    def coefficients(self, number: int, beside: int | None = None) -> np.ndarray:
        """Coefficients (k,) of mixed columns, in units of the columns, for the first log."""
        mine, table = self.columns[number], self._with(beside)
        found = table.solve(mine - self.base, ends=self.ends(number)) / self.scale[mine]
        return found[: self._width(number)]

    def _width(self, number: int) -> int:
        """Columns of a trial or dependence that speak of the first log."""
        if number < len(self.trials):
            return self.trials[number].mix.shape[1]
        return len(self.columns[number])

    def base_values(self, number: int) -> np.ndarray:
        """(P,) values of the base model when a trial is fitted with them, where it still holds."""
        mine, table = self.columns[number] - self.base, self._fitted
        b = table.solve(mine, ends=self.ends(number))
        moved = (table.share[:, -1] - table.share[:, mine] @ b) / self.scale[: self.base]
        values = np.array(self.model.values()) + self.directions @ moved
        return np.clip(values, *value_bounds(self.model, SETTINGS.nearby_factors))

    def scatter(self, number: int) -> np.ndarray:
        """(k, k) covariance of the first log's coefficients, from the scatter between stretches.

        Small effects leave the errors of the base model in the scores, as a test of their absence
        should; after an effect is added its interval comes from the refined model.
        """
        mine = self.columns[number]
        bread = self._fitted.inverse(mine - self.base) / np.outer(
            self.scale[mine], self.scale[mine]
        )
        scores = self.scores[:, mine - self.base] * self.scale[mine]
        width = self._width(number)
        return (bread @ (scores.T @ scores) @ bread)[:width, :width]

    def strength(self, number: int, size: np.ndarray) -> float:
        """Share of the error that one unit of a size (k,) of the mixed columns amounts to.

        ``size`` says what the size is per unit of each coefficient; what the base parameters
        absorb does not count.
        """
        mine = self.columns[number][: self._width(number)] - self.base
        along = np.linalg.pinv(size[None])[:, 0] * self.scale[mine + self.base]
        inner = self._fitted.fit[np.ix_(mine, mine)]
        return float(along @ inner @ along) / self._fitted.before

    def p_values(self, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
        """P values of everything tried, by effect and adjusted for all effects."""
        families = [t.identifier for t in self.trials] + [""] * len(self.dependences)
        scores = [self.scores[:, columns - self.base] for columns in self.columns]
        return wild_p_values(scores, np.array(families), seed)


def _in_blocks(run: np.ndarray) -> np.ndarray:
    """(W,) block of each window: of runs whole ones, else consecutive windows.

    Runs that follow each other are often of one kind; every block holds some of every kind.
    """
    number = np.unique(run, return_inverse=True)[1]
    if number[-1] + 1 >= SETTINGS.table_blocks:
        return number % SETTINGS.table_blocks
    return np.arange(len(run)) * SETTINGS.table_blocks // len(run)


def _here_and_there(run: np.ndarray) -> np.ndarray:
    """(W,) block of each window, every so many windows one of the same."""
    return np.arange(len(run)) % SETTINGS.table_blocks


def _placed(columns: np.ndarray, number: int, count: int) -> np.ndarray:
    """Columns (..., k) of one log at their place among those of all logs (..., k count)."""
    width = columns.shape[-1]
    placed = np.zeros((*columns.shape[:-1], width * count))
    placed[..., number * width : (number + 1) * width] = columns
    return placed


def parts_of(rows: np.ndarray, sim: Linearised) -> int:
    """How many stretches each window of rows (W, l, m, n) is cut into."""
    return max(1, round(rows.shape[1] * samples_a_row(sim) * sim.log.dt / SETTINGS.stretch))


def stretches(rows: np.ndarray, sim: Linearised) -> np.ndarray:
    """Rows (W, l, m, n) of windows as rows (stretches, r, n)."""
    windows, length, _, count = rows.shape
    parts = parts_of(rows, sim)
    length -= length % parts
    return rows[:, :length].reshape(windows * parts, -1, count)


def samples_a_row(sim: Linearised) -> int:
    """Samples that are averaged to one row."""
    return max(1, round(1.0 / (SETTINGS.table_rate * sim.log.dt)))


def score(rows: np.ndarray, share: np.ndarray, base: int) -> np.ndarray:
    """(stretches, n - base - 1) inner products of columns and errors, less what the base takes."""
    left = rows[..., base:] - rows[..., :base] @ share
    return np.einsum("srk,sr->sk", left[..., :-1], left[..., -1], optimize=True)


def summed(scores: np.ndarray, together: np.ndarray) -> np.ndarray:
    """Scores (stretches, k) summed over what goes together, by ascending numbers (stretches,)."""
    first = np.flatnonzero(np.diff(together, prepend=-1))
    return np.add.reduceat(scores, first, axis=0)


def _groups(sim: Linearised, asked: Sequence, columns: Sequence[int]) -> Iterator[list]:
    """What is asked in groups, in order, whose columns in full have few bytes together.

    In full they have all samples, and are there several times while they are made.
    """
    most, group, count = max(1, SETTINGS.most_bytes // sim.residual.nbytes), [], 0
    for one, more in zip(asked, columns, strict=True):
        if group and count + more > most:
            yield group
            group, count = [], 0
        group.append(one)
        count += more
    if group:
        yield group


def _scores(
    rows: np.ndarray, fitted: np.ndarray, sim: Linearised, by: np.ndarray, share: np.ndarray
) -> np.ndarray:
    """``score`` of the stretches of the fitted windows, some windows at a time."""
    some = max(1, SETTINGS.most_bytes // rows[0].nbytes)
    return np.concatenate([
        score(stretches(rows[fitted[k : k + some]], sim) / by, share, len(share))
        for k in range(0, len(fitted), some)
    ])  # fmt: skip


def averaged(sim: Linearised, rows: np.ndarray) -> np.ndarray:
    """Settled samples (W, L, m, n) averaged to about ``table_rate``, as rows (W, l, m, n)."""
    rows = settled(sim, rows)
    together = samples_a_row(sim)
    count = rows.shape[1] // together
    rows = rows[:, : count * together].reshape(len(rows), count, together, *rows.shape[2:])
    # A mean over k samples of white noise has k times less variance: each row stands for k.
    rows = rows.mean(axis=2) * np.sqrt(together)
    return np.nan_to_num(rows)
