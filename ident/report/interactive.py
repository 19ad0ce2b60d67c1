"""Figures that can be zoomed and hovered, as Plotly reads them: plain dicts, made of results.

The workbench draws them; ``plotly.graph_objects.Figure(figure)`` shows the same in a notebook.
Nothing is computed here but what a drawing needs.  Colours are those of Okabe and Ito, which people
tell apart whatever their colour vision; lines differ in dash as well.  Text and grid have no
colour of their own: ``ident.report.themes`` gives them one.
"""

from __future__ import annotations

import re
from collections.abc import Sequence
from typing import Any

import numpy as np

from ident.comparison import Comparison, Regime
from ident.comparison.binned import bin_means, cell_medians
from ident.comparison.moments import wheel_torques
from ident.comparison.regimes import slices
from ident.comparison.shares import stretch_numbers
from ident.free_run import FreeRun
from ident.log import Log
from ident.report.look import pretty, thin
from ident.report.themes import DASHES, STAGES, stage_color
from ident.results import Quantity
from youbot_env.backend import NUMPY
from youbot_env.effects import effect_names, get_effect
from youbot_env.references import Reference

Figure = dict[str, Any]

FLOOR = "#8a8f98"
# In a row at the top of the figure, where it stays when the figure changes its size.
LEGEND = {"orientation": "h", "yref": "container", "y": 0.995, "yanchor": "top", "x": 0.0}
VELOCITIES = (("V<sub>X</sub>", "m/s"), ("V<sub>Y</sub>", "m/s"), ("Ω", "rad/s"))
SHORT, LONG = 24, 40  # bins of a residual
POINTS = 2400
# Signals that residuals are drawn over, by the name in a menu.
SIGNALS = ("wheel speed", "roller phase", "wheel torque", "heading", "time")
# Planes that residual forces are mapped over, by the name in a menu.
PLANES = ("velocity map", "floor map")
CELLS, FEWEST = 15, 10  # cells a side, and rows that a cell needs to say something


def staircase(names: Sequence[str], errors: Sequence[float], floor: float | None) -> Figure:
    """The error falling from stage to stage, with what noise leaves; shares on a log scale."""
    x = list(range(len(names)))
    percent = [100 * error for error in errors]
    data = [
        {"type": "scatter", "mode": "lines", "x": x, "y": percent, "hoverinfo": "skip",
         "line": {"shape": "hv", "color": "ink", "width": 1.5}},
        {"type": "scatter", "mode": "markers", "x": x, "y": percent, "text": list(names),
         "marker": {"size": 10, "color": [stage_color(k) for k in x]},
         "hovertemplate": "%{text}: %{y:.3g} %<extra></extra>"},
    ]  # fmt: skip
    shapes = []
    if floor:
        line = {"color": FLOOR, "dash": "dot", "width": 1.5}
        shapes.append({"type": "line", "xref": "paper", "x0": 0, "x1": 1, "y0": 100 * floor,
                       "y1": 100 * floor, "line": line})  # fmt: skip
    values = percent + ([100 * floor] if floor else [])
    low, high = np.log10(min(values)) - 0.25, np.log10(max(values)) + 0.25
    layout = {
        "showlegend": False, "shapes": shapes, "margin": {"l": 44, "r": 8, "t": 6, "b": 8},
        "xaxis": {"visible": False, "range": [-0.3, max(len(names) - 0.7, 1.2)],
                  "fixedrange": True},
        "yaxis": {"type": "log", "range": [float(low), float(high)], "ticksuffix": " %",
                  "fixedrange": True, "dtick": 1, "tickfont": {"size": 10}},
    }  # fmt: skip
    return {"data": data, "layout": layout}


