"""Figures of where the error is: ranked regimes, maps over velocity, residual over each signal."""

from __future__ import annotations

import numpy as np

from ident.comparison import Comparison, Regime
from ident.comparison.binned import BINS, bin_means, cell_medians
from ident.comparison.moments import wheel_torques
from ident.comparison.regimes import ROLLERS
from ident.comparison.shares import stretch_numbers
from ident.estimators import cluster_numbers
from ident.report.look import BODY, FORCES, IDENTIFIED, INK, MAP, MEASURED, WHEELS, figure, legend

ROWS = 16
CELLS, FEWEST = 13, 12
COLUMNS = 3
PER_BIN = 5  # stretches of time in a bin over time
ROW_HEIGHT = 0.27  # in


def regimes_figure(where: tuple[Regime, ...]) -> bytes:
    """Error for its time in the first regimes, with intervals."""
    shown = where[:ROWS]
    return figure(1.0 + ROW_HEIGHT * len(shown))(_draw_regimes)(shown)


def _draw_regimes(canvas, shown: tuple[Regime, ...]) -> None:
    height = 1.0 + ROW_HEIGHT * len(shown)
    axis = canvas.add_axes((0.27, 0.62 / height, 0.44, 1 - 0.72 / height))
    axis.axvline(1.0, color=MEASURED, linewidth=1.2)
    for row, regime in enumerate(shown):
        color = IDENTIFIED if regime.flagged else MEASURED
        axis.plot(regime.excess_ci95, (row, row), color=color, linewidth=2.0, solid_capstyle="butt")
        filled = color if regime.flagged else "white"
        axis.plot(regime.excess, row, "o", color=color, markerfacecolor=filled, markersize=6)
        text = (
            f"{100 * regime.share_of_error:.0f} % of the error, "
            f"{100 * regime.share_of_time:.0f} % of the "
            + ("components" if regime.kind in ("axis", "wheel") else "time")
        )
        axis.annotate(
            text, (1.02, row), xycoords=("axes fraction", "data"), va="center", fontsize=9.5,
            color=INK if regime.flagged else "#5a6069",
        )  # fmt: skip
    axis.set_yticks(range(len(shown)), [regime.name for regime in shown], fontsize=9.5)
    axis.tick_params(axis="y", length=0)
    axis.grid(False, axis="y")
    axis.set_ylim(len(shown) - 0.4, -0.6)
    axis.set_xlim(left=0.0)
    axis.set_xlabel("share of the error over share of the time")


@figure(3.7)
def map_figure(canvas, comparison: Comparison) -> None:
    """Median residual over the planes of velocities: forces as arrows, their size as colour."""
    m, force = comparison.moments, comparison.force_residual
    unit, _, moment = comparison.force_units
    vx, vy, turning = m.velocity.T
    names = ("$V_X$, m/s", "$V_Y$, m/s", "$\\Omega$, rad/s")
    axes = canvas.subplots(1, 3)
    canvas.subplots_adjust(0.065, 0.34, 0.98, 0.97, wspace=0.3)
    x, y, median = cell_medians(vx, vy, force[:, :2], CELLS, FEWEST)
    size = np.linalg.norm(median, axis=2)
    _cells(canvas, axes[0], x, y, size, f"median of the force left, {unit}", "Blues", 0.0)
    centres = np.meshgrid(0.5 * (x[1:] + x[:-1]), 0.5 * (y[1:] + y[:-1]), indexing="ij")
    axes[0].quiver(
        *centres, median[..., 0], median[..., 1], angles="xy", pivot="mid", color=INK, width=0.006,
        scale_units="width", scale=1.25 * CELLS * max(np.nanmax(size), 1e-12),
    )  # fmt: skip
    for axis, other, label in ((axes[1], vx, names[0]), (axes[2], vy, names[1])):
        cells = cell_medians(other, turning, force[:, 2:], CELLS, FEWEST)
        values = cells[2][..., 0]
        _cells(canvas, axis, *cells[:2], values, f"median of the moment left, {moment}", MAP, None)
        axis.set_xlabel(label)
        axis.set_ylabel(names[2])
    axes[0].set_xlabel(names[0])
    axes[0].set_ylabel(names[1])


def _cells(canvas, axis, x, y, values: np.ndarray, label: str, colors: str, low) -> None:
    top = float(np.nanmax(np.abs(values))) if np.any(np.isfinite(values)) else 1.0
    drawn = axis.pcolormesh(
        x, y, values.T, cmap=colors, vmin=-top if low is None else low, vmax=top, rasterized=True
    )
    axis.grid(False)
    axis.set_facecolor("#eef0f2")
    box = axis.get_position()
    bar = canvas.add_axes((box.x0, 0.115, box.width, 0.03))
    canvas.colorbar(drawn, cax=bar, orientation="horizontal", label=label)
    bar.locator_params(nbins=5)


