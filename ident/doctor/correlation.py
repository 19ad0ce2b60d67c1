"""What one source of body motion says about the signals of the wheels: their fingerprints.

The fingerprint of a wheel is how much of each body motion its signal holds: a row of J for wheel
speeds, and positive multiples of the columns of J for torques and voltages, because friction and
inertia are positive.  It shows signs, order and units without any parameter of the robot.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

HEARD = 0.01  # share of a signal that an axis alone must explain to be heard
COLLINEAR = 4.0  # variance inflation beyond which axes move together
MISSED = 0.03  # share that unheard axes may explain together, before nothing is said of any axis
SAME = 0.3  # of a fingerprint, by which it may change when the unheard axes are fitted as well
STEADY = 4.0  # squared mean of a motion over its variance, from which on it is steady
WEAK = 0.5  # of what the strongest axis contributes, below which an axis counts for less
# Fingerprints are fitted again without each of the parts of the log, which are dealt out in
# stretches of so many s.  A column contradicts a wheel beyond so many standard errors.
PARTS, STRETCH, CERTAIN = 10, 0.5, 3.0
IDLE = 0.05  # rms of a column over that of the busiest, below which it says nothing
REPEATED = 0.5  # of the cosine between fingerprints of two axes, from that of the wheel table
FEWEST = 4  # parts: from fewer no scatter is known
RIDGE = 1e-3  # keeps speed and acceleration apart where one follows the other


class Likeness(NamedTuple):
    """How columns of a signal resemble wheels.

    Attributes:
        cosines: (n, n) between column i and wheel k; NaN where nothing is said.
        errors: (n, n) their standard errors.
    """

    cosines: np.ndarray
    errors: np.ndarray

    def most(self, signs: np.ndarray | float = 1.0) -> np.ndarray:
        """(n, n) resemblance that is not excluded, of columns with a sign each."""
        return signs * self.cosines + CERTAIN * self.errors


@dataclass(frozen=True)
class Correlation:
    """A signal of the wheels against the body motion by one source.

    Attributes:
        signal: (K, n) wheel speeds or drive input.
        motion: (K, 3) body velocities.
        share: of the variance of the signal, what the motion explains.
        axes: (3,) axes heard one by one; none where they move together.
        rows: (n, axes) fingerprint; None where axes move together.
        weights: (axes,) 1 for an axis that contributes about as much as the strongest, less for one
            that hardly moves: what it shows is mostly errors of the others.
        without: fingerprints of the log without each of its parts; empty where it is too short.
    """

    signal: np.ndarray
    motion: np.ndarray
    share: float
    axes: np.ndarray
    rows: np.ndarray | None
    weights: np.ndarray | None = None
    without: tuple[np.ndarray, ...] = ()

    def table(self, jacobian: np.ndarray, driven: bool) -> Likeness | None:
        """Cosines between the columns of the signal and the wheels.

        Args:
            jacobian: (n, 3) J, with flipped columns to try other signs of the axes.
            driven: the signal is a torque or voltage, known up to a positive factor an axis.
        """
        if self.rows is not None:
            expected = jacobian[:, self.axes]
            own = _driven(self.rows, expected, self.weights)
            expected, weights = expected[:, own], self.weights[own]
            cosines = _cosines(self.rows[:, own], expected, weights)
            size = np.sqrt(np.mean(self.signal**2, axis=0))
            cosines[size < IDLE * size.max()] = np.nan
            fewer = [_cosines(rows[:, own], expected, weights) for rows in self.without]
            return Likeness(cosines, _jackknife(fewer, cosines))
        if driven:  # how far each axis is braked is unknown, so is what the wheel should do
            return None
        expected = self.motion @ jacobian.T
        count = len(jacobian)
        with np.errstate(invalid="ignore", divide="ignore"):
            table = _covariance(self.signal, expected, about=centre(self.motion))
            own, size = np.split(np.sqrt(np.diag(table)), 2)
            table = (table / np.sqrt(np.outer(np.diag(table), np.diag(table))))[:count, count:]
        table[:, size < 0.2 * size.max()] = np.nan
        table[own < 0.2 * own.max()] = np.nan
        return Likeness(table, np.zeros_like(table))

    def gains(self, jacobian: np.ndarray) -> np.ndarray:
        """(n, 3) sizes of the signal over ``J motion``; NaN where nothing is said."""
        gains = np.full(jacobian.shape, np.nan)
        if self.rows is None:
            expected = self.motion @ jacobian.T
            power = np.mean(expected**2, axis=0)
            clear = power > 0.04 * power.max()
            gains[clear] = (np.mean(self.signal * expected, axis=0)[clear] / power[clear])[:, None]
            return gains
        clear = np.abs(jacobian) > 0.2 * np.abs(jacobian).max(axis=0)
        gains[:, self.axes] = self.rows / np.where(clear, jacobian, np.nan)[:, self.axes]
        return gains


def correlate(
    signal: np.ndarray,
    motion: np.ndarray,
    rates: np.ndarray | None = None,
    step: float = np.inf,
) -> Correlation:
    """Compare a signal of the wheels with a body motion.

    Args:
        signal: (K, n).
        motion: (K, 3) body velocities.
        rates: (K, 3) their derivatives, for torques and voltages.  Contributions of velocity and
            acceleration are added, each times its rms.
        step: s between samples, to know how far a fingerprint is certain.
    """
    regressors = motion if rates is None else np.hstack([motion, rates])
    about = centre(motion)
    covariance = _covariance(regressors, signal, about=about)
    width = regressors.shape[1]
    without: tuple[np.ndarray, ...] = ()

    def fit(axes) -> tuple[np.ndarray, np.ndarray]:
        chosen = [*axes] if rates is None else [*axes, *(k + 3 for k in axes)]
        return _fit(covariance, chosen, width)

    full = fit(range(3))[1]
    without = [fit([k for k in range(3) if k != axis])[1] for axis in range(3)]
    axes = np.array([np.max(full - less) > HEARD for less in without])
    chosen, rows, weights = np.flatnonzero(axes).tolist(), None, None

    def fingerprint(fitted: list[int], covariance: np.ndarray = covariance) -> np.ndarray:
        """Rows of the chosen axes, others being fitted with them."""
        places, count = [fitted.index(axis) for axis in chosen], len(fitted)
        columns = fitted if rates is None else [*fitted, *(k + 3 for k in fitted)]
        coefficients = _fit(covariance, columns, width)[0]
        if rates is None:
            return (coefficients[places] / np.sqrt(np.diag(covariance)[chosen])[:, None]).T
        return (coefficients[places] + coefficients[[k + count for k in places]]).T

    if chosen and _inflation(covariance[:3, :3])[axes].max() < COLLINEAR:
        rows, alone = fingerprint(chosen), fit(chosen)[1]
        typical = np.median(np.abs(rows), axis=0) + 1e-300
        # An axis that adds nothing because others move with it would be counted as theirs.
        whole = fingerprint([0, 1, 2])
        differ = np.linalg.norm((rows - whole) / typical) > SAME * np.linalg.norm(rows / typical)
        if differ or np.median(full - alone) > MISSED:
            rows = None
        else:
            size = np.sqrt(np.diag(covariance)[chosen]) if rates is None else 1.0
            weights = np.minimum(1.0, typical * size / (WEAK * (typical * size).max()))
            without = tuple(
                fingerprint(chosen, _covariance(regressors[kept], signal[kept], about=about))
                for kept in _parts(len(signal), step)
            )
    # A wheel at rest is all noise, one in another unit all variance: the kinder of two averages.
    spread = np.diag(covariance)[width:]
    share = max(np.median(full), full @ spread / (spread.sum() + 1e-300))
    return Correlation(signal, motion, float(share), axes, rows, weights, without)


def _parts(count: int, step: float) -> list[np.ndarray]:
    """(count,) samples that stay, for each part left out; empty where the log is too short."""
    stretch = np.arange(count) // max(1, round(min(STRETCH / step, count)))
    parts = min(PARTS, int(stretch[-1]) + 1)
    return [stretch % parts != part for part in range(parts)] if parts >= FEWEST else []


def _jackknife(fewer: list[np.ndarray], whole: np.ndarray) -> np.ndarray:
    """Standard errors of cosines from those without each part; 1 where nothing is known."""
    if not fewer:
        return np.full_like(whole, 1.0)
    scatter = np.sum((np.array(fewer) - np.mean(fewer, axis=0)) ** 2, axis=0)
    return np.sqrt((len(fewer) - 1) / len(fewer) * scatter)


def explained(signal: np.ndarray, regressors: np.ndarray, about: float | None = None) -> np.ndarray:
    """(n,) fraction of the variance of each column that the regressors explain.

    Args:
        signal: (K, n).
        regressors: (K, r).
        about: part of the means that is taken out; none of a steady motion, else all, if left.
    """
    width = regressors.shape[1]
    about = centre(regressors) if about is None else about
    covariance = _covariance(regressors, signal, about=about)
    return _fit(covariance, list(range(width)), width)[1]


def centre(motion: np.ndarray) -> float:
    """1 where a motion varies, 0 where it is steady: what varies then is noise.

    A loop answers noise of the speed with torque of the other sign, which is no braking.
    """
    mean, spread = np.mean(motion, axis=0), np.var(motion, axis=0)
    size = mean**2 + spread + 1e-300
    weight = size / size.max()
    return 0.0 if np.sum(weight * mean**2 / size) > STEADY * np.sum(weight * spread / size) else 1.0


def _covariance(*signals: np.ndarray, about: float) -> np.ndarray:
    """Second moments of all columns, about so much of their means."""
    columns = np.hstack(signals)
    columns = columns - about * columns.mean(axis=0)
    return columns.T @ columns / len(columns) + 1e-24 * np.eye(columns.shape[1])


def _fit(covariance: np.ndarray, chosen: list[int], first: int) -> tuple[np.ndarray, np.ndarray]:
    """Regress the columns from ``first`` on the chosen ones.

    Returns:
        coefficients of regressors scaled to unit rms, and the explained fraction of each column.
    """
    scale = np.sqrt(np.diag(covariance)[chosen])
    gram = covariance[np.ix_(chosen, chosen)] / np.outer(scale, scale)
    cross = covariance[chosen, first:] / scale[:, None]
    coefficients = np.linalg.solve(gram + RIDGE * np.eye(len(chosen)), cross)
    gain = np.sum(coefficients * (2 * cross - gram @ coefficients), axis=0)
    return coefficients, gain / np.diag(covariance)[first:]


def _inflation(covariance: np.ndarray) -> np.ndarray:
    """(3,) variance inflation factors: 1 where an axis moves independently of the others."""
    scale = np.sqrt(np.diag(covariance))
    correlation = covariance / np.outer(scale, scale)
    return np.diag(np.linalg.inv(correlation + 1e-6 * np.eye(len(correlation))))


def _driven(found: np.ndarray, expected: np.ndarray, weights: np.ndarray) -> list[int]:
    """Axes that the wheels drove; others moved with these, by drift or slip.

    Whatever the order and signs of the columns, the angles between fingerprints of two axes are
    those of the wheel table.  A robot that drifts while it drives repeats the fingerprint of what
    it drives.
    """

    def angles(rows: np.ndarray) -> np.ndarray:
        rows = rows / (np.linalg.norm(rows, axis=0) + 1e-300)
        return np.abs(rows.T @ rows)

    apart = np.abs(angles(found) - angles(expected)) < REPEATED
    order = np.argsort(-weights * np.linalg.norm(found, axis=0), kind="stable")
    own: list[int] = []
    for axis in order.tolist():
        if all(apart[axis, other] for other in own):
            own.append(axis)
    return sorted(own)


def _cosines(found: np.ndarray, expected: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Cosines between rows; columns are scaled by their median size, so units do not count."""

    def directions(rows: np.ndarray) -> np.ndarray:
        typical, largest = np.median(np.abs(rows), axis=0), np.abs(rows).max(axis=0)
        rows = weights * rows / np.where(typical > 1e-3 * largest, typical, largest + 1e-300)
        return rows / (np.linalg.norm(rows, axis=1, keepdims=True) + 1e-300)

    return directions(found) @ directions(expected).T
