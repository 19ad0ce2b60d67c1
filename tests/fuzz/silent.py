"""How often a spoiled log changes what is identified, and nobody is told.

A log of 40 s is spoiled, read and, where it has changed and no finding says so, identified.
"""

from __future__ import annotations

import io
import tempfile
from pathlib import Path
from typing import Any

import numpy as np
from spoiled_logs import good_frame

from fuzz.cases import Case, draw, judge
from fuzz.originals import Original, complete, lay_out, read_log
from fuzz.spoil_bytes import BYTES
from fuzz.spoil_tables import FRAME, TABLE
from ident.identification import identify
from ident.log import Log
from youbot_env.model_file import load_model

RIGHT, WRONG = "silently right", "silently wrong"


def long_logs(folder: Path) -> list[Original]:
    """A CSV and a Parquet file of 40 s at 50 Hz."""
    frame = good_frame()[::2]
    stream = io.BytesIO()
    frame.write_parquet(stream)
    text = frame.write_csv(float_precision=6).encode()
    made = [
        Original("CSV", {"mine.csv": text}, "mine.csv", read_log,
                 {"mine.csv": {**BYTES, **TABLE}}),
        Original("Parquet", {"mine.parquet": stream.getvalue()}, "mine.parquet", read_log,
                 {"mine.parquet": {**BYTES, **FRAME}}),
    ]  # fmt: skip
    return [complete(one, folder / f"good{k}") for k, one in enumerate(made)]


def judge_silent(good: dict[str, Any], spoiled, index: int, folder: Path) -> Case:
    """As ``judge``; what has changed silently is identified: ``silently right`` or ``wrong``."""
    case = judge(spoiled, index, folder)
    if case.outcome != "changed":
        return case
    place = folder / f"silent{index}"
    lay_out(spoiled.files, place)
    try:
        found = lumps(place / spoiled.original.entry)
    except ValueError as error:
        return Case(index, case.kind, case.spoiled, "refused", str(error))
    known = good[case.kind]
    if found["doubts"] - known["doubts"]:
        return Case(index, case.kind, case.spoiled, "told", "; ".join(found["doubts"]))
    apart = {
        name: (known[name], value)
        for name, value in found.items()
        if name != "doubts" and abs(value[0] - known[name][0]) > value[1] + known[name][1]
    }
    outcome = WRONG if apart else RIGHT
    return Case(index, case.kind, case.spoiled, outcome, repr(apart))


def lumps(path: Path) -> dict[str, Any]:
    """Combinations of parameters with the half widths of their 95 % intervals, and the doubts."""
    result = identify([Log.load(path)], load_model("nominal")).as_dict()
    found = {
        name: (entry["value"], np.ptp(entry["ci95"]) / 2)
        for name, entry in result["lumps"].items()
        if entry["ci95"] is not None
    }
    return found | {"doubts": {str(doubt) for doubt in result["doubts"]}}


def serve_silent(pipe, seed: int, indices) -> None:
    """What the process of ``watch.run`` does for this measure."""
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        logs = long_logs(folder)
        good = {}
        for one in logs:
            lay_out(one.files, folder / "whole")
            good[one.kind] = lumps(folder / "whole" / one.entry)
        pipe.send("ready")
        for index in indices:
            spoiled = draw(logs, seed, index)
            pipe.send((spoiled.original.kind, spoiled.steps))
            pipe.send(judge_silent(good, spoiled, index, folder))
