"""Weighted least squares of the kinematic values, what they leave undetermined, and intervals.

Residuals are coloured (rollers change, wheels slip), so covariances come from leaving out stretches
of time, one after the other, and never from single rows.

The normal equations hold pose against odometry, and wheels against each other.  Everything is kept
by clusters, stretches of time whose residuals are independent of each other.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from ident.distributions import fisher_above, student_quantile
from ident.estimators import CLUSTERS
from ident.kinematics.wheels import Rolling, parameter_names, rolling
from ident.kinematics.windows import LONGEST_DELAY, MOUNT, Windows, integrate
from ident.pooling import MANY_RUNS
from youbot_env.platform import Platform

# What could plausibly be: radii and base 5 %, roller angle 3 degrees; offsets 0.2 m and 12
# degrees; delay 0.1 s.
PLAUSIBLE, PLAUSIBLE_MOUNT = 0.05, (0.2, 0.2, 0.2, 0.1)
ROUNDING = 1e-9  # a record without noise still has it: m, rad, rad/s


class Normal:
    """Sums of squares and products at given values, by G clusters.

    Args:
        windows: the log.
        platform: nominal wheel table.
        values: (p,) kinematic values, then the mount.

    Attributes:
        rolling: kinematics at the values.
        noise: rms of what is left: position m, yaw rad, contradiction of the wheels rad/s.
    """

    def __init__(self, windows: Windows, platform: Platform, values: np.ndarray):
        count = len(platform.wheels)
        self.wheels, self.radius = count, platform.wheel_radius
        self.rolling = rolling(platform, values[: count + 2])
        residual, design, nuisance = windows.residual(self.rolling.odometry, values[count + 2 :])
        fresh = windows.fresh[..., None]
        left = _project(residual[..., None], nuisance, fresh * np.ones(3))[..., 0] * fresh
        squares = np.sum(left**2, axis=(0, 1)) / fresh.sum()
        place, yaw = np.sqrt(squares[:2].mean()), np.sqrt(squares[2])
        speed = windows.speed(0.0)
        contrary = speed @ self.rolling.contradiction.T
        slip = np.sqrt(np.mean(np.sum(contrary**2, axis=2)) / max(count - 3, 1))
        self.noise = (float(place), float(yaw), float(slip))

        weight = fresh / (np.array([place, place, yaw]) + ROUNDING) ** 2
        design = _project(design, nuisance, weight)
        groups = _independent(windows)
        self._pose = _by_group(_gram(design, design * weight[..., None]), groups)
        self._score = _by_group(np.einsum("wkab,wka->wb", design, residual * weight), groups)
        self._speed = None
        if count > 3:
            self._speed = _by_group(_gram(speed, speed) / (slip + ROUNDING) ** 2, groups)

    def sums(self, scale: np.ndarray, free: bool = False) -> tuple[np.ndarray, np.ndarray]:
        """Information (G, p, p) and scores (G, p) of all values in scaled units.

        Args:
            scale: (p,) units.
            free: append the 3 n entries of J, in units of 5 % of 1 / R.
        """
        count, mount, slopes = self.wheels, len(MOUNT), self.rolling
        kinematic = count + 2
        size, unit = kinematic + mount, scale
        if free:
            unit = np.append(scale, np.full(3 * count, PLAUSIBLE / self.radius))
        chain = np.zeros((3 * count + mount, len(unit)))
        chain[: 3 * count, :kinematic] = slopes.odometry_slope
        chain[3 * count :, kinematic:size] = np.eye(mount)
        parts = np.zeros((len(unit), count, count))
        parts[:kinematic] = slopes.contradiction_slope.T.reshape(-1, count, count)
        if free:
            chain[: 3 * count, size:] = slopes.odometry_free
            parts[size:] = slopes.contradiction_free.T.reshape(-1, count, count)
        information = chain.T @ self._pose @ chain
        score = self._score @ chain
        if self._speed is not None:
            # Each sample says P phi' = 0; the slope by a value is (dP/dp) phi'.
            seen = np.einsum("pai,gij->gpaj", parts, self._speed)
            information = information + np.einsum("gpaj,qaj->gpq", seen, parts)
            score = score - np.einsum("gpaj,aj->gp", seen, slopes.contradiction)
        return information * unit[:, None] * unit, score * unit


def _independent(windows: Windows) -> list[np.ndarray]:
    """Windows of each cluster: stretches of time, of many logs each one."""
    number = np.arange(len(windows.run))
    runs, begin = np.unique(windows.run, return_index=True)
    if len(runs) >= MANY_RUNS:
        return np.split(number, begin[1:])
    return np.array_split(number, min(CLUSTERS, len(number)))


def _gram(left: np.ndarray, right: np.ndarray) -> np.ndarray:
    """Products of columns within each window, (W, ..., p) and (W, ..., q) to (W, p, q)."""
    tall, other = (part.reshape(len(part), -1, part.shape[-1]) for part in (left, right))
    return tall.transpose(0, 2, 1) @ other


def _by_group(values: np.ndarray, groups: list[np.ndarray]) -> np.ndarray:
    return np.array([values[group].sum(axis=0) for group in groups])


def _project(columns: np.ndarray, nuisance: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Take the heading at the start of each window out of columns (W, K, 3, m)."""
    weighted = weight * nuisance
    size = np.einsum("wka,wka->w", weighted, nuisance)
    share = np.einsum("wka,wkam->wm", weighted, columns) / size[:, None]
    return columns - nuisance[..., None] * share[:, None, None, :]


