"""Run cases and print the table of docs/robustness.md, or replay one case."""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
import time
from collections import Counter
from dataclasses import asdict
from pathlib import Path

from fuzz.cases import FAULTS, OUTCOMES, Case, draw, judge
from fuzz.originals import lay_out, originals
from fuzz.silent import RIGHT, WRONG, serve_silent
from fuzz.watch import HANG, run


def main() -> int:
    parser = argparse.ArgumentParser(prog="python -m fuzz", description=__doc__)
    parser.add_argument("--cases", type=int, default=1000, help="how many")
    parser.add_argument("--first", type=int, default=0, help="index of the first")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--replay", type=int, metavar="INDEX", help="one case, in this process")
    parser.add_argument("--keep", type=Path, metavar="DIR", help="with --replay: its files")
    parser.add_argument("--silent", action="store_true", help="identify logs that changed untold")
    parser.add_argument(
        "--json", type=Path, metavar="FILE", help="every case is added here, a line each"
    )
    chosen = parser.parse_args()
    if chosen.replay is not None:
        return replay(chosen.seed, chosen.replay, chosen.keep)
    began, cases = time.perf_counter(), []
    serve, faults = (serve_silent, (*FAULTS, WRONG)) if chosen.silent else (None, FAULTS)
    # Identification takes seconds.
    hang = 6 * HANG if chosen.silent else HANG
    for case in run(chosen.seed, range(chosen.first, chosen.first + chosen.cases), serve, hang):
        cases.append(case)
        if chosen.json is not None:  # at once: a long run may be stopped
            with chosen.json.open("a") as file:
                file.write(json.dumps(asdict(case)) + "\n")
        if case.outcome in faults:
            again = (
                f"--silent --cases 1 --first {case.index}"
                if chosen.silent
                else (f"--replay {case.index}")
            )
            print(f"\n{case.outcome}: --seed {chosen.seed} {again}\n"
                  f"{case.kind}, {case.spoiled}\n{case.detail[-1500:]}", flush=True)  # fmt: skip
        if sys.stderr.isatty():
            print(f"\r{len(cases)}/{chosen.cases}", end="", file=sys.stderr)
    print(table(cases))
    seconds = time.perf_counter() - began
    print(f"seed {chosen.seed}, {len(cases)} cases from {chosen.first} on, {seconds:.0f} s")
    return int(any(case.outcome in faults for case in cases))


def table(cases: list[Case]) -> str:
    """Counts by kind and outcome, as Markdown."""
    counts = Counter((case.kind, case.outcome) for case in cases)
    heads = [*OUTCOMES, *FAULTS]
    if any(case.outcome in (RIGHT, WRONG) for case in cases):
        heads = [*OUTCOMES[:3], RIGHT, WRONG, *FAULTS]
    lines = [f"| file | cases | {' | '.join(heads)} |", "|---|" + "---|" * (len(heads) + 1)]
    for kind in [*dict.fromkeys(sorted(case.kind for case in cases)), "all"]:
        row = [sum(n for (k, o), n in counts.items() if o == outcome and kind in (k, "all"))
               for outcome in heads]  # fmt: skip
        lines.append(f"| {kind} | {sum(row)} | {' | '.join(map(str, row))} |")
    return "\n".join(lines)


def replay(seed: int, index: int, keep: Path | None) -> int:
    """Run one case here, with its whole traceback; its files stay in ``keep``."""
    with tempfile.TemporaryDirectory() as folder:
        spoiled = draw(originals(Path(folder)), seed, index)
        if keep is not None:
            lay_out(spoiled.files, keep)
        print(f"{spoiled.original.kind}: {', '.join(spoiled.steps)}", flush=True)
        case = judge(spoiled, index, Path(folder))
    print(f"{case.outcome}\n{case.detail}")
    return int(case.outcome in FAULTS)


if __name__ == "__main__":
    sys.exit(main())
