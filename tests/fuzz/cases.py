"""One case: draw a good file, spoil it, read it, and say how that ended."""

from __future__ import annotations

import shutil
import traceback
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from fuzz.originals import Original, lay_out

# How often each kind is drawn; tables are what people edit by hand.
WEIGHTS = {"CSV": 5.0, "CSV with units": 2.0, "FTC telemetry": 2.0, "Parquet": 4.0,
           "model": 2.0, "motion": 3.0, "platform and map": 3.0, "policy": 3.0,
           "policy, SHA-256 renewed": 3.0}  # fmt: skip
# What may happen; the last five are faults.
OUTCOMES = ("refused", "told", "same", "changed")
FAULTS = ("traceback", "unsound", "nameless", "hang", "memory", "died")


@dataclass(frozen=True)
class Case:
    """What happened.

    Attributes:
        index: number of the case.
        kind: of file.
        spoiled: how, each step ``file: way``.
        outcome: one of ``OUTCOMES`` and ``FAULTS``.
        detail: message or traceback.
    """

    index: int
    kind: str
    spoiled: tuple[str, ...]
    outcome: str
    detail: str = ""


@dataclass(frozen=True)
class Spoiled:
    """A good file and its spoiled copy."""

    original: Original
    files: dict[str, bytes]
    steps: tuple[str, ...]


def draw(originals: list[Original], seed: int, index: int) -> Spoiled:
    """The spoiled files of a case; equal for equal arguments."""
    rng = np.random.default_rng(np.random.SeedSequence(seed, spawn_key=(index,)))
    weights = np.array([WEIGHTS.get(original.kind, 1.0) for original in originals])
    original = originals[rng.choice(len(originals), p=weights / weights.sum())]
    files, steps = dict(original.files), []
    for _ in range(1 + rng.binomial(2, 0.15)):
        name = sorted(original.spoilers)[rng.integers(len(original.spoilers))]
        ways = original.spoilers[name]
        way = list(ways)[rng.integers(len(ways))]
        if len(files) > 1 and rng.random() < 0.05:
            files.pop(name, None)
            steps.append(f"{name}: missing")
        elif name in files:
            files[name] = ways[way](rng, files[name])
            steps.append(f"{name}: {way}")
    return Spoiled(original, files, tuple(steps))


def judge(spoiled: Spoiled, index: int, folder: Path) -> Case:
    """Read the spoiled files of a case in a folder of its own."""
    original, place = spoiled.original, folder / f"case{index}"
    lay_out(spoiled.files, place)
    # Nothing left of a folder is not a case of its reader.
    (place / original.entry).parent.mkdir(parents=True, exist_ok=True)
    outcome, detail = _read(original, place / original.entry)
    shutil.rmtree(place)
    return Case(index, original.kind, spoiled.steps, outcome, detail)


def _read(original: Original, path: Path) -> tuple[str, str]:
    try:
        content, told = original.read(path)
    except MemoryError:
        return "memory", traceback.format_exc()
    except KeyboardInterrupt:
        raise
    except AssertionError as error:
        return "unsound", str(error)
    # The project's errors of bad input are all of this kind, and a missing file is an OSError.
    except (ValueError, OSError) as error:
        if not _ours(error):
            return "traceback", traceback.format_exc()
        named = path.name in str(error) or f"{path.stem}." in str(error)  # or its other file
        return ("refused" if named else "nameless"), str(error)
    except BaseException:
        return "traceback", traceback.format_exc()
    if told - original.told:
        return "told", "; ".join(sorted(told - original.told))
    return ("same" if content == original.content else "changed"), ""


def _ours(error: BaseException) -> bool:
    """Whether the project wrote this error, not a library that it calls."""
    trace = error.__traceback__
    while trace.tb_next is not None:
        trace = trace.tb_next
    place = Path(trace.tb_frame.f_code.co_filename)
    return place.parts[-3:-1] != () and any(
        part in ("ident", "youbot_env", "controllers") for part in place.parts
    )
