"""Colours of interactive figures, for light and dark pages; imports nothing that computes.

The colours are those of Okabe and Ito, which people tell apart whatever their colour vision.
"""

from __future__ import annotations

from typing import Any

# Measured is the colour of text; stages of a model in this order.
STAGES = ("#E69F00", "#CC79A7", "#0072B2", "#009E73", "#D55E00", "#56B4E9")
# What is too dark for a dark page, and what stands for it there.
BRIGHT = {"#0072B2": "#4FA8E0", "#009E73": "#2FBF95"}
DASHES = ("dot", "dash", "solid", "solid", "solid", "solid")


def stage_color(number: int, dark: bool = False) -> str:
    """Colour of a stage, counted from the start; later than the palette is long it repeats."""
    color = STAGES[number] if number < len(STAGES) else STAGES[2 + (number - 2) % 4]
    return BRIGHT.get(color, color) if dark else color


def themed(figure: dict[str, Any], dark: bool) -> dict[str, Any]:
    """The figure with text and grid for a light or a dark page."""
    ink, soft, grid = (
        ("#e8eaed", "#aab0b8", "#3a3f47") if dark else ("#1d2127", "#5a6069", "#e3e6ea")
    )
    layout = {
        "paper_bgcolor": "rgba(0,0,0,0)", "plot_bgcolor": "rgba(0,0,0,0)",
        "font": {"family": "system-ui, sans-serif", "size": 13, "color": ink},
        "hoverlabel": {"bgcolor": "#23272e" if dark else "#ffffff", "font": {"color": ink}},
        "margin": {"l": 64, "r": 16, "t": 30, "b": 48},
    } | figure["layout"]  # fmt: skip
    for name, axis in figure["layout"].items():
        if name.startswith(("xaxis", "yaxis")):
            lines = {"gridcolor": grid, "zerolinecolor": soft, "linecolor": soft}
            layout[name] = {**lines, "zerolinewidth": 1, **axis}
            if "title" in axis:
                layout[name]["title"] = {"font": {"size": 13}, "standoff": 8} | axis["title"]
    data = [_colored(trace, ink, dark) for trace in figure["data"]]
    config = {"displaylogo": False, "responsive": True, "displayModeBar": False}
    return {"data": data, "layout": layout, "config": config}


def _colored(trace: dict, ink: str, dark: bool) -> dict:
    """Lines and markers as the page needs them; ``ink`` is the colour of text."""

    def seen(color: Any) -> Any:
        if isinstance(color, list):
            return [seen(one) for one in color]
        return ink if color == "ink" else BRIGHT.get(color, color) if dark else color

    found = dict(trace)
    for key in ("line", "marker", "error_x", "error_y"):
        if "color" in found.get(key, ()):
            found[key] = found[key] | {"color": seen(found[key]["color"])}
    return found
