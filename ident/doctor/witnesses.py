"""What the channels of a log testify about signs and order, and which faults would explain it.

Wheel speeds, drive input and every measurement or command of the body motion are compared by their
fingerprints.  Faults considered: another arrangement of the wheel speeds, of the drive input, or of
both alike, and other signs of the axes of one source of body motion.
"""

from __future__ import annotations

import itertools
from copy import copy
from dataclasses import dataclass, field

import numpy as np

from ident.doctor.arrangement import Arrangement, arrangements, fitting
from ident.doctor.evidence import Evidence, explained, hear
from ident.doctor.record import Record
from ident.doctor.smoothing import BODY_SOURCES, Smooth

ALIKE = 0.6  # cosine between fingerprints; rows of other mecanum wheels are at 1/3
SPEAKS = 0.5  # fraction of the wheel speeds that a body motion must explain to be a witness
DRIVES = 0.3  # fraction of the drive input that the motion must explain to say anything
REDUNDANT = 0.25  # last over next singular value of wheel speeds that shows their redundancy
FLIPS = [np.array(flip) for flip in itertools.product((1, -1), repeat=3)]
BODY_COLUMNS = {
    "body_velocity": ("V_X", "V_Y", "yaw rate"),
    "reference": ("V_X", "V_Y", "yaw rate"),
    "pose": ("x", "y", "yaw"),
}


@dataclass(frozen=True)
class Fault:
    """One way in which signs and order of a log may be wrong.

    Attributes:
        wheels, drive: how the columns of wheel speeds and of the drive input are arranged.
        source, flip: a source of body motion with other signs of its axes; "" for none.
    """

    wheels: Arrangement
    drive: Arrangement
    source: str = ""
    flip: tuple[int, ...] = field(default=(1, 1, 1))

    @property
    def size(self) -> tuple[int, int]:
        """Number of independent faults, then of the columns they touch."""
        parts = {a for a in (self.wheels, self.drive) if a.changed}
        columns = sum(len(a.changed) for a in parts) + sum(sign < 0 for sign in self.flip)
        return len(parts) + bool(self.source), columns

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
            axes = [n for n, s in zip(BODY_COLUMNS[self.source], self.flip, strict=True) if s < 0]
            parts.append(f"{self.source}: {', '.join(axes)} with the other sign")
        return " and ".join(parts)


class Witnesses:
    """The channels of a log that say something about signs, and how a fault would fit them."""

    def __init__(self, record: Record, signals: Smooth):
        self.J = record.platform.jacobian_array
        self.all = arrangements(len(self.J))
        self.wheels = signals.signals.get("wheel_velocity")
        self.wheel_rates = signals.rates.get("wheel_velocity")
        drives = [c for c in ("wheel_torque", "wheel_voltage") if c in signals.signals]
        self.drive = drives[0] if drives else ""
        self.force = signals.signals.get(self.drive)
        self.sources, self.silent = [], {}
        self._evidence: dict[tuple[str, str], Evidence] = {}
        for source in BODY_SOURCES:
            # A command of zero is none; a measurement of zero is a witness.
            if source in signals.signals and (
                source != "reference" or np.any(signals.signals[source])
            ):
                self._listen(source, signals.signals[source], signals.rates[source])

    def _listen(self, source: str, motion: np.ndarray, rates: np.ndarray) -> None:
        heard = {}
        if self.wheels is not None:
            heard["wheels"] = hear(self.wheels, motion)
        if self.force is not None:
            heard["drive"] = hear(self.force, motion, rates)
        first, least = ("wheels", SPEAKS) if self.wheels is not None else ("drive", DRIVES)
        share = heard[first].share if first in heard else 0.0
        if share < least:
            self.silent[source] = share
            return
        self.sources.append(source)
        for kind, evidence in heard.items():
            if kind == "wheels" or evidence.share > DRIVES:
                self._evidence[source, kind] = evidence

    def cosines(self, source: str, kind: str, flip=(1, 1, 1)) -> np.ndarray | None:
        """Resemblance of columns to wheels by one source, None where it is silent on them."""
        evidence = self._evidence.get((source, kind))
        return evidence and evidence.table(self.J * np.array(flip), kind == "drive")

    def _fitting(self, kind: str, source: str, flip: tuple[int, ...]) -> list[Arrangement]:
        """Arrangements that agree with all sources, one of them flipped."""
        tables = [self.cosines(s, kind, flip if s == source else (1, 1, 1)) for s in self.sources]
        return self._alike([table for table in tables if table is not None])

    def _alike(self, tables: list[np.ndarray]) -> list[Arrangement]:
        """Arrangements that all tables allow; the right one where nothing is said."""
        if not tables:
            return self.all[:1]
        fits = np.all([fitting(self.all, table, ALIKE) for table in tables], axis=0)
        return [self.all[k] for k in np.flatnonzero(fits)]

    def faults(self) -> list[Fault]:
        """All faults that explain the log, the simplest ones only; the empty fault if it does.

        Fewest independent faults win.  Fewer columns decide only between arrangements of wheels:
        a robot seen from its other end is as likely as a reference with another sign.
        """
        found = self._with_sources() if self.sources else self._without_sources()
        least = min((fault.size[0] for fault in found), default=0)
        simplest = []
        for of_source in (False, True):
            group = [f for f in found if f.size[0] == least and bool(f.source) == of_source]
            columns = min((fault.size[1] for fault in group), default=0)
            simplest += [fault for fault in group if fault.size[1] == columns]
        return simplest

    def without(self, source: str) -> Witnesses:
        """The same witnesses, one of them not heard."""
        fewer = copy(self)
        fewer.sources = [name for name in self.sources if name != source]
        return fewer

    def _with_sources(self) -> list[Fault]:
        found, cases = [], [("", (1, 1, 1))]
        cases += [(source, tuple(flip.tolist())) for source in self.sources for flip in FLIPS[1:]]
        for source, flip in cases:
            wheels = self._fitting("wheels", source, flip)
            drives = self._fitting("drive", source, flip)
            found += [Fault(w, d, source, flip) for w, d in _pairs(wheels, drives)]
            if not source and any(fault.size == (0, 0) for fault in found):
                break
        return found

    def _without_sources(self) -> list[Fault]:
        """Only the wheels' redundancy and the drive input speak; the drive decides by friction."""
        if self.wheels is None:
            return [Fault(self.all[0], self.all[0])]
        found = []
        speaks = self.force is not None and np.median(
            explained(self.force, np.hstack([self.wheels, self.wheel_rates]))
        ) > DRIVES  # fmt: skip
        inverse = np.linalg.pinv(self.J).T
        for wheels in self._redundant():
            if not speaks:
                found.append(Fault(wheels, self.all[0]))
                continue
            motion, rates = (wheels.undo(v) @ inverse for v in (self.wheels, self.wheel_rates))
            table = hear(self.force, motion, rates).table(self.J, True)
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
