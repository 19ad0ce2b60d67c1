"""Figure of when the error is: residual and free-run error over time, worst stretches marked."""

from __future__ import annotations

import json
import math
from pathlib import Path

import numpy as np

from ident.comparison import Comparison
from ident.comparison.stretches import start_pose, track, window_errors
from ident.report.look import INK, MEASURED, figure, legend, thin
from ident.report.page import Live
from youbot_env.platform import Platform

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


HERE = Path(__file__).parent
RATE = 25.0  # frames a second; more than an eye follows
DIGITS = 4  # of a metre and of a radian


def player(drawn: list[tuple[str, Comparison]]) -> Live:
    """Measured and simulated motion in the worst stretches of the best model.

    Args:
        drawn: colour and comparison of each model over the same windows, the best last.
    """
    from jinja2 import Environment, FileSystemLoader, StrictUndefined

    environment = Environment(
        loader=FileSystemLoader(HERE), autoescape=True, undefined=StrictUndefined
    )
    data = scene(drawn)
    # A closing tag inside a name must not end the script.
    text = json.dumps(data, separators=(",", ":"), allow_nan=False).replace("<", "\\u003c")
    html = environment.get_template("player.html").render(data=data, text=text)
    best = drawn[-1][1]
    caption = (
        f"The stretches in which {best.model.name} goes most astray, worst first. Grey: the motion "
        "that the measured velocities give; in colour: what the models make of the same drive "
        "input. All start at the same pose and velocity."
    )
    return Live("player", html, caption)


def scene(drawn: list[tuple[str, Comparison]]) -> dict:
    """Everything the player shows: robot, models, stretches with poses at ``RATE``."""
    best = drawn[-1][1]
    models = [
        {"name": c.model.name, "color": color, "shown": c is best or len(drawn) <= 2}
        for color, c in drawn
    ]
    return {
        "measured": MEASURED,
        "ink": INK,
        "robot": robot_outline(best.log.platform),
        "models": models,
        "stretches": [_motion(stretch, drawn) for stretch in best.worst],
    }


def robot_outline(platform: Platform) -> dict:
    """Body polygon and wheels, m and rad, in the body frame."""
    wheels = platform.wheels
    centre = np.mean([(w.x, w.y) for w in wheels], axis=0)
    around = sorted(wheels, key=lambda w: math.atan2(w.y - centre[1], w.x - centre[0]))
    return {
        "body": [[round(w.x, DIGITS), round(w.y, DIGITS)] for w in around],
        "wheels": [[round(w.x, DIGITS), round(w.y, DIGITS), w.heading] for w in wheels],
        "radius": platform.wheel_radius,
    }


def _motion(stretch, drawn: list[tuple[str, Comparison]]) -> dict:
    best = drawn[-1][1]
    run, log = best.run, best.log
    rows = np.flatnonzero(run.window == stretch.window)
    time, start = run.time[rows], start_pose(log, run.time[rows[0]])
    frames = np.linspace(time[0], time[-1], max(2, round((time[-1] - time[0]) * RATE) + 1))
    tracks = [track(time, run.measured[rows], start)]
    tracks += [track(time, c.run.simulated[rows], start) for _, c in drawn]
    return {
        "start": round(stretch.start, 2),
        "seconds": round(float(time[-1] - time[0]), 3),
        "error": round(100 * stretch.nrmse, 1),
        "share": round(100 * stretch.share_of_error, 1),
        "tracks": [_frames(time, poses, frames) for poses in tracks],
    }


def _frames(time: np.ndarray, poses: np.ndarray, frames: np.ndarray) -> list[list[float]]:
    """Poses at the frames; one that is not finite, or farther than any floor, stops there."""
    at = np.stack([np.interp(frames, time, column) for column in poses.T], axis=1)
    wild = ~np.all(np.isfinite(at) & (np.abs(at) < 1e4), axis=1)
    if np.any(wild):
        at = at[: max(1, int(np.argmax(wild)))]
        at = np.where(np.isfinite(at), at, 0.0)
    return np.round(at, DIGITS).tolist()
