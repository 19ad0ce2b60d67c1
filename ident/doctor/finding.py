"""What the doctor says about a log, and the error that stops a bad one."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

Severity = Literal["fixed", "warning", "error"]


@dataclass(frozen=True)
class Finding:
    """One thing noticed in a log.

    Attributes:
        severity: ``fixed`` (the log was corrected, with certainty), ``warning`` (unusual, left as
            it is) or ``error`` (the log cannot be used as it stands).
        what: what was found, with the value.
        where: row and column in the file.
        remedy: what was done, or what the user can do.
    """

    severity: Severity
    what: str
    where: str
    remedy: str

    def __str__(self) -> str:
        return f"{self.severity}: {self.where}: {self.what}; {self.remedy}"


class LogError(ValueError):
    """A log that cannot be used; the message names place, value and remedy of each error.

    Attributes:
        findings: the errors, and everything noticed before them.
    """

    def __init__(self, source: str, findings: tuple[Finding, ...] | list[Finding]):
        self.source, self.findings = source, tuple(findings)
        errors = [finding for finding in self.findings if finding.severity == "error"]
        lines = [f"{e.where}: {e.what}; {e.remedy}" for e in errors or self.findings]
        super().__init__("\n".join([f"{source} cannot be used:", *lines]))
