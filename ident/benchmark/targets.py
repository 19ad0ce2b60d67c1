"""What a diagnosis has to reach before its names can be trusted."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any


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
