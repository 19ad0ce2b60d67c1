"""What is known before any log, and estimates that keep to it where the logs say less.

A log of straight runs moves yaw by its noise only, yet least squares makes numbers of that: a
negative friction, a mass of tons.  Estimates that stay possible are left alone.  Where one runs
away, directions in which the logs say less than what is known beforehand stay where they started,
and a value that would still leave its bounds is held there.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
from scipy.linalg import null_space, orth

from ident.estimators import least_squares
from ident.free_values import value_bounds
from ident.observability import OFFSET, echelon
from ident.recursive import sample_times
from ident.regression import Regression
from ident.seen import Seen
from youbot_env.model import Model

# Standard deviations of what is known beforehand, as shares of the start values: a robot is weighed
# to a half, its inertias and frictions are known by their order of magnitude.
SPREADS = {"m0": 0.5, "I0": 1.0, "I1": 1.0, "mu1": 1.0, "mu2": 1.0}
# The same of effects, in typical sizes.
TYPICAL = 5.0
# Of what a model leaves unexplained this share may lie along the trace of any direction: leads of
# simulated robots with effects that no nuisance stands for were wrong by as much.
ALIGNED = 0.3


def prior_spreads(names: tuple[str, ...], model: Model) -> np.ndarray:
    """(P,) standard deviations of parameters before any log, SI."""
    values = dict(zip(model.names(), model.values(), strict=True))
    found = []
    for name in names:
        identifier, _, flat = name.rpartition(".")
        if identifier:
            active = next(a for a in model.effects if a.identifier == identifier)
            found.append(TYPICAL * (abs(active.effect.parameter_of(flat).default) or 1.0))
        elif name in SPREADS:
            found.append(SPREADS[name] * abs(values[name]))
        else:
            found.append(2.0 * OFFSET * model.platform.reach * values["m0"])
    return np.array(found)


def outside(names: tuple[str, ...], values: np.ndarray, model: Model) -> dict[str, float]:
    """Bounds that values (P,) leave, by name of the parameter."""
    ends = dict(zip(model.names(), zip(*value_bounds(model), strict=True), strict=True))
    found = {}
    for name, value in zip(names, values, strict=True):
        low, high = ends[name]
        if not low <= value <= high:
            found[name] = float(low if value < low else high)
    return found


def kept_possible(seen: Seen, regression: Regression, model: Model) -> tuple[Seen, list[str]]:
    """What is estimated, cut back until the estimate lies within the bounds of its parameters.

    Args:
        seen: directions that leave a trace.
        regression: rows of all logs.
        model: start values and bounds.

    Returns:
        ``seen`` itself where least squares is possible; else with fewer directions, and what would
        have become of the values that are held at a bound.
    """
    values = _solved(seen, regression)
    broken = outside(seen.names, values, model)
    if not broken:
        return seen, []
    spreads, words = prior_spreads(seen.names, model), []
    left = _energy(regression, regression.residual(values)) / _energy(regression, regression.y)
    # A value that misses its bound by less than what was known beforehand has not run away.
    near = all(
        abs(value - broken.get(name, value)) <= spread
        for name, value, spread in zip(seen.names, values, spreads, strict=True)
    )
    least, held = 0.0 if near else ALIGNED**2 * left, {}
    cut = _cut(seen, regression, spreads, least, held)
    for _ in range(len(seen.names)):
        values = _solved(cut, regression)
        broken = outside(cut.names, values, model)
        if not broken:
            break
        at = [cut.names.index(name) for name in broken]
        worst = max(at, key=lambda k: abs(values[k] - broken[cut.names[k]]) / spreads[k])
        name = cut.names[worst]
        held[name] = broken[name]
        words.append(
            f"{name} would come out at {values[worst]:.3g}; it is held at its bound, "
            f"{broken[name]:.3g}"
        )
        cut = _cut(seen, regression, spreads, least, held)
    return cut, words


def _cut(
    seen: Seen, regression: Regression, spreads: np.ndarray, least: float, held: dict[str, float]
) -> Seen:
    """Directions in which the logs say more than the prior, without the values that are held.

    Args:
        least: share of the drive's energy that a change by a prior spread must move.
    """
    start = seen.start.copy()
    for name, value in held.items():
        start[seen.names.index(name)] = value
    free = orth(seen.basis / spreads[:, None])
    fixed = [seen.names.index(name) for name in held]
    if fixed:
        free = free @ null_space(free[fixed])
    H = regression.H @ (spreads[:, None] * free)
    weights = sample_times(regression)
    gramian = np.einsum("n,nap,naq->pq", weights, H, H) / _energy(regression, regression.y)
    strength, turn = np.linalg.eigh(gramian)
    kept = free @ turn[:, strength > least]
    known = np.column_stack([kept, np.eye(len(spreads))[:, fixed]])
    unseen = null_space(known.T) if known.shape[1] else np.eye(len(spreads))
    null = echelon(unseen.T) * spreads
    return replace(seen, start=start, basis=spreads[:, None] * kept, null=null, held=tuple(held))


def _solved(seen: Seen, regression: Regression) -> np.ndarray:
    if not seen.basis.shape[1]:
        return seen.start
    return seen.restore(least_squares(seen.reduce(regression))).values


def _energy(regression: Regression, rows: np.ndarray) -> float:
    return float(np.einsum("n,na,na->", sample_times(regression), rows, rows)) or 1.0
