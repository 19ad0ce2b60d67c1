"""What the channels of a log testify about signs and order, and which faults would explain it.

Wheel speeds, drive input and every measurement or command of the body motion are compared by their
fingerprints.  Faults considered: another arrangement of the wheel speeds, of the drive input, or of
both alike, and other axes of one source of body motion.

An arrangement is a signed order of wheels: which column holds which wheel, and with which sign.
"""

from __future__ import annotations

import itertools
from copy import copy
from dataclasses import dataclass

import numpy as np

from ident.doctor.correlation import CERTAIN, Correlation, Likeness, correlate, explained
from ident.doctor.record import Record
from ident.doctor.smoothing import BODY_SOURCES, Smooth
from ident.doctor.turns import QUARTER, RIGHT, TURNS, Turn, turn_by

MOST_WHEELS = 4  # beyond that only single swaps are considered, not all orders


@dataclass(frozen=True)
class Arrangement:
    """Column i of a log holds ``signs[i]`` times the signal of wheel ``order[i]``."""

    order: tuple[int, ...]
    signs: tuple[int, ...]

    @property
    def changed(self) -> tuple[int, ...]:
        """Columns that hold another wheel or the other sign."""
        return tuple(
            i for i, (k, s) in enumerate(zip(self.order, self.signs, strict=True))
            if k != i or s < 0
        )  # fmt: skip

    def undo(self, values: np.ndarray) -> np.ndarray:
        """Put columns into the order and signs of the platform."""
        result = np.empty_like(values)
        result[:, list(self.order)] = values * np.array(self.signs)
        return result

    def undo_vector(self, vector: np.ndarray) -> np.ndarray:
        """Do the same for one value a column."""
        return self.undo(vector[None])[0]

    def words(self, names: tuple[str, ...]) -> str:
        """Say it for people: ``fl has the other sign``, ``fl and fr are exchanged``."""
        parts, moved = [], [i for i, k in enumerate(self.order) if k != i]
        flipped = [names[i] for i in range(len(names)) if i not in moved and self.signs[i] < 0]
        if len(flipped) == len(names):
            parts.append("all wheels have the other sign")
        elif flipped:
            verb = "has" if len(flipped) == 1 else "have"
            parts.append(f"{', '.join(flipped)} {verb} the other sign")
        if len(moved) == 2 and all(self.signs[i] > 0 for i in moved):
            parts.append(f"{names[moved[0]]} and {names[moved[1]]} are exchanged")
        elif moved:
            listed = [
                f"{names[i]} holds {'-' if self.signs[i] < 0 else ''}{names[self.order[i]]}"
                for i in moved
            ]
            parts.append(", ".join(listed))
        return "; ".join(parts) or "as they should be"


def arrangements(count: int) -> list[Arrangement]:
    """All arrangements of ``count`` wheels, those that change least first."""
    if count <= MOST_WHEELS:
        orders = list(itertools.permutations(range(count)))
    else:
        orders = [tuple(range(count))]
        for i, k in itertools.combinations(range(count), 2):
            order = list(range(count))
            order[i], order[k] = k, i
            orders.append(tuple(order))
    found = [Arrangement(o, s) for o in orders for s in itertools.product((1, -1), repeat=count)]
    return sorted(found, key=lambda arrangement: len(arrangement.changed))


def fitting(candidates: list[Arrangement], table: Likeness, least: float) -> np.ndarray:
    """Tell for each candidate whether every column may resemble its wheel; NaN says nothing.

    Args:
        candidates: arrangements of n wheels.
        table: columns against wheels.
        least: cosine that counts as resemblance.
    """
    orders = np.array([candidate.order for candidate in candidates])
    signs = np.array([candidate.signs for candidate in candidates])
    columns = np.arange(orders.shape[1])
    found = signs * table.cosines[columns, orders] + CERTAIN * table.errors[columns, orders]
    return ~np.any(found <= least, axis=1)


