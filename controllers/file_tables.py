"""The tables of all files for people, written from the schemas that readers check by.

``python -m controllers.file_tables`` prints docs/files.md.
"""

from __future__ import annotations

from controllers.rl_policy import FILE, NETWORK, NORMALISATION, TASK
from youbot_env import schema
from youbot_env.schema import Section

INTRODUCTION = """\
# Files

Written by `python -m controllers.file_tables > docs/files.md`; do not edit by hand.

What the files hold that are read and written. An entry of YAML that is not listed is refused, and
so is one that is needed and missing, and a number that is not finite or outside its range; the
message names the file, the entry, the value and the range. Ranges are inclusive and far beyond any
robot: they keep slips of the pen and damaged files out, and say nothing of what is likely.
Logs: [logs.md](logs.md); platforms of your own: [add_a_platform.md](add_a_platform.md).
"""
SECTIONS = (
    schema.MODEL, schema.PARAMETERS, schema.PARAMETER, schema.PLATFORM, schema.WHEEL,
    schema.MOTION, schema.SINE, FILE, NETWORK, TASK, NORMALISATION,
)  # fmt: skip


def file_tables() -> str:
    """Return docs/files.md: one table for each section, as Markdown."""
    return INTRODUCTION + "".join(_table(section) for section in SECTIONS)


def _table(section: Section) -> str:
    rows = [("entry", "meaning", "range", "needed"), ("---",) * 4]
    rows += [
        (f"`{entry.name}`", entry.meaning, entry.span, "yes" if entry.needed else "")
        for entry in section.entries
    ]
    return f"\n## {section.title}\n\n" + "".join(f"| {' | '.join(row)} |\n" for row in rows)


if __name__ == "__main__":
    print(file_tables(), end="")
