"""What a model leaves unexplained widens the intervals of its values.

Scatter between stretches of a log tells how noise moves an estimate.  An effect that the model
lacks moves it the same way in every stretch, and no scatter shows that: intervals from it alone
exclude the truth with certainty.  A share of what is left may lie along the trace of any direction.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
from scipy.linalg import orth

from ident.estimators import least_squares
from ident.free_run import FreeRun
from ident.identifiability import Seen
from ident.kinematics.ripple import seen_phases
from ident.kinematics.wheels import RIPPLE
from ident.log import Log
from ident.noise_floor import velocity_floor
from ident.prior import ALIGNED
from ident.regression import Regression, allowed_directions, build_regression
from ident.sensitivity import Linearised
from youbot_env.model import Model

# Squared free-run error beyond noise and rolling, in units of these, that no noise makes; and from
# which on it is likely that something is missing.  Of 32 robots of which nothing is missing, half
# of them on real rollers, all stayed below 0.4.
UNEXPLAINED, LIKELY = 3.0, 1.0
# Forces that robots usually have, which tell how far one that is missing moves values.
# The rule was chosen on 32 logs and then measured on 59 others, of robots that lack one of 17
# effects, seen for certain: of 236 lumps intervals from scatter alone held the truth of 60 %, with
# these shifts and ``ALIGNED`` of what they leave of 90 %; half widths grew from 7 to 19 % of the
# value.  Of robots whose friction changes with load or time, or whose battery sags, 11 of 28 held.
NUISANCES = (
    "wheel_coulomb_friction",
    "roller_coulomb_friction",
    "body_dry_friction",
    "floor_slope",
    "torque_offset",
    "torque_gain",
)
# Directions of a weaker trace than this share of the strongest, squared, shift nothing.
RANK = 1e-10


@dataclass(frozen=True)
class Unexplained:
    """Free-run error of a model on the logs that it was fitted to.

    Attributes:
        error: as a share of the motion's rms.
        floor: what noise, rolling and the uncertainty of the values leave of it.
    """

    error: float
    floor: float

    @classmethod
    def of(cls, logs: Sequence[Log], model: Model, run: FreeRun) -> Unexplained:
        """From the free run of a model, with the covariance that scatter gives it."""
        spread = np.maximum(run.measured.std(axis=0), 1e-9)
        floor = math.hypot(*velocity_floor(Linearised.of(logs[0], model), spread))
        return cls(run.nrmse, floor)

    @property
    def certain(self) -> bool:
        """Whether something is missing, whatever it is."""
        return self.error**2 > (1.0 + UNEXPLAINED) * self.floor**2

    @property
    def likely(self) -> bool:
        """Whether something may well be missing; then intervals are widened."""
        return self.error**2 > (1.0 + LIKELY) * self.floor**2

    @property
    def share(self) -> float:
        """Share of the squared error that noise does not make; 0 where it may make all."""
        return 1.0 - (self.floor / self.error) ** 2 if self.likely else 0.0


def widening(
    seen: Seen, regression: Regression, logs: Sequence[Log], model: Model, share: float
) -> np.ndarray:
    """(P, P) covariance of a model's linear values for what it lacks.

    By how much the usual forces (``NUISANCES``) would shift the values is taken for a standard
    error, as the robot need not have them; and a share of what they leave as well may lie along
    any direction.

    Args:
        seen: directions that were estimated.
        regression: rows of the logs for the model.
        logs: records that were fitted.
        model: the identified one.
        share: of the squared residual that is no noise.
    """
    there = {active.identifier for active in model.effects}
    rich = model.with_effects({name: None for name in NUISANCES if name not in there})
    wide = Regression.join([build_regression(log, rich) for log in logs])
    names = [name for name in wide.names if name not in regression.names]
    at = [wide.names.index(name) for name in names]
    allowed = allowed_directions(tuple(wide.names), rich)
    free = np.eye(len(at)) if allowed is None else orth(allowed[at])
    mine, y = seen.reduce(regression).rows
    beside = wide.H[..., at].reshape(len(mine), -1) @ free
    plain, _, inverse = _least_squares(mine, y)
    rest, left, _ = _least_squares(np.column_stack([mine, beside]), y)
    shift = seen.basis @ (rest[: len(plain)] - plain)
    unknown = ALIGNED**2 * share * left * seen.basis @ inverse @ seen.basis.T
    return np.outer(shift, shift) + unknown


def rolling_shift(seen: Seen, logs: Sequence[Log], model: Model) -> np.ndarray | None:
    """(P,) by how much a model without ripple of its rollers misjudges a robot that has it.

    To the robot of the model exact finite rollers are added, and what the regression makes of the
    forces that the same motion then takes is compared with what was put in.  Ten robots with real
    rollers (MuJoCo) were misjudged so in sign and size: masses by -5 to -16 %, where this says -3
    to -11 %, friction of the rollers by -8 to -14 %, where this says -6 to -10 %.

    Args:
        seen: directions that were estimated.
        logs: records that were fitted.
        model: the identified one.

    Returns:
        None where no log's wheels ripple, or the model holds that already.
    """
    rolled = [seen_phases(log) for log in logs]
    if RIPPLE in {one.identifier for one in model.effects} or all(one is None for one in rolled):
        return None
    values = dict(zip(model.names(), model.values(), strict=True))
    estimate = np.array([values[name] for name in seen.names])
    parts = []
    for log, phases in zip(logs, rolled, strict=True):
        plain = build_regression(log, model)
        y = plain.H @ estimate
        if phases is not None:
            names = (f"phi0_{wheel}" for wheel in log.platform.wheel_names)
            at = dict(zip(names, phases.tolist(), strict=True))
            finite = build_regression(log, model.with_effects({RIPPLE: {"size": 1.0, **at}}))
            y = finite.H @ estimate + plain.y - finite.y
        parts.append(replace(plain, y=y))
    found = seen.restore(least_squares(seen.reduce(Regression.join(parts))))
    return found.values - estimate


def _least_squares(columns: np.ndarray, y: np.ndarray) -> tuple[np.ndarray, float, np.ndarray]:
    """Solution (k,), squared residual, and inverse (k, k) of the inner products."""
    scale = np.linalg.norm(columns, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    inner = np.linalg.pinv((columns / scale).T @ (columns / scale), rcond=RANK, hermitian=True)
    solution = inner @ (columns.T @ y / scale) / scale
    return solution, float(np.sum((y - columns @ solution) ** 2)), inner / np.outer(scale, scale)
