"""Rates with their intervals, from the records of a run."""

from __future__ import annotations

from collections import Counter
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import numpy as np

from ident.benchmark.score import Score, meant, score


def targets(result: dict[str, Any]) -> list[dict[str, Any]]:
    """The figures a trustworthy diagnosis has to reach, and whether they are."""
    sizes, seconds, verify = result["sizes"], result["seconds"], result["verify"]
    full, half, quarter = (sizes.get(key) for key in ("1", "0.5", "0.25"))
    nothing, cover = result["nothing"]["named"], result["coverage"]["all"]
    rows: list[tuple[str, dict | None, str, Callable[[float], bool]]] = [
        ("false alarms, nothing hidden", nothing, "at most 5 %", lambda v: v <= 0.05),
        ("their upper limit", _limit(nothing), "at most 8 %", lambda v: v <= 0.08),
        ("right group, full size", _get(full, "group"), "at least 97 %", lambda v: v >= 0.97),
        ("right group, half size", _get(half, "group"), "at least 90 %", lambda v: v >= 0.90),
        ("exact name, full size", _get(full, "exact"), "at least 90 %", lambda v: v >= 0.90),
        ("exact name after the proposed experiment, full size", result["followed"]["exact"],
         "at least 97 %", lambda v: v >= 0.97),
        ("reported set holds the truth, full size", _get(full, "holds"), "at least 95 %",
         lambda v: v >= 0.95),
        ("mean size of the reported set", _plain(full and full["set_size"], ""), "at most 1.5",
         lambda v: v <= 1.5),
        ("wrong names, quarter size", _get(quarter, "wrong"), "at most 5 %", lambda v: v <= 0.05),
        ("outside the library, yet named", result["outside"]["all"]["named"], "at most 5 %",
         lambda v: v <= 0.05),
        ("pairs, both named", result["pairs"]["both"], "at least 80 %", lambda v: v >= 0.80),
        ("95 % intervals that hold the size", cover, "92 to 98 %", lambda v: 0.92 <= v <= 0.98),
        ("verifying free-run error fell", verify["fell"], "at least 95 %", lambda v: v >= 0.95),
        ("gap to the true model closed, median", _plain(verify["closed"] and verify["closed"][1]),
         "at least 90 %", lambda v: v >= 0.90),
        ("seconds a log, 95 % of logs", _plain(seconds and seconds["p95"], "s"), "at most 10 s",
         lambda v: v <= 10.0),
    ]  # fmt: skip
    return [
        {"what": what, "target": words, "met": passes(rate["value"]), "unit": "%"} | rate
        for what, rate, words, passes in rows
        if rate is not None and rate["value"] is not None
    ]


def _get(rates: dict | None, key: str) -> dict | None:
    return rates and rates[key]


def _plain(value: float | None, unit: str = "%") -> dict | None:
    if value is None:
        return None
    return {"value": value, "ci95": None, "hits": None, "count": None, "unit": unit}


def _limit(rate: dict) -> dict | None:
    return _plain(rate["ci95"] and rate["ci95"][1])


Scored = list[tuple[dict[str, Any], Score]]


@dataclass(frozen=True)
class Rate:
    """How often something happened, with its exact (Clopper-Pearson) 95 % interval.

    Attributes:
        hits, count: how often, of how many.
    """

    hits: int
    count: int

    @classmethod
    def of(cls, happened: Iterable[bool]) -> Rate:
        """Count."""
        happened = list(happened)
        return cls(sum(map(bool, happened)), len(happened))

    @property
    def value(self) -> float | None:
        """Share, or None of nothing."""
        return self.hits / self.count if self.count else None

    @property
    def ci95(self) -> tuple[float, float] | None:
        """Clopper-Pearson interval of the share."""
        if not self.count:
            return None
        from scipy.stats import binomtest

        low, high = binomtest(self.hits, self.count).proportion_ci(0.95, "exact")
        return float(low), float(high)

    def as_dict(self) -> dict[str, Any]:
        """Return what JSON shows."""
        ci95 = None if self.ci95 is None else list(self.ci95)
        return {"value": self.value, "ci95": ci95, "hits": self.hits, "count": self.count}


