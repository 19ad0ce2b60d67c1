"""What one source of body motion says about the signals of the wheels: their fingerprints.

The fingerprint of a wheel is how much of each body motion its signal holds: a row of J for wheel
speeds, and positive multiples of the columns of J for torques and voltages, because friction and
inertia are positive.  It shows signs, order and units without any parameter of the robot.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

HEARD = 0.01  # share of a signal that an axis alone must explain to be heard
COLLINEAR = 4.0  # variance inflation beyond which axes move together
MISSED = 0.03  # share that unheard axes may explain together, before nothing is said of any axis
SAME = 0.3  # of a fingerprint, by which it may change when the unheard axes are fitted as well
WEAK = 0.5  # of what the strongest axis contributes, below which an axis counts for less
RIDGE = 1e-3  # keeps speed and acceleration apart where one follows the other


@dataclass(frozen=True)
class Evidence:
    """A signal of the wheels against the body motion by one source.

    Attributes:
        signal: (K, n) wheel speeds or drive input.
        motion: (K, 3) body velocities.
        share: of the variance of the signal, what the motion explains.
        axes: (3,) axes heard one by one; none where they move together.
        rows: (n, axes) fingerprint; None where axes move together.
        weights: (axes,) 1 for an axis that contributes about as much as the strongest, less for one
            that hardly moves: what it shows is mostly errors of the others.
    """

    signal: np.ndarray
    motion: np.ndarray
    share: float
    axes: np.ndarray
    rows: np.ndarray | None
    weights: np.ndarray | None = None

    def table(self, jacobian: np.ndarray, driven: bool) -> np.ndarray | None:
        """(n, n) cosines between column i of the signal and wheel k; NaN where nothing is said.

        Args:
            jacobian: (n, 3) J, with flipped columns to try other signs of the axes.
            driven: the signal is a torque or voltage, known up to a positive factor an axis.
        """
        if self.rows is not None:
            return _cosines(self.rows, jacobian[:, self.axes], self.weights)
        if driven:  # how far each axis is braked is unknown, so is what the wheel should do
            return None
        expected = self.motion @ jacobian.T
        size = np.std(expected, axis=0)
        count = len(jacobian)
        with np.errstate(invalid="ignore", divide="ignore"):
            table = np.corrcoef(self.signal.T, expected.T)[:count, count:]
        table[:, size < 0.2 * size.max()] = np.nan
        return table

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


def hear(signal: np.ndarray, motion: np.ndarray, rates: np.ndarray | None = None) -> Evidence:
    """Compare a signal of the wheels with a body motion.

    Args:
        signal: (K, n).
        motion: (K, 3) body velocities.
        rates: (K, 3) their derivatives, for torques and voltages.  Contributions of velocity and
            acceleration are added, each times its rms.
    """
    regressors = motion if rates is None else np.hstack([motion, rates])
    covariance = _covariance(regressors, signal)
    width = regressors.shape[1]

    def fit(axes) -> tuple[np.ndarray, np.ndarray]:
        chosen = [*axes] if rates is None else [*axes, *(k + 3 for k in axes)]
        return _fit(covariance, chosen, width)

    full = fit(range(3))[1]
    without = [fit([k for k in range(3) if k != axis])[1] for axis in range(3)]
    axes = np.array([np.max(full - less) > HEARD for less in without])
    chosen, rows, weights = np.flatnonzero(axes).tolist(), None, None

    def fingerprint(fitted: list[int]) -> np.ndarray:
        """Rows of the chosen axes, others being fitted with them."""
        places, count = [fitted.index(axis) for axis in chosen], len(fitted)
        coefficients = fit(fitted)[0]
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
    # A wheel at rest is all noise, one in another unit all variance: the kinder of two averages.
    spread = np.diag(covariance)[width:]
    share = max(np.median(full), full @ spread / (spread.sum() + 1e-300))
    return Evidence(signal, motion, float(share), axes, rows, weights)


def explained(signal: np.ndarray, regressors: np.ndarray) -> np.ndarray:
    """(n,) fraction of the variance of each column that the regressors explain."""
    width = regressors.shape[1]
    return _fit(_covariance(regressors, signal), list(range(width)), width)[1]


def _covariance(*signals: np.ndarray) -> np.ndarray:
    columns = np.hstack(signals)
    columns = columns - columns.mean(axis=0)
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


def _cosines(found: np.ndarray, expected: np.ndarray, weights: np.ndarray) -> np.ndarray:
    """Cosines between rows; columns are scaled by their median size, so units do not count."""

    def directions(rows: np.ndarray) -> np.ndarray:
        typical, largest = np.median(np.abs(rows), axis=0), np.abs(rows).max(axis=0)
        rows = weights * rows / np.where(typical > 1e-3 * largest, typical, largest + 1e-300)
        return rows / (np.linalg.norm(rows, axis=1, keepdims=True) + 1e-300)

    return directions(found) @ directions(expected).T
