"""The look of all figures: colours with one meaning each, sizes, thinned lines, PNG bytes.

matplotlib is imported where a figure is drawn, and without pyplot: nothing global, no window.
"""

from __future__ import annotations

import io
from collections.abc import Callable
from functools import wraps

import numpy as np

# One colour, one meaning, on every figure.
MEASURED = "#8a8f98"
NOMINAL = "#e07b1a"
IDENTIFIED = "#1f6fb4"
INK = "#2b2f36"
WHEELS = ("#2f8f6b", "#8e5bb0", "#7a5a3a", "#c9415c")
BODY = ("#3c4f76", "#8a8a2b", "#b06a9c")
MAP = "PRGn"  # signed shares; neither end is the colour of a model

WIDTH = 10.0  # in; figures are shown at the width of the page
DPI = 140
STYLE = {
    "font.size": 10.5,
    "axes.titlesize": 10.5,
    "axes.titlelocation": "left",
    "axes.labelsize": 10.5,
    "xtick.labelsize": 9,
    "ytick.labelsize": 9,
    "legend.fontsize": 10,
    "legend.frameon": False,
    "axes.spines.top": False,
    "axes.spines.right": False,
    "axes.edgecolor": "#9aa0a8",
    "axes.linewidth": 0.8,
    "axes.labelcolor": INK,
    "text.color": INK,
    "xtick.color": "#5a6069",
    "ytick.color": "#5a6069",
    "axes.grid": True,
    "grid.color": "#e6e8eb",
    "grid.linewidth": 0.7,
    "axes.axisbelow": True,
    "lines.linewidth": 1.3,
    "lines.solid_joinstyle": "round",
    "figure.facecolor": "white",
    "savefig.facecolor": "white",
}
SYMBOLS = {
    "m0": "$m_0$",
    "I0": "$I_0$",
    "I1": "$I_1$",
    "a_x": "$a_x$",
    "a_y": "$a_y$",
    "max": "$m\\,a_x$",
    "may": "$m\\,a_y$",
    "mu1": "$\\mu_1$",
    "mu2": "$\\mu_2$",
}
VELOCITIES = (("$V_X$", "m/s"), ("$V_Y$", "m/s"), ("$\\Omega$", "rad/s"))
FORCES = ("$L\\,F_X$", "$L\\,F_Y$", "$M_O$")


def figure(height: float | Callable[..., float], width: float = WIDTH) -> Callable:
    """Turn ``draw(figure, ...)`` into a function of the rest that returns the PNG as bytes.

    Its ``on_canvas`` returns the figure itself, of matplotlib.

    Args:
        height, width: inches; a height may be computed from what is drawn.
    """

    def decorate(draw: Callable[..., None]) -> Callable[..., bytes]:
        @wraps(draw)
        def drawn(*args) -> bytes:
            import matplotlib

            stream = io.BytesIO()
            with matplotlib.rc_context(STYLE):
                on_canvas(*args).savefig(stream, format="png", metadata={"Software": None})
            return stream.getvalue()

        def on_canvas(*args):
            import matplotlib
            from matplotlib.figure import Figure

            inches = height(*args) if callable(height) else height
            with matplotlib.rc_context(STYLE):
                canvas = Figure(figsize=(width, inches), dpi=DPI)
                draw(canvas, *args)
            return canvas

        drawn.on_canvas = on_canvas  # ty: ignore[missing-attribute]
        return drawn

    return decorate


def pretty(unit: str) -> str:
    """A unit as print shows it."""
    return unit.replace("^2", "\u00b2").replace("^3", "\u00b3")


def thin(
    x: np.ndarray, y: np.ndarray, piece: np.ndarray | None = None, points: int = 3000
) -> tuple[np.ndarray, np.ndarray]:
    """Thin a line for drawing without losing its peaks, and lift the pen between pieces.

    Args:
        x, y: (N,) coordinates.
        piece: (N,) number of the contiguous piece of each sample; None for one piece.
        points: about how many points to leave.
    """
    edges = [] if piece is None else np.flatnonzero(np.diff(piece)) + 1
    stride = max(1, 2 * len(x) // points)
    parts = []
    for rows in np.split(np.arange(len(x)), edges):
        whole = len(rows) // stride * stride
        if stride > 2 and whole:
            block = rows[:whole].reshape(-1, stride)
            low, high = y[block].argmin(axis=1), y[block].argmax(axis=1)
            at = np.sort(np.stack([low, high], axis=1), axis=1)
            rows = np.append(np.take_along_axis(block, at, axis=1).ravel(), rows[-1])
        parts += [np.column_stack([x[rows], y[rows]]), [[np.nan, np.nan]]]
    line = np.concatenate(parts[:-1])
    return line[:, 0], line[:, 1]


def legend(canvas, handles, labels, **where) -> None:
    """One legend for the whole figure, in a row at the top."""
    canvas.legend(
        handles, labels, loc="upper left", ncols=len(labels), handlelength=1.6, columnspacing=1.8,
        **where,
    )  # fmt: skip


def span(axis, *lines: np.ndarray, margin: float = 0.12) -> None:
    """Fit the y axis to some lines, whatever else is drawn."""
    values = np.concatenate([np.ravel(line) for line in lines])
    values = values[np.isfinite(values)]
    low, high = float(values.min()), float(values.max())
    room = margin * (high - low) or 0.1 * abs(high) or 1.0
    axis.set_ylim(low - room, high + room)
