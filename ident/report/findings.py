"""What the log doctor found, for text, page and JSON of every command that reads logs."""

from __future__ import annotations

import re
from collections.abc import Iterable
from typing import Any

from ident.doctor.finding import Finding
from ident.log import Log
from ident.report.page import Notes

# Logs of one finding that are listed by name.
LISTED = 4


def finding_lines(logs: Iterable[Log]) -> list[str]:
    """Each finding with the names of the logs it is about; what is alike is said once.

    Of many logs with the same finding in other numbers or columns the first stands for all.
    """
    about: dict[str, list[str]] = {}
    kinds: dict[tuple[str, str, str], list[str]] = {}
    for log in logs:
        for finding in log.findings:
            words = str(finding)
            about.setdefault(words, []).append(log.name)
            alike = kinds.setdefault(_kind(finding), [])
            if words not in alike:
                alike.append(words)
    lines = []
    for alike in kinds.values():
        names = list(dict.fromkeys(name for words in alike for name in about[words]))
        if len(alike) > 1 and len(names) > LISTED:
            first = about[alike[0]][0]
            also = f"so in {first}, in the others with numbers or columns of their own"
            lines.append(f"{_listed(names)}: {alike[0]} ({also})")
        else:
            lines += [f"{_listed(about[words])}: {words}" for words in alike]
    return lines


def _kind(finding: Finding) -> tuple[str, str, str]:
    """What findings have in common that say the same in other numbers, of other columns."""
    start = re.split(r"[:;(]", finding.what, maxsplit=1)[0]
    return finding.severity, finding.name, re.sub(r"[-+]?\d[\w.,]*", "#", start)


def _listed(names: list[str]) -> str:
    more = f" and {len(names) - LISTED} more" if len(names) > LISTED else ""
    return f"{', '.join(names[:LISTED])}{more}"


def findings_json(logs: Iterable[Log]) -> list[dict[str, Any]]:
    """Findings with the name of their log, as ``--json`` writes them."""
    return [{"log": log.name} | finding.as_dict() for log in logs for finding in log.findings]


def findings_notes(logs: Iterable[Log]) -> Notes:
    """Findings on a page."""
    logs = list(logs)
    otherwise = f"Findings of the log doctor: nothing odd in {_listed([x.name for x in logs])}."
    return Notes(finding_lines(logs), otherwise)


def accepted(logs: Iterable[Log]) -> dict[str, dict[str, list[str]]]:
    """What the user accepted of each log, for the provenance of a result; empty where nothing."""
    there = {log.source or log.name: list(log.accepted) for log in logs if log.accepted}
    return {"accepted": there} if there else {}