def signals_figure(comparison: Comparison) -> bytes:
    """Mean residual over each signal that the log has, with 95 % intervals."""
    return panels_figure(comparison, _panels(comparison))


def panels_figure(comparison: Comparison, panels: list[tuple]) -> bytes:
    """Mean residuals over chosen signals, with 95 % intervals.

    Args:
        comparison: of the model whose residual it is.
        panels: ``(title, signals (N, C), residuals (N, C), colours, span)`` of each; the colours
            are ``WHEELS`` (residuals are torques on the shafts) or ``BODY``.
    """
    columns = min(COLUMNS, len(panels))
    height = 0.7 + 2.35 * -(-len(panels) // columns)
    return figure(height)(_draw_signals)(comparison, panels, height)


def _panels(comparison: Comparison) -> list[tuple]:
    """``(title, signals (N, C), residuals (N, C), colours, span)`` of each small multiple."""
    m, force = comparison.moments, comparison.force_residual
    torque = wheel_torques(comparison.residual, m.platform)
    kind = "torque, N m" if comparison.log.drive == "torque" else "voltage, V"
    panels = [("wheel speed, rad/s", m.wheel_speed, torque, WHEELS, None)]
    panels += [(f"wheel {kind}", m.command, torque, WHEELS, None)]
    if m.wheel_angle is not None:
        pitch = 360.0 / ROLLERS
        angle = np.mod(np.degrees(m.wheel_angle), pitch)
        title = f"wheel angle modulo {pitch:.0f} deg"
        panels += [(title, angle, torque, WHEELS, (0.0, pitch))]
    leveled = force / (1.0, 1.0, m.platform.lever)
    body = [("speed, m/s", m.speed, None), ("time, s", m.time, (m.time[0], m.time[-1]))]
    if m.pose is not None:
        yaw = m.pose[:, 2]
        middle = np.angle(np.mean(np.exp(1j * yaw)))  # a jump belongs where the robot seldom looks
        heading = np.degrees(middle + np.mod(yaw - middle + np.pi, 2 * np.pi) - np.pi)
        body += [("heading, deg", heading, None)]
        body += [("x, m", m.pose[:, 0], None), ("y, m", m.pose[:, 1], None)]
    body += [("yaw rate, rad/s", m.velocity[:, 2], None)]
    for title, signal, span in body:
        panels.append((title, np.repeat(signal[:, None], 3, axis=1), leveled, BODY, span))
    return panels


def _draw_signals(canvas, comparison: Comparison, panels: list[tuple], height: float) -> None:
    unit, _, moment = comparison.force_units
    columns = min(COLUMNS, len(panels))
    rows = -(-len(panels) // columns)
    axes = canvas.subplots(rows, columns, squeeze=False).ravel()
    canvas.subplots_adjust(0.07, 0.5 / height, 0.985, 1 - 0.62 / height, hspace=0.42, wspace=0.25)
    stretch = stretch_numbers(comparison.regression)
    # Over time a bin holds few stretches, so they are cut shorter.
    short = cluster_numbers(comparison.regression, PER_BIN * BINS)
    handles: dict[tuple, list] = {WHEELS: [], BODY: []}
    before = None
    for axis, (title, signals, residual, colors, span) in zip(axes, panels, strict=False):
        number = short if title.startswith("time") else stretch
        axis.axhline(0.0, color=MEASURED, linewidth=1.0)
        lines = []
        for k in range(residual.shape[1]):
            found = bin_means(signals[:, k], residual[:, k], number, span)
            color = colors[k % len(colors)]
            low, high = found.mean - found.half, found.mean + found.half
            axis.fill_between(found.centre, low, high, color=color, alpha=0.13, linewidth=0)
            lines += axis.plot(found.centre, found.mean, color=color, linewidth=1.5)
        handles[colors] = lines
        axis.set_xlabel(title)
        axis.locator_params(nbins=5)
        if axis.get_subplotspec().is_first_col() or colors is not before:
            axis.set_ylabel(moment if colors is WHEELS else unit)
        before = colors
    for axis in axes[len(panels) :]:
        axis.set_visible(False)
    forces = (FORCES[0].replace("L\\,", ""), FORCES[1].replace("L\\,", ""), "$M_O/L$")
    labels = [f"wheel {name}" for name in comparison.log.platform.wheel_names]
    labels = labels[: len(handles[WHEELS])] + list(forces)[: len(handles[BODY])]
    legend(canvas, handles[WHEELS] + handles[BODY], labels, bbox_to_anchor=(0.06, 1.0))
