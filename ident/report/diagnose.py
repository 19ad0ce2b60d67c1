"""The page of a diagnosis: what is missing, why that is believed, and what is left unexplained."""

from __future__ import annotations

import numpy as np

from ident.comparison import compare
from ident.consistency import invisible
from ident.diagnosis.diagnose import Diagnosis
from ident.diagnosis.minimum_detectable import MinimumDetectable
from ident.diagnosis.settings import SETTINGS
from ident.log import Log
from ident.recording_words import in_words
from ident.report import motion
from ident.report.compare_words import probability
from ident.report.diagnose_error import depends_on, ends, falling, where
from ident.report.diagnose_figures import gains_figure, sizes_figure
from ident.report.findings import findings_notes
from ident.report.outcome import interval, percent, rounded
from ident.report.page import Grid, Notes, Page, Picture, Section
from youbot_env.effects import get_effect

# Head of ``untried_lines``.
UNTRIED = "Not tried, because these logs do not show it"
DOCTOR = "What the log doctor found"
HEADLINES = {
    "named": "Missing",
    "ambiguous": "Missing, but not told apart",
    "nothing_missing": "Nothing is missing",
    "outside_library": "Missing, and not in the library",
    "cannot_say": "These logs cannot say",
}


def diagnosis_page(
    found: Diagnosis, provenance: dict[str, str], logs: tuple[Log, ...] = ()
) -> Page:
    """Draw everything and put the page together; nothing is written.

    Args:
        found: the diagnosis.
        provenance: how it came about, by name.
        logs: whose findings are told, and which are shown where the diagnosis has used none.
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
        f"{found.log}: {len(found.minimum_detectable)} effects were tried on {used:.0f} s of "
        f"motion. An effect counts when it is significant among all that were tried and removes "
        f"more than {100 * SETTINGS.least_gain:.0f} % of the squared free-run error of stretches "
        f"to which it was not fitted; what changes with time {100 * SETTINGS.changing:.0f} % of "
        f"that to which it was. {found.errors.windows} windows were kept for the end; nothing was "
        "fitted to them or chosen by them."
    )


def figures(found: Diagnosis) -> list[tuple[str, str]]:
    """The few numbers that carry the verdict."""
    if found.errors is None:
        return []
    errors = found.errors
    shown = [
        (percent(errors.before), f"{errors.what} of the base model"),
        (percent(errors.after), "with what was added"),
        (percent(errors.floor), "left by noise of sensors and drive"),
    ]
    return shown if len(errors.nrmse) > 1 else [shown[0], shown[2]]


def sections(found: Diagnosis, logs: tuple[Log, ...] = ()) -> list[Section]:
    """Everything between the verdict and the provenance."""
    if found.first is None:
        shown = [_experiment(found), *(_log(log) for log in logs)]
    else:
        compared = compare(found.first.parts[0].log, ends(found))
        shown = [
            Section("How the logs were recorded", [Notes(in_words(found.recording), "")]),
            _tried(found),
            _sizes(found),
            _untried(found),
            _experiment(found),
            falling(found),
            depends_on(found, compared),
            where(compared),
        ]
    if logs:
        shown.append(Section(DOCTOR, [findings_notes(logs)]))
    return [section for section in shown if section is not None]


def units_note(log: Log) -> str:
    """What units mean where the drive was logged in volts; empty for a log of torques."""
    if log.drive == "torque":
        return ""
    words = invisible([log])[0]
    return f"{words[0].upper()}{words[1:]}; units stand for themselves times volts per N m."


def untried_lines(found: Diagnosis) -> list[str]:
    """What the logs cannot show and what to record, with the effects that this is said of."""
    about: dict[str, list[str]] = {}
    for effect, reason in found.untried.items():
        about.setdefault(reason, []).append(effect)
    return [f"{', '.join(effects)}: {reason}" for reason, effects in about.items()]


def _untried(found: Diagnosis) -> Section | None:
    lines = untried_lines(found)
    return Section(UNTRIED, [Notes(lines)]) if lines else None


def _tried(found: Diagnosis) -> Section:
    named = tuple(step.best.identifier for step in found.steps)
    caption = (
        "On top of the base model, each effect alone in its best form. Those that pass are refined "
        "together with the base parameters; of those that then fit alike the simplest is added "
        "(bold). An effect that is looked for and not there makes errors larger where it was not "
        "fitted; an arrow: by more than the picture shows. Right: the smallest size that these "
        f"logs show with a chance of {100 * SETTINGS.power:.0f} %, and the chance to see the "
        "typical size."
    )
    if found.first.parts[0].log.drive == "voltage":
        caption += " Typical are sizes in N m; beside sizes in volts they say little."
    head = (
        "effect",
        "size",
        "on its own",
        "95 % interval",
        "unit",
        "held-out reduction %",
        "p adjusted",
    )
    rows = [
        (r.effect, r.parameter, _figure(r.size, r), " ... ".join(_figure(v, r) for v in r.ci95),
         r.unit or "-", f"{100 * r.gain:.1f}", probability(r.p))
        for r in sorted(found.minimum_detectable, key=lambda one: -one.gain)
    ]  # fmt: skip
    table = (
        "Sizes before anything else is added: effects that stand in for a missing one take its "
        "place here. Held-out reduction: share of squared error removed where it was not fitted."
    )
    blocks = [
        Picture("effects", gains_figure(found.minimum_detectable, named), caption),
        Grid(head, rows, table, words=(0, 1, 4)),
    ]
    return Section("Every effect that was tried", blocks)


def _figure(value: float, one: MinimumDetectable) -> str:
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
    if units := units_note(found.first.parts[0].log):
        notes.append(units)
    if notes:
        blocks.append(Notes(notes))
    if drawn:
        caption = "Sizes in the final model, in units of what is typical of each effect."
        blocks.insert(0, Picture("sizes", sizes_figure(drawn), caption))
    return Section("What was added", blocks)


def experiment_lines(found: Diagnosis) -> list[str]:
    """What to record next and what for; empty where nothing is proposed."""
    e = found.experiment
    if e is None:
        return []
    words = [
        f"{e.motion}: {e.purpose}, {60 * e.minutes:.0f} s.",
        f"With a simulated robot: {e.command}",
    ]
    if e.separates:
        words.append(
            f"It tells {' from '.join(e.separates)}: expected odds {odds(e.odds)}, from "
            "simulations of each with the other fitted to it."
        )
    return words


def _experiment(found: Diagnosis) -> Section | None:
    e = found.experiment
    if e is None:
        return None
    blocks: list = [Notes(experiment_lines(found))]
    if e.alternatives:
        rows = [(name, odds(value)) for name, value in ((e.motion, e.odds), *e.alternatives)]
        blocks.append(
            Grid(
                ("motion", "odds"), rows, "Odds of the true effect after a record of equal length."
            )
        )
    return Section("What to record next", blocks)


def odds(value: float) -> str:
    """Odds as people say them."""
    if value >= SETTINGS.certain_odds:
        return f"more than {SETTINGS.certain_odds:,.0f} to 1"
    return f"{value:,.0f} to 1" if value >= 9.5 else f"{value:.1f} to 1"


def _log(log: Log) -> Section:
    caption = f"{log.name}: {len(np.atleast_1d(log.time))} samples, {log.duration:.0f} s."
    picture = Picture(f"log_{log.name}", motion.log_figure(log), caption)
    return Section(f"The log {log.name}", [picture])
