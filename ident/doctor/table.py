"""What a loader hands to the doctor: the columns of a file, unchecked."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from ident.doctor.finding import Finding
from youbot_env.platform import Platform


@dataclass
class Table:
    """Columns as they stand in a file, before any check.

    Attributes:
        columns: by name in the file; text (polars Series of strings) or numbers (NumPy), N each.
        lines: (N,) place of each row in the file, for messages.
        unit_of_place: what ``lines`` counts ("line" of a text file, "row" or "message").
        names: log names of foreign columns, ``{log name: column}``.
        findings: what the loader had to put right.
        aliases: other names of columns, for mappings: ``{(channel, name): column}``; an empty
            channel is any.
        usual: ``{log name: column}`` of the robot's logs; a column may be absent.
        accept: names of findings that are no reason to refuse the log.
        units: declared units of columns, by name.
        unnamed: joints of which none could be told to be a wheel.
        platform: the wheel table that the file names, or None.
        foreign: what makes it look like a log of another robot than the youBot; empty for none.
        recalled: findings that a converted log remembers.
        recording: what the file declares about how it was recorded, ``EFFECT=VALUE`` each.
        cuts: (N,) rows before which the loader left some out; None where it read them all.
    """

    columns: dict[str, Any]
    lines: np.ndarray
    unit_of_place: str = "line"
    names: dict[str, str] = field(default_factory=dict)
    findings: list[Finding] = field(default_factory=list)
    recalled: list[Finding] = field(default_factory=list)
    recording: list[str] = field(default_factory=list)
    cuts: np.ndarray | None = None
    aliases: dict[tuple[str, str], str] = field(default_factory=dict)
    usual: dict[str, str] = field(default_factory=dict)
    accept: tuple[str, ...] = ()
    units: dict[str, str] = field(default_factory=dict)
    unnamed: tuple[str, ...] = ()
    platform: Platform | None = None
    foreign: str = ""

    def tell(self, what: str, where: str, remedy: str) -> None:
        """Add a finding about something that was put right."""
        self.findings.append(Finding("fixed", what, where, remedy))
