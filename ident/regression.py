"""The filtered regression (paper eq. 8, 9), built from the one physics at unit parameters.

No column is written by hand: the column of a parameter in which the dynamics are linear is
what ``dynamics`` or an effect's law gives when that parameter is one and the others are zero.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.linalg import null_space

from ident.filters import FirstOrderFilter
from ident.instruments import hold_of
from ident.log import Log
from ident.restored import restored
from ident.signals import Measured, measure
from youbot_env import dynamics
from youbot_env.backend import NUMPY
from youbot_env.dynamics import Theta
from youbot_env.measurement import HELD
from youbot_env.model import Model

# Corner of the filters, rad/s: above the motions (a few rad/s), below the noise of differences.
CORNER = 10.0
# Rows are kept this share of the filters' time constant apart.
SPACING = 0.05
AXES = ("x", "y", "yaw")


@dataclass(frozen=True)
class Regression:
    """Rows ``y = H theta + residual`` of one or more contiguous pieces.

    The force rows are multiplied by the lever L as in paper eq. (7), so all rows are in N m and
    carry equal noise on a mecanum platform.

    Attributes:
        names: names of the P columns, theta first.
        H: (N, 3, P) columns.
        y: (N, 3) filtered generalized forces (L F_X, L F_Y, M_O), N m, less known effects.
        time: (N,) s.
        piece: (N,) number of the piece each row belongs to.
        lever: L, m.
        allowed: (P, K) orthonormal directions in which the parameters may move.  Where only
            differences between wheels can be seen (``contrast`` parameters), their common part
            belongs to another parameter, or to none, and stays where it is.  None allows all.
    """

    names: tuple[str, ...]
    H: np.ndarray
    y: np.ndarray
    time: np.ndarray
    piece: np.ndarray
    lever: float
    allowed: np.ndarray | None = None

    @property
    def rows(self) -> tuple[np.ndarray, np.ndarray]:
        """``(H (3N, P), y (3N,))`` with the axes of each sample next to each other."""
        return self.H.reshape(-1, self.H.shape[2]), self.y.ravel()

    def residual(self, estimate: np.ndarray) -> np.ndarray:
        """(N, 3) rows of ``y - H theta``, N m."""
        return self.y - self.H @ estimate

    @classmethod
    def join(cls, parts: list[Regression]) -> Regression:
        """Put the rows of several logs under each other."""
        pieces, offset = [], 0
        for part in parts:
            pieces.append(part.piece + offset)
            offset = pieces[-1].max() + 1
        stacked = [np.concatenate([getattr(p, name) for p in parts]) for name in ("H", "y", "time")]
        first = parts[0]
        return cls(first.names, *stacked, np.concatenate(pieces), first.lever, first.allowed)


def build_regression(
    log: Log,
    model: Model,
    corner: float = CORNER,
    transform: Callable[[Log], Log] | None = None,
    settle: float = 5.0,
) -> Regression:
    """Build the regression of a log in theta and in the linear parameters of the model's effects.

    Args:
        log: measured record with wheel torques; the model's instruments are undone here.
        model: platform and effects; nonlinear parameters of effects stay at the model's values.
        corner: corner of the filters, rad/s.
        transform: replaces each piece before columns are built (instruments from a simulation).
        settle: rows left out at the start of each piece, in units of 1 / corner; before, an unknown
            history (a lag's state, an offset) still shows.

    Raises:
        ValueError: no piece is long enough.
    """
    held = hold_of(log, model) == HELD
    parts, log = [], restored(log, model)
    for number, piece in enumerate(log.pieces()):
        skip = int(np.searchsorted(piece.time, piece.time[0] + settle / corner))
        if len(piece.time) - skip < 2:
            continue
        seen = measure(transform(piece) if transform else piece, model, origin=log.time[0])
        # Rows far closer than the filters can tell apart repeat each other.
        rows = slice(skip, None, max(1, int(SPACING / (corner * piece.dt))))
        H, y = _columns(seen, model, corner, rows, held)
        parts.append((H, y, piece.time[rows], np.full(len(y), number)))
    if not parts:
        raise ValueError(
            f"log {log.name!r}: no contiguous piece is longer than {settle / corner:.2g} s, which "
            "the filters need to settle; record longer without gaps"
        )
    H, y, time, piece = (np.concatenate(column) for column in zip(*parts, strict=True))
    names = linear_names(model)
    return Regression(
        names, H, y, time, piece, model.platform.lever, allowed_directions(names, model)
    )


def linear_names(model: Model) -> tuple[str, ...]:
    """Names of the parameters that enter linearly: theta, then those of effects."""
    names = list(Theta._fields)
    for active in model.effects:
        if active.effect.link == "sensor":
            continue
        linear = [name for name in active.values if active.effect.parameter_of(name).linear]
        names += [f"{active.identifier}.{name}" for name in linear]
    return tuple(names)


def allowed_directions(names: tuple[str, ...], model: Model) -> np.ndarray | None:
    """(P, K) orthonormal basis that keeps the mean of every contrast parameter fixed, if any."""
    fixed = []
    for active in model.effects:
        for parameter in active.effect.parameters:
            members = [
                f"{active.identifier}.{name}"
                for name in active.values
                if active.effect.parameter_of(name) is parameter
            ]
            row = np.isin(names, members)
            if parameter.contrast and row.sum() > 1:
                fixed.append(row / np.sqrt(row.sum()))
    return null_space(np.array(fixed)) if fixed else None


def _columns(
    seen: Measured, model: Model, corner: float, rows: slice, held: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Columns (N, 3, P) and right side (N, 3) of one piece at some rows.

    The forces of drive and effects are linearised at the model's values, one parameter at a time;
    in parameters that enter linearly this is exact.
    """
    filters = _Filters(seen.time, corner, model.platform.lever, rows, held)
    columns = [filters.inertial(seen, row) for row in np.eye(7).tolist()]
    values = np.array(model.values())
    force, extra = filters.force(seen), seen.robot.theta_change(seen.signals, NUMPY)
    right = force if extra is None else force - filters.inertial(seen, extra)
    names = model.names()
    for name in linear_names(model)[7:]:
        at = names.index(name)
        moved = values.copy()
        moved[at] += 1.0
        other = seen.with_values(moved)
        column = force - filters.force(other)
        if extra is not None:
            change = other.robot.theta_change(other.signals, NUMPY)
            column = column + filters.inertial(
                seen, [b - a for a, b in zip(extra, change, strict=True)]
            )
        columns.append(column)
        right = right + column * values[at]
    return np.stack(columns, axis=-1), right


class _Filters:
    """The filters of one piece, with force rows scaled by the lever; returns the wanted rows.

    While torques are held velocities run straight, and so do their forces.  Otherwise neither does,
    and all that is known of an interval are means: laws that are linear hold for these whatever
    happens within.  Forces that ran straight beside torques that did not would shift inertia by
    ``corner D dt^2 / 12``.
    """

    def __init__(self, time: np.ndarray, corner: float, lever: float, rows: slice, held: bool):
        self._filter, self._rows, self._straight = FirstOrderFilter(time, corner), rows, held
        self._scale, self._count = (lever, lever, 1.0), len(time[rows])

    def inertial(self, seen: Measured, theta) -> np.ndarray:
        """Filtered left side ``d/dt (M v) + centripetal + D v`` for theta, (rows, 3).

        Entries of theta may vary over time (a payload): mass that comes or goes takes its
        momentum along, so only ``theta_j d(M_j v)/dt`` counts.
        """
        s, total = seen.signals, np.zeros((self._count, 3))
        for number, weight in enumerate(theta):
            if np.ndim(weight) == 0 and weight == 0.0:
                continue
            unit = Theta(*np.eye(7)[number].tolist())
            momentum = dynamics.momentum(s.geometry, unit, s.v)
            quadratic = dynamics.centripetal(unit, s.v)
            viscous = dynamics.friction(s.geometry, unit, s.v)
            for axis in range(3):
                force = quadratic[axis] + viscous[axis]
                total[:, axis] += self._left(momentum[axis], force, weight) * self._scale[axis]
        return total

    def _left(self, momentum, force, weight) -> np.ndarray | float:
        """Filtered ``weight (momentum' + force)``; zeros that are plain numbers cost nothing."""
        result = 0.0
        if np.ndim(momentum):
            if np.ndim(weight):
                steps = 0.5 * (weight[1:] + weight[:-1]) * np.diff(momentum)
                momentum = np.concatenate([[0.0], np.cumsum(steps)])
            result = result + self._filter.rate(momentum)[self._rows]
        if np.ndim(force) and np.any(force):
            force = force * weight if np.ndim(weight) else force
            result = result + self._between(force[:-1], force[1:])
        return result

    def force(self, seen: Measured) -> np.ndarray:
        """Filtered generalized forces of drive and effects, (rows, 3)."""
        begin, end = seen.interval_wrenches()
        held = (self._between(b, e) for b, e in zip(begin, end, strict=True))
        return np.stack([h * k for h, k in zip(held, self._scale, strict=True)], axis=-1)

    def _between(self, begin: np.ndarray, end: np.ndarray) -> np.ndarray:
        """A filtered force that is known at both ends of each interval."""
        if not self._straight:
            begin = end = 0.5 * (begin + end)
        return self._filter.hold(begin, end)[self._rows]
