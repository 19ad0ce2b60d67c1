"""What the forces at the measured motion say of an effect that a free run likes.

A free run feels what its own velocities make of an effect.  A law that holds a standing robot
lowers the error that noise or rollers leave in a simulation, whether or not the robot has it.  At
the measured velocities it does not: there an effect that the robot has is found at its full size,
and one that only calms the simulation at none.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from ident.diagnosis.refit import Refits, without
from ident.diagnosis.settings import SETTINGS
from ident.diagnosis.splits import judges
from ident.log import Log
from ident.regression import Regression, build_regression, linear_names
from ident.sensitivity import Linearised
from youbot_env.effects import get_effect
from youbot_env.model import Model

# Links of laws that are forces at the measured motion; other laws change that motion itself.
FORCES = ("shaft", "roller", "body", "drive", "inertial")


class ForceShare(NamedTuple):
    """The size of an effect at the measured motion, as a share of that which a free run found.

    Attributes:
        value: 1 where both agree.
        error: its standard error.
    """

    value: float
    error: float

    @property
    def denies(self) -> bool:
        """Whether it speaks against the law."""
        return abs(self.value - 1.0) > SETTINGS.off_share + SETTINGS.denied_errors * self.error


def feigned(simulations: Sequence[Linearised], identifier: str) -> bool:
    """Tell whether the forces of any log deny most of an effect that its simulation contains."""
    shares = [force_share(sim.raw, sim.model, identifier) for sim in simulations]
    return any(
        s is not None and s.value + SETTINGS.denied_errors * s.error < SETTINGS.denied_share
        for s in shares
    )


def confirmations(
    fits: Refits, model: Model, identifiers: Sequence[str]
) -> dict[str, list[ForceShare]]:
    """By effect the shares that the logs confirm, of those that can."""
    models, found = fits.models(model), {}
    for identifier in identifiers:
        shares = [
            force_share(part.log, own, identifier)
            for part, own in zip(fits.parts, models, strict=True)
            if judges(part, get_effect(identifier))
        ]
        found[identifier] = [share for share in shares if share is not None]
    return found


def force_share(log: Log, model: Model, identifier: str) -> ForceShare | None:
    """Share of an effect of a model that forces confirm.

    Args:
        log: the record, as logged.
        model: with the effect, at the values that the free run found.
        identifier: the effect.

    Returns:
        None where it cannot be judged so: it is no force, or makes the drive late, which shifts the
        noise of the drive with it, or it makes no difference here.
    """
    effect = get_effect(identifier)
    if effect.link not in FORCES or effect.late:
        return None
    alone = without(model, identifier)
    base, full = build_regression(log, alone), build_regression(log, model)
    left, right = _residual(base, alone), _residual(full, model)
    kept = _moved(log, base.time)
    trace, y, columns = (left - right)[kept], left[kept], base.H[..., :7][kept]
    size = float(np.linalg.norm(trace))
    if not np.isfinite(size) or size <= 1e-12 * np.linalg.norm(y):
        return None
    scale = np.maximum(np.linalg.norm(columns, axis=0), 1e-300)
    turn, strength, _ = np.linalg.svd(columns / scale, full_matrices=False)
    turn = turn[:, strength > SETTINGS.force_weak * strength[0]]
    own = trace - turn @ (turn.T @ trace)
    value = float(own @ y / (own @ own))
    error = y - turn @ (turn.T @ y) - value * own
    blocks = np.array_split(np.arange(len(y)), SETTINGS.force_blocks)
    scores = np.array([own[block] @ error[block] for block in blocks])
    return ForceShare(value, float(np.linalg.norm(scores) / (own @ own)))


def _moved(log: Log, time: np.ndarray) -> np.ndarray:
    """(N, 3) along which axes the robot really moves at times (N,)."""
    v = np.column_stack([np.interp(time, log.time, axis) for axis in log.velocity().T])
    v = np.abs(v * (1.0, 1.0, log.platform.lever))
    speed = np.linalg.norm(v, axis=1, keepdims=True)
    return v >= SETTINGS.moving_share * np.maximum(speed, np.sqrt(np.mean(speed**2)))


def _residual(regression: Regression, model: Model) -> np.ndarray:
    """(N, 3) rows that a model leaves, N m."""
    values = dict(zip(model.names(), model.values(), strict=True))
    return regression.residual(np.array([values[name] for name in linear_names(model)]))
