"""Figures of odometry and of designed motions, for notebooks."""

from __future__ import annotations

import numpy as np

from ident.report.look import IDENTIFIED, MEASURED, figure
from ident.results import Quantity


@figure(lambda gains: 0.9 + 0.45 * len(gains))
def gains_figure(canvas, gains: dict[str, Quantity]) -> None:
    """Measured motion over what nominal odometry says, by axis, with 95 % intervals.

    Args:
        gains: by axis; 1 is a motion as odometry says.
    """
    axis = _rows(canvas, list(gains))
    axis.axvline(100.0, color=MEASURED, linewidth=1.0)
    for row, gain in enumerate(gains.values()):
        if gain.ci95 is not None:
            ends = 100 * np.array(gain.ci95)
            axis.plot(ends, (row, row), color=IDENTIFIED, linewidth=2.4, solid_capstyle="butt")
        filled = "white" if gain.ci95 is None else IDENTIFIED
        axis.plot(100 * gain.value, row, "o", color=IDENTIFIED, markerfacecolor=filled)
    axis.set_xlabel("measured motion over nominal odometry, %, with 95 % interval")


@figure(lambda mine, theirs: 0.9 + 0.32 * len(mine))
def design_figure(canvas, mine: dict[str, float], theirs: dict[str, float]) -> None:
    """Expected intervals of one motion as shares of those of another.

    Args:
        mine: half widths by quantity.
        theirs: the same of the motion it is compared with.
    """
    axis = _rows(canvas, list(mine))
    shares = [100 * half / theirs[name] for name, half in mine.items()]
    axis.barh(range(len(shares)), shares, height=0.62, color=IDENTIFIED)
    axis.axvline(100.0, color=MEASURED, linewidth=1.0)
    axis.set_xlabel("half width of the expected interval, % of that of motions I-IV")


def _rows(canvas, names: list[str]):
    """An axis with a row for each name, the first on top."""
    height = canvas.get_figheight()
    axis = canvas.add_axes((0.16, 0.55 / height, 0.8, 1 - 0.65 / height))
    axis.set_yticks(range(len(names)), names)
    axis.set_ylim(len(names) - 0.5, -0.5)
    axis.tick_params(axis="y", length=0)
    axis.grid(False, axis="y")
    return axis
