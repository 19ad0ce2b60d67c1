"""What a converted log remembers: its robot, how it was recorded, and what was done to it.

CSV holds it in comments, ``# platform: {...}``, Parquet in its metadata under the same names.
"""

from __future__ import annotations

import json
import re
from collections.abc import Iterable, Mapping
from typing import TYPE_CHECKING

from ident.doctor.finding import Finding
from ident.doctor.table import Table
from youbot_env.effects import get_effect
from youbot_env.model_file import platform_from_dict, platform_to_dict

if TYPE_CHECKING:
    from ident.log import Log

NAMES = ("recording", "platform", "accept", "findings", "made")
COMMENT = re.compile(rf"^#+[ \t]*({'|'.join(NAMES)}):[ \t]*(.*?)[ \t]*$".encode(), re.MULTILINE)


def remember(log: Log, made: str, accept: Iterable[str] = ()) -> dict[str, str]:
    """Entries to write beside a log, each one line.

    Args:
        log: as it was read.
        made: how the file came to be, in words.
        accept: names of findings that the log is used in spite of.
    """
    found = [
        [f.severity, f.what, f"{log.source}, {f.where}", f.remedy, f.name, f.geometry]
        for f in log.findings
    ]
    entries = {
        "made": made,
        "platform": json.dumps(platform_to_dict(log.platform)),
        "recording": ", ".join(_declared(log)),
        "accept": ", ".join(accept),
        "findings": json.dumps(found) if found else "",
    }
    return {name: " ".join(text.split()) for name, text in entries.items() if text}


def recall(table: Table, entries: Iterable[tuple[str, str]] | Mapping[str, str]) -> None:
    """Give a table what its file remembers.

    Raises:
        ValueError: an entry that nobody could have written so; says which.
    """
    for name, text in dict(entries).items() if isinstance(entries, Mapping) else entries:
        try:
            if name == "recording":
                table.recording += [item for item in re.split(r"[,;]\s*|\s+", text) if item]
            elif name == "accept":
                table.accept = (*table.accept, *(w for w in re.split(r"[,\s]+", text) if w))
            elif name == "platform":
                table.platform = platform_from_dict(json.loads(text) if "{" in text else text)
            elif name == "findings":
                table.recalled += [
                    Finding(*map(str, one[:5]), geometry=len(one) > 5 and one[5] is True)
                    for one in json.loads(text)
                ]
        except (ValueError, TypeError, RecursionError) as error:
            raise ValueError(f"{name}: {text[:80]!r} cannot be read ({error})") from error


def comments(data: bytes) -> list[tuple[str, str]]:
    """Entries in the comments of a text table."""
    return [
        (name.decode(), text.decode("utf-8", "replace")) for name, text in COMMENT.findall(data)
    ]


def _declared(log: Log) -> list[str]:
    """How a log was recorded, as ``ident.log`` reads it."""
    words = []
    for name, values in log.recording.items():
        for flat, value in values.items():
            choices = get_effect(name).parameter_of(flat).choices
            words.append(f"{name}.{flat}={choices[int(value)] if choices else repr(float(value))}")
    return words
