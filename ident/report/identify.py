"""The page of an identification: what was found, how far to trust it, and what it rests on."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.log import Log
from ident.recording_words import in_words
from ident.report import forces, motion
from ident.report.estimates import correlation_figure, track_figure
from ident.report.findings import findings_notes
from ident.report.outcome import (
    Outcome,
    agreement,
    agreement_note,
    determined,
    effect_rows,
    error_rows,
    lump_rows,
    parameter_rows,
    parameter_units,
    percent,
)
from ident.report.page import Grid, Name, Notes, Page, Picture, Section
from youbot_env.parameters import MEANING

SUBSCRIPTS = str.maketrans(
    "0123456789", "\u2080\u2081\u2082\u2083\u2084\u2085\u2086\u2087\u2088\u2089"
)
LUMP_MEANING = {
    "x1+x3": "inertia against translation",
    "x2+x3": "inertia against turning",
    "x6": "friction of the wheels",
    "x7": "friction of the rollers",
}


def identification_page(outcome: Outcome, provenance: dict[str, str], logs: Sequence[Log]) -> Page:
    """Draw everything and put the page together; nothing is written.

    Args:
        outcome: what was found.
        provenance: how the result came about, as name and text.
        logs: all that were given, with their findings.
    """
    result, label = outcome.result, outcome.label
    samples = sum(len(log.time) for log in result.logs)
    seconds = sum(log.duration for log in result.logs)
    fitted = " and ".join(log.name for log in result.logs)
    lead = (
        f"Fitted by {result.method} to {samples} samples ({seconds:.0f} s) of {fitted}. "
        "Free run: body velocities simulated in windows of 5 s from the measured drive input "
        "alone, each window starting at the measured velocity; the error is its rms over the rms "
        "of the motion about its mean, all three axes together."
    )
    gain, seen = outcome.before_run.nrmse / outcome.after_run.nrmse, result.observability
    figures = [
        (percent(float(result.residual_nrmse[3])), "of the drive's force unexplained"),
        (f"{seen.rank} of {len(seen.names)}", "parameter directions seen"),
        (f"{seconds:.0f} s", "of motion fitted"),
    ]
    if np.isfinite(gain) and gain > 1:
        times = f"{gain:.2g}" if gain < 10 else f"{gain:.0f}"
        figures.insert(0, (f"{times} times", f"less free-run error than {label}"))
    verdict = outcome.verdict
    if outcome.problems:
        verdict = f"Do not use this model: {'; '.join(outcome.problems)}. {verdict}"
    return Page(
        "Identification of a mecanum platform",
        verdict,
        not outcome.problems,
        lead,
        figures,
        [
            _prediction(outcome),
            Section("How the logs were recorded", [Notes(in_words(result.recording), "")]),
            _parameters(outcome),
            _trust(outcome),
            _estimators(outcome),
            _forces(outcome),
            _log(outcome, logs),
        ],
        provenance,
    )


def _prediction(outcome: Outcome) -> Section:
    label = outcome.label
    png = motion.free_run_figure(outcome.before_run, outcome.after_run, label)
    kind = "kept out of the fit" if outcome.held_out else "the one that was fitted"
    caption = (
        f"Body velocities of {outcome.judged_on}, {kind}, and the same simulated in free run"
        f"{_shown(outcome.before_run.time, motion.SHOWN)}. A line that breaks starts anew at the "
        "measured velocity."
    )
    head = ("axis", "unit", "rms of the motion", f"rms error, {label}", "rms error, identified")
    rows = [(_name(row[0]), *row[1:]) for row in error_rows(outcome)]
    blocks = [Picture("free_run", png, caption), Grid(head, rows, words=(0, 1))]
    return Section("How well the models predict", blocks)


def _parameters(outcome: Outcome) -> Section:
    result = outcome.result
    marks = [f"({k}) {doubt}" for k, doubt in enumerate(outcome.doubts, 1)]
    meaning = MEANING | {
        f"{a.identifier}.{flat}": a.effect.title for a in result.model.effects for flat in a.values
    }
    found = parameter_rows(outcome) + effect_rows(outcome)
    rows = [(_name(row[0], meaning), *row[1:]) for row in found]
    lumps = [(_name(row[0], LUMP_MEANING), *row[1:]) for row in lump_rows(outcome)]
    head = ("parameter", outcome.label, "identified", "95 % interval", "unit")
    note = (
        "Combinations that are known better than the single inertias, in the paper's coordinates: "
        "x1 = m0 L^2, x2 = I0, x3 the spin inertia of all wheels as it resists turning, x6 and x7 "
        "the frictions likewise."
    )
    blocks = [
        Grid((*head, "source", "doubt"), rows, words=(0, 4, 5, 6)),
        Notes(marks, "Nothing about these values is physically odd."),
        Grid(head, lumps, note, words=(0, 4)),
    ]
    return Section("Parameters", blocks)


def _trust(outcome: Outcome) -> Section:
    result = outcome.result
    seen = result.observability
    total = len(seen.names)
    names = result.model.names()
    firm = np.array([determined(result, name) for name in names])
    covariance = np.where(np.outer(firm, firm), np.array(result.model.covariance), 0.0)
    png = correlation_figure(names, covariance)
    caption = (
        "Correlations of the estimate. A pair near 1 or -1 is known only together; a blank row "
        "rests on the prior model."
    )
    words = [f"Practically unidentifiable: {sentence}." for sentence in seen.words]
    words += [f"Structurally unidentifiable: {sentence}." for sentence in result.invisible]
    if np.isfinite(seen.condition):
        lead = (
            f"The log determines all {total} parameters; the condition number of the scaled "
            f"regression is {seen.condition:.3g}."
        )
    else:
        lead = (
            f"The log determines {seen.rank} of {total} directions; along the others the prior "
            "model is kept."
        )
    blocks = [Picture("correlation", png, caption, wide=False), Notes(words, wide=False)]
    return Section("What the log cannot tell", blocks, lead)


def _estimators(outcome: Outcome) -> Section:
    result = outcome.result
    names, units = result.regression.names, parameter_units(result.model)
    time, track = result.track
    at = [result.model.names().index(name) for name in names]
    values = np.array(result.model.values())[at]
    spread = np.sqrt(np.maximum(np.diag(np.array(result.model.covariance))[at], 0.0))
    factor = result.estimates["least squares"].quantile
    final = {
        name: (value, factor * se if determined(result, name) else None)
        for name, value, se in zip(names, values, spread, strict=True)
    }
    before = dict(zip(outcome.before.names(), outcome.before.values(), strict=True))
    known = {name: before[name] for name in names if name in before}
    png = track_figure(
        _running(time, result.logs[0].time[0]), track, names, units, known, final, outcome.label
    )
    caption = (
        "Recursive least squares while the log runs, and the final value with its 95 % interval. "
        "The first quarter may leave the picture."
    )
    head, rows = agreement(outcome)
    rows = [(_name(row[0]), *row[1:]) for row in rows]
    grid = Grid(head, rows, agreement_note(result), words=(0, len(head) - 1))
    return Section("Do the estimators agree", [Picture("estimates", png, caption), grid])


def _forces(outcome: Outcome) -> Section:
    result, label = outcome.result, outcome.label
    regression = result.regression
    before = dict(zip(outcome.before.names(), outcome.before.values(), strict=True))
    after = dict(zip(result.model.names(), result.model.values(), strict=True))
    old = regression.H @ np.array([before.get(name, 0.0) for name in regression.names])
    new = regression.H @ np.array([after[name] for name in regression.names])
    running = _running(regression.time, result.logs[0].time[0])
    x, y, yaw, _ = (percent(float(share)) for share in result.residual_nrmse)
    caption = (
        f"Generalized forces of the drive, filtered, times the lever L = {regression.lever:.4g} m "
        f"where they are forces{_shown(running, forces.SHOWN)}. Unexplained: {x}, {y} and {yaw} "
        "of their rms."
    )
    # Voltages in place of torques leave one common factor open, torque per volt.
    unit = "N m" if result.logs[0].drive == "torque" else "V"
    drawn = forces.forces_figure(running, regression.piece, regression.y, old, new, label, unit)
    residual = forces.residual_figure(result.velocity, regression.y, old, new, label, unit)
    blocks = [
        Picture("forces", drawn, caption),
        Picture(
            "residual",
            residual,
            "Where the residual is large: rms of what the equation leaves of each force, over the "
            "velocity on the same axis. Humps at small and middle speeds point to dry friction, a "
            "rise at the ends to drag, slip or saturation.",
        ),
    ]
    return Section("Forces predicted and measured", blocks)


def _log(outcome: Outcome, logs: Sequence[Log]) -> Section:
    first = outcome.result.logs[0]
    png = motion.log_figure(first)
    caption = (
        f"{first.name}: {len(first.time)} samples, {first.duration:.0f} s at {1 / first.dt:.0f} Hz."
    )
    return Section("The log", [Picture("log", png, caption), findings_notes(logs)])


def _running(time: np.ndarray, origin: float) -> np.ndarray:
    """Time from an origin that runs on from one log to the next."""
    steps = np.diff(time)
    typical = float(np.median(steps[steps > 0]))
    return time[0] - origin + np.cumsum(np.r_[0.0, np.where(steps > 0, steps, typical)])


def _shown(time: np.ndarray, most: float) -> str:
    return f" (the first {most:.0f} s)" if time[-1] - time[0] > most else ""


def _name(name: str, meaning: dict[str, str] | None = None) -> Name:
    """A parameter, lump or axis as symbol with index."""
    words = (meaning or {}).get(name, "")
    greek = name.replace("mu", "\u03bc").replace("Omega", "\u03a9")
    if name in ("max", "may"):
        return Name("m a", name[-1], words)
    if name.startswith("x"):
        return Name(" + ".join(name.translate(SUBSCRIPTS).split("+")), "", words)
    if "." in name:
        name = name.rpartition(".")[2]
        letter, _, index = name.partition("_")
        return Name(letter, index, words)
    letter, index = greek.split("_") if "_" in greek else (greek.rstrip("0123456789"), "")
    return Name(letter, index or greek[len(letter) :].lstrip("_"), words)