def summarise(records: list[dict[str, Any]]) -> dict[str, Any]:
    """Everything that the benchmark says, in types that JSON has.

    Args:
        records: as ``runner.run`` returns them, of one or more methods.
    """
    methods = sorted({record["method"] for record in records})
    own = [record for record in records if record["method"] == "diagnosis"]
    result = _one_method(own) if own else {}
    result["baselines"] = {
        method: _baseline([r for r in records if r["method"] == method], own)
        for method in methods
        if method != "diagnosis"
    }
    failed = [r for r in records if r["error"] is not None]
    result["failed"] = [
        {"method": r["method"], "case": r["case"], "error": r["error"].strip().splitlines()[-1]}
        for r in failed
    ]
    return result


def _one_method(records: list[dict[str, Any]]) -> dict[str, Any]:
    scored: Scored = [(r, score(r)) for r in records if r["error"] is None]

    def part(name: str, *sizes: float) -> list[Score]:
        return [s for r, s in scored if r["part"] == name and (not sizes or r["size"] in sizes)]

    single = [(r, s) for r, s in scored if r["part"] == "single"]
    sizes = sorted({r["size"] for r, _ in single}, reverse=True)
    result = {
        "cases": dict(Counter(r["part"] for r, _ in scored)),
        "nothing": _counted(part("nothing")),
        "sizes": {f"{size:g}": _rates(part("single", size)) for size in sizes},
        "effects": _by_effect(single, sizes),
        "followed": _followed([r for r, _ in single if r["size"] == 1.0]),
        "confusion": _confusion([(r, s) for r, s in single if r["size"] == 1.0]),
        "outside": _grouped(scored, "outside", _counted),
        "laws": _grouped(scored, "laws", _rates),
        "pairs": _pairs(part("pairs")),
        "rollers": _rollers(part("rollers")),
        "coverage": _coverage(s for _, s in single),
        "verify": _verified([s for r, s in scored if r["part"] in ("single", "pairs", "laws")]),
        "seconds": _seconds([r["seconds"] for r, _ in scored]),
    }
    result["targets"] = targets(result)
    return result


def _rates(scores: list[Score]) -> dict[str, Any]:
    """Rates of answers about robots that hide something the library knows."""
    sizes = [s.size for s in scores if s.names]
    return {
        "exact": Rate.of(s.exact for s in scores).as_dict(),
        "first": Rate.of(s.first for s in scores).as_dict(),
        "group": Rate.of(s.group for s in scores).as_dict(),
        "holds": Rate.of(s.holds for s in scores if s.names).as_dict(),
        "wrong": Rate.of(s.wrong for s in scores).as_dict(),
        "extra": Rate.of(s.extra for s in scores).as_dict(),
        "silent": Rate.of(not s.names for s in scores).as_dict(),
        "set_size": float(np.mean(sizes)) if sizes else None,
    }


def _counted(scores: list[Score]) -> dict[str, Any]:
    """Rates of answers about robots in which no name is right."""
    return {
        "named": Rate.of(bool(s.names) for s in scores).as_dict(),
        "names": dict(Counter(s.names[0] for s in scores if s.names).most_common()),
        "verdicts": dict(Counter(s.verdict for s in scores).most_common()),
    }


def _by_effect(single: Scored, sizes: list[float]) -> dict[str, Any]:
    effects = dict.fromkeys(r["hidden"][0] for r, _ in single)
    found = {}
    for effect in effects:
        found[effect] = {}
        for size in sizes:
            chosen = [(r, s) for r, s in single if r["hidden"] == [effect] and r["size"] == size]
            shares = [r["share"][effect] for r, _ in chosen]
            share = float(np.median(shares)) if shares else None
            found[effect][f"{size:g}"] = _rates([s for _, s in chosen]) | {"share": share}
    return found