# A direction whose standard error under white noise exceeds this share of the plausible is blind.
BLIND = 0.2
# Part of a blind direction in a combination from which on the combination rests on the platform.
TOUCHED = 0.05
ITERATIONS, SETTLED = 30, 1e-6
FIXED = 3  # steps after which the split into seen and blind directions stays as it is
# Of a pose that moves more than this within windows, m and rad, wheels must explain half.
MOVES, EXPLAINED = (0.02, 0.05), 0.5
LARGEST = 0.3  # relative errors beyond this are no calibration but a wrong table or column
SIGNIFICANT = 0.05


@dataclass(frozen=True)
class Surplus:
    """What a Jacobian with free entries would explain beyond the fitted values.

    Attributes:
        rank: how many further combinations of its entries the log could have shown.
        ratio: F statistic of all of them; p_value: its p value; None where rank is 0.
        size: largest entry they amount to, relative to 1 / R.
    """

    rank: int
    ratio: float | None
    p_value: float | None
    size: float

    @property
    def widening(self) -> float:
        """Factor on all intervals: Birge's ratio where the further combinations contradict.

        Deviations that repeat from stretch to stretch (rollers at the same phase, slip under the
        same load) are not seen by the scatter between stretches, but they show up here.
        """
        if self.p_value is None or self.p_value > SIGNIFICANT:
            return 1.0
        return max(float(np.sqrt(self.ratio)), 1.0)


