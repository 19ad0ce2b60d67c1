"""The paper's decomposed identification: each parameter from the motion that sees it best.

A calibration motion leaves some directions of x without a trace, but what it does see it often sees
apart from everything else.  So parameters are taken motion by motion; those found are put in, which
brings further ones into sight, until nothing new appears.  Beside it stands the joint fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from scipy.linalg import null_space

from ident.estimators import (
    Estimate,
    instrumental_variables,
    least_squares,
    reference_motion,
)
from ident.identifiability import (
    X_NAMES,
    blind_directions,
    column_noise,
    coordinate_factors,
    parameter_sizes,
    scaled_energy,
)
from ident.log import Log
from ident.regression import Regression, build_regression
from youbot_env.model import Model

# Order of the motions in the paper's experiment.
CALIBRATION = ("I", "III", "II", "IV")


@dataclass(frozen=True)
class MotionIdentification:
    """Parameters by motion and by the joint fit, in coordinates x1.. and effects' parameters.

    Attributes:
        names: (P,) of the parameters.
        motions: (K,) names of the parts.
        alone: (K, P) what each part determines by itself; NaN where it cannot see.
        alone_errors: (K, P) their standard errors.
        decomposed: (P,) each parameter from the part that sees it best, those found before put in.
        decomposed_errors: (P,) standard errors, with those of the values put in.
        source: (P,) the part each value came from; empty where no part sees it.
        joint: (P,) one fit to all parts; NaN where all together cannot see.
        joint_errors: (P,) its standard errors.
    """

    names: tuple[str, ...]
    motions: tuple[str, ...]
    alone: np.ndarray
    alone_errors: np.ndarray
    decomposed: np.ndarray
    decomposed_errors: np.ndarray
    source: tuple[str, ...]
    joint: np.ndarray
    joint_errors: np.ndarray


def cut_calibration(log: Log, motions: Sequence[str] = CALIBRATION) -> list[tuple[str, Log]]:
    """Cut a log of motions of equal length, one after the other, into its parts."""
    edges = np.linspace(log.time[0], log.time[-1] + log.dt / 2, len(motions) + 1)
    return [(name, log.part(a, b)) for name, a, b in zip(motions, edges, edges[1:], strict=False)]


def identify_by_motion(parts: Sequence[tuple[str, Log]], model: Model) -> MotionIdentification:
    """Identify block by block and motion by motion, and jointly.

    Instruments from the commanded motion are used where every part holds one.

    Args:
        parts: name and log of each motion.
        model: platform, effects and sizes of the parameters.
    """
    instruments = all(log.reference is not None for _, log in parts)
    fits = [_Part.of([log], model, instruments) for _, log in parts]
    joint = _Part.of([log for _, log in parts], model, instruments)
    motions, count = tuple(name for name, _ in parts), len(joint.sizes)
    everything, nothing = np.ones(count, bool), np.zeros((count, count))
    start = np.zeros(count)

    alone = [fit.solve(everything, start, nothing) for fit in fits]
    values, errors, source = _decompose(fits, motions)
    together, covariance, seen = joint.solve(everything, start, nothing)
    scale = coordinate_factors(joint.regression.names, model)
    return MotionIdentification(
        names=(*X_NAMES, *joint.regression.names[7:]),
        motions=motions,
        alone=np.array([np.where(seen, v, np.nan) for v, _, seen in alone]) * scale,
        alone_errors=np.array([_errors(c, seen) for _, c, seen in alone]) * scale,
        decomposed=values * scale,
        decomposed_errors=errors * scale,
        source=source,
        joint=np.where(seen, together, np.nan) * scale,
        joint_errors=_errors(covariance, seen) * scale,
    )


def _decompose(fits: list[_Part], motions: tuple[str, ...]) -> tuple:
    """Values (P,), standard errors (P,) and the motion each came from."""
    count = len(fits[0].sizes)
    values, source, unknown = np.zeros(count), [""] * count, np.ones(count, bool)
    covariance = np.zeros((count, count))
    while True:
        found = [fit.solve(unknown, values, covariance) for fit in fits]
        errors = np.array([_errors(c, seen) for _, c, seen in found])
        errors = np.where(np.isnan(errors), np.inf, errors)
        best = errors.argmin(axis=0)
        new = np.isfinite(errors.min(axis=0))
        if not new.any():
            break
        for k, (estimate, uncertainty, _) in enumerate(found):
            chosen = new & (best == k)
            values[chosen] = estimate[chosen]
            for place in (np.ix_(chosen, chosen | ~unknown), np.ix_(chosen | ~unknown, chosen)):
                covariance[place] = uncertainty[place]
            for parameter in np.flatnonzero(chosen):
                source[parameter] = motions[k]
        unknown &= ~new
    return np.where(unknown, np.nan, values), _errors(covariance, ~unknown), tuple(source)


@dataclass(frozen=True)
class _Part:
    """Rows of one motion with what they see."""

    regression: Regression
    instruments: np.ndarray | None
    sizes: np.ndarray
    energy: tuple[np.ndarray, np.ndarray]

    @classmethod
    def of(cls, logs: list[Log], model: Model, instruments: bool) -> _Part:
        rows = Regression.join([build_regression(log, model) for log in logs])
        wanted = None
        if instruments:
            moved = [build_regression(log, model, transform=reference_motion) for log in logs]
            wanted = np.concatenate([part.H for part in moved])
        energy = scaled_energy(rows, column_noise(rows), model)
        return cls(rows, wanted, parameter_sizes(rows.names, model), energy)

    def solve(
        self, unknown: np.ndarray, values: np.ndarray, covariance: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Estimate the unknown parameters, the others being known.

        Args:
            unknown: (P,) which are looked for.
            values: (P,) the known ones.
            covariance: (P, P) of the known ones.

        Returns:
            ``(values (P,), covariance (P, P), determined (P,))``.
        """
        inner = np.ix_(unknown, unknown)
        null = blind_directions(self.energy[0][inner], self.energy[1][inner])
        basis = np.zeros((len(unknown), int(unknown.sum()) - len(null)))
        basis[unknown] = null_space(null) if len(null) else np.eye(len(basis.T))
        basis *= self.sizes[:, None]
        determined = unknown.copy()
        determined[unknown] = ~null.any(axis=0)
        if not determined.any():
            return values, covariance, determined
        known = np.where(unknown, 0.0, values)
        H = self.regression.H
        own = self._estimate(self.regression.y - H @ known, basis)
        # What an error of a known value does to those estimated.
        carried = np.zeros_like(covariance)
        for j in np.flatnonzero(~unknown):
            carried[:, j] = -basis @ self._estimate(H[:, :, j], basis).values
        spread = carried + np.diag((~unknown).astype(float))
        total = spread @ covariance @ spread.T + basis @ own.covariance @ basis.T
        return known + basis @ own.values, total, determined

    def _estimate(self, y: np.ndarray, basis: np.ndarray) -> Estimate:
        """Coordinates along the basis (P, k) for a right side y (N, 3)."""
        r = self.regression
        names = tuple(f"b{k}" for k in range(basis.shape[1]))
        rows = Regression(names, r.H @ basis, y, r.time, r.piece, r.lever)
        if self.instruments is None:
            return least_squares(rows)
        return instrumental_variables(rows, self.instruments @ basis)


def _errors(covariance: np.ndarray, seen: np.ndarray) -> np.ndarray:
    return np.where(seen, np.sqrt(np.maximum(np.diag(covariance), 0.0)), np.nan)
