"""How often the diagnosis names the right effect, and how often it should have been silent."""

from __future__ import annotations

from dataclasses import replace
from fnmatch import fnmatch
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from youbot_cli import console
from youbot_cli.names import PARTS

if TYPE_CHECKING:
    from ident.benchmark.cases import PARTS, Case
    from ident.benchmark.runner import Task

RESULTS = Path("runs/benchmark_diagnosis.jsonl")
BASELINES = ("pysindy", "sysidentpy")
# Cases of each kind that the baselines get: robots of every effect at full size, quiet robots.
BASELINE_SEEDS, BASELINE_NOTHING = 3, 30


def benchmark(
    quick: Annotated[bool, typer.Option("--quick", help="A few dozen cases, a few minutes.")] = (
        False
    ),
    conditions: Annotated[
        str,
        typer.Option(help="own (this project's defaults) or foreign (as other laboratories log)."),
    ] = "own",
    part: Annotated[
        list[str] | None,
        typer.Option(help=f"Only this part ({', '.join(PARTS)}); may be repeated."),
    ] = None,
    cases: Annotated[
        str | None,
        typer.Option(metavar="PATTERN", help="Only cases like this, as 'single/floor_slope/*@1'."),
    ] = None,
    baselines: Annotated[
        bool,
        typer.Option("--baselines", help="Also PySINDy and SysIdentPy on some of the logs."),
    ] = False,
    jobs: Annotated[int, typer.Option(min=1, max=1024, help="Processes, one thread each.")] = 1,
    cluster: console.Cluster = None,
    resume: Annotated[
        bool, typer.Option(help="Go on where an earlier run of the same code stopped.")
    ] = True,
    finished: Annotated[
        bool, typer.Option("--finished", help="Run nothing, count what is finished already.")
    ] = False,
    results: Annotated[
        Path, typer.Option(metavar="FILE", help="Where finished cases are kept.")
    ] = RESULTS,
    show: Annotated[
        bool, typer.Option("--list", help="Print the cases and stop; nothing is run.")
    ] = False,
    seed: console.Seed = 0,
    json_file: console.Json = None,
    force: console.Force = False,
    report: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write the page with tables and figures.")
    ] = None,
) -> None:
    """Hide effects in simulated robots, diagnose each from its logs, and count what came out.

    Finished cases are kept in a file, so a run that was stopped goes on where it was; results of
    other code do not count.  The full run takes hours.
    """
    from ident.benchmark.runner import run
    from ident.benchmark.store import Store, code_version
    from ident.benchmark.summary import summarise

    chosen = choose(quick, part, cases, seed, conditions)
    if show:
        console.out.print("\n".join(case.id for case in chosen))
        return
    page = None if report is None else report / "index.html"
    console.check_writable(json_file, page, results)  # finished cases are added to the last
    console.check_results(json_file, page, force=force)
    tasks: list[Task] = [("diagnosis", case) for case in chosen]
    if baselines:
        require_baselines()
        tasks += [(method, case) for method in BASELINES for case in chosen if compared(case)]
    store = Store(results, code_version())
    if finished:
        there = store.finished()
        tasks = [task for task in tasks if (task[0], task[1].id) in there]
        if not tasks:
            raise ValueError(f"{results} holds no finished case of this code; leave out --finished")
    try:
        with console.progress("cases", len(tasks), "cases") as tell:
            records = run(tasks, store, jobs, tell, resume, cluster=cluster)
    except KeyboardInterrupt:
        raise console.Stopped(
            f"stopped; finished cases are kept in {console.shown(results)}: the same command goes "
            "on from there"
        ) from None
    found = summarise(records)
    found["version"] = store.version
    found["provenance"] = console.provenance(seed)
    console.write_json(json_file, found)
    print_tables(found)
    if report is not None:
        from ident.benchmark.page import benchmark_page

        written = benchmark_page(found).write(report)
        console.out.print(f"\npage: {console.shown(written)}", soft_wrap=True)
    if found["failed"]:
        raise console.CheckFailed(
            f"{len(found['failed'])} of {len(tasks)} cases failed; their tracebacks are in "
            f"{console.shown(results)}, and they are tried again next time"
        )


