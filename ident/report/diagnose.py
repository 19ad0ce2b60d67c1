"""The page of a diagnosis: what is missing, why that is believed, and what is left unexplained."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from ident.comparison import Comparison, compare
from ident.diagnosis.parts import VERIFY, Part
from ident.diagnosis.power import Reach
from ident.diagnosis.rounds import LEAST_GAIN
from ident.diagnosis.verdict import Diagnosis
from ident.free_run import FreeRun, free_run
from ident.log import Log
from ident.report import compare_where, motion
from ident.report.compare_words import WHERE_HEAD, note, probability, where_rows
from ident.report.diagnose_figures import (
    dependence_figure,
    error_steps_figure,
    gains_figure,
    sizes_figure,
)
from ident.report.look import IDENTIFIED, NOMINAL
from ident.report.outcome import interval, percent, rounded
from ident.report.page import Grid, Notes, Page, Picture, Section
from ident.sensitivity import window_length
from youbot_env.effects import get_effect

HEADLINES = {
    "named": "Missing",
    "ambiguous": "Missing, but not told apart",
    "nothing_missing": "Nothing is missing",
    "outside_library": "Missing, and not in the library",
    "cannot_say": "These logs cannot say",
}
REGIMES = 10
FALLING = "The error on untouched windows"


def diagnosis_page(
    found: Diagnosis, provenance: dict[str, str], logs: tuple[Log, ...] = ()
) -> Page:
    """Draw everything and put the page together; nothing is written.

    Args:
        found: the diagnosis.
        provenance: how it came about, by name.
        logs: to show where the diagnosis has used none.
    """
    return Page(
        "What the model is missing",
        f"{HEADLINES[found.verdict]}: {found.reason}.".replace(" %", "\u00a0%"),
        found.verdict in ("named", "nothing_missing"),
        lead(found),
        figures(found),
        sections(found, logs),
        provenance,
    )


def lead(found: Diagnosis) -> str:
    """What the verdict rests on."""
    if found.errors is None:
        return f"{found.log}: nothing was fitted, and nothing is named."
    used = sum(part.log.duration for part in found.first.parts)
    return (
        f"{found.log}: {len(found.reach)} effects were tried on {used:.0f} s of motion. An effect "
        f"counts when it is significant among all that were tried and removes more than "
        f"{100 * LEAST_GAIN:.0f} % of the squared free-run error of stretches to which it was not "
        f"fitted. {found.errors.windows} windows were kept for the end; nothing was fitted to them "
        "or chosen by them."
    )


def figures(found: Diagnosis) -> list[tuple[str, str]]:
    """The few numbers that carry the verdict."""
    if found.errors is None:
        return []
    errors = found.errors
    shown = [
        (percent(errors.before), "free-run error of the base model"),
        (percent(errors.after), "with what was added"),
        (percent(errors.floor), "left by the noise of the sensors"),
    ]
    return shown if len(errors.nrmse) > 1 else [shown[0], shown[2]]


def sections(found: Diagnosis, logs: tuple[Log, ...] = ()) -> list[Section]:
    """Everything between the verdict and the provenance."""
    if found.first is None:
        shown = [_experiment(found), *(_log(log) for log in logs)]
    else:
        compared = compare(found.first.parts[0].log, _ends(found))
        shown = [
            _tried(found),
            _sizes(found),
            _falling(found),
            _left(found, compared[-1]),
            _where(compared),
            _experiment(found),
        ]
    return [section for section in shown if section is not None]


def _ends(found: Diagnosis) -> list:
    """The base model and, where something was added, the last one, named as on the page."""
    ends = [replace(found.base, name="base model")]
    return ends + [replace(found.model, name="final model")] * (len(found.chain) > 1)


def _tried(found: Diagnosis) -> Section:
    named = tuple(step.best.identifier for step in found.steps)
    caption = (
        "On top of the base model, each effect alone in its best form. Bold: added. An effect that "
        "is looked for and not there makes errors larger where it was not fitted. Right: the "
        "smallest size that these logs show with a chance of 80 %, and the chance for the typical "
        "size."
    )
    head = ("effect", "size", "on its own", "95 % interval", "unit", "gain %", "p adjusted")
    rows = [
        (r.effect, r.parameter, _figure(r.size, r), " ... ".join(_figure(v, r) for v in r.ci95),
         r.unit or "-", f"{100 * r.gain:.1f}", probability(r.p))
        for r in found.reach
    ]  # fmt: skip
    table = (
        "Sizes before anything else is added: effects that stand in for a missing one take its "
        "place here. Gain: share of squared error removed where it was not fitted."
    )
    blocks = [
        Picture("effects", gains_figure(found.reach, named), caption),
        Grid(head, rows, table, words=(0, 1, 4)),
    ]
    return Section("Every effect that was tried", blocks)


def _figure(value: float, one: Reach) -> str:
    return rounded(value, max((one.ci95[1] - one.ci95[0]) / 4, 1e-12))


def _sizes(found: Diagnosis) -> Section | None:
    if not found.steps:
        return None
    drawn, rows, notes = [], [], []
    for step in found.steps:
        effect = get_effect(step.best.identifier)
        for flat, q in step.sizes(found.model).items():
            typical = abs(effect.parameter_of(flat).default) or 1.0
            if q.ci95 is not None:
                label = f"{step.best.identifier}, {flat}"
                drawn.append((label, q.value, q.ci95, typical, q.unit))
            rows.append(
                (step.best.identifier, flat, effect.parameter_of(flat).meaning,
                 rounded(q.value, q.se), interval(q), q.unit or "-", probability(step.p))
            )  # fmt: skip
        if len(step.group) > 1:
            rivals = ", ".join(step.group[1:])
            notes.append(f"{step.best.identifier} cannot be told from {rivals} by these logs.")
        if step.background:
            notes.append(
                f"{step.best.identifier} is what every robot has some of; it is modelled before "
                "anything is named."
            )
    head = ("effect", "", "meaning", "value", "95 % interval", "unit", "p adjusted")
    blocks: list = [Grid(head, rows, "In the final model.", words=(0, 1, 2, 5))]
    if notes:
        blocks.append(Notes(notes))
    if drawn:
        caption = "Sizes in the final model, in units of what is typical of each effect."
        blocks.insert(0, Picture("sizes", sizes_figure(drawn), caption))
    return Section("What was added", blocks)


def _falling(found: Diagnosis) -> Section:
    errors = found.errors
    low, high = (percent(end) for end in errors.drop_ci95)
    caption = (
        "Rms free-run errors on windows that nothing was fitted to or chosen by, with each effect "
        "that was added."
    )
    if len(errors.nrmse) > 1:
        caption += f" The error falls by {percent(1 - errors.after / errors.before)}, 95 % interval"
        caption += f" {low} ... {high} ({errors.windows} windows)."
    part = max(found.first.parts, key=lambda part: part.windows(VERIFY).sum())
    colors = (NOMINAL, IDENTIFIED)
    runs = [
        (model.name, color, untouched(part, free_run(part.log, model, window_length(part.log))))
        for model, color in zip(_ends(found), colors, strict=False)
    ]
    seen = (
        f"{part.log.name}: windows that were kept for the end, measured and simulated from the "
        "drive input alone. A line that breaks starts anew at the measured velocity."
    )
    blocks = [
        Picture("error_falling", error_steps_figure(errors), caption),
        Picture("velocities", motion.velocities_figure(runs), seen),
    ]
    return Section(FALLING, blocks, note(part.log))


def untouched(part: Part, run: FreeRun) -> FreeRun:
    """The windows of a run that were kept for the end."""
    rows = part.windows(VERIFY)[run.window]
    return FreeRun(run.time[rows], run.simulated[rows], run.measured[rows], run.window[rows])


def _left(found: Diagnosis, final: Comparison) -> Section:
    title = "What the remaining error depends on"
    signals = [signal for signal, _ in found.depends_on]
    if not signals:
        words = (
            "No signal that was tried (speeds, torque, heading, place, time, wheel angle, history "
            f"of the direction) explains {100 * LEAST_GAIN:.0f} % of what the final model leaves."
        )
        return Section(title, [], words)
    gains = ", ".join(f"{signal} ({percent(gain)})" for signal, gain in found.depends_on)
    words = f"Strongest first, with the share of the squared free-run error behind it: {gains}."
    drawn = dependence_figure(final, signals)
    if drawn is None:
        return Section(title, [], words)
    caption = (
        f"Mean of what the equations of the {final.model.name} leave of {final.log.name}, with "
        "95 % intervals from stretches of time. Over wheel signals: as torque on that wheel's "
        "shaft"
        + (", along its rotation" if "history of the direction" in signals else "")
        + ". Over the others: forces on the body, the moment over the lever L."
    )
    return Section(title, [Picture("depends_on", drawn, caption)], words)


def _where(compared: list[Comparison]) -> Section:
    words = (
        f"The squared equation error on {compared[0].log.name}, divided over kinds of moments. "
        "Filled: more error than time by more than chance, at a false discovery rate of 5 %."
    )
    blocks: list = []
    for comparison in compared:
        shown = comparison.where[:REGIMES]
        name = comparison.model.name
        caption = f"{name.capitalize()}: share of the error over share of the time."
        picture = compare_where.regimes_figure(shown)
        blocks.append(Picture(f"where_{name.split()[0]}", picture, caption))
    grid = Grid(WHERE_HEAD, where_rows(compared[0].where, REGIMES), "Base model.", words=(0, 6))
    return Section("Where the error is", [*blocks, grid], words)


def _experiment(found: Diagnosis) -> Section | None:
    e = found.experiment
    if e is None:
        return None
    words = [f"{e.motion} ({e.purpose}), {60 * e.minutes:.0f} s: {e.command}"]
    if e.separates:
        words.append(
            f"It tells {' from '.join(e.separates)}; expected odds after it {odds(e.odds)}, from "
            "simulations of each with the other fitted to it."
        )
    blocks: list = [Notes(words)]
    if e.alternatives:
        rows = [(name, odds(value)) for name, value in ((e.motion, e.odds), *e.alternatives)]
        blocks.append(Grid(("motion", "odds"), rows, "Equal lengths."))
    return Section("What to record next", blocks)


def odds(value: float) -> str:
    """Odds as people say them."""
    return f"{value:.0f} to 1" if value >= 9.5 else f"{value:.1f} to 1"


def _log(log: Log) -> Section:
    words = [str(finding) for finding in log.findings]
    caption = f"{log.name}: {len(np.atleast_1d(log.time))} samples, {log.duration:.0f} s."
    blocks = [
        Picture(f"log_{log.name}", motion.log_figure(log), caption),
        Notes(words, "The log doctor found nothing odd."),
    ]
    return Section(f"The log {log.name}", blocks)
