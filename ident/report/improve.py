"""The page of an improvement: the error falling, what became of the base, and the use of it all."""

from __future__ import annotations

from dataclasses import replace

from ident.improvement import Improvement, Stage
from ident.log import Log
from ident.report import diagnose as diagnosis
from ident.report.diagnose import DOCTOR
from ident.report.diagnose_error import FALLING
from ident.report.diagnose_figures import base_figure
from ident.report.outcome import percent, rounded
from ident.report.page import Grid, Notes, Page, Picture, Section

ERRORS_HEAD = ("model", "vx m/s", "vy m/s", "yaw rad/s", "all %", "share of the gap closed %")


def improvement_page(
    done: Improvement, gains: list[str], provenance: dict[str, str], logs: tuple[Log, ...] = ()
) -> Page:
    """Draw everything and put the page together; nothing is written.

    Args:
        done: what the loop did.
        gains: what the final model is good for, in sentences and lines of code.
        provenance: how it came about, by name.
        logs: whose findings are told, and which are shown where they decide nothing.
    """
    found, parts = done.found, {part.title: part for part in diagnosis.sections(done.found, logs)}
    # The evidence first, then what it did to error and parameters, then what that is good for.
    shown = []
    for title, part in parts.items():
        if title == FALLING:
            table = Grid(ERRORS_HEAD, error_rows(done), "Rms errors in free run.")
            part = replace(part, blocks=[part.blocks[0], table, *part.blocks[1:]])
        shown.append(part)
        if title == FALLING:
            shown.append(_base(done))
    if gains:
        at = next((k for k, part in enumerate(shown) if part.title == DOCTOR), len(shown))
        shown.insert(at, Section("What the controllers gain", [Notes(gains)]))
    figures = diagnosis.figures(found)
    if len(done.stages) > 1:
        figures.append((percent(done.stages[-1].covered), "of the way down to that noise"))
    return Page(
        "Improving a model until nothing is missing",
        verdict(done).replace(" %", "\u00a0%"),
        found.verdict in ("named", "nothing_missing") and not done.problems,
        diagnosis.lead(found),
        figures,
        shown,
        provenance,
    )


def verdict(done: Improvement) -> str:
    """What was added and how far the error fell."""
    found, added = done.found, [stage.added for stage in done.stages[1:]]
    if found.verdict in ("named", "ambiguous"):
        before, after = percent(found.errors.before), percent(found.errors.after)
        sentence = f"Added {', '.join(added)}: {found.errors.what} {before} before, {after} after"
        doubtful = [step.group for step in found.named if len(step.group) > 1]
        for group in doubtful:
            sentence += f"; the logs do not tell {' from '.join(group)}"
        return f"{sentence}."
    sentence = f"{diagnosis.HEADLINES[found.verdict]}: {found.reason}."
    if added:
        low, high = found.errors.drop_ci95
        sentence += (
            f" The model keeps {', '.join(added)} as the best there is: the {found.errors.what} on "
            f"held-out windows falls by {percent(max(low, 0.0))} to {percent(high)}. That does "
            "not say that the robot has them."
        )
    return sentence


def stage_name(number: int, stage: Stage) -> str:
    """What tables call a stage."""
    return f"+{number} {stage.added}" if number else "base"


def error_rows(done: Improvement) -> list[tuple[str, ...]]:
    """Rows of ``ERRORS_HEAD``, with what noise leaves last."""
    rows = [
        (stage_name(number, stage), *(rounded(v, v) for v in stage.axes),
         f"{100 * stage.nrmse:.3g}", f"{100 * stage.covered:.0f}")
        for number, stage in enumerate(done.stages)
    ]  # fmt: skip
    return [*rows, ("noise", "", "", "", f"{100 * done.found.errors.floor:.3g}",
            "100")]  # fmt: skip


def base_head(done: Improvement) -> tuple[str, ...]:
    """Head of ``base_rows``."""
    steps = [words for k in range(1, len(done.stages)) for words in (f"+{k}", "shift, se")]
    return ("", "unit", "base", *steps)


def base_rows(done: Improvement) -> list[tuple[str, ...]]:
    """Each base parameter and lump: value at every stage, shift in its standard errors."""
    rows = []
    for name, first in done.stages[0].base.items():
        cells = [name, first.unit, rounded(first.value, first.se)]
        for stage in done.stages[1:]:
            q, shift = stage.base[name], stage.shifts[name]
            cells += [rounded(q.value, q.se), "-" if shift is None else f"{shift:+.1f}"]
        rows.append(tuple(cells))
    return rows


def base_note(done: Improvement) -> str:
    """What the units of the base parameters are."""
    return diagnosis.units_note(done.found.first.parts[0].log)


def _base(done: Improvement) -> Section:
    stages = [stage.base for stage in done.stages]
    numbers = ", ".join(f"+{k} {stage.added}" for k, stage in enumerate(done.stages) if k)
    caption = (
        "The seven parameters and two identifiable combinations (x1 = m0 L^2, x2 = I0, x3 the spin "
        "inertia of all wheels as it resists turning), with 95 % intervals"
        + (f": base model, {numbers}" if numbers else "")
        + ". Open: the logs do not determine it alone. A model that lacks an effect bends its "
        "parameters to stand in for it."
    )
    table = "Shift from the stage before, in standard errors of the later stage."
    grid = Grid(base_head(done), base_rows(done), table if numbers else "", words=(0, 1))
    blocks = [Picture("base", base_figure(list(stages[0]), stages), caption), grid]
    return Section("What the additions did to the base parameters", blocks, base_note(done))
