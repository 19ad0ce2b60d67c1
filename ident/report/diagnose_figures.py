"""Figures of a diagnosis: every effect that was tried, the error falling, what is left over."""

from __future__ import annotations

import numpy as np
from scipy.signal import periodogram

from ident.comparison import Comparison
from ident.comparison.moments import wheel_torques
from ident.diagnosis.power import POWER, Reach
from ident.diagnosis.rounds import LEAST_GAIN, SIGNIFICANT
from ident.diagnosis.untouched import FreeRunErrors
from ident.improvement import LUMPS
from ident.quantities import Quantity
from ident.report.compare_where import panels_figure
from ident.report.estimates import symbol
from ident.report.look import (
    BODY,
    IDENTIFIED,
    INK,
    MEASURED,
    NOMINAL,
    WHEELS,
    figure,
    pretty,
    span,
)
from ident.report.outcome import percent, rounded

SOFT = "#5a6069"
ROW_HEIGHT = 0.27  # in
COLUMNS = 5
# Effects that make things worse where they were not fitted all do so; how much does not matter.
LOWEST = -0.15
# Time since a reversal that is drawn, s.
RECENT = 1.5
# Oscillations that are looked for in the residual, Hz, as far as a log of that length shows them.
SLOWEST, FASTEST, PERIODS = 0.05, 3.0, 3
AXES = (("$V_X$", "m/s"), ("$V_Y$", "m/s"), ("$\\Omega$", "rad/s"))


def gains_figure(reach: tuple[Reach, ...], named: tuple[str, ...]) -> bytes:
    """Share of the squared error that each effect removes where it was not fitted.

    Args:
        reach: every effect that was tried.
        named: identifiers of those that were added.
    """
    shown = sorted(reach, key=lambda one: -one.gain)
    height = 1.25 + ROW_HEIGHT * len(shown)
    return figure(height)(_draw_gains)(shown, named, height)


def _draw_gains(canvas, shown: list[Reach], named: tuple[str, ...], height: float) -> None:
    from matplotlib.lines import Line2D

    axis = canvas.add_axes((0.2, 0.55 / height, 0.43, 1 - 1.25 / height))
    axis.axvline(0.0, color=MEASURED, linewidth=1.0)
    axis.axvline(100 * LEAST_GAIN, color=NOMINAL, linewidth=1.4)
    for row, one in enumerate(shown):
        passes = one.p < SIGNIFICANT and one.gain > LEAST_GAIN
        color = IDENTIFIED if passes else MEASURED
        at = 100 * max(one.gain, LOWEST)
        axis.plot((0.0, at), (row, row), color=color, linewidth=2.4, solid_capstyle="butt")
        marker = "<" if one.gain < LOWEST else "o"
        filled = color if one.p < SIGNIFICANT else "white"
        axis.plot(at, row, marker, color=color, markerfacecolor=filled, markersize=6)
        smallest = "never" if one.smallest is None else f"{one.smallest:.2g} {pretty(one.unit)}"
        style = {"va": "center", "fontsize": 9.5, "xycoords": ("axes fraction", "data"),
                 "color": INK if one.power >= POWER else SOFT}  # fmt: skip
        axis.annotate(f"{one.parameter} = {smallest}", (1.05, row), **style)
        axis.annotate(f"{one.typical:.2g}", (1.52, row), ha="right", **style)
        axis.annotate(f"{100 * one.power:.0f} %", (1.74, row), ha="right", **style)
    heads = {"xycoords": ("axes fraction", "data"), "va": "bottom", "fontsize": 9.5, "color": SOFT}
    axis.annotate("smallest size seen", (1.05, -0.75), **heads)
    axis.annotate("typical", (1.52, -0.75), ha="right", **heads)
    axis.annotate("power there", (1.74, -0.75), ha="right", **heads)
    axis.set_yticks(range(len(shown)), [one.effect for one in shown], fontsize=9.5)
    for label, one in zip(axis.get_yticklabels(), shown, strict=True):
        if one.effect in named:
            label.set_fontweight("bold")
    axis.tick_params(axis="y", length=0)
    axis.grid(False, axis="y")
    axis.set_ylim(len(shown) - 0.4, -0.6)
    axis.set_xlim(100 * LOWEST - 4, 103)
    axis.set_xlabel("squared error removed where it was not fitted, %")
    handles = (
        Line2D([], [], color=IDENTIFIED, marker="o", linewidth=2.4),
        Line2D([], [], color=MEASURED, marker="o", linewidth=2.4),
        Line2D([], [], color=MEASURED, marker="o", markerfacecolor="white", linewidth=2.4),
        Line2D([], [], color=NOMINAL, linewidth=1.4),
    )
    labels = ("passes", "significant, gains too little", "not significant", "least gain")
    canvas.legend(
        handles, labels, loc="upper left", ncols=4, bbox_to_anchor=(0.0, 1.0), handlelength=1.6,
        columnspacing=1.8,
    )  # fmt: skip


def error_steps_figure(errors: FreeRunErrors) -> bytes:
    """Free-run error on untouched windows with every effect that was added."""
    height = 1.15 + 0.42 * len(errors.names)
    return figure(height)(_draw_steps)(errors, height)