@dataclass(frozen=True)
class Fit:
    """Values of the p unknowns, kinematics first, then the mount of the pose sensor.

    Attributes:
        names: (p) names; values: (p,) relative errors, rad, m and s.
        covariance: (p, p) from leaving out one cluster at a time.
        information: (G, p, p) of each cluster along the determined directions.
        blind: (p, k) orthonormal directions, in scaled units, kept at the nominal values.
        scale: (p,) scale in which they are meant.
        noise: rms of what is left: position m, yaw rad, contradiction of the wheels rad/s.
        rolling: kinematics at the estimate.
        surplus: test of the values against a free Jacobian.
    """

    names: tuple[str, ...]
    values: np.ndarray
    covariance: np.ndarray
    information: np.ndarray
    blind: np.ndarray
    scale: np.ndarray
    noise: tuple[float, float, float]
    rolling: Rolling
    surplus: Surplus

    @property
    def mount(self) -> np.ndarray:
        """offset_x, offset_y m, offset_yaw rad, delay s."""
        return self.values[-len(MOUNT) :]

    def determines(self, weights: np.ndarray) -> bool:
        """Tell whether ``weights @ values`` is free of blind directions."""
        scaled = np.asarray(weights, float) * self.scale
        touched = np.linalg.norm(self.blind.T @ scaled) / np.linalg.norm(scaled)
        return bool(touched < TOUCHED)

    def uncertainty(self, weights: np.ndarray) -> tuple[float, float]:
        """Standard error of ``weights @ values`` and half width of its 95 % interval.

        The quantile has as many degrees of freedom as there are clusters that speak for the
        combination, less one.
        """
        weights = np.asarray(weights, float)
        error = float(np.sqrt(weights @ self.covariance @ weights)) * self.surplus.widening
        scaled = self.information * self.scale[:, None] * self.scale
        at = np.linalg.pinv(scaled.sum(axis=0), hermitian=True) @ (weights * self.scale)
        spoken = np.einsum("p,gpq,q->g", at, scaled, at)
        effective = spoken.sum() ** 2 / max(np.sum(spoken**2), 1e-300)
        return error, float(student_quantile(0.975, max(effective - 1.0, 1.0))) * error


def fit(windows: Windows, platform: Platform) -> Fit:
    """Fit kinematics, mount and delay by Gauss-Newton steps.

    Raises:
        ValueError: the steps do not settle, or lead to values that no calibration can mean.
    """
    names = (*parameter_names(platform), *MOUNT)
    count = len(names) - len(MOUNT)
    scale = np.array([PLAUSIBLE] * count + list(PLAUSIBLE_MOUNT))
    nominal = np.zeros(len(names))
    nominal[count + 2] = _first_turn(windows, rolling(platform, nominal[:count]).odometry)
    values = nominal.copy()
    for step in range(ITERATIONS):
        normal = Normal(windows, platform, values)
        information, score = normal.sums(scale)
        total, gap = information.sum(axis=0), (values - nominal) / scale
        if step < FIXED:
            seen, blind = _split(total)
        reduced = seen.T @ total @ seen
        wanted = seen @ np.linalg.solve(reduced, seen.T @ (score.sum(axis=0) + total @ gap))
        values = nominal + scale * wanted
        _check(names, values, count)
        if step >= FIXED and np.abs(wanted - gap).max() < SETTLED:
            break
    else:
        raise ValueError(
            f"the kinematic calibration did not settle in {ITERATIONS} steps; check that pose and "
            "wheels belong together (units, signs, clocks)"
        )
    _check_explained(windows, normal.noise)
    inside = seen.T @ information @ seen
    shifts = scale * (leave_one_out(inside, score @ seen) @ seen.T)
    return Fit(
        names,
        values,
        shifts.T @ shifts,
        (seen @ inside @ seen.T) / scale[:, None] / scale,
        blind,
        scale,
        normal.noise,
        normal.rolling,
        _surplus(normal, scale, seen),
    )


def leave_one_out(information: np.ndarray, score: np.ndarray) -> np.ndarray:
    """(G, r) shifts of an estimate when one cluster is left out, sized for a covariance.

    Args:
        information: (G, r, r) of each cluster.
        score: (G, r) at the estimate.

    Returns:
        Rows whose products sum to the covariance of the estimate.
    """
    total, groups = information.sum(axis=0), len(score)
    shifts = [
        np.linalg.pinv(total - own, hermitian=True) @ pull
        for own, pull in zip(information, score, strict=True)
    ]
    return np.array(shifts) * np.sqrt((groups - 1) / groups)