def choose(
    quick: bool,
    parts: list[str] | None,
    pattern: str | None,
    seed: int,
    conditions: str = "own",
) -> list[Case]:
    """Cases of the plan that the options leave.

    Raises:
        ValueError: unknown conditions, an unknown part, or nothing is left.
    """
    from ident.benchmark.cases import FOREIGN_PLAN, FULL_PLAN, QUICK_PLAN

    for name in parts or ():
        if name not in PARTS:
            raise ValueError(f"--part {name}: choose one of {', '.join(PARTS)}")
    plans = {"own": FULL_PLAN, "foreign": FOREIGN_PLAN}
    if conditions not in plans:
        raise ValueError(f"--conditions {conditions}: choose one of {', '.join(plans)}")
    plan = plans[conditions]
    if quick:
        plan = replace(QUICK_PLAN, foreign=plan.foreign)
    left = [case for case in plan.cases(seed) if not parts or case.part in parts]
    if pattern is not None:
        left = [case for case in left if fnmatch(case.id, pattern)]
    if not left:
        raise ValueError(
            f"--cases {pattern}: no case is left; names are like single/floor_slope/003@0.5, "
            "--list prints them"
        )
    return left


def compared(case: Case) -> bool:
    """Tell whether the baselines are asked about a case."""
    if case.part == "nothing":
        return case.number < BASELINE_NOTHING
    return case.part == "single" and case.size == 1.0 and case.number < BASELINE_SEEDS


def require_baselines() -> None:
    """Refuse, before hours of work, baselines that are not installed."""
    import importlib.util

    missing = [name for name in BASELINES if importlib.util.find_spec(name) is None]
    if missing:
        raise ValueError(
            f"--baselines needs {' and '.join(missing)}: pip install pysindy, and pip install "
            "--no-deps sysidentpy (it asks for an older NumPy and does not need it), or leave the "
            "option out"
        )


def print_tables(found: dict) -> None:
    """Say what was found: targets, then every effect at every size."""
    rows = []
    for target in found.get("targets", ()):
        met = "yes" if target["met"] else "NO"
        rows.append((target["what"], *figure(target), target["target"], met))
    if rows:
        console.table("Targets", ("", "figure", "95 % interval", "of", "target", "met"), rows)
    rows = []
    for effect, sizes in found.get("effects", {}).items():
        for size, rates in sizes.items():
            shown = (percent(rates[key]) for key in ("exact", "group", "wrong", "silent"))
            rows.append((effect, size, rates["exact"]["count"], *shown))
    if rows:
        console.out.print()
        heads = ("effect", "size", "logs", "exact %", "group %", "wrong %", "silent %")
        console.table("Effects of the library", heads, rows)
    rows = []
    for method, pair in found["baselines"].items():
        for who, rates in ((method, pair["itself"]), ("diagnosis, same logs", pair["diagnosis"])):
            shown = (percent(rates["hidden"][key]) for key in ("exact", "first", "extra"))
            rows.append((who, percent(rates["nothing"]["named"]), *shown))
    if rows:
        console.out.print()
        heads = ("baseline", "false alarms %", "exact %", "first name right %", "too many names %")
        console.table("Baselines", heads, rows)
    for failed in found["failed"]:
        console.err.print(
            f"failed: {failed['case']} ({failed['method']}): {failed['error']}", soft_wrap=True
        )


def figure(target: dict) -> tuple[str, str, str]:
    """A figure, its interval and its count as they are printed."""
    if target["count"] is None:
        return shown(target), "", ""
    low, high = target["ci95"]
    return shown(target), f"{100 * low:.1f} ... {100 * high:.1f}", str(target["count"])


def shown(target: dict) -> str:
    """The value of a target with its unit."""
    scale, unit = (100, " %") if target["unit"] == "%" else (1, f" {target['unit']}")
    return f"{scale * target['value']:.3g}{unit}".rstrip()


def percent(rate: dict) -> str:
    """A rate in percent, a dash where it is one of nothing."""
    return "-" if rate["value"] is None else f"{100 * rate['value']:.1f}"


def start() -> None:
    """Run the command line."""
    console.run(benchmark, "--quick --jobs 2 --report report/benchmark")