def likeness(arrangement: Arrangement, table: Likeness) -> float:
    """The least resemblance of a column to its wheel; NaN says nothing.

    Args:
        arrangement: of n wheels.
        table: columns against wheels.
    """
    cosines = table.cosines
    found = np.array(arrangement.signs) * cosines[np.arange(len(cosines)), list(arrangement.order)]
    return float(np.min(found, where=np.isfinite(found), initial=1.0))


MIN_COSINE = 0.6  # cosine between fingerprints; rows of other mecanum wheels are at 1/3
MIN_R2 = 0.5  # fraction of the wheel speeds that a body motion must explain to be a witness
MIN_R2_OF_DRIVE = 0.3  # fraction of the drive input that the motion must explain to say anything
OBLIQUE = 0.2  # rad from a multiple of a quarter turn, beyond which a frame stands between two
REDUNDANT = 0.25  # last over next singular value of wheel speeds that shows their redundancy


@dataclass(frozen=True)
class Fault:
    """One way in which signs and order of a log may be wrong.

    Attributes:
        wheels, drive: how the columns of wheel speeds and of the drive input are arranged.
        source, turn: a source of body motion with other axes; "" for none.
    """

    wheels: Arrangement
    drive: Arrangement
    source: str = ""
    turn: Turn = RIGHT

    @property
    def size(self) -> tuple[int, int]:
        """Number of independent faults, then of the columns they touch."""
        parts = {a for a in (self.wheels, self.drive) if a.changed}
        columns = sum(len(a.changed) for a in parts) + self.turn.columns
        return len(parts) + bool(self.source), columns

    @property
    def of_source(self) -> bool:
        """Whether only a source of body motion is at fault, wheels and drive input are right."""
        return bool(self.source) and not self.wheels.changed and not self.drive.changed

    def words(self, record: Record, drive: str) -> str:
        """Say what is wrong."""
        names, parts = record.platform.wheel_names, []
        if self.wheels.changed and self.wheels == self.drive and drive:
            parts.append(f"wheel_velocity and {drive}: {self.wheels.words(names)}")
        else:
            if self.wheels.changed:
                parts.append(f"wheel_velocity: {self.wheels.words(names)}")
            if self.drive.changed:
                parts.append(f"{drive}: {self.drive.words(names)}")
        if self.source:
            parts.append(f"{self.source}: {self.turn.words(self.source)}")
        return " and ".join(parts)


