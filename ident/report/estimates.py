"""Figures of estimates: how they settle while the log runs, and how they hang together."""

from __future__ import annotations

import math

import numpy as np

from ident.report.look import IDENTIFIED, MAP, NOMINAL, SYMBOLS, figure, legend, pretty, span

SETTLED = 0.25  # share of the log after which the estimates should be drawn in full
COLUMNS = 4
BAND = 0.18  # opacity
MOST_WRITTEN = 14  # parameters; with more, a number no longer fits its cell


def symbol(name: str) -> str:
    """How a figure writes the name of a parameter."""
    return SYMBOLS.get(name, name.rpartition(".")[2].replace("_", " "))


def track_height(count: int) -> float:
    """Height in inches of the figure of ``count`` estimates over time."""
    return 0.9 + 1.75 * math.ceil(count / COLUMNS)


def track_figure(
    time: np.ndarray,
    track: np.ndarray,
    names: tuple[str, ...],
    units: dict[str, str],
    nominal: dict[str, float],
    final: dict[str, tuple[float, float | None]],
    label: str,
) -> bytes:
    """Recursive estimates over time with the final 95 % interval (paper Fig. 6).

    Args:
        time: (K,) s of data used.
        track: (K, P) estimates.
        names: of the P parameters.
        units, nominal: by name; a parameter without a nominal value is left out there.
        final: value and half width of the interval, by name; None where it rests on the prior.
        label: what the nominal model is called.
    """
    draw = figure(track_height(len(names)))(_draw_track)
    return draw(time, track, names, units, nominal, final, label)


def _draw_track(canvas, time, track, names, units, nominal, final, label) -> None:
    from matplotlib.lines import Line2D
    from matplotlib.patches import Patch

    rows = math.ceil(len(names) / COLUMNS)
    height = track_height(len(names))
    axes = canvas.subplots(rows, COLUMNS, sharex=True, squeeze=False)
    canvas.subplots_adjust(0.055, 0.52 / height, 0.985, 1 - 0.62 / height, hspace=0.3, wspace=0.32)
    late = time >= time[0] + SETTLED * (time[-1] - time[0])
    for k, (axis, name) in enumerate(zip(axes.flat, names, strict=False)):
        value, half = final[name]
        axis.plot(time, track[:, k], color=IDENTIFIED)
        shown, words = [track[late, k]], [symbol(name), pretty(units[name])]
        if half is None:
            words.append("not seen")
        else:
            axis.axhspan(value - half, value + half, color=IDENTIFIED, alpha=BAND, linewidth=0)
            shown.append([value - half, value + half])
        if name in nominal:
            axis.axhline(nominal[name], color=NOMINAL, linewidth=1.2)
            shown.append([nominal[name]])
        span(axis, *shown)
        axis.set_title(", ".join(word for word in words if word))
        axis.locator_params(axis="y", nbins=4)
    for axis in axes.flat[len(names) :]:
        axis.set_visible(False)
    for column in range(COLUMNS):
        used = [axes[row, column] for row in range(rows) if row * COLUMNS + column < len(names)]
        if used:
            used[-1].set_xlabel("time, s")
            used[-1].tick_params(labelbottom=True)
    axes[0, 0].set_xlim(0.0, time[-1])
    labels = ("recursive estimate", "final value, 95 % interval", label)
    handles = (
        Line2D([], [], color=IDENTIFIED),
        Patch(color=IDENTIFIED, alpha=BAND, linewidth=0),
        Line2D([], [], color=NOMINAL),
    )
    legend(canvas, handles, labels, bbox_to_anchor=(0.045, 1.0))


@figure(4.8, width=5.2)
def correlation_figure(canvas, names: tuple[str, ...], covariance: np.ndarray) -> None:
    """Correlations of the estimates as a map; parameters kept from the prior stay blank."""
    spread = np.sqrt(np.maximum(np.diag(covariance), 0.0))
    known = spread > 0
    share = np.full_like(covariance, np.nan)
    share[np.ix_(known, known)] = covariance[np.ix_(known, known)] / np.outer(
        spread[known], spread[known]
    )
    count = len(names)
    np.fill_diagonal(share, np.nan)
    axis = canvas.add_axes((0.14, 0.08, 0.85, 0.91))
    axis.set_facecolor("#eef0f2")
    axis.imshow(share, cmap=MAP, vmin=-1, vmax=1)
    labels = [symbol(name) for name in names]
    axis.set_xticks(range(count), labels, rotation=0 if count < 9 else 60, fontsize=10)
    axis.set_yticks(range(count), labels, fontsize=10)
    axis.tick_params(length=0)
    axis.grid(False)
    for edge in axis.spines.values():
        edge.set_visible(False)
    for i in range(count):
        for j in range(count):
            if np.isfinite(share[i, j]) and count <= MOST_WRITTEN:
                strong = abs(share[i, j]) > 0.55
                axis.text(
                    j, i, f"{share[i, j]:.2f}", ha="center", va="center", fontsize=8,
                    color="white" if strong else "#4a4f57",
                )  # fmt: skip
