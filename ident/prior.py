"""What is known before any log, and estimates that keep to it where the logs say less.

A log of straight runs moves yaw by its noise only, yet least squares makes numbers of that: a
negative friction, a mass of tons.  Estimates that stay possible are left alone.  Where one runs
away, directions in which the logs say less than what is known beforehand stay where they started,
and a value that would still leave its bounds is held there.

A fit by output error is pulled gently where the logs say less.  A direction that leaves hardly a
trace costs a fit nothing: it walks along it for kilometres to save a thousandth of its noise, and
every value that takes part is ruined.  Pulled to what is known
beforehand with the strength of what errors may feign, directions that are seen stay where the logs
put them and the others where they started.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import null_space, orth

from ident.estimators import least_squares
from ident.identifiability import OFFSET, Seen, echelon
from ident.noise_floor import noise_floor
from ident.parameter_space import FreeValues, value_bounds
from ident.recursive import sample_times
from ident.regression import Regression
from ident.residuals import ScaledFit
from youbot_env.dynamics import Theta
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


def kept_possible(seen: Seen, regression: Regression, model: Model) -> tuple[Seen, Seen, list[str]]:
    """What is estimated, cut back until the estimate lies within the bounds of its parameters.

    Args:
        seen: directions that leave a trace.
        regression: rows of all logs.
        model: start values and bounds.

    Returns:
        ``seen`` itself where least squares is possible, else with fewer directions; the same with
        nothing held, for that a value is held does not tell the others any better; and what would
        have become of the values that are held.
    """
    values = _solved(seen, regression)
    broken = outside(seen.names, values, model)
    if not broken:
        return seen, seen, []
    spreads, words = prior_spreads(seen.names, model), []
    left = _energy(regression, regression.residual(values)) / _energy(regression, regression.y)
    # A value that misses its bound by less than what was known beforehand has not run away.
    near = all(
        abs(value - broken.get(name, value)) <= spread
        for name, value, spread in zip(seen.names, values, spreads, strict=True)
    )
    least, held = 0.0 if near else ALIGNED**2 * left, {}
    cut = loose = _cut(seen, regression, spreads, least, held)
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
    return cut, loose, words


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


# Independent errors in a window: they remember each other some tenths of a second.
EACH = 8


@dataclass(frozen=True, eq=False)
class Pull:
    """Rows beside those of a fit.

    Attributes:
        centre: (Z,) values before any log, as the fit's scopes lay them out.
        spread: (Z,) their standard deviations; infinite where nothing is known.
        error: what the fit may feign along any direction, as a root of a sum of squares.
    """

    centre: np.ndarray
    spread: np.ndarray
    error: float

    @classmethod
    def of(cls, fit: ScaledFit, prior: Model | None) -> Pull | None:
        """What a model says of the seven parameters of the robot, beside a fit.

        Errors feign what their independent part does by chance, and a share of what is no noise.
        None without a model.
        """
        if prior is None:
            return None
        names = tuple(Theta._fields)
        centre, spread = fit.values.copy(), np.full(len(fit.values), np.inf)
        at = [fit.scopes.index[0, fit.scopes.names.index(name)] for name in names]
        known = dict(zip(prior.names(), prior.values(), strict=True))
        centre[at] = [known[name] for name in names]
        spread[at] = prior_spreads(names, prior)
        pairs = zip(fit.simulations, fit.keep, fit.weights, strict=True)
        windows = sum(int(kept.sum()) for _, kept, _ in pairs)
        floors = [noise_floor(s).of(w) for s, w in zip(fit.simulations, fit.weights, strict=True)]
        left = max(2.0 * fit.cost - len(fit.error) * float(np.mean(floors)), 0.0)
        chance = 2.0 * fit.cost / max(EACH * windows, 1)
        return cls(centre, spread, float(np.sqrt(chance + ALIGNED**2 * left)))

    @property
    def weight(self) -> np.ndarray:
        """(Z,) of a value's distance from where it was expected."""
        return self.error / self.spread

    def cost(self, values: np.ndarray) -> float:
        """Half the sum of squares of the rows, at values (Z,)."""
        return 0.5 * float(np.sum((self.weight * (values - self.centre)) ** 2))

    def rows(self, values: np.ndarray, moving: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Columns (K, M) by the values that move, and what is left (K,)."""
        at = self._at(moving)
        columns = np.zeros((len(at), int(moving.sum())))
        columns[np.arange(len(at)), np.searchsorted(np.flatnonzero(moving), at)] = self.weight[at]
        return columns, self.weight[at] * (self.centre[at] - values[at])

    def covariance(self, fit: ScaledFit, free: FreeValues, scatter: np.ndarray) -> np.ndarray:
        """(Z, Z) of the pulled values: what logs say scatters, the rest is as unknown as before.

        Args:
            fit: at the values.
            free: what may move.
            scatter: (Z, Z) without the pull.
        """
        basis, moving = free.directions, free.moving
        columns, beside = fit.columns(free) @ basis[moving], self.rows(fit.values, moving)[0]
        beside = beside @ basis[moving]
        scale = np.sqrt(np.sum(columns**2, axis=0) + np.sum(beside**2, axis=0))
        scale = np.where(scale > 0, scale, 1.0)
        pulled = (beside / scale).T @ (beside / scale)
        inverse = np.linalg.pinv((columns / scale).T @ (columns / scale) + pulled, hermitian=True)
        # Steps that the rows of the pull make of a change of what was known.
        kept = basis / scale @ inverse @ (beside / scale).T * self.weight[self._at(moving)]
        known = self.spread[self._at(moving)]
        share = np.eye(len(scatter))
        share[:, self._at(moving)] -= kept
        return share @ scatter @ share.T + (kept * known) @ (kept * known).T

    def _at(self, moving: np.ndarray) -> np.ndarray:
        return np.flatnonzero(moving & np.isfinite(self.spread))
