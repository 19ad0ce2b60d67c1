"""Figures of a diagnosis: every effect that was tried, sizes, the error falling, the base."""

from __future__ import annotations

import numpy as np

from ident.diagnosis.holdout import FreeRunErrors
from ident.diagnosis.minimum_detectable import MinimumDetectable
from ident.diagnosis.settings import SETTINGS
from ident.improvement import LUMPS
from ident.report.estimates import symbol
from ident.report.look import (
    IDENTIFIED,
    INK,
    MEASURED,
    NOMINAL,
    figure,
    pretty,
    span,
)
from ident.report.outcome import percent, rounded
from ident.results import Quantity

SOFT = "#5a6069"
ROW_HEIGHT = 0.27  # in
COLUMNS = 5
# The axis of gains reaches at least so far, %.
NARROWEST = 30.0
# Effects that make things worse where they were not fitted all do so; how much does not matter.
LOWEST = -0.15
AXES = (("$V_X$", "m/s"), ("$V_Y$", "m/s"), ("$\\Omega$", "rad/s"))


def gains_figure(detectable: tuple[MinimumDetectable, ...], named: tuple[str, ...]) -> bytes:
    """Share of the squared error that each effect removes where it was not fitted.

    Args:
        detectable: every effect that was tried.
        named: identifiers of those that were added.
    """
    shown = sorted(detectable, key=lambda one: -one.gain)
    height = 1.25 + ROW_HEIGHT * len(shown)
    return figure(height)(_draw_gains)(shown, named, height)


def _draw_gains(
    canvas, shown: list[MinimumDetectable], named: tuple[str, ...], height: float
) -> None:
    from matplotlib.lines import Line2D

    axis = canvas.add_axes((0.2, 0.55 / height, 0.43, 1 - 1.25 / height))
    axis.axvline(0.0, color=MEASURED, linewidth=1.0)
    axis.axvline(100 * SETTINGS.least_gain, color=NOMINAL, linewidth=1.4)
    for row, one in enumerate(shown):
        sure = one.p < SETTINGS.significant or one.gain > SETTINGS.overwhelming
        color = IDENTIFIED if sure and one.gain > SETTINGS.least_gain else MEASURED
        at = 100 * max(one.gain, LOWEST)
        axis.plot((0.0, at), (row, row), color=color, linewidth=2.4, solid_capstyle="butt")
        marker = "<" if one.gain < LOWEST else "o"
        filled = color if sure else "white"
        axis.plot(at, row, marker, color=color, markerfacecolor=filled, markersize=6)
        smallest = "never" if one.smallest is None else f"{one.smallest:.2g} {pretty(one.unit)}"
        style = {"va": "center", "fontsize": 9.5, "xycoords": ("axes fraction", "data"),
                 "color": INK if one.power >= SETTINGS.power else SOFT}  # fmt: skip
        axis.annotate(f"{one.parameter} = {smallest}", (1.05, row), **style)
        axis.annotate(f"{one.typical:.2g}", (1.52, row), ha="right", **style)
        axis.annotate(f"{100 * one.power:.0f} %", (1.74, row), ha="right", **style)
    heads = {"xycoords": ("axes fraction", "data"), "va": "bottom", "fontsize": 9.5, "color": SOFT}
    axis.annotate("minimum detectable", (1.05, -0.75), **heads)
    axis.annotate("typical", (1.52, -0.75), ha="right", **heads)
    axis.annotate("power there", (1.74, -0.75), ha="right", **heads)
    axis.set_yticks(range(len(shown)), [one.effect for one in shown], fontsize=9.5)
    for label, one in zip(axis.get_yticklabels(), shown, strict=True):
        if one.effect in named:
            label.set_fontweight("bold")
    axis.tick_params(axis="y", length=0)
    axis.grid(False, axis="y")
    axis.set_ylim(len(shown) - 0.4, -0.6)
    axis.set_xlim(100 * LOWEST - 4, min(103.0, max(NARROWEST, 120 * shown[0].gain)))
    axis.set_xlabel("squared error removed where it was not fitted, %")
    handles = (
        Line2D([], [], color=IDENTIFIED, marker="o", linewidth=2.4),
        Line2D([], [], color=MEASURED, marker="o", linewidth=2.4),
        Line2D([], [], color=MEASURED, marker="o", markerfacecolor="white", linewidth=2.4),
        Line2D([], [], color=NOMINAL, linewidth=1.4),
    )
    labels = ("passes", "significant, gains too little", "not significant", "least gain to count")
    canvas.legend(
        handles, labels, loc="upper left", ncols=4, bbox_to_anchor=(0.0, 1.0), handlelength=1.6,
        columnspacing=1.8,
    )  # fmt: skip