def velocities(
    runs: Sequence[tuple[str, int, FreeRun]],
    start: float,
    held_out: Sequence[tuple[float, float]] = (),
    marked: Sequence[tuple[float, float]] = (),
    window: float | None = None,
) -> Figure:
    """Measured body velocities and free runs over time.

    Args:
        runs: name, number of the stage and free run of each model, over the same windows.
        start: time, s, at which the log begins.
        held_out: stretches, s from there, that nothing was fitted to; they are shaded.
        marked: stretches that are marked.
        window: length of the free runs, s, said on the axis.
    """
    data: list[dict] = []
    first = runs[0][2]
    for k, (_, unit) in enumerate(VELOCITIES):
        axes = {"xaxis": "x", "yaxis": f"y{k + 1}" if k else "y"}
        lines = [("measured", {"color": "ink", "width": 3}, first.measured, 0.55)]
        lines += [
            (name, {"color": stage_color(n), "width": 1.6, "dash": DASHES[min(n, 5)]},
             run.simulated, 1.0)
            for name, n, run in runs
        ]  # fmt: skip
        for name, line, values, opacity in lines:
            x, y = thin(first.time - start, values[:, k], first.window, POINTS)
            data.append({
                "type": "scatter", "mode": "lines", "name": name, "legendgroup": name,
                "showlegend": k == 0, "x": _list(x), "y": _list(y), "line": line,
                "opacity": opacity, **axes,
                "hovertemplate": f"{name} %{{y:.3f}} {unit}<extra></extra>",
            })  # fmt: skip
    shapes = [_band(span, "rgba(86,180,233,0.13)") for span in held_out]
    shapes += [_band(span, "rgba(213,94,0,0.16)") for span in marked]
    notes = []
    if held_out:
        notes.append({"x": held_out[0][0], "y": 1.0, "yref": "paper", "yanchor": "bottom",
                      "xanchor": "left", "text": "held out", "showarrow": False,
                      "font": {"size": 12}})  # fmt: skip
    told = f", free runs start anew every {window:.3g} s" if window else ""
    layout = {
        "shapes": shapes, "annotations": notes, "hovermode": "x unified",
        "legend": LEGEND,
        "margin": {"l": 70, "r": 16, "t": 44, "b": 46},
        "xaxis": {"title": {"text": f"time, s{told}"}, "anchor": "y3"},
    }  # fmt: skip
    for k, (symbol, unit) in enumerate(VELOCITIES):
        # A run that goes far astray must not press the rest together.
        low, high = np.percentile(first.measured[:, k], (0.2, 99.8))
        room = 0.35 * (high - low) or 0.1
        layout[f"yaxis{k + 1}" if k else "yaxis"] = {
            "title": {"text": f"{symbol}, {unit}"},
            "domain": [(2 - k) * 0.345, (2 - k) * 0.345 + 0.31],
            "range": [float(low - room), float(high + room)],
        }  # fmt: skip
    return {"data": data, "layout": layout}


