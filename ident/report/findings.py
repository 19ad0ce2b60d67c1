"""What the log doctor found, for text, page and JSON of every command that reads logs."""

from __future__ import annotations

from collections.abc import Iterable
from typing import Any

from ident.log import Log
from ident.report.page import Notes

# Logs of one finding that are listed by name.
LISTED = 4


def finding_lines(logs: Iterable[Log]) -> list[str]:
    """Each finding with the names of the logs it is about; what is alike is said once."""
    about: dict[str, list[str]] = {}
    for log in logs:
        for finding in log.findings:
            about.setdefault(str(finding), []).append(log.name)
    lines = []
    for words, names in about.items():
        more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
        lines.append(f"{', '.join(names[:LISTED])}{more}: {words}")
    return lines


def findings_json(logs: Iterable[Log]) -> list[dict[str, Any]]:
    """Findings with the name of their log, as ``--json`` writes them."""
    return [{"log": log.name} | finding.as_dict() for log in logs for finding in log.findings]


def findings_notes(logs: Iterable[Log]) -> Notes:
    """Findings on a page."""
    logs = list(logs)
    otherwise = f"Findings of the log doctor: nothing odd in {', '.join(log.name for log in logs)}."
    return Notes(finding_lines(logs), otherwise)


def accepted(logs: Iterable[Log]) -> dict[str, dict[str, list[str]]]:
    """What the user accepted of each log, for the provenance of a result; empty where nothing."""
    there = {log.source or log.name: list(log.accepted) for log in logs if log.accepted}
    return {"accepted": there} if there else {}
