"""The page of a comparison: which model is best, where it fails, and how that looks."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from ident.comparison import Beside, Comparison, Standing
from ident.log import Log
from ident.report import compare_where, motion
from ident.report.compare_time import player, time_figure
from ident.report.compare_words import (
    BESIDE,
    FREE_RUN_HEAD,
    WHERE_HEAD,
    beside_table,
    equation_head,
    equation_rows,
    failing,
    free_run_rows,
    harmonic_rows,
    note,
    share,
    stretch_rows,
    verdict,
    where_rows,
)
from ident.report.findings import findings_notes
from ident.report.look import IDENTIFIED, NOMINAL
from ident.report.outcome import percent
from ident.report.page import Grid, Page, Picture, Section

# The best model is blue and a nominal one orange; what others have must not be taken for either.
OTHERS = ("#2f8f6b", "#8e5bb0", "#c9415c", "#7a5a3a")
MOST_DRAWN = 1 + len(OTHERS)
REGIMES, HARMONICS = 20, 8


def comparison_page(
    standings: list[Standing],
    provenance: dict[str, str],
    logs: Sequence[Log] = (),
    fitted: Beside | None = None,
) -> Page:
    """Draw everything and put the page together; nothing is written.

    Args:
        standings: models in the order of their errors.
        provenance: how it came about, by name.
        logs: whose findings are told; that of the comparison if left.
        fitted: the models on the logs that they were fitted to, where others judge.
    """
    best = standings[0].comparison
    drawn = colored(standings)
    run, duration = best.run, best.log.duration
    window = best.worst[0].end - best.worst[0].start + best.log.dt
    lead = (
        f"{failing(best)} {best.log.name}: {duration:.0f} s at {1 / best.log.dt:.0f} Hz. Free run: "
        f"body velocities simulated in windows of {window:.3g} s from the measured drive input "
        "alone, each window starting at the measured velocity. Equation: what the filtered "
        "equations of motion leave of the measured forces. Shares are of each signal's rms about "
        "its mean."
    )
    figures = [
        (percent(run.nrmse), f"free-run error of {best.model.name}"),
        (percent(float(best.equation[3])), "of the drive's force unexplained"),
        (str(len(standings)), "models compared" if len(standings) > 1 else "model compared"),
    ]
    sections = [
        _errors(standings, drawn, fitted),
        _where(best),
        _velocity(best),
        _signals(best),
        _time(drawn),
        _log(best, logs or [best.log]),
    ]
    good = bool(np.isfinite(run.nrmse) and run.nrmse < 1.0)
    title = "Models against a measured log"
    words = verdict(standings).replace(" %", "\u00a0%")
    return Page(title, words, good, lead, figures, sections, provenance)


def colored(standings: list[Standing]) -> list[tuple[str, Comparison]]:
    """Colour and comparison of the models that are drawn, the best last and on top."""
    left, drawn = iter(OTHERS), []
    for standing in standings[:MOST_DRAWN]:
        comparison = standing.comparison
        if comparison is standings[0].comparison:
            color = IDENTIFIED
        else:
            color = NOMINAL if comparison.model.name == "nominal" else next(left)
        drawn.append((color, comparison))
    return drawn[::-1]


def _errors(
    standings: list[Standing], drawn: list[tuple[str, Comparison]], fitted: Beside | None
) -> Section:
    best = standings[0].comparison
    rows = free_run_rows(standings)
    beside = (
        "95 % intervals from windows drawn at random, for both models alike where two are compared."
    )
    blocks = [
        Grid(FREE_RUN_HEAD, rows, f"Free run, rms errors. {beside}"),
        Grid(equation_head(best.force_units), equation_rows(standings), "Equation, rms errors."),
    ]
    if fitted is not None:
        blocks.insert(1, Grid(*beside_table(standings, fitted), f"{BESIDE}."))
    png = motion.velocities_figure([(c.model.name, color, c.run) for color, c in drawn])
    left_out = len(standings) - len(drawn)
    caption = (
        "Measured velocities and free runs"
        + (f", the first {motion.SHOWN:.0f} s" if best.log.duration > motion.SHOWN else "")
        + ". A line that breaks starts anew at the measured velocity."
        + (f" The {left_out} models with the largest errors are not drawn." if left_out else "")
    )
    blocks.append(Picture("free_run", png, caption))
    warning = note(best.log)
    return Section("How large the errors are", blocks, warning)


def _where(best: Comparison) -> Section:
    lead = (
        f"The squared equation error of {best.model.name}, divided over kinds of moments. Regimes "
        "of one wheel share out the residual force that falls to that wheel. Filled: more error "
        "than time by more than chance, at a false discovery rate of 5 % over all "
        f"{len(best.where)} regimes."
    )
    caption = "Share of the error over share of the time, with 95 % intervals: above one the error "
    caption += "gathers there."
    picture = Picture("regimes", compare_where.regimes_figure(best.where), caption)
    grid = Grid(WHERE_HEAD, where_rows(best.where, REGIMES), words=(0, 6))
    return Section("Where the error is", [picture, grid], lead)


def _velocity(best: Comparison) -> Section:
    caption = (
        "Left: median force left over by the equations, as arrow (right is forward, up is left) "
        "and colour. Arrows along the velocity: resistance that the model lacks; everywhere in "
        "one direction: a slope or an offset. Middle and right: median moment left over. Cells "
        "without enough rows stay blank."
    )
    picture = Picture("velocity_map", compare_where.map_figure(best), caption)
    return Section("Over the velocities", [picture])


def _signals(best: Comparison) -> Section:
    caption = (
        "Mean of what the equations leave, with 95 % intervals from stretches of time. Over wheel "
        "signals: as torque on that wheel's shaft. Over the others: forces on the body, the moment "
        "over the lever L. A step at zero speed is dry friction; a line, wrong viscous friction, "
        "inertia or gain; a wave over the heading, a slope; six waves a turn, rollers."
    )
    blocks: list = [Picture("signals", compare_where.signals_figure(best), caption)]
    if best.ripple:
        unit = best.force_units[2]
        head = ("wheel", f"amplitude, {unit}", "95 % interval", "p adjusted", "significant")
        told = (
            "Harmonics of the wheel angles in the residual, the most significant and largest first."
        )
        blocks.append(Grid(head, harmonic_rows(best, HARMONICS), told, words=(0, 4)))
    return Section("Over each signal", blocks)


def _time(drawn: list[tuple[str, Comparison]]) -> Section:
    best = drawn[-1][1]
    total = share(sum(stretch.share_of_error for stretch in best.worst))
    caption = (
        "Above: force that the equations leave, running rms over 1 s, the moment over the lever L "
        "included. Below: free-run error of each window. Shaded and numbered: the worst windows "
        f"of {best.model.name}; they hold {total} % of its squared error."
    )
    head = ("stretch", "time, s", "vx m/s", "vy m/s", "yaw rad/s", "error %", "of all error %")
    blocks = [
        Picture("time", time_figure(drawn), caption),
        player(drawn),
        Grid(head, stretch_rows(best), words=(0, 1)),
    ]
    return Section("When it is worst", blocks)


def _log(best: Comparison, logs: Sequence[Log]) -> Section:
    log = best.log
    png = motion.log_figure(log)
    caption = f"{log.name}: {len(log.time)} samples, {log.duration:.0f} s."
    return Section("The log", [Picture("log", png, caption), findings_notes(logs)])
