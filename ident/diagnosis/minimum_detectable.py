"""How large an effect had to be to show in a log, and how surely the typical size would."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

import numpy as np
from scipy.special import ndtr, ndtri

from ident.diagnosis.rounds import Round
from ident.diagnosis.settings import SETTINGS
from ident.distributions import student_quantile


@dataclass(frozen=True)
class MinimumDetectable:
    """One effect against one log, on top of the base model.

    Attributes:
        effect: identifier.
        parameter, unit: what the size is of.
        p: adjusted p value.
        size, ci95: estimate and interval on top of the base model.
        power: chance that the log would have shown the effect at its typical size.
        smallest: size that it shows with a chance of 80 %; None where it shows none.
        gain: share of squared error removed where it was not fitted.
        typical: typical size.
    """

    effect: str
    parameter: str
    unit: str
    p: float
    size: float
    ci95: tuple[float, float]
    power: float
    smallest: float | None
    gain: float
    typical: float

    def as_dict(self) -> dict[str, Any]:
        """Return what JSON shows."""
        return {
            "effect": self.effect,
            "parameter": self.parameter,
            "p_adjusted": self.p,
            "size": self.size,
            "ci95": list(self.ci95),
            "unit": self.unit,
            "power": self.power,
            "smallest_detectable": self.smallest,
            "gain": self.gain,
        }


def minimum_detectable(found: Round) -> tuple[MinimumDetectable, ...]:
    """Every effect that was tried, in its best form, the most significant first."""
    best: dict[str, int] = {}
    for k, trial in enumerate(found.table.trials):
        old = best.get(trial.identifier)
        if old is None or found.gains[k] > found.gains[old]:
            best[trial.identifier] = k
    every = [_of(found, k) for k in best.values()]
    return tuple(sorted((one for one in every if one is not None), key=lambda r: (r.p, -r.gain)))


def _of(found: Round, number: int) -> MinimumDetectable | None:
    table, trial = found.table, found.trial(number)
    coefficients, scatter = table.coefficients(number), table.scatter(number)
    mixed = trial.mix * trial.units[:, None]
    values = mixed @ coefficients
    errors = np.sqrt(np.maximum(np.einsum("ij,jk,ik->i", mixed, scatter, mixed), 0.0))
    if not np.any(errors > 0):
        return None
    # Of several parameters the one that shows most.
    k = int(np.argmax(np.abs(values) / np.where(errors > 0, errors, np.inf)))
    windows = len(table.scores)
    sure = float(student_quantile(0.975, windows - 1))
    rare = SETTINGS.significant / 2 / max(len(found.gains), 1)
    threshold = -float(student_quantile(rare, windows - 1))
    parameter = trial.effect.parameter_of(trial.names[k])
    typical = abs(parameter.default) or 1.0
    strength = table.strength(number, mixed[k])
    needed = (
        np.sqrt(SETTINGS.least_gain / (1 - SETTINGS.least_gain) / strength)
        if strength > 0
        else np.inf
    )
    half = ndtri(SETTINGS.power)
    smallest = max((threshold + half) * errors[k], needed)
    power = float(ndtr((typical / smallest - 1.0) * (threshold + half) + half))
    return MinimumDetectable(
        effect=trial.identifier,
        parameter=trial.names[k],
        unit=parameter.unit,
        p=float(found.p[number]),
        size=float(values[k]),
        ci95=(float(values[k] - sure * errors[k]), float(values[k] + sure * errors[k])),
        power=power,
        smallest=float(smallest) if np.isfinite(smallest) else None,
        gain=float(found.gains[number]),
        typical=typical,
    )
