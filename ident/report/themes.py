"""Colours of interactive figures, for light and dark pages; imports nothing that computes.

The colours are those of Okabe and Ito, which people tell apart whatever their colour vision.
"""

from __future__ import annotations

from typing import Any

# Measured is the colour of text; stages of a model in this order.
STAGES = ("#E69F00", "#56B4E9", "#0072B2", "#009E73", "#CC79A7", "#D55E00")
DASHES = ("dot", "dash", "solid", "solid", "solid", "solid")


def stage_color(number: int) -> str:
    """Colour of a stage, counted from the start; later than the palette is long it repeats."""
    return STAGES[number] if number < len(STAGES) else STAGES[2 + (number - 2) % 4]


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
    data = [_inked(trace, ink) for trace in figure["data"]]
    config = {"displaylogo": False, "responsive": True, "displayModeBar": False}
    return {"data": data, "layout": layout, "config": config}


def _inked(trace: dict, ink: str) -> dict:
    """Lines and markers of the colour ``ink`` get the colour of text."""
    found = dict(trace)
    for key in ("line", "marker"):
        if key in found and found[key].get("color") == "ink":
            found[key] = found[key] | {"color": ink}
    return found
