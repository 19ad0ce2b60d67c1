"""Figure of when the error is: residual and free-run error over time, worst stretches marked."""

from __future__ import annotations

import numpy as np

from ident.comparison import Comparison
from ident.comparison.stretches import window_errors
from ident.report.look import INK, figure, legend, thin

SMOOTH = 1.0  # s


@figure(4.6)
def time_figure(canvas, drawn: list[tuple[str, Comparison]]) -> None:
    """Residual force and free-run error of some models over time.

    Args:
        drawn: colour and comparison of each model, the best last; its worst stretches are marked.
    """
    from matplotlib.ticker import LogLocator, NullFormatter

    best = drawn[-1][1]
    axes = canvas.subplots(2, 1, sharex=True)
    canvas.subplots_adjust(0.075, 0.115, 0.985, 0.88, hspace=0.14)
    for color, comparison in drawn:
        time, size = residual_size(comparison)
        line = thin(time, size, comparison.regression.piece)
        axes[0].plot(*line, color=color, label=comparison.model.name)
        _windows(axes[1], comparison, color)
    for number, stretch in enumerate(best.worst, start=1):
        for axis in axes:
            axis.axvspan(stretch.start, stretch.end, color="#f3ead8", zorder=0, linewidth=0)
        axes[0].annotate(
            str(number), (0.5 * (stretch.start + stretch.end), 1.02), va="bottom", ha="center",
            xycoords=("data", "axes fraction"), fontsize=10, color=INK,
        )  # fmt: skip
    for axis in axes:
        axis.set_yscale("log")
        axis.yaxis.set_major_locator(LogLocator(subs=(1, 2, 5)))
        axis.yaxis.set_major_formatter("{x:g}")
        axis.yaxis.set_minor_formatter(NullFormatter())
    axes[0].set_ylabel(f"force left, {best.force_units[0]}")
    axes[1].set_ylabel("free-run error, %")
    axes[1].set_xlabel("time, s")
    axes[1].set_xlim(0.0, best.log.duration)
    legend(canvas, *axes[0].get_legend_handles_labels(), bbox_to_anchor=(0.065, 1.01))


def residual_size(comparison: Comparison) -> tuple[np.ndarray, np.ndarray]:
    """Time (N,), s, and running rms (N,) of the force left, moment over the lever, N."""
    lever, force = comparison.regression.lever, comparison.force_residual
    squared = np.sum((force / (1.0, 1.0, lever)) ** 2, axis=1)
    time = comparison.moments.time
    low, high = (np.searchsorted(time, time + half) for half in (-SMOOTH / 2, SMOOTH / 2))
    total = np.concatenate([[0.0], np.cumsum(squared)])
    return time, np.sqrt((total[high] - total[low]) / np.maximum(high - low, 1))


def _windows(axis, comparison: Comparison, color: str) -> None:
    run, start = comparison.run, comparison.log.time[0]
    first = np.flatnonzero(np.diff(run.window, prepend=-1))
    last = np.append(first[1:], len(run.window)) - 1
    errors = 100 * np.sqrt(window_errors(run))
    x = np.stack([run.time[first], run.time[last], np.full(len(first), np.nan)], 1) - start
    y = np.stack([errors, errors, np.full(len(first), np.nan)], 1)
    axis.plot(x.ravel(), y.ravel(), color=color, linewidth=2.2, solid_capstyle="butt")