class Witnesses:
    """The channels of a log that say something about signs, and how a fault would fit them."""

    def __init__(self, record: Record, signals: Smooth):
        self.J = record.platform.jacobian_array
        self.all = arrangements(len(self.J))
        self.step = float(np.median(np.diff(record.time[signals.rows])))
        self.wheels = signals.signals.get("wheel_velocity")
        self.wheel_rates = signals.rates.get("wheel_velocity")
        drives = [c for c in ("wheel_torque", "wheel_voltage") if c in signals.signals]
        self.drive = drives[0] if drives else ""
        self.force = signals.signals.get(self.drive)
        self.sources, self.silent = [], {}
        self.turns: dict[str, list[Turn]] = {}
        self._evidence: dict[tuple[str, str], Correlation] = {}
        self._agree: bool | None = None
        for source in BODY_SOURCES:
            # A command of zero is none; a measurement of zero is a witness.
            if source in signals.signals and (
                source != "reference" or np.any(signals.signals[source])
            ):
                self._listen(source, signals.signals[source], signals.rates[source])

    def _listen(self, source: str, motion: np.ndarray, rates: np.ndarray) -> None:
        heard = {}
        if self.wheels is not None:
            heard["wheels"] = correlate(self.wheels, motion, step=self.step)
        if self.force is not None:
            heard["drive"] = correlate(self.force, motion, rates, self.step)
        first, least = ("wheels", MIN_R2) if self.wheels is not None else ("drive", MIN_R2_OF_DRIVE)
        share = heard[first].share if first in heard else 0.0
        if share < least:
            self.silent[source] = share
            return
        self.sources.append(source)
        oblique = self._oblique(motion) or self._oblique_drive(motion, rates)
        self.turns[source] = [t for t in TURNS[1:] if not (oblique and t.rotates)] + oblique
        for kind, evidence in heard.items():
            if kind == "wheels" or evidence.share > MIN_R2_OF_DRIVE:
                self._evidence[source, kind] = evidence

    def _oblique(self, motion: np.ndarray) -> list[Turn]:
        """The frame of a source turned by no multiple of 90 deg, if the wheels say so."""
        if self.wheels is None:
            return []
        rolled = self.wheels @ np.linalg.pinv(self.J).T
        seen = np.linalg.lstsq(rolled[:, :2], motion[:, :2], rcond=None)[0].T
        angle = float(np.arctan2(seen[1, 0] - seen[0, 1], seen[0, 0] + seen[1, 1]))
        clear = abs((angle + QUARTER / 2) % QUARTER - QUARTER / 2) > OBLIQUE
        return [turn_by(angle)] if clear else []

    def _oblique_drive(self, motion: np.ndarray, rates: np.ndarray) -> list[Turn]:
        """The same by the drive input alone: a mass is the same forward and sideways."""
        if self.wheels is not None or self.force is None:
            return []
        columns = np.hstack([motion, rates])
        columns = columns - columns.mean(axis=0)
        pushed = self.force @ self.J[:, :2]
        found = np.linalg.lstsq(columns, pushed - pushed.mean(axis=0), rcond=None)[0].T
        mass = found[:, 3:5]
        angle = -float(np.arctan2(mass[1, 0] - mass[0, 1], mass[0, 0] + mass[1, 1]))
        clear = abs((angle + QUARTER / 2) % QUARTER - QUARTER / 2) > OBLIQUE
        return [turn_by(angle)] if clear else []

    def table(self, source: str, kind: str, turn: Turn = RIGHT) -> Likeness | None:
        """Resemblance of columns to wheels by one source, None where it is silent on them."""
        evidence = self._evidence.get((source, kind))
        return evidence and evidence.table(self.J @ turn.matrix.T, kind == "drive")

    def _fitting(self, kind: str, source: str, turn: Turn) -> list[Arrangement]:
        """Arrangements that agree with all sources, one of them turned."""
        tables = [self.table(s, kind, turn if s == source else RIGHT) for s in self.sources]
        return self._alike([table for table in tables if table is not None])

    def _alike(self, tables: list[Likeness]) -> list[Arrangement]:
        """Arrangements that all tables allow; the right one where nothing is said."""
        if not tables:
            return self.all[:1]
        fits = np.all([fitting(self.all, table, MIN_COSINE) for table in tables], axis=0)
        return [self.all[k] for k in np.flatnonzero(fits)]

    def faults(self) -> list[Fault]:
        """All faults that explain the log, the simplest ones only; the empty fault if it does.

        Fewest independent faults win.  Among those, a source of body motion with other axes comes
        before a rearrangement of good columns: where wheel speeds and drive input agree with each
        other they outvote it, and a command is outvoted by wheel speeds alone.
        """
        if self._undisputed():
            return [Fault(self.all[0], self.all[0])]
        found = self._with_sources() if self.sources else self._without_sources()
        least = min((fault.size[0] for fault in found), default=0)
        found = [fault for fault in found if fault.size[0] == least]
        groups = [[f for f in found if f.of_source], [f for f in found if not f.of_source]]
        if all(groups):
            mistaken = [f for f in groups[0] if f.source == "reference" or self.wheels_agree()]
            groups = [mistaken] if mistaken and self.wheels is not None else groups
        simplest = []
        for group in groups:
            columns = min((fault.size[1] for fault in group), default=0)
            simplest += [fault for fault in group if fault.size[1] == columns]
        return simplest

    def _undisputed(self) -> bool:
        """Whether all sources agree with the wheel speeds, and these with the drive input.

        What a command says about the drive input itself is hearsay then: the wheels know better.
        """
        if self.wheels is None or not self.sources:
            return False
        right = all(self.all[0] in self._fitting("wheels", s, RIGHT) for s in self.sources)
        return right and self.wheels_agree()

    def wheels_agree(self) -> bool:
        """Whether wheel speeds and drive input, as they stand, agree with each other."""
        if self._agree is None:
            self._agree = (
                self.wheels is not None
                and self.force is not None
                and self._drive_speaks()
                and self.all[0] in self._redundant()
                and self._drive_follows()
            )
        return self._agree

    def _drive_follows(self) -> bool:
        """Whether the drive input, as it stands, moves the wheels as they move.

        Wheel loops may press the wheels against each other, which moves nothing.  What is left
        without that must follow the wheels, and better than any other arrangement does with it.
        """
        inverse = np.linalg.pinv(self.J).T
        motion, rates = self.wheels @ inverse, self.wheel_rates @ inverse
        heard = correlate(self.force, motion, rates, self.step)
        table = heard.table(self.J, True)
        if table is None or self.all[0] in self._alike([table]):
            return True
        rolling = correlate(self.force @ self.J @ inverse.T, motion, rates, self.step)
        if rolling.rows is None or np.any(heard.axes & ~rolling.axes):
            return False
        best = max(likeness(arrangement, table) for arrangement in self.all)
        return likeness(self.all[0], rolling.table(self.J, True)) > max(MIN_COSINE, best)

    def _drive_speaks(self) -> bool:
        """Whether the wheel speeds explain enough of the drive input."""
        regressors = np.hstack([self.wheels, self.wheel_rates])
        return bool(np.median(explained(self.force, regressors)) > MIN_R2_OF_DRIVE)

    def without(self, source: str) -> Witnesses:
        """The same witnesses, one of them not heard."""
        fewer = copy(self)
        fewer.sources = [name for name in self.sources if name != source]
        return fewer

    def _with_sources(self) -> list[Fault]:
        found, cases = [], [("", RIGHT)]
        cases += [(source, turn) for source in self.sources for turn in self.turns[source]]
        for source, turn in cases:
            wheels = self._fitting("wheels", source, turn)
            drives = self._fitting("drive", source, turn)
            found += [Fault(w, d, source, turn) for w, d in _pairs(wheels, drives)]
            if not source and any(fault.size == (0, 0) for fault in found):
                break
        return found

    def _without_sources(self) -> list[Fault]:
        """Only the wheels' redundancy and the drive input speak; the drive decides by friction."""
        if self.wheels is None:
            return [Fault(self.all[0], self.all[0])]
        found = []
        speaks = self.force is not None and self._drive_speaks()
        inverse = np.linalg.pinv(self.J).T
        for wheels in self._redundant():
            if not speaks:
                found.append(Fault(wheels, self.all[0]))
                continue
            motion, rates = (wheels.undo(v) @ inverse for v in (self.wheels, self.wheel_rates))
            table = correlate(self.force, motion, rates, self.step).table(self.J, True)
            drives = self._alike([] if table is None else [table])
            found += [Fault(w, d) for w, d in _pairs([wheels], drives)]
            if any(fault.size == (0, 0) for fault in found):
                break
        return found

    def _redundant(self) -> list[Arrangement]:
        """Arrangements in which the wheel speeds have the redundancy of the platform."""
        _, spread, right = np.linalg.svd(
            self.wheels - self.wheels.mean(axis=0), full_matrices=False
        )
        left = np.linalg.svd(self.J)[0][:, 3:]
        if left.shape[1] != 1 or spread[-1] > REDUNDANT * spread[-2]:
            return self.all
        measured, expected = right[-1], left[:, 0]
        return [a for a in self.all if abs(a.undo_vector(measured) @ expected) > 0.9]


def _pairs(wheels: list[Arrangement], drives: list[Arrangement]):
    """Pairs worth considering: the simplest of each, and the same for both."""
    simple = [[a for a in group if len(a.changed) == len(group[0].changed)]
              for group in (wheels, drives) if group]  # fmt: skip
    if len(simple) < 2:
        return []
    return {*itertools.product(*simple), *((a, a) for a in set(wheels) & set(drives))}