@figure(lambda errors: 1.15 + 0.42 * len(errors.names))
def error_steps_figure(canvas, errors: FreeRunErrors) -> None:
    """Free-run error on held-out windows with every effect that was added."""
    height = canvas.get_figheight()
    names = ["base model", *(f"+ {name}" for name in errors.names[1:])]
    grid = canvas.add_gridspec(
        1, 4, width_ratios=(1.9, 1, 1, 1), left=0.2, right=0.98, bottom=0.6 / height,
        top=1 - 0.4 / height, wspace=0.18,
    )  # fmt: skip
    axes = [canvas.add_subplot(grid[0, k]) for k in range(4)]
    total = 100 * np.array(errors.nrmse)
    columns = [total, *errors.axes.T]
    titles = ["all axes, % of the motion's rms", *(f"{name}, {unit}" for name, unit in AXES)]
    for axis, values, title in zip(axes, columns, titles, strict=True):
        colors = [NOMINAL] + [IDENTIFIED] * (len(values) - 1)
        axis.barh(range(len(values)), values, height=0.62, color=colors)
        axis.set_ylim(len(values) - 0.5, -0.5)
        axis.set_xlim(0.0, 1.4 * float(np.max(values)))
        for row, value in enumerate(values):
            text = percent(value / 100) if axis is axes[0] else rounded(value, value)
            axis.annotate(
                text, (value, row), xytext=(4, 0), textcoords="offset points", va="center",
                fontsize=9.5,
            )  # fmt: skip
        axis.set_title(title)
        axis.set_yticks(range(len(values)), names if axis is axes[0] else [])
        axis.tick_params(axis="y", length=0)
        axis.grid(False, axis="y")
        axis.locator_params(axis="x", nbins=4 if axis is axes[0] else 3)
    axes[0].axvline(100 * errors.floor, color=INK, linestyle="--", linewidth=1.1)
    axes[0].set_xlabel(f"dashed: noise of sensors and drive, {percent(errors.floor)}", color=SOFT)


def sizes_figure(rows: list[tuple[str, float, tuple[float, float], float, str]]) -> bytes:
    """Sizes of the effects that were added, with 95 % intervals, in units of typical ones.

    Args:
        rows: label, value, interval, typical size, unit.
    """
    height = 0.75 + 0.34 * len(rows)
    return figure(height)(_draw_sizes)(rows, height)


def _draw_sizes(canvas, rows: list[tuple], height: float) -> None:
    axis = canvas.add_axes((0.33, 0.55 / height, 0.4, 1 - 0.65 / height))
    axis.axvline(0.0, color=MEASURED, linewidth=1.0)
    for row, (_, value, (low, high), typical, unit) in enumerate(rows):
        ends = (low / typical, high / typical)
        axis.plot(ends, (row, row), color=IDENTIFIED, linewidth=2.4, solid_capstyle="butt")
        axis.plot(value / typical, row, "o", color=IDENTIFIED, markersize=6)
        text = f"{value:.3g} ({low:.3g} ... {high:.3g}) {pretty(unit)}"
        axis.annotate(
            text, (1.03, row), xycoords=("axes fraction", "data"), va="center", fontsize=9.5
        )
    axis.set_yticks(range(len(rows)), [label for label, *_ in rows], fontsize=9.5)
    axis.tick_params(axis="y", length=0)
    axis.grid(False, axis="y")
    axis.set_ylim(len(rows) - 0.4, -0.6)
    axis.set_xlabel("size over the typical one, with 95 % interval")


def base_figure(names: list[str], stages: list[dict[str, Quantity]]) -> bytes:
    """Base parameters at every stage with 95 % intervals; open where the logs do not fix them.

    Args:
        names: what is drawn.
        stages: quantities by name, from the base model on.
    """
    height = 0.55 + 1.75 * -(-len(names) // COLUMNS)
    return figure(height)(_draw_base)(names, stages, height)


def _draw_base(canvas, names: list[str], stages: list[dict], height: float) -> None:
    rows = -(-len(names) // COLUMNS)
    axes = canvas.subplots(rows, COLUMNS, squeeze=False).ravel()
    canvas.subplots_adjust(0.07, 0.4 / height, 0.985, 1 - 0.3 / height, hspace=0.55, wspace=0.62)
    for axis, name in zip(axes, names, strict=False):
        shown = []
        for number, stage in enumerate(stages):
            q, color = stage[name], IDENTIFIED if number else NOMINAL
            if q.ci95 is not None:
                axis.plot((number, number), q.ci95, color=color, linewidth=2.4,
                          solid_capstyle="butt")  # fmt: skip
            filled = color if q.ci95 is not None else "white"
            axis.plot(number, q.value, "o", color=color, markerfacecolor=filled, markersize=6)
            shown.append((q.value, *(q.ci95 or ())))
        span(axis, *map(np.array, shown))
        words = (symbol(name) if name not in LUMPS else name.replace("+", " + "), stage[name].unit)
        axis.set_title(", ".join(pretty(word) for word in words))
        labels = ["base", *(f"+{number}" for number in range(1, len(stages)))]
        axis.set_xticks(range(len(stages)), labels)
        axis.set_xlim(-0.5, len(stages) - 0.5)
        axis.grid(False, axis="x")
        axis.locator_params(axis="y", nbins=4)
    for axis in axes[len(names) :]:
        axis.set_visible(False)
