"""The working copy of a log while the doctor examines it."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from ident.doctor.finding import Finding, LogError
from youbot_env.platform import Platform


@dataclass
class Record:
    """Channels of a log on their way to SI units and paper signs.

    Attributes:
        source: file name, for messages.
        platform: wheel table.
        kt: torque constant of a motor, N m/A, or None where not given.
        gear: motor turns per wheel turn, or None.
        accept: names of findings that are no reason to refuse the log.
        time: (N,) as found, then s.
        lines: (N,) place of each sample in the file.
        unit_of_place: what ``lines`` counts.
        channels: (N, k) arrays by channel name.
        columns: names in the file, by channel.
        header: all columns of the file.
        units: declared unit of each log name that was found; empty where none was.
        breaks: (N,) true where a sample does not follow from the one before.
        findings: what was noticed so far.
        derived: what was computed from the channels; emptied whenever one changes.
    """

    source: str
    platform: Platform
    time: np.ndarray
    lines: np.ndarray
    unit_of_place: str = "line"
    kt: float | None = None
    gear: float | None = None
    accept: tuple[str, ...] = ()
    channels: dict[str, np.ndarray] = field(default_factory=dict)
    columns: dict[str, tuple[str, ...]] = field(default_factory=dict)
    header: tuple[str, ...] = ()
    units: dict[str, str] = field(default_factory=dict)
    breaks: np.ndarray = field(default_factory=lambda: np.zeros(0, bool))
    findings: list[Finding] = field(default_factory=list)
    derived: dict = field(default_factory=dict, repr=False)

    def __post_init__(self) -> None:
        if not len(self.breaks):
            self.breaks = np.zeros(len(self.time), bool)

    def get(self, channel: str) -> np.ndarray | None:
        """Return a channel, or None where the log has none."""
        return self.channels.get(channel)

    def set(self, channel: str, values: np.ndarray) -> None:
        """Replace the values of a channel."""
        self.channels[channel] = values
        self.derived.clear()

    def leave_out(self, channel: str) -> None:
        """Forget a channel."""
        del self.channels[channel]
        self.derived.clear()

    @property
    def dt(self) -> float:
        """Median sample time, s."""
        return float(np.median(np.diff(self.time)))

    def place(self, row: int, channel: str | None = None, column: int = 0) -> str:
        """Say where a sample stands in the file."""
        text = f"{self.unit_of_place} {self.lines[row]}"
        return f"{text}, column {self.columns[channel][column]}" if channel else text

    def name(self, channel: str, columns: list[int] | np.ndarray | None = None) -> str:
        """Names in the file of (some of) the columns of a channel."""
        names = self.columns[channel]
        chosen = names if columns is None else [names[int(k)] for k in columns]
        return ("column " if len(chosen) == 1 else "columns ") + ", ".join(chosen)

    def fixed(self, name: str, what: str, where: str, remedy: str) -> None:
        """Tell about a correction that was made."""
        self.findings.append(Finding("fixed", what, where, remedy, name))

    def warn(self, name: str, what: str, where: str, remedy: str, geometry: bool = False) -> None:
        """Tell about something unusual that was left as it is.

        Args:
            name: kind of finding.
            what, where, remedy: see ``Finding``.
            geometry: it bends the kinematics, unless the user accepts it.
        """
        if name in self.accept:
            what, geometry = f"accepted: {what}", False
        self.findings.append(Finding("warning", what, where, remedy, name, geometry=geometry))

    def refuse(self, name: str, what: str, where: str, remedy: str, final: bool = False) -> bool:
        """Note an error, at which the examination stops when the present check ends.

        Args:
            name: kind of finding.
            what, where, remedy: see ``Finding``.
            final: no log is left, so it cannot be accepted.

        Returns:
            Whether the log is refused; where the user accepts the finding it is told instead.
        """
        if name in self.accept and not final:
            self.findings.append(
                Finding("warning", f"accepted: {what}", where, "used as it is", name)
            )
            return False
        self.findings.append(Finding("error", what, where, remedy, name, acceptable=not final))
        return True

    @property
    def accepted(self) -> tuple[str, ...]:
        """Names of the findings that would have counted, had the user not accepted them."""
        there = {f.name for f in self.findings if f.what.startswith("accepted: ")}
        return tuple(name for name in self.accept if name in there)

    def stop_on_error(self) -> None:
        """Raise ``LogError`` when an error was noted."""
        if any(finding.severity == "error" for finding in self.findings):
            raise LogError(self.source, self.findings)

    def drop(self, rows: np.ndarray, split: bool) -> None:
        """Leave samples out.

        Args:
            rows: (N,) true for samples that go.
            split: whether the log is broken there.
        """
        keep = ~rows
        breaks = self.breaks.copy()
        if split:
            breaks[1:] |= rows[:-1] & keep[1:]
        self.time, self.lines, self.breaks = self.time[keep], self.lines[keep], breaks[keep]
        self.channels = {name: array[keep] for name, array in self.channels.items()}
        self.derived.clear()

    def reorder(self, order: np.ndarray) -> None:
        """Put the samples into another order."""
        self.time, self.lines = self.time[order], self.lines[order]
        self.channels = {name: array[order] for name, array in self.channels.items()}
        self.derived.clear()


def runs(flags: np.ndarray) -> list[tuple[int, int]]:
    """Stretches ``[begin, end)`` in which flags are true."""
    edges = np.diff(np.concatenate([[0], flags.astype(np.int8), [0]]))
    return list(
        zip(np.flatnonzero(edges == 1).tolist(), np.flatnonzero(edges == -1).tolist(), strict=True)
    )
