"""The page of the benchmark: targets, every effect, what is taken for what, baselines."""

from __future__ import annotations

from typing import Any

import numpy as np

from ident.benchmark.cases import FULL
from ident.benchmark.score import ROLLING
from ident.report import look
from ident.report.page import Grid, Notes, Page, Picture, Section

VERDICTS = ("nothing_missing", "outside_library", "cannot_say")
LABELLED = 5


@look.figure(4.6)
def power_picture(canvas, effects: dict, sizes: dict) -> None:
    """Right group against size, one line an effect and one for all."""
    axis = canvas.add_subplot()
    order = sorted(sizes, key=float)
    x = np.array([float(size) for size in order])
    last = {}
    for effect, rates in effects.items():
        if not all(size in rates for size in order):
            continue
        y = [100 * rates[size]["group"]["value"] for size in order]
        axis.plot(x, y, color=look.MEASURED, alpha=0.45, linewidth=1.0)
        last[effect] = y[-1]
    middle = [100 * sizes[size]["group"]["value"] for size in order]
    low, high = ([100 * sizes[size]["group"]["ci95"][end] for size in order] for end in (0, 1))
    axis.fill_between(x, low, high, color=look.IDENTIFIED, alpha=0.2, linewidth=0)
    axis.plot(x, middle, color=look.IDENTIFIED, linewidth=2.4, marker="o")
    weakest = sorted(last, key=last.get)[:LABELLED]
    place = -np.inf
    for effect in sorted(weakest, key=last.get):
        if last[effect] > 95:
            continue
        place = max(last[effect], place + 5.5)  # labels do not overlap
        axis.annotate(effect.replace("_", " "), (x[-1], last[effect]), (1.03 * x[-1], place),
                      va="center", fontsize=9, color="#5a6069", annotation_clip=False)  # fmt: skip
    axis.set_xscale("log", base=2)
    axis.set_xticks(x, [f"{value:g}" for value in x])
    axis.set_xlim(x[0] / 1.04, x[-1] * 1.3)
    axis.set_ylim(-3, 103)
    axis.set_xlabel("size of the hidden effect")
    axis.set_ylabel("right group, % of logs")
    canvas.subplots_adjust(left=0.07, right=0.9, top=0.97, bottom=0.12)


@look.figure(8.0)
def confusion_picture(canvas, confusion: dict[str, dict[str, int]]) -> None:
    """Hidden effect by first name, share of the row."""
    axis = canvas.add_subplot()
    rows = list(confusion)
    said = dict.fromkeys(name for row in confusion.values() for name in row)
    others = [name for name in said if name not in rows and name not in VERDICTS]
    columns = [*rows, *others, *(name for name in VERDICTS if name in said)]
    counts = np.array([[confusion[r].get(c, 0) for c in columns] for r in rows], float)
    share = 100 * counts / counts.sum(axis=1, keepdims=True)
    axis.imshow(share, cmap="Blues", vmin=0, vmax=100, aspect="auto")
    for i, j in zip(*np.nonzero(share), strict=True):
        color = "white" if share[i, j] > 55 else look.INK
        axis.text(j, i, f"{share[i, j]:.0f}", ha="center", va="center", fontsize=8, color=color)
    names = [name.replace("_", " ") for name in columns]
    axis.set_xticks(range(len(columns)), names, rotation=60, ha="right", rotation_mode="anchor")
    axis.set_yticks(range(len(rows)), names[: len(rows)])
    axis.axvline(len(rows) - 0.5, color=look.INK, linewidth=0.8)
    axis.grid(visible=False)
    axis.tick_params(length=0)
    axis.set_xlabel("first name, or verdict without one")
    axis.set_ylabel("hidden")
    canvas.subplots_adjust(left=0.2, right=0.985, top=0.985, bottom=0.25)


EXACT = "first name right and no other"
GROUP = "truth in the first group, or the name is listed in the library as looking like it"


def benchmark_page(found: dict[str, Any]) -> Page:
    """Build the page from what ``summary.summarise`` gives, with ``provenance`` and ``version``."""
    targets = found.get("targets", [])
    met, total = sum(t["met"] for t in targets), sum(found.get("cases", {}).values())
    return Page(
        title="Hidden-effect benchmark",
        verdict=(
            f"{met} of {len(targets)} targets met on {total} simulated robots"
            if targets
            else "No case was diagnosed"
        ),
        good=bool(targets) and met == len(targets),
        lead=(
            "Each case is a robot drawn around the paper's, with sensor noise and closed wheel "
            f"loops. At full size an effect adds or takes {100 * FULL:.0f} % of the rms wheel "
            "torque. The diagnosis starts from the data-sheet model and sees one log of 112 s; a "
            "second log of 48 s only verifies."
        ),
        figures=_headline(targets),
        sections=[section for section in _sections(found, targets) if section.blocks],
        provenance=_provenance(found),
    )


