"""What is known before any log, in a fit by output error: a gentle pull where the logs say less.

A direction that leaves hardly a trace costs a fit nothing: it walks along it for kilometres to save
a thousandth of its noise, and every value that takes part is ruined.  Pulled to what is known
beforehand with the strength of what errors may feign, directions that are seen stay where the logs
put them and the others where they started.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.free_values import FreeValues
from ident.noise_floor import noise_floor
from ident.prior import ALIGNED, prior_spreads
from ident.scaled_fit import ScaledFit
from youbot_env.dynamics import Theta
from youbot_env.model import Model

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
