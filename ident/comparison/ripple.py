"""What is left that repeats with the angle of a wheel: harmonics of the residual torque."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from ident.comparison.shares import FALSE_DISCOVERIES
from ident.distributions import false_discoveries, fisher_above
from ident.estimators import least_squares
from ident.log import Log
from ident.regression import Regression, build_regression
from youbot_env.model import Model

EFFECT = "torque_ripple"
# Periods a turn: an eccentric wheel, an oval one, and six rollers with their overtone.
ORDERS = (1, 2, 6, 12)
# Samples a period at the wheel's usual speed below which a harmonic cannot be told from others.
LEAST_SAMPLES = 4.0


@dataclass(frozen=True)
class Harmonic:
    """A residual torque ``a cos k phi + b sin k phi`` of one wheel.

    Attributes:
        wheel: its name.
        order: k, periods a turn.
        amplitude: N m (V for a log driven by voltage) on the wheel's shaft.
        ci95: interval of it, N m.
        p, p_adjusted: of no such torque; the second over all wheels and orders.
    """

    wheel: str
    order: int
    amplitude: float
    ci95: tuple[float, float]
    p: float
    p_adjusted: float = 1.0

    @property
    def flagged(self) -> bool:
        """Whether it is there by more than chance, all wheels and orders considered."""
        return self.p_adjusted < FALSE_DISCOVERIES

    def as_dict(self) -> dict[str, Any]:
        """Return what JSON shows."""
        return {**vars(self), "ci95": list(self.ci95), "significant": self.flagged}


def harmonics(
    log: Log, model: Model, regression: Regression, residual: np.ndarray
) -> tuple[Harmonic, ...]:
    """Fit harmonics of the wheel angles to a residual (N, 3); empty where no angle is known.

    The columns are those of the effect ``torque_ripple``; the model's own effects do not touch
    them.  Over a wheel that swings to and fro the orders look alike, so the clearest is fitted
    first and the next to what it leaves.
    """
    if log.wheel_velocity is None or len(log.pieces()) > 1:
        return ()
    bare = replace(model, effects=(), covariance=None)
    usual = np.sqrt(np.mean(log.wheel_velocity**2))
    columns = {
        order: _columns(log, bare, order)
        for order in ORDERS
        if order * usual * log.dt * LEAST_SAMPLES <= 2 * np.pi
    }
    found: list[Harmonic] = []
    while columns:
        fits = {k: _fit(regression, H, residual, k, log) for k, H in columns.items()}
        clearest = min(fits, key=lambda k: min(harmonic.p for harmonic in fits[k][0]))
        of_order, explained = fits[clearest]
        found += of_order
        residual = residual - explained
        del columns[clearest]
    if not found:
        return ()
    adjusted = false_discoveries([harmonic.p for harmonic in found], dependent=True)
    judged = [replace(h, p_adjusted=float(p)) for h, p in zip(found, adjusted, strict=True)]
    return tuple(sorted(judged, key=lambda h: (not h.flagged, -h.amplitude)))


def _columns(log: Log, bare: Model, order: int) -> np.ndarray:
    """(N, 3, 2n) rows of the cosines of all n wheels, then of their sines, at one."""
    names = [f"{part}_{wheel}" for part in "ab" for wheel in log.platform.wheel_names]
    values = dict.fromkeys(names, 0.0) | {"k": float(order)}
    rows = build_regression(log, bare.with_effects({EFFECT: values}))
    return rows.H[:, :, [rows.names.index(f"{EFFECT}.{name}") for name in names]]


def _fit(
    regression: Regression, H: np.ndarray, residual: np.ndarray, order: int, log: Log
) -> tuple[list[Harmonic], np.ndarray]:
    """One harmonic for each wheel, and the part (N, 3) of the residual they explain."""
    wheels = log.platform.wheel_names
    names = tuple(f"{part}_{wheel}" for part in "ab" for wheel in wheels)
    rows = replace(regression, names=names, H=H, y=residual, allowed=None)
    estimate = least_squares(rows)
    spare = max(estimate.clusters - 2, 1)
    found = []
    for k, wheel in enumerate(wheels):
        at = [k, len(wheels) + k]
        size, covariance = estimate.values[at], estimate.covariance[np.ix_(at, at)]
        amplitude = float(np.hypot(*size))
        toward = size / max(amplitude, 1e-300)
        half = estimate.quantile * float(np.sqrt(toward @ covariance @ toward))
        wald = float(size @ np.linalg.pinv(covariance) @ size)
        p = float(fisher_above(wald / 2 * spare / (spare + 1), 2, spare))
        ends = (max(amplitude - half, 0.0), amplitude + half)
        found.append(Harmonic(wheel, order, amplitude, ends, p))
    return found, H @ estimate.values
