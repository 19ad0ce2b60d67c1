"""Figures of motions: simulated against measured velocities, and the log itself."""

from __future__ import annotations

import numpy as np
from scipy.integrate import cumulative_trapezoid

from ident.free_run import FreeRun
from ident.log import Log
from ident.report.look import (
    BODY,
    IDENTIFIED,
    MEASURED,
    NOMINAL,
    VELOCITIES,
    WHEELS,
    figure,
    legend,
    span,
    thin,
)
from youbot_env.backend import NUMPY
from youbot_env.stepping import pose_rate

SHOWN = 60.0  # s; more would hide the shape of the motion


def free_run_figure(nominal: FreeRun, identified: FreeRun, label: str) -> bytes:
    """Velocities over time, measured and simulated by two models (paper Fig. 5).

    Args:
        nominal, identified: free runs over the same windows.
        label: what the first model is called.
    """
    return velocities_figure([(label, NOMINAL, nominal), ("identified", IDENTIFIED, identified)])


@figure(6.2)
def velocities_figure(canvas, runs: list[tuple[str, str, FreeRun]]) -> None:
    """Velocities over time, measured and simulated by some models.

    Args:
        runs: name, colour and free run of each model over the same windows; the last, on top, is
            the one whose lines fit into the picture.
    """
    last = runs[-1][2]
    rows = last.time <= last.time[0] + SHOWN
    time, window = (last.time - last.time[0])[rows], last.window[rows]
    axes = canvas.subplots(3, 1, sharex=True)
    canvas.subplots_adjust(0.075, 0.085, 0.985, 0.925, hspace=0.16)
    lines = [(last.measured, MEASURED, 2.8, "measured")]
    lines += [(run.simulated, color, 1.2, f"simulated, {label}") for label, color, run in runs]
    for k, (axis, (symbol, unit)) in enumerate(zip(axes, VELOCITIES, strict=True)):
        for values, color, width, label in lines:
            line = thin(time, values[rows, k], window)
            axis.plot(*line, color=color, linewidth=width, label=label)
        axis.set_ylabel(f"{symbol}, {unit}")
        span(axis, last.measured[rows, k], last.simulated[rows, k], margin=0.3)
    axes[-1].set_xlabel("time, s")
    axes[-1].set_xlim(time[0], time[-1])
    legend(canvas, *axes[0].get_legend_handles_labels(), bbox_to_anchor=(0.065, 1.0))


@figure(5.2)
def log_figure(canvas, log: Log) -> None:
    """Path in the plane, wheel (or body) speeds and drive input of a log."""
    grid = canvas.add_gridspec(
        2, 2, width_ratios=(1, 1.55), left=0.075, right=0.985, bottom=0.1, top=0.92, wspace=0.22,
        hspace=0.16,
    )  # fmt: skip
    path, upper = canvas.add_subplot(grid[:, 0]), canvas.add_subplot(grid[0, 1])
    lower = canvas.add_subplot(grid[1, 1], sharex=upper)
    for number, piece in enumerate(log.pieces()):
        x, y = _path(piece)
        path.plot(*thin(x, y), color=MEASURED, linewidth=1.2)
        if number == 0:
            path.plot(x[0], y[0], "o", color=MEASURED)
            path.annotate(
                "start", (x[0], y[0]), xytext=(0, -15), textcoords="offset points", ha="center"
            )
    path.set_aspect("equal", adjustable="datalim")
    path.set_xlabel("x, m")
    path.set_ylabel("y, m")
    path.set_title("path" if log.pose is not None else "path, from the measured velocities")
    piece = np.searchsorted(log.starts, np.arange(len(log.time)), side="right")
    upper.tick_params(labelbottom=False)
    if log.wheel_velocity is not None:
        _traces(upper, log, log.wheel_velocity, piece, log.platform.wheel_names, WHEELS)
        upper.set_ylabel("wheel velocity, rad/s")
    else:
        scaled = log.velocity() * [1.0, 1.0, log.platform.lever]
        _traces(upper, log, scaled, piece, ("$V_X$", "$V_Y$", "$L\\,\\Omega$"), BODY)
        upper.set_ylabel("body velocity, m/s")
    _traces(lower, log, log.command, piece, log.platform.wheel_names, WHEELS)
    lower.set_ylabel("wheel torque, N m" if log.drive == "torque" else "wheel voltage, V")
    lower.set_xlabel("time, s")
    lower.set_xlim(0.0, log.duration)
    legend(canvas, *upper.get_legend_handles_labels(), bbox_to_anchor=(0.46, 1.0))
    if log.wheel_velocity is None:
        above = {"loc": "lower left", "bbox_to_anchor": (0.0, 0.98), "borderpad": 0.1}
        lower.legend(ncols=len(log.platform.wheels), fontsize=9, **above)


def _path(piece: Log) -> tuple[np.ndarray, np.ndarray]:
    """Measured x and y (N,), m, or the velocities integrated from the origin on."""
    if piece.pose is not None:
        return piece.pose[:, 0], piece.pose[:, 1]
    v = tuple(piece.velocity().T)
    yaw = cumulative_trapezoid(v[2], piece.time, initial=0.0)
    rate = pose_rate(v, yaw, NUMPY)
    return tuple(cumulative_trapezoid(part, piece.time, initial=0.0) for part in rate[:2])


def _traces(axis, log: Log, values: np.ndarray, piece: np.ndarray, labels, colors) -> None:
    for k, label in enumerate(labels):
        line = thin(log.time - log.time[0], values[:, k], piece, points=2000)
        axis.plot(*line, color=colors[k % len(colors)], linewidth=0.7, label=label)
    # A few spikes should not press the rest together.
    span(axis, np.percentile(values, (0.05, 99.95)), margin=0.1)
