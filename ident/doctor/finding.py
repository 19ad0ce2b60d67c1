"""What the doctor says about a log, names of its findings, and the error that stops a bad log."""

from __future__ import annotations

import difflib
from collections.abc import Iterable
from dataclasses import dataclass
from typing import Literal

Severity = Literal["fixed", "warning", "error"]

# One short name for one kind of finding; `--accept NAME` and docs/logs.md use them.
NAMES = {
    "file": "the file cannot be read as it stands",
    "excerpt": "a file so long that stretches of it are used",
    "columns": "names of columns",
    "cells": "missing values, text in place of numbers",
    "clock": "time stamps, or columns that come late",
    "short": "the log is short",
    "rest": "the robot, or an axis of it, hardly moves",
    "velocities": "no velocities",
    "drive": "the drive input",
    "duty": "duty cycles",
    "battery": "voltage of the battery",
    "platform": "another robot than that of the wheel table",
    "failed_reads": "one number again and again where a read failed",
    "overflow": "values that wrap round at the limits of an integer",
    "resolution": "coarse steps",
    "stuck_sensor": "a sensor that stands still",
    "saturation": "a signal at its limit",
    "slow_sensor": "a sensor slower than the log",
    "frozen_rows": "noisy channels that repeat the same digits",
    "pieces": "pieces of a few samples",
    "spikes": "gross errors of single samples",
    "signs": "signs and order of columns",
    "roller_hand": "rollers that form an O where the wheel table says X",
    "witness": "nothing, or little, that confirms the wheels",
    "world_frame": "velocities in the axes of the world",
    "turned_frame": "a frame turned against the robot's",
    "units": "units",
    "mass": "torques that would move an unusual mass",
    "braking": "torques against the speed all the time",
    "slip": "wheel speeds that do not roll together",
    "offset": "a sensor whose zero is off",
    "scales": "factors between wheels and other witnesses of the motion",
    "lever": "yaw against the lever l + h of the wheel table",
    "wheel_scale": "one wheel against the others",
    "pose_jumps": "a pose that jumps",
    "differs": "a log to judge by of another load, floor or battery than the fitted ones",
    "wheel_odometry": "a pose that was computed from the wheels",
}


@dataclass(frozen=True)
class Finding:
    """One thing noticed in a log.

    Attributes:
        severity: ``fixed`` (the log was corrected, with certainty), ``warning`` (unusual, left as
            it is) or ``error`` (the log cannot be used as it stands).
        what: what was found, with the value.
        where: row and column in the file.
        remedy: what was done, or what the user can do.
        name: kind of finding, one of ``NAMES``.
        acceptable: whether a log is left when an error is accepted.
        geometry: what was found bends the kinematics, and with them every effect that might be
            missing.
    """

    severity: Severity
    what: str
    where: str
    remedy: str
    name: str = "file"
    acceptable: bool = False
    geometry: bool = False

    def __str__(self) -> str:
        return f"{self.severity}: {self.message}"

    @property
    def message(self) -> str:
        """The finding in a line, and how to use the log in spite of it."""
        text = f"{self.where}: {self.what}; {self.remedy}"
        if self.geometry:
            return f"{text}; no effect is named on it (--accept {self.name} if it is right)"
        if self.severity != "error":
            return text
        if self.acceptable:
            return f"{text}; to use it all the same: --accept {self.name}"
        return f"{text} (--accept cannot help: no log would be left)"

    def as_dict(self) -> dict[str, str | bool]:
        """What ``--json`` writes."""
        return {
            "name": self.name,
            "severity": self.severity,
            "what": self.what,
            "where": self.where,
            "remedy": self.remedy,
            "geometry": self.geometry,
        }


def check_accepted(names: Iterable[str]) -> tuple[str, ...]:
    """Names of findings to accept, each known.

    Raises:
        ValueError: an unknown name; the message lists the names.
    """
    names = tuple(names)
    for name in names:
        if name not in NAMES:
            near = difflib.get_close_matches(name, NAMES, 1)
            hint = f"did you mean {near[0]!r}? " if near else ""
            raise ValueError(f"--accept {name}: no finding has this name; {hint}the names are "
                             f"{', '.join(sorted(NAMES))}")  # fmt: skip
    return names


class LogError(ValueError):
    """A log that cannot be used; the message names place, value and remedy of each error.

    Attributes:
        findings: the errors, and everything noticed before them.
    """

    def __init__(self, source: str, findings: tuple[Finding, ...] | list[Finding]):
        self.source, self.findings = source, tuple(findings)
        errors = [finding for finding in self.findings if finding.severity == "error"]
        lines = [finding.message for finding in errors or self.findings]
        super().__init__("\n".join([f"{source} cannot be used:", *lines]))