def _headline(targets: list[dict]) -> list[tuple[str, str]]:
    wanted = (
        "false alarms, nothing hidden", "right group, full size", "exact name, full size",
        "outside the library, yet named",
    )  # fmt: skip
    return [(value(t), t["what"]) for t in targets if t["what"] in wanted]


def _sections(found: dict[str, Any], targets: list[dict]) -> list[Section]:
    return [
        Section("Targets", [_targets(targets)] if targets else [],
                "All intervals are exact binomial (Clopper-Pearson) at 95 %."),
        Section("Library effects", _effects(found),
                f"Exact: {EXACT}. Group: {GROUP}. Wrong: any name that is neither. Where a bound "
                "keeps an effect below full size (a payload above 20 kg, a radius off by 5 %), "
                "half and quarter are parts of what it reaches."),
        Section("Where no name is right", _nameless(found),
                "Robots that hide nothing, and robots that hide what no library holds. Silence, "
                "'outside the library' and 'cannot say' are all right; a name is wrong."),
        Section("Known phenomena, other laws", _laws(found),
                "The library's relative of the law counts as the truth."),
        Section("Two at once, and real rollers", _pairs_and_rollers(found),
                "Pairs are of effects that do not look alike, each at full size. On real rollers "
                f"{' and '.join(ROLLING)} count neither for nor against."),
        Section("Sizes, verification, time", _figures(found),
                "Closed: share of the verifying free-run error between the fitted data-sheet "
                "structure and the true model that the named effects take away."),
        Section("Baselines", _baselines(found),
                "The same logs given to public tools for sparse models, with the columns of all "
                "effects at typical size as candidates. PySINDy: thresholded least squares, the "
                "threshold chosen on the second log. SysIdentPy: forward regression, BIC. Their "
                "answer is the set of effects whose columns are picked, largest first."),
        Section("Failed cases", [Notes([f"{f['case']} ({f['method']}): {f['error']}"
                                        for f in found["failed"]])] if found["failed"] else [],
                "Cases that raised an error; they are left out of all figures above."),
    ]  # fmt: skip


def _targets(targets: list[dict]) -> Grid:
    rows = [
        (t["what"], value(t), interval(t), "" if t["count"] is None else str(t["count"]),
         t["target"], "yes" if t["met"] else "no")
        for t in targets
    ]  # fmt: skip
    return Grid(("", "figure", "95 % interval", "of", "target", "met"), rows, words=(0, 4, 5))


def _effects(found: dict[str, Any]) -> list:
    effects, blocks = found.get("effects", {}), []
    if not effects:
        return []
    if len(found["sizes"]) > 1:
        blocks.append(
            Picture("power", power_picture(effects, found["sizes"]),
                    "Share of logs with the right group against size. Grey: each effect; the "
                    "weakest are labelled. Blue: all effects, with 95 % interval.")
        )  # fmt: skip
    if found["confusion"]:
        blocks.append(
            Picture("confusion", confusion_picture(found["confusion"]),
                    "What each hidden effect (row) was first called (column) at full size, share "
                    "of its logs.")
        )  # fmt: skip
    order, rows = list(found["sizes"]), []
    keys = ("exact", "group", "holds", "wrong", "silent")
    for effect, sizes in effects.items():
        there = [sizes[size] for size in order if size in sizes]
        shares = "/".join(f"{100 * r['share']:.2g}" for r in there if r["share"] is not None)
        rates = (_row(there, key) for key in keys)
        rows.append((effect, str(max(r["exact"]["count"] for r in there)), shares, *rates))
    total = [found["sizes"][size] for size in order]
    rows.append(("all", str(total[0]["exact"]["count"]), "", *(_row(total, k) for k in keys)))
    heads = ("hidden", "logs each", "of torque %", "exact %", "group %", "set holds it %",
             "wrong %", "silent %")  # fmt: skip
    words = f"Each cell: at size {' / '.join(order)}." if len(order) > 1 else ""
    return [*blocks, Grid(heads, rows, words)]


def _row(there: list[dict], key: str) -> str:
    return "/".join(
        "–" if r[key]["value"] is None else f"{100 * r[key]['value']:.0f}" for r in there
    )


def _nameless(found: dict[str, Any]) -> list:
    if "nothing" not in found:
        return []
    kinds = {"nothing": found["nothing"], **found["outside"]["effects"]}
    rows = [
        (name, str(r["named"]["count"]), cell(r["named"]), interval(r["named"]),
         listed(r["names"]), listed(r["verdicts"]))
        for name, r in kinds.items()
        if r["named"]["count"]
    ]  # fmt: skip
    heads = ("hidden", "logs", "named %", "95 % interval", "names", "verdicts")
    return [Grid(heads, rows, words=(0, 4, 5))] if rows else []