def _split(information: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Directions that the log determines and those it does not, both orthonormal."""
    strength, directions = np.linalg.eigh(information)
    seen = strength > 1.0 / BLIND**2
    if not seen.any():
        raise ValueError(
            "this log determines no kinematic value at all; record a motion on all axes, of some "
            "centimetres at least"
        )
    return directions[:, seen], directions[:, ~seen]


def _surplus(normal: Normal, scale: np.ndarray, seen: np.ndarray) -> Surplus:
    """Wald test of the fitted values against a Jacobian with free entries, by clusters."""
    information, score = normal.sums(scale, free=True)
    total, size = information.sum(axis=0), len(scale)
    known = np.linalg.solve(seen.T @ total[:size, :size] @ seen, seen.T @ total[:size, size:])
    # Entries of J less what the values make of them.
    apart = np.concatenate([-seen @ known, np.eye(len(total) - size)])
    strength, directions = np.linalg.eigh(apart.T @ total @ apart)
    # Entries that the values cover anyway come out as rounding, far below a billionth.
    keep = (strength > 1.0 / BLIND**2) & (strength > 1e-9 * np.trace(total[size:, size:]))
    rank, groups = int(keep.sum()), len(score)
    if rank == 0 or groups <= rank + 1:
        return Surplus(0, None, None, 0.0)
    apart = apart @ directions[:, keep]
    entries = (score @ apart).sum(axis=0) / strength[keep]
    inside = apart.T @ information @ apart
    shifts = leave_one_out(inside, score @ apart - inside @ entries)
    # Hotelling's law, with as many clusters as speak for the weakest combination.
    share = np.einsum("gkk->gk", inside) / strength[keep]
    spoken = max(float(np.min(1.0 / np.sum(share**2, axis=0))), rank + 1.0)
    square = entries @ np.linalg.solve(shifts.T @ shifts, entries)
    ratio = float(square * (spoken - rank) / (rank * (spoken - 1.0)))
    p_value = float(fisher_above(ratio, rank, spoken - rank))
    largest = np.abs(directions[:, keep] @ entries).max() * PLAUSIBLE
    return Surplus(rank, ratio, p_value, float(largest))


def _first_turn(windows: Windows, odometry: np.ndarray) -> float:
    """Yaw offset to start from: where the ways point on average; zero where they say little."""
    residual, _, _ = windows.residual(odometry, np.zeros(len(MOUNT)), slopes=False)
    step, speed = np.diff(windows.time, axis=1), windows.speed(0.0)
    way = integrate(step, speed, odometry, slopes=False).place
    way = (way - way.mean(axis=1, keepdims=True)) @ [1.0, 1.0j]
    seen = residual[..., :2] @ [1.0, 1.0j] + way
    product = np.vdot(seen, way)
    clear = abs(product) > 0.5 * np.linalg.norm(way) * np.linalg.norm(seen)
    return float(np.angle(product)) if clear else 0.0


def _check(names: tuple[str, ...], values: np.ndarray, count: int) -> None:
    for name, value in zip(names[:count], values[:count], strict=True):
        if not abs(value) < LARGEST:
            raise ValueError(
                f"kinematic calibration: {name} would be wrong by {value:+.2g}, beyond {LARGEST}; "
                "check the platform's table and the signs, units and order of the columns"
            )
    if not abs(values[-1]) < LONGEST_DELAY:
        raise ValueError(
            f"kinematic calibration: the pose would be {values[-1]:.3g} s late, beyond "
            f"{LONGEST_DELAY} s; align the clocks of pose and wheels first"
        )


def _check_explained(windows: Windows, noise: tuple[float, float, float]) -> None:
    spread = np.sqrt(np.mean(windows.pose.var(axis=1), axis=0))
    parts = (
        ("position", "m", float(np.sqrt(np.mean(spread[:2] ** 2))), noise[0], MOVES[0]),
        ("yaw", "rad", float(spread[2]), noise[1], MOVES[1]),
    )
    for name, unit, moves, left, least in parts:
        if moves > least and left > EXPLAINED * moves:
            raise ValueError(
                f"kinematic calibration: the {name} of the pose moves by {moves:.3g} {unit} within "
                f"windows, of which {left:.3g} {unit} contradict the wheels; check units, signs "
                "and clock of the pose"
            )
