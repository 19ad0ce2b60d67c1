"""What a motion is wanted for, as a number to be made small."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ident.consistency import decode, lump_weights
from ident.identifiability import OFFSET, X_NAMES, coordinate_factors
from youbot_env.dynamics import Theta
from youbot_env.model import Model
from youbot_env.parameters import UNITS

# Half width of a 95 % interval in standard errors, for many samples.
NORMAL = 1.96


class Linear(NamedTuple):
    """A quantity as it depends on theta: value, gradient (7,) and unit."""

    value: float
    gradient: np.ndarray
    unit: str


@dataclass(frozen=True)
class Criterion:
    """Logarithm of an expected interval.

    Attributes:
        name: of a quantity, or ``A`` (all parameters, each in sizes of itself) or ``D`` (volume).
        gradients: (q, 7) of the quantities that count, divided by their sizes.
    """

    name: str
    gradients: np.ndarray

    @classmethod
    def of(cls, name: str, model: Model) -> Criterion:
        """Make the criterion of that name.

        Raises:
            ValueError: unknown name.
        """
        known = quantities(model)
        if name in ("A", "D"):
            sizes = {"a_x": OFFSET * model.platform.reach, "a_y": OFFSET * model.platform.reach}
            rows = [known[k].gradient / sizes.get(k, abs(known[k].value) or 1.0) for k in UNITS]
            return cls(name, np.array(rows))
        if name not in known:
            raise ValueError(
                f"nothing called {name!r} to design for; choose {sorted(known)}, A or D"
            )
        return cls(name, known[name].gradient[None])

    def value(self, covariance: np.ndarray) -> np.ndarray:
        """(...) value for covariances (..., 7, 7) of theta: half the logarithm of a variance."""
        spread = self.gradients @ covariance @ self.gradients.T
        if self.name == "D":
            return 0.5 * np.linalg.slogdet(spread)[1] / len(self.gradients)
        return 0.5 * np.log(np.trace(spread, axis1=-2, axis2=-1))


def quantities(model: Model) -> dict[str, Linear]:
    """Everything a motion can be designed for, linearised at the model's values."""
    known = {
        name: Linear(value, gradient[:7], UNITS[name])
        for name, (value, gradient) in decode(model).items()
    }
    theta = np.array(model.values()[:7])
    for name, (weights, unit) in lump_weights(model).items():
        known[name] = Linear(float(weights[:7] @ theta), weights[:7], unit)
    factors = coordinate_factors(Theta._fields, model)
    for name, row in zip(X_NAMES, np.diag(factors), strict=True):
        unit = "N m s" if name in ("x6", "x7") else "kg m^2"
        known.setdefault(name, Linear(float(row @ theta), row, unit))
    return known


def intervals(covariance: np.ndarray, model: Model) -> dict[str, float]:
    """Half widths of the expected 95 % intervals of all quantities, in their units."""
    return {
        name: NORMAL * float(np.sqrt(q.gradient @ covariance @ q.gradient))
        for name, q in quantities(model).items()
    }