def residual_torques(
    compared: Sequence[tuple[str, int, Comparison]],
    signal: str = "wheel speed",
    regime: str | None = None,
) -> Figure:
    """Torque that the equations leave on each wheel over a signal, several stages on the same axes.

    Args:
        compared: name, number of the stage and comparison of each, with the same log.
        signal: one of ``SIGNALS``.
        regime: name of a regime; only its moments are drawn.

    Raises:
        ValueError: the log does not have the signal.
    """
    m = compared[0][2].moments
    wheels = m.platform.wheel_names
    values, title, span = _signal(compared[0][2], signal)
    mask = np.ones(len(m.time), bool) if regime is None else _mask(compared[0][2], regime)
    stretch = stretch_numbers(compared[0][2].regression)
    unit = compared[0][2].force_units[2]
    data, ends = [], []
    for name, number, one in compared:
        torque = wheel_torques(one.residual, m.platform)
        for k, wheel in enumerate(wheels):
            column = values[:, k] if values.ndim == 2 else values
            ends_of = span or tuple(np.percentile(column, (1, 99)))
            bins = LONG if mask.sum() > 4000 else SHORT
            b = bin_means(column[mask], torque[mask, k], stretch[mask], ends_of, bins)
            known = np.isfinite(b.mean)
            if not known.any():
                continue
            x, y, half = b.centre[known], b.mean[known], b.half[known]
            color, axes = stage_color(number), _panel(k)
            data.append({
                "type": "scatter", "mode": "lines", "x": _list([*x, *x[::-1]]),
                "y": _list([*(y + half), *(y - half)[::-1]]), "fill": "toself",
                "fillcolor": _faint(color), "line": {"width": 0}, "hoverinfo": "skip",
                "showlegend": False, "legendgroup": name, **axes,
            })  # fmt: skip
            data.append({
                "type": "scatter", "mode": "lines+markers", "x": _list(x), "y": _list(y),
                "name": name, "legendgroup": name, "showlegend": k == 0,
                "line": {"color": color, "width": 2, "dash": DASHES[min(number, 5)]},
                "marker": {"color": color, "size": 5}, **axes,
                "hovertemplate": f"{wheel}, {name}: %{{y:.3f}} {unit} at %{{x:.3g}}<extra></extra>",
            })  # fmt: skip
            ends += [y.min(), y.max()]
    high = 1.25 * max(map(abs, ends), default=1.0)
    layout: dict[str, Any] = {
        "legend": LEGEND, "annotations": [],
        "margin": {"l": 70, "r": 16, "t": 44, "b": 48},
    }  # fmt: skip
    columns, rows = 2, -(-len(wheels) // 2)
    for k, wheel in enumerate(wheels):
        row, column = divmod(k, columns)
        left, bottom = column * 0.56, 1 - (row + 1) / rows + (0.1 / rows if row < rows - 1 else 0)
        top, tail = 1 - row / rows - (0.07 if row else 0.0), f"{k + 1}" if k else ""
        layout[f"xaxis{tail}"] = {
            "domain": [left, left + 0.44], "anchor": f"y{tail}", "matches": "x" if k else None,
            "title": {"text": title, "standoff": 4} if row == rows - 1 else {"text": ""},
        }  # fmt: skip
        layout[f"yaxis{tail}"] = {
            "domain": [bottom, top], "anchor": f"x{tail}", "range": [-high, high],
            "title": {"text": f"residual torque, {unit}"} if column == 0 else {"text": ""},
        }  # fmt: skip
        layout["annotations"].append({
            "text": f"wheel {wheel}", "showarrow": False, "xref": "paper", "yref": "paper",
            "x": left + 0.01, "y": top, "xanchor": "left", "yanchor": "top", "font": {"size": 13},
        })  # fmt: skip
    for axis in [key for key in layout if key.startswith("xaxis")]:
        layout[axis] = {k: v for k, v in layout[axis].items() if v is not None}
    return {"data": data, "layout": layout}


def residual_map(compared: Sequence[tuple[str, int, Comparison]], plane: str) -> Figure:
    """Median force that the equations leave, over a plane: its size as colour, arrows for where to.

    Arrows along the velocity: resistance that a model lacks.  Everywhere in one direction of the
    floor: a slope or a cable.

    Args:
        compared: name, number of the stage and comparison of each, side by side.
        plane: one of ``PLANES``.

    Raises:
        ValueError: the log has no pose.
    """
    m = compared[0][2].moments
    if plane == "floor map" and m.pose is None:
        raise ValueError("the log has no pose; record x, y and yaw for a map of the floor")
    unit = compared[0][2].force_units[0]
    titles = ("x, m", "y, m") if plane == "floor map" else tuple(
        f"{symbol}, {u}" for symbol, u in VELOCITIES[:2]
    )  # fmt: skip
    data: list[dict] = []
    layout: dict[str, Any] = {
        "annotations": [], "showlegend": False, "margin": {"l": 60, "r": 60, "t": 34, "b": 48},
    }  # fmt: skip
    found = [_mapped(one, plane) for _, _, one in compared]
    largest = max(float(np.nanmax(np.hypot(*cells[2].T))) for cells in found)
    for k, ((name, _, _), (x, y, force)) in enumerate(zip(compared, found, strict=True)):
        size, tail = np.hypot(force[..., 0], force[..., 1]), f"{k + 1}" if k else ""
        left, width = k / len(compared), 1 / len(compared) - (0.09 if len(compared) > 1 else 0.0)
        data.append({
            "type": "heatmap", "x": _list(x), "y": _list(y), "z": [_list(row) for row in size.T],
            "zmin": 0.0, "zmax": float(f"{largest:.4g}"), "colorscale": "Cividis", **_panel(k),
            "showscale": k == len(compared) - 1,
            "colorbar": {"title": {"text": unit}, "thickness": 14},
            "hovertemplate": f"{name}: %{{z:.2f}} {unit}<extra></extra>",
        })  # fmt: skip
        data.append(_arrows(x, y, force, largest) | _panel(k))
        layout[f"xaxis{tail}"] = {"domain": [left, left + width], "anchor": f"y{tail}",
                                  "title": {"text": titles[0]}, "zeroline": False}  # fmt: skip
        layout[f"yaxis{tail}"] = {"anchor": f"x{tail}", "zeroline": False,
                                  "title": {"text": titles[1]}}  # fmt: skip
        layout["annotations"].append({
            "text": name, "showarrow": False, "xref": "paper", "yref": "paper", "x": left,
            "y": 1.0, "xanchor": "left", "yanchor": "bottom",
        })  # fmt: skip
    return {"data": data, "layout": layout}


def _mapped(one: Comparison, plane: str) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Middles of cells along both sides, and the median force (B, B, 2) there, NaN where unknown.

    Over the floor forces are in the frame of the world, over velocities in that of the body.
    """
    m, force = one.moments, one.force_residual[:, :2]
    if plane == "floor map":
        c, s = np.cos(m.pose[:, 2]), np.sin(m.pose[:, 2])
        force = np.stack([c * force[:, 0] - s * force[:, 1], s * force[:, 0] + c * force[:, 1]], 1)
        x, y = m.pose[:, 0], m.pose[:, 1]
    else:
        x, y = m.velocity[:, 0], m.velocity[:, 1]
    along, up, cells = cell_medians(x, y, force, CELLS, FEWEST)
    return 0.5 * (along[1:] + along[:-1]), 0.5 * (up[1:] + up[:-1]), cells


def _arrows(x: np.ndarray, y: np.ndarray, force: np.ndarray, largest: float) -> dict[str, Any]:
    """Lines from the middle of each cell towards its force, at most a cell long."""
    across, down = (float(np.median(np.diff(side))) for side in (x, y))
    points: list[tuple[float, float]] = []
    for i, j in zip(*np.nonzero(np.isfinite(force[..., 0])), strict=True):
        dx, dy = force[i, j] / largest
        points += [(x[i], y[j]), (x[i] + 0.95 * across * dx, y[j] + 0.95 * down * dy),
                   (np.nan, np.nan)]  # fmt: skip
    ends = ["circle", "arrow", "circle"] * (len(points) // 3)
    return {
        "type": "scatter", "mode": "lines+markers", "x": _list([p[0] for p in points]),
        "y": _list([p[1] for p in points]), "hoverinfo": "skip",
        "line": {"color": "#ffffff", "width": 1.3},
        "marker": {"color": "#ffffff", "size": [0, 6, 0] * (len(points) // 3), "symbol": ends,
                   "angleref": "previous", "opacity": 1},
    }  # fmt: skip


def regimes(where: Sequence[Regime], rows: int = 12) -> Figure:
    """Share of the error over share of the time in some regimes, with 95 % intervals.

    Those where the error gathers by more than chance are filled.
    """
    shown = list(where[:rows])[::-1]
    names = [regime.name for regime in shown]
    color = ["#0072B2" if regime.flagged else FLOOR for regime in shown]
    data = [{
        "type": "scatter", "mode": "markers", "x": _list([r.excess for r in shown]), "y": names,
        "customdata": names,
        "error_x": {"type": "data", "symmetric": False, "thickness": 1.6, "color": FLOOR,
                    "array": _list([r.excess_ci95[1] - r.excess for r in shown]),
                    "arrayminus": _list([r.excess - r.excess_ci95[0] for r in shown])},
        "marker": {"size": 11, "color": color,
                   "symbol": ["circle" if r.flagged else "circle-open" for r in shown]},
        "text": [f"{100 * r.share_of_error:.0f} % of the error of {r.of} in "
                 f"{100 * r.share_of_time:.0f} % of the time" for r in shown],
        "hovertemplate": "%{y}: %{text}<extra></extra>",
    }]  # fmt: skip
    layout = {
        "showlegend": False, "margin": {"l": 250, "r": 16, "t": 10, "b": 48},
        "shapes": [{"type": "line", "x0": 1, "x1": 1, "yref": "paper", "y0": 0, "y1": 1,
                    "line": {"color": FLOOR, "width": 1}}],
        "xaxis": {"title": {"text": "share of the error over share of the time"},
                  "rangemode": "tozero"},
        "yaxis": {"type": "category", "showgrid": False, "fixedrange": True},
    }  # fmt: skip
    return {"data": data, "layout": layout}


def regime_spans(compared: Comparison, regime: str, join: float = 0.3) -> list[tuple[float, float]]:
    """Stretches of time, s from the start of the log, that belong to a regime.

    Args:
        compared: any model with the log.
        regime: its name.
        join: gaps up to this length, s, are closed.
    """
    mask, time = _mask(compared, regime), compared.moments.time
    if mask.all():
        return []
    spans: list[list[float]] = []
    for t in time[mask]:
        if spans and t - spans[-1][1] <= join:
            spans[-1][1] = float(t)
        else:
            spans.append([float(t), float(t)])
    return [(begin, end) for begin, end in spans if end > begin]


def account(shares: dict[str, float]) -> Figure:
    """What the base model's squared error is made of; shares add up to one."""
    data, colors = [], iter((*STAGES[2:], *STAGES[:2]))
    fixed = {"white noise": FLOOR, "lasting noise of the drive": "#b5b9c0", "parameters": "#c9b27c",
             "rolling": "#a58d6f", "remainder": "ink"}  # fmt: skip
    for name, share in shares.items():
        color = fixed.get(name) or next(colors)
        if share < 5e-5:
            continue
        data.append({
            "type": "bar", "orientation": "h", "x": [round(100 * share, 3)], "y": ["error"],
            "name": _titled(name), "marker": {"color": color},
            "hovertemplate": f"{_titled(name)}: {100 * share:.2g} %<extra></extra>",
        })  # fmt: skip
    layout = {
        "barmode": "stack", "margin": {"l": 16, "r": 16, "t": 40, "b": 44},
        "xaxis": {"title": {"text": "share of the refit model's squared held-out error, %"},
                  "range": [0, 100]},
        "yaxis": {"visible": False, "fixedrange": True},
        "legend": LEGEND,
    }  # fmt: skip
    return {"data": data, "layout": layout}


def parameters(stages: Sequence[tuple[str, int, dict[str, Quantity]]]) -> Figure:
    """Base parameters of every stage with 95 % intervals, each on an axis of its own.

    Open symbols: the logs do not determine the value alone.
    """
    names = list(stages[0][2])
    data, columns = [], 3
    rows = -(-len(names) // columns)
    layout: dict[str, Any] = {
        "annotations": [], "legend": LEGEND,
        "margin": {"l": 56, "r": 16, "t": 62, "b": 10},
    }  # fmt: skip
    for k, name in enumerate(names):
        row, column = divmod(k, columns)
        tail = f"{k + 1}" if k else ""
        left, height = column / columns, 1 / rows
        for number, (label, stage, base) in enumerate(stages):
            q = base[name]
            half = 0.0 if q.ci95 is None else 0.5 * (q.ci95[1] - q.ci95[0])
            span = "not determined" if q.ci95 is None else f"± {half:.2g}"
            data.append({
                "type": "scatter", "mode": "markers", "x": [number], "y": [float(q.value)],
                "error_y": {"type": "data", "array": [half], "thickness": 1.8,
                            "color": stage_color(stage), "visible": q.ci95 is not None},
                "marker": {"size": 10, "color": stage_color(stage),
                           "symbol": "circle-open" if q.ci95 is None else "circle"},
                "name": label, "legendgroup": label, "showlegend": k == 0, **_panel(k),
                "hovertemplate": f"{label}: {name} %{{y:.4g}} {span} {q.unit}<extra></extra>",
            })  # fmt: skip
        top = 1 - row * height - 0.06
        layout[f"xaxis{tail}"] = {
            "domain": [left + 0.015, left + 1 / columns - 0.055], "anchor": f"y{tail}",
            "showticklabels": False, "range": [-0.6, len(stages) - 0.4], "showgrid": False,
            "zeroline": False, "fixedrange": True,
        }  # fmt: skip
        layout[f"yaxis{tail}"] = {
            "domain": [1 - (row + 1) * height + 0.02, top], "anchor": f"x{tail}", "nticks": 4,
            "zeroline": False,
        }  # fmt: skip
        layout["annotations"].append({
            "text": f"{_symbol(name)}, {pretty(stages[0][2][name].unit)}", "showarrow": False,
            "xref": "paper", "yref": "paper", "x": left + 0.015, "y": top,
            "xanchor": "left", "yanchor": "bottom",
        })  # fmt: skip
    return {"data": data, "layout": layout}


def autocorrelation(
    compared: Sequence[tuple[str, int, Comparison]], longest: float = 2.0
) -> Figure:
    """Correlation of the residual forces with themselves some time later, mean over the axes."""
    data = []
    for name, number, one in compared:
        step = float(np.median(np.diff(one.moments.time)))
        count = max(2, round(longest / step))
        total = np.zeros(count)
        for column in one.residual.T:
            column = column - column.mean()
            power = np.abs(np.fft.rfft(column, 2 * len(column))) ** 2
            found = np.fft.irfft(power)[:count]
            total += found / max(found[0], 1e-300)
        lag = step * np.arange(count)
        x, y = thin(lag, total / one.residual.shape[1], points=400)
        data.append({
            "type": "scatter", "mode": "lines", "name": name, "x": _list(x), "y": _list(y),
            "line": {"color": stage_color(number), "width": 2, "dash": DASHES[min(number, 5)]},
            "hovertemplate": f"{name}: %{{y:.2f}} after %{{x:.2f}} s<extra></extra>",
        })  # fmt: skip
    layout = {
        "xaxis": {"title": {"text": "time between two moments, s"}},
        "yaxis": {"title": {"text": "correlation of the residual"}, "range": [-0.6, 1.05]},
        "legend": LEGEND,
        "margin": {"l": 64, "r": 16, "t": 44, "b": 48},
    }  # fmt: skip
    return {"data": data, "layout": layout}


def recorded(log: Log) -> Figure:
    """Wheel (or body) speeds and the drive input of a log."""
    piece = np.searchsorted(log.starts, np.arange(len(log.time)), side="right")
    time, names = log.time - log.time[0], log.platform.wheel_names
    if log.wheel_velocity is not None:
        upper, labels, title = log.wheel_velocity, names, "wheel speed, rad/s"
    else:
        upper, title = log.velocity(), "body velocity, m/s, rad/s"
        labels = tuple(symbol for symbol, _ in VELOCITIES)
    lower = "wheel torque, N m" if log.drive == "torque" else "wheel voltage, V"
    data = []
    for values, of, axis in ((upper, labels, "y"), (log.command, names, "y2")):
        for k, label in enumerate(of):
            x, y = thin(time, values[:, k], piece, 1600)
            data.append({
                "type": "scatter", "mode": "lines", "name": label, "legendgroup": label,
                "showlegend": axis == "y", "x": _list(x), "y": _list(y), "xaxis": "x",
                "yaxis": axis, "line": {"width": 1, "color": stage_color((2, 0, 3, 4)[k % 4])},
            })  # fmt: skip
    layout = {
        "legend": LEGEND,
        "margin": {"l": 64, "r": 16, "t": 40, "b": 46},
        "xaxis": {"title": {"text": "time, s"}, "anchor": "y2"},
        "yaxis": {"title": {"text": title}, "domain": [0.54, 1.0]},
        "yaxis2": {"title": {"text": lower}, "domain": [0.0, 0.46]},
    }  # fmt: skip
    return {"data": data, "layout": layout}


def motion(reference: Reference, seconds: float) -> Figure:
    """A commanded motion: its path over the floor and its velocities over time."""
    time = np.linspace(0.0, seconds, 1200)
    found = reference.sample(time, seed=0)
    path, velocity = np.array(found.pose).T, np.array(found.twist(NUMPY)).T
    data = [{
        "type": "scatter", "mode": "lines", "x": _list(path[:, 0]), "y": _list(path[:, 1]),
        "xaxis": "x", "yaxis": "y", "line": {"color": "ink", "width": 1.5}, "showlegend": False,
        "hovertemplate": "x %{x:.2f} m, y %{y:.2f} m<extra></extra>",
    }]  # fmt: skip
    for k, (symbol, unit) in enumerate(VELOCITIES):
        data.append({
            "type": "scatter", "mode": "lines", "x": _list(time), "y": _list(velocity[:, k]),
            "xaxis": "x2", "yaxis": "y2", "name": f"{symbol}, {unit}",
            "line": {"color": stage_color((2, 0, 3)[k]), "width": 1.5},
        })  # fmt: skip
    layout = {
        "margin": {"l": 64, "r": 16, "t": 40, "b": 48},
        "legend": LEGEND,
        "xaxis": {"title": {"text": "x, m"}, "domain": [0.0, 0.36]},
        "yaxis": {"title": {"text": "y, m"}, "scaleanchor": "x"},
        "xaxis2": {"title": {"text": "time, s"}, "domain": [0.45, 1.0], "anchor": "y2"},
        "yaxis2": {"title": {"text": "commanded velocity, m/s, rad/s"}, "anchor": "x2"},
    }  # fmt: skip
    return {"data": data, "layout": layout}


def _signal(one: Comparison, signal: str) -> tuple[np.ndarray, str, tuple[float, float] | None]:
    """Values (N,) or (N, n) of a signal, its title with unit, and its ends where it has any."""
    m = one.moments
    if signal == "wheel speed":
        return m.wheel_speed, "wheel speed, rad/s", None
    if signal == "wheel torque":
        kind = "wheel torque, N m" if m.drive == "torque" else "wheel voltage, V"
        return m.command, kind, None
    if signal == "time":
        return m.time, "time, s", (float(m.time[0]), float(m.time[-1]))
    if signal == "roller phase":
        if m.wheel_angle is None:
            raise ValueError("the log has no wheel speeds to follow the rollers by")
        return np.mod(np.degrees(m.wheel_angle), 60.0), "roller phase, deg of 60", (0.0, 60.0)
    if signal == "heading":
        if m.pose is None:
            raise ValueError("the log has no pose; record x, y and yaw for a heading")
        heading = np.degrees(np.mod(m.pose[:, 2] + np.pi, 2 * np.pi) - np.pi)
        return heading, "heading, deg", (-180.0, 180.0)
    raise ValueError(f"no signal {signal!r}; choose one of {', '.join(SIGNALS)}")


def _mask(one: Comparison, regime: str) -> np.ndarray:
    """(N,) moments that belong to a regime; all for one that is a component."""
    for part in slices(one.moments):
        if part.name == regime:
            everything = np.ones(len(one.moments.time), bool)
            return everything if part.mask is None else part.mask
    raise ValueError(f"the log has no regime {regime!r}")


def _panel(number: int) -> dict[str, str]:
    tail = f"{number + 1}" if number else ""
    return {"xaxis": f"x{tail}", "yaxis": f"y{tail}"}


def _band(span: tuple[float, float], color: str) -> dict[str, Any]:
    return {"type": "rect", "xref": "x", "yref": "paper", "x0": round(span[0], 3),
            "x1": round(span[1], 3), "y0": 0, "y1": 1, "fillcolor": color, "layer": "below",
            "line": {"width": 0}}  # fmt: skip


def _faint(color: str) -> str:
    red, green, blue = (int(color[k : k + 2], 16) for k in (1, 3, 5))
    return f"rgba({red},{green},{blue},0.18)"


def _titled(name: str) -> str:
    return get_effect(name).title.lower() if name in effect_names() else name


def _symbol(name: str) -> str:
    """A parameter as print shows it."""
    letters = name.replace("mu", "μ").replace("_", "")
    return re.sub(r"(\w)([\dxy])(?=\W|$)", r"\1<sub>\2</sub>", letters)


def _list(values) -> list[float | None]:
    """Numbers with five digits, None for gaps: JSON has no other word for them."""
    return [None if not np.isfinite(v) else float(f"{v:.5g}") for v in values]