def _followed(records: list[dict[str, Any]]) -> dict[str, Any]:
    """Rates when the experiment that an ambiguous answer asked for has been recorded."""
    asked = [record for record in records if record.get("followed")]
    return {
        "asked": len(asked),
        "exact": Rate.of(score(record, at_last=True).exact for record in records).as_dict(),
        "of_those_asked": Rate.of(score(r, at_last=True).exact for r in asked).as_dict(),
        "of_those_asked_before": Rate.of(score(r).exact for r in asked).as_dict(),
    }


def _confusion(scored: Scored) -> dict[str, dict[str, int]]:
    """How often each effect was answered by which first name, or by which verdict without one."""
    found: dict[str, Counter] = {}
    for record, s in scored:
        row = found.setdefault(record["hidden"][0], Counter())
        row[s.names[0] if s.names else s.verdict] += 1
    return {effect: dict(row.most_common()) for effect, row in found.items()}


def _grouped(scored: Scored, part: str, summary: Callable) -> dict[str, Any]:
    chosen = [(r, s) for r, s in scored if r["part"] == part]
    effects = dict.fromkeys(r["hidden"][0] for r, _ in chosen)
    by_effect = {e: summary([s for r, s in chosen if r["hidden"] == [e]]) for e in effects}
    return {"all": summary([s for _, s in chosen]), "effects": by_effect}


def _pairs(scores: list[Score]) -> dict[str, Any]:
    return {
        "both": Rate.of(s.all_held for s in scores).as_dict(),
        "exact": Rate.of(s.exact for s in scores).as_dict(),
        "first": Rate.of(s.first for s in scores).as_dict(),
        "wrong": Rate.of(s.wrong for s in scores).as_dict(),
    }


def _rollers(scores: list[Score]) -> dict[str, Any]:
    quiet, loud = ([s for s in scores if bool(s.hidden) is b] for b in (False, True))
    strange = [s for s in loud if not any(map(meant, s.hidden))]
    known = [s for s in loud if any(map(meant, s.hidden))]
    return {"nothing": _counted(quiet), "hidden": _rates(known), "outside": _counted(strange)}


def _coverage(scores: Iterable[Score]) -> dict[str, Any]:
    by_parameter: dict[str, list[bool]] = {}
    for s in scores:
        for name, inside in s.covered.items():
            key = f"{s.names[0]}.{name.split('_')[0]}"
            by_parameter.setdefault(key, []).append(inside)
    every = [inside for column in by_parameter.values() for inside in column]
    return {
        "all": Rate.of(every).as_dict(),
        "parameters": {key: Rate.of(column).as_dict() for key, column in by_parameter.items()},
    }


def _verified(scores: list[Score]) -> dict[str, Any]:
    fell = [s.fell for s in scores if s.fell is not None]
    closed = [s.closed for s in scores if s.closed is not None]
    quartiles = np.quantile(closed, (0.25, 0.5, 0.75)).tolist() if closed else None
    return {"fell": Rate.of(fell).as_dict(), "closed": quartiles, "count": len(closed)}


def _seconds(seconds: list[float]) -> dict[str, float] | None:
    if not seconds:
        return None
    median, late = np.quantile(seconds, (0.5, 0.95)).tolist()
    return {"median": median, "p95": late, "largest": max(seconds)}


def _baseline(records: list[dict[str, Any]], own: list[dict[str, Any]]) -> dict[str, Any]:
    """A baseline, and the diagnosis of this project on the very same cases."""
    cases = {record["case"] for record in records}

    def rates(chosen: list[dict[str, Any]]) -> dict[str, Any]:
        scored = [(r, score(r)) for r in chosen if r["error"] is None]
        quiet, loud = ([s for _, s in scored if bool(s.hidden) is b] for b in (False, True))
        median = float(np.median([r["seconds"] for r, _ in scored])) if scored else None
        return {"nothing": _counted(quiet), "hidden": _rates(loud), "seconds": median}

    return {"itself": rates(records), "diagnosis": rates([r for r in own if r["case"] in cases])}