def _draw_steps(canvas, errors: FreeRunErrors, height: float) -> None:
    names = ["base model", *(f"+ {name}" for name in errors.names[1:])]
    grid = canvas.add_gridspec(
        1, 4, width_ratios=(2.2, 1, 1, 1), left=0.2, right=0.985, bottom=0.6 / height,
        top=1 - 0.4 / height, wspace=0.16,
    )  # fmt: skip
    axes = [canvas.add_subplot(grid[0, k]) for k in range(4)]
    total = 100 * np.array(errors.nrmse)
    columns = [total, *errors.axes.T]
    titles = ["all axes, % of the motion's rms", *(f"{name}, {unit}" for name, unit in AXES)]
    for axis, values, title in zip(axes, columns, titles, strict=True):
        colors = [NOMINAL] + [IDENTIFIED] * (len(values) - 1)
        axis.barh(range(len(values)), values, height=0.62, color=colors)
        axis.set_ylim(len(values) - 0.5, -0.5)
        axis.set_xlim(0.0, 1.22 * float(np.max(values)))
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
        axis.locator_params(axis="x", nbins=4)
    axes[0].axvline(100 * errors.floor, color=INK, linestyle="--", linewidth=1.1)
    axes[0].set_xlabel(f"dashed: noise of the sensors, {percent(errors.floor)}", color=SOFT)


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
    canvas.subplots_adjust(0.07, 0.4 / height, 0.985, 1 - 0.3 / height, hspace=0.55, wspace=0.3)
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


def dependence_figure(comparison: Comparison, signals: list[str]) -> bytes | None:
    """Mean of what the equations leave over the signals that it depends on.

    Args:
        comparison: of the model with everything that was added.
        signals: names of ``ident.diagnosis.dependence``.

    Returns:
        None where the log has none of the signals.
    """
    found = [panel for signal in signals for panel in _panels(comparison, signal)]
    return panels_figure(comparison, found) if found else None


def _panels(comparison: Comparison, signal: str) -> list[tuple]:
    """Panels for ``panels_figure`` of one signal; empty where the log does not have it."""
    m, force = comparison.moments, comparison.force_residual
    leveled = force / (1.0, 1.0, m.platform.lever)
    torque = wheel_torques(comparison.residual, m.platform)

    def body(title: str, values: np.ndarray, span=None) -> tuple:
        return (title, np.repeat(values[:, None], 3, axis=1), leveled, BODY, span)

    def wheels(title: str, values: np.ndarray, span=None) -> tuple:
        return (title, values, torque, WHEELS, span)

    if signal == "forward speed":
        return [body("$V_X$, m/s", m.velocity[:, 0])]
    if signal == "sideways speed":
        return [body("$V_Y$, m/s", m.velocity[:, 1])]
    if signal == "yaw rate":
        return [body("yaw rate, rad/s", m.velocity[:, 2])]
    if signal == "wheel speed":
        return [wheels("wheel speed, rad/s", m.wheel_speed)]
    if signal == "torque":
        kind = "torque, N m" if m.drive == "torque" else "voltage, V"
        return [wheels(f"wheel {kind}", m.command)]
    if signal == "history of the direction":
        since = since_reversal(m.time, m.wheel_speed)
        along = np.where(since <= RECENT, np.sign(m.wheel_speed), 0.0)
        title = "time since the wheel turned round, s"
        return [(title, since, torque * along, WHEELS, (0.0, RECENT))]
    if signal == "wheel angle" and m.wheel_angle is not None:
        angle = np.mod(np.degrees(m.wheel_angle), 360.0)
        return [wheels("wheel angle, deg", angle, (0.0, 360.0))]
    if signal == "heading" and m.pose is not None:
        heading = np.degrees(np.mod(m.pose[:, 2] + np.pi, 2 * np.pi) - np.pi)
        return [body("heading, deg", heading)]
    if signal == "place" and m.pose is not None:
        return [body("x, m", m.pose[:, 0]), body("y, m", m.pose[:, 1])]
    if signal == "time":
        period = strongest_period(m.time, leveled)
        panels = [body("time, s", m.time, (m.time[0], m.time[-1]))]
        if period is not None:
            phase = np.mod(m.time - m.time[0], period)
            title = f"time, folded at {1 / period:.3g} Hz, s"
            panels.append(body(title, phase, (0.0, period)))
        return panels
    return []


def since_reversal(time: np.ndarray, speed: np.ndarray) -> np.ndarray:
    """(N, n) s since each wheel last changed its direction; infinite before it first did."""
    since = np.empty_like(speed)
    for k in range(speed.shape[1]):
        turned = np.append(False, np.diff(np.sign(speed[:, k])) != 0)
        last = np.maximum.accumulate(np.where(turned, time, -np.inf))
        since[:, k] = time - last
    return since


def strongest_period(time: np.ndarray, force: np.ndarray) -> float | None:
    """Period, s, at which residual forces (N, C) oscillate most; None for a short log."""
    step = float(np.median(np.diff(time)))
    even = np.arange(time[0], time[-1], step)
    evenly = np.stack([np.interp(even, time, column) for column in force.T], axis=1)
    frequency, power = periodogram(evenly, 1.0 / step, axis=0, detrend="linear")
    slowest = max(SLOWEST, PERIODS / (even[-1] - even[0]))
    inside = (frequency >= slowest) & (frequency <= min(FASTEST, 0.4 / step))
    if not np.any(inside):
        return None
    return float(1.0 / frequency[inside][np.argmax(power.sum(axis=1)[inside])])
