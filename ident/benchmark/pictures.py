"""Figures of the benchmark."""

from __future__ import annotations

import numpy as np

from ident.report import look

VERDICTS = ("nothing_missing", "outside_library", "cannot_say")
LABELLED = 5


@look.figure(4.6)
def power_picture(canvas, effects: dict, sizes: dict) -> None:
    """Right group against size, one line an effect and one for all."""
    axis = canvas.add_subplot()
    order = sorted(sizes, key=float)
    x = np.array([float(size) for size in order])
    last = {}
    for effect, rates in effects.items():
        if not all(size in rates for size in order):
            continue
        y = [100 * rates[size]["group"]["value"] for size in order]
        axis.plot(x, y, color=look.MEASURED, alpha=0.45, linewidth=1.0)
        last[effect] = y[-1]
    middle = [100 * sizes[size]["group"]["value"] for size in order]
    low, high = ([100 * sizes[size]["group"]["ci95"][end] for size in order] for end in (0, 1))
    axis.fill_between(x, low, high, color=look.IDENTIFIED, alpha=0.2, linewidth=0)
    axis.plot(x, middle, color=look.IDENTIFIED, linewidth=2.4, marker="o")
    weakest = sorted(last, key=last.get)[:LABELLED]
    place = -np.inf
    for effect in sorted(weakest, key=last.get):
        if last[effect] > 95:
            continue
        place = max(last[effect], place + 5.5)  # labels do not overlap
        axis.annotate(effect.replace("_", " "), (x[-1], last[effect]), (1.03 * x[-1], place),
                      va="center", fontsize=9, color="#5a6069", annotation_clip=False)  # fmt: skip
    axis.set_xscale("log", base=2)
    axis.set_xticks(x, [f"{value:g}" for value in x])
    axis.set_xlim(x[0] / 1.04, x[-1] * 1.3)
    axis.set_ylim(-3, 103)
    axis.set_xlabel("size of the hidden effect")
    axis.set_ylabel("right group, % of logs")
    canvas.subplots_adjust(left=0.07, right=0.9, top=0.97, bottom=0.12)


@look.figure(8.0)
def confusion_picture(canvas, confusion: dict[str, dict[str, int]]) -> None:
    """Hidden effect by first name, share of the row."""
    axis = canvas.add_subplot()
    rows = list(confusion)
    said = dict.fromkeys(name for row in confusion.values() for name in row)
    others = [name for name in said if name not in rows and name not in VERDICTS]
    columns = [*rows, *others, *(name for name in VERDICTS if name in said)]
    counts = np.array([[confusion[r].get(c, 0) for c in columns] for r in rows], float)
    share = 100 * counts / counts.sum(axis=1, keepdims=True)
    axis.imshow(share, cmap="Blues", vmin=0, vmax=100, aspect="auto")
    for i, j in zip(*np.nonzero(share), strict=True):
        color = "white" if share[i, j] > 55 else look.INK
        axis.text(j, i, f"{share[i, j]:.0f}", ha="center", va="center", fontsize=8, color=color)
    names = [name.replace("_", " ") for name in columns]
    axis.set_xticks(range(len(columns)), names, rotation=60, ha="right", rotation_mode="anchor")
    axis.set_yticks(range(len(rows)), names[: len(rows)])
    axis.axvline(len(rows) - 0.5, color=look.INK, linewidth=0.8)
    axis.grid(visible=False)
    axis.tick_params(length=0)
    axis.set_xlabel("first name, or verdict without one")
    axis.set_ylabel("hidden")
    canvas.subplots_adjust(left=0.2, right=0.985, top=0.985, bottom=0.25)