def _laws(found: dict[str, Any]) -> list:
    rows = [
        (law, str(r["exact"]["count"]),
         *(cell(r[key]) for key in ("first", "group", "wrong", "silent")))
        for law, r in found.get("laws", {}).get("effects", {}).items()
    ]  # fmt: skip
    heads = ("hidden", "logs", "relative named %", "group %", "wrong %", "silent %")
    return [Grid(heads, rows)] if rows else []


def _pairs_and_rollers(found: dict[str, Any]) -> list:
    if "pairs" not in found:
        return []
    pairs, rollers = found["pairs"], found["rollers"]
    quiet, hidden = rollers["nothing"]["named"], rollers["hidden"]
    lines = (
        ("pairs: both named", pairs["both"]),
        ("pairs: both named and nothing else", pairs["exact"]),
        ("pairs: at least one right", pairs["first"]),
        ("pairs: a wrong name", pairs["wrong"]),
        ("rollers, nothing hidden: a name", quiet),
        ("rollers, one hidden: first name right", hidden["first"]),
        ("rollers, one hidden: right group", hidden["group"]),
        ("rollers, one hidden: a wrong name", hidden["wrong"]),
    )
    rows = [(w, cell(r), interval(r), str(r["count"])) for w, r in lines if r["count"]]
    return [Grid(("", "%", "95 % interval", "of"), rows)] if rows else []


def _figures(found: dict[str, Any]) -> list:
    if "coverage" not in found:
        return []
    rows = [
        (name, cell(r), interval(r), str(r["count"]))
        for name, r in (("all", found["coverage"]["all"]), *found["coverage"]["parameters"].items())
        if r["count"]
    ]
    notes = []
    verify, seconds = found["verify"], found["seconds"]
    if verify["fell"]["count"]:
        notes.append(
            f"The verifying free-run error fell in {cell(verify['fell'])} % of "
            f"{verify['fell']['count']} named cases ({interval(verify['fell'])})."
        )
    if verify["closed"]:
        low, middle, high = (100 * q for q in verify["closed"])
        notes.append(
            f"Of the gap to the true model {middle:.1f} % closed (median; quartiles {low:.1f} and "
            f"{high:.1f} %, {verify['count']} cases)."
        )
    if seconds:
        notes.append(
            f"One diagnosis took {seconds['median']:.1f} s (median), {seconds['p95']:.1f} s or "
            f"less in 95 % of the cases, {seconds['largest']:.1f} s at most."
        )
    grid = Grid(("95 % interval of", "holds the truth %", "95 % interval", "of"), rows)
    return [*([grid] if rows else []), *([Notes(notes)] if notes else [])]


def _baselines(found: dict[str, Any]) -> list:
    rows = []
    for method, pair in found.get("baselines", {}).items():
        for who, r in ((method, pair["itself"]), ("diagnosis, same logs", pair["diagnosis"])):
            hidden = r["hidden"]
            rows.append(
                (who, cell(r["nothing"]["named"]), str(r["nothing"]["named"]["count"]),
                 *(cell(hidden[key]) for key in ("exact", "first", "holds", "extra")),
                 str(hidden["exact"]["count"]),
                 "" if r["seconds"] is None else f"{r['seconds']:.1f}")
            )  # fmt: skip
    heads = ("", "false alarms %", "quiet logs", "exact %", "first name right %",
             "first group holds it %", "more names than effects %", "logs", "s a log")  # fmt: skip
    return [Grid(heads, rows)] if rows else []


def _provenance(found: dict[str, Any]) -> dict[str, str]:
    used = found["provenance"]
    kept = {key: str(used[key]) for key in ("command", "seed", "date", "git_commit") if key in used}
    versions = ", ".join(f"{name} {number}" for name, number in used["versions"].items())
    return kept | {"versions": versions, "code": found["version"]}


def value(target: dict) -> str:
    """The figure of a target with its unit."""
    scale, unit = (100, " %") if target["unit"] == "%" else (1, f" {target['unit']}")
    return f"{scale * target['value']:.3g}{unit}".rstrip()


def cell(rate: dict) -> str:
    """A rate in percent, a dash where it is one of nothing."""
    return "–" if rate["value"] is None else f"{100 * rate['value']:.1f}"


def interval(rate: dict) -> str:
    """The interval of a rate in percent."""
    if rate["ci95"] is None:
        return ""
    low, high = rate["ci95"]
    return f"{100 * low:.1f} to {100 * high:.1f} %"


def listed(counts: dict[str, int]) -> str:
    """Counted words, most frequent first."""
    return ", ".join(f"{name.replace('_', ' ')} {count}" for name, count in counts.items())
