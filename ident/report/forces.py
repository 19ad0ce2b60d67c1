"""Figures of the equation: predicted against measured generalized forces, and what is left."""

from __future__ import annotations

import numpy as np

from ident.report.look import (
    FORCES,
    IDENTIFIED,
    MEASURED,
    NOMINAL,
    VELOCITIES,
    figure,
    legend,
    span,
    thin,
)

SHOWN = 120.0  # s
DOTS = 1500
BINS = 14
FEWEST = 20  # rows; a bin with fewer says nothing


@figure(6.4)
def forces_figure(
    canvas,
    time: np.ndarray,
    piece: np.ndarray,
    measured: np.ndarray,
    nominal: np.ndarray,
    identified: np.ndarray,
    label: str,
    unit: str,
) -> None:
    """Filtered generalized forces over time and one against the other (paper Fig. 7).

    Args:
        time: (N,) s.
        piece: (N,) number of the contiguous piece.
        measured, nominal, identified: (N, 3) in ``unit``.
        label: what the nominal model is called.
        unit: of the forces times the lever.
    """
    grid = canvas.add_gridspec(
        3, 2, width_ratios=(3.4, 1), left=0.075, right=0.985, bottom=0.085, top=0.93, wspace=0.17,
        hspace=0.26,
    )  # fmt: skip
    rows = time <= time[0] + SHOWN
    dots = slice(None, None, max(1, len(time) // DOTS))
    lines = (
        (measured, MEASURED, 2.8, "measured"),
        (nominal, NOMINAL, 1.1, f"predicted, {label}"),
        (identified, IDENTIFIED, 1.1, "predicted, identified"),
    )
    for k, force in enumerate(FORCES):
        axis, scatter = canvas.add_subplot(grid[k, 0]), canvas.add_subplot(grid[k, 1])
        for values, color, width, label in lines:
            line = thin(time[rows], values[rows, k], piece[rows])
            axis.plot(*line, color=color, linewidth=width, label=label)
        axis.set_ylabel(f"{force}, {unit}")
        axis.set_xlim(0.0, time[rows][-1])
        axis.tick_params(labelbottom=k == 2)
        span(axis, measured[rows, k], identified[rows, k])
        for values, color in ((nominal, NOMINAL), (identified, IDENTIFIED)):
            scatter.plot(
                measured[dots, k], values[dots, k], ".", color=color, markersize=2.2, alpha=0.5,
                markeredgewidth=0,
            )  # fmt: skip
        low, high = measured[:, k].min(), measured[:, k].max()
        scatter.plot((low, high), (low, high), color=MEASURED, linewidth=0.9)
        span(scatter, measured[dots, k], identified[dots, k])
        scatter.set_xlim(scatter.get_ylim())
        scatter.locator_params(nbins=4)
        scatter.set_ylabel(f"predicted, {unit}", fontsize=9)
        if k == 0:
            legend(canvas, *axis.get_legend_handles_labels(), bbox_to_anchor=(0.065, 1.0))
    axis.set_xlabel("time, s")
    scatter.set_xlabel(f"measured, {unit}")


@figure(3.2)
def residual_figure(
    canvas,
    velocity: np.ndarray,
    measured: np.ndarray,
    nominal: np.ndarray,
    identified: np.ndarray,
    label: str,
    unit: str,
) -> None:
    """What the equation leaves unexplained, by axis, over the velocity on that axis.

    Args:
        velocity: (N, 3) m/s, m/s, rad/s.
        measured, nominal, identified: (N, 3) in ``unit``.
        label: what the nominal model is called.
        unit: of the forces times the lever.
    """
    from matplotlib.ticker import LogLocator, NullFormatter

    axes = canvas.subplots(1, 3)
    canvas.subplots_adjust(0.075, 0.17, 0.985, 0.83, wspace=0.24)
    models = ((nominal, NOMINAL, label), (identified, IDENTIFIED, "identified"))
    for k, (axis, force, (name, unit)) in enumerate(zip(axes, FORCES, VELOCITIES, strict=True)):
        edges = np.linspace(*np.percentile(velocity[:, k], (0.5, 99.5)), BINS + 1)
        number = np.digitize(velocity[:, k], edges) - 1
        for predicted, color, label in models:
            rms = _rms_by_bin((measured - predicted)[:, k], number)
            axis.stairs(rms, edges, baseline=None, color=color, linewidth=1.6, label=label)
        rms = _rms_by_bin(measured[:, k], number)
        axis.stairs(
            rms, edges, baseline=None, color=MEASURED, linewidth=1.6, label="measured force itself"
        )
        axis.set_yscale("log")
        axis.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.yaxis.set_major_formatter("{x:g}")
        axis.yaxis.set_minor_formatter(NullFormatter())
        axis.set_xlabel(f"{name}, {unit}")
        axis.set_title(f"axis of {force}")
    axes[0].set_ylabel(f"residual rms, {unit}")
    legend(canvas, *axes[0].get_legend_handles_labels(), bbox_to_anchor=(0.065, 1.02))


def _rms_by_bin(values: np.ndarray, number: np.ndarray) -> np.ndarray:
    inside = (number >= 0) & (number < BINS)
    count = np.bincount(number[inside], minlength=BINS)
    squares = np.bincount(number[inside], values[inside] ** 2, minlength=BINS)
    return np.sqrt(np.where(count >= FEWEST, squares / np.maximum(count, 1), np.nan))
