"""A kinematic calibration in words and tables."""

from __future__ import annotations

import numpy as np

from ident.kinematics.fit import Fit
from ident.kinematics.ripple import Ripple
from ident.kinematics.wheels import mean_odometry
from ident.kinematics.windows import MOUNT
from ident.log import Log
from ident.results import Quantity
from youbot_env.platform import Platform

AXES = ("forward", "sideways", "in yaw")
# Rms of an axis, of the strongest (yaw at the wheels' lever), below which it counts as still.
STILL = 0.05
WHOLE, PART = 0.98, 0.25  # how much of a quantity lies in the blind directions
# A pose this close to the wheels, m, may have been computed from them.
TOO_GOOD = 5e-5
# Sideways over forward gain: more has a cause beyond the drawing of the wheels.
SHORT = 0.02


def undetermined_words(fit: Fit, log: Log, platform: Platform) -> tuple[str, ...]:
    """Say the directions that this motion leaves open, and why; empty when there are none."""
    if not fit.blind.shape[1]:
        return ()
    share = {name: _share(fit.blind, block) for name, block in _quantities(platform).items()}
    alone = [name for name, part in share.items() if part > WHOLE]
    mixed = [name for name, part in share.items() if PART < part <= WHOLE]
    words = [f"not seen: {', '.join(alone)}"] if alone else []
    if mixed:
        words.append(f"not told apart: {', '.join(mixed)}")
    if not words:
        words.append("a combination of small shares of all values")
    still = _still_axes(log, platform)
    if still:
        words.append(f"the robot hardly moves {' or '.join(still)}; record a motion that does")
    return (*words, "these values stay as the platform has them, without an interval")


def _quantities(platform: Platform) -> dict[str, np.ndarray]:
    """Directions (p, k) of what a person calls one thing, orthonormal in scaled units."""
    count = len(platform.wheels)
    size = count + 2 + len(MOUNT)
    units, common = np.eye(size), np.ones((count, 1)) / np.sqrt(count)
    differences = np.linalg.svd(np.eye(count) - common @ common.T)[0][:, : count - 1]
    offsets = ("x offset of the sensor", "y offset of the sensor", "yaw offset of the sensor")
    single = ("base geometry", "roller angle", *offsets, "delay")
    return {
        "common wheel radius": units[:, :count] @ common,
        "differences between wheel radii": units[:, :count] @ differences,
    } | {name: units[:, [count + k]] for k, name in enumerate(single)}


def _share(blind: np.ndarray, block: np.ndarray) -> float:
    """Largest part of a unit vector of the block that lies in the blind directions."""
    return float(np.linalg.norm(block.T @ blind, 2))


def _still_axes(log: Log, platform: Platform) -> list[str]:
    v = log.wheel_velocity @ np.linalg.pinv(platform.jacobian_array).T
    rms = np.sqrt(np.mean(v**2, axis=0)) * [1.0, 1.0, platform.lever]
    return [axis for axis, size in zip(AXES, rms, strict=True) if size < STILL * rms.max()]


def remarks(
    fit: Fit, platform: Platform, ripple: Ripple | None, gains: np.ndarray, finite: bool
) -> tuple[str, ...]:
    """What a reader of the numbers must know.

    Args:
        fit: the estimate.
        platform: the nominal platform.
        ripple: what the wheels say about finite rollers.
        gains: (3,) motion over nominal odometry.
        finite: whether the ripple was taken out of the wheel speeds.
    """
    words = []
    if ripple is not None and ripple.seen:
        words.append(_roller_words(ripple, platform, gains, finite))
    elif abs(gains[1] / gains[0] - 1.0) > SHORT:
        words.append(
            f"sideways the robot comes {gains[1] / gains[0]:.3f} times as far as forward, by its "
            "wheels: slip on this floor or under this load, and the rollers' own give, do that "
            "more often than a wrong roller angle, which the table holds in their place"
        )
    surplus = fit.surplus
    if surplus.widening > 1.0:
        words.append(
            "radii, base and roller angle do not explain everything "
            f"(p = {surplus.p_value:.1g}, up to {surplus.size:.2%} of 1/R): wheels slip, or "
            "rollers repeat their phase; all intervals are widened "
            f"{surplus.widening:.1f} times, and differences between radii need not be worn wheels"
        )
    elif surplus.rank == 0:
        words.append(
            "wheels and pose have nothing left over to contradict this table of values; slip would "
            "go unnoticed"
        )
    if fit.noise[0] < TOO_GOOD:
        words.append(
            f"the pose follows the wheels within {1e3 * fit.noise[0]:.2g} mm: if it was computed "
            "from them, this calibration says nothing about the robot"
        )
    return tuple(words)


def _roller_words(ripple: Ripple, platform: Platform, gains: np.ndarray, finite: bool) -> str:
    def shown(values: np.ndarray) -> str:
        pairs = zip(values, AXES, strict=True)
        return ", ".join(f"1/{1 / value:.3f} {axis}" for value, axis in pairs)

    mean, _ = mean_odometry(platform, np.zeros(len(platform.wheels) + 2), ripple.size)
    alone = np.diag(mean @ platform.jacobian_array)
    text = (
        f"the wheels ripple as finite rollers do ({ripple.size:.2f} of the effect roller_ripple). "
        f"On average such rollers alone give gains of {shown(alone)}; measured are {shown(gains)}, "
        f"which leaves {shown(gains / alone)} to slip and geometry. "
    )
    if finite:
        return text + (
            "Radii, base and roller angle are those beyond the rollers: the shorter way sideways "
            "is not a wrong radius. What is left of it, and a radius off by a percent, is slip "
            "under load more often than a wrong drawing"
        )
    return text + (
        "The roller angle error here is this average, not a wrong radius and not badly made wheels"
    )


GAINS = ("forward", "sideways", "yaw")
SOURCE, KEPT = "pose against wheels", "kept from the platform"


def parameter_table(estimate: Fit, platform: Platform) -> dict[str, Quantity]:
    """Radii, base, lever and roller angle; see ``KinematicCalibration.parameters``."""
    count, values = len(platform.wheels), estimate.values
    radius, lever, units = platform.wheel_radius, platform.lever, np.eye(len(values))
    common = units[:count].mean(axis=0)
    rows = {"wheel_radius": (radius * (1 + common @ values), radius * common, "m")}
    for k, name in enumerate(platform.wheel_names):
        rows[f"wheel_radius_{name}"] = (radius * (1 + values[k]), radius * units[k], "m")
    rows["base_error"] = (values[count], units[count], "")
    rows["lever"] = (lever * (1 + values[count]), lever * units[count], "m")
    rows["roller_angle_error"] = (values[count + 1], units[count + 1], "rad")
    return {name: _quantity(estimate, *row) for name, row in rows.items()}


def gain_table(
    estimate: Fit, platform: Platform, odometry: np.ndarray, slope: np.ndarray
) -> dict[str, Quantity]:
    """Motion over what nominal odometry says, by axis, for W and its derivatives by the values."""
    J = platform.jacobian_array
    slopes = slope.reshape(3, len(J), -1)
    gains = {}
    for k, name in enumerate(GAINS):
        weights = np.zeros(len(estimate.values))
        weights[: slopes.shape[2]] = J[:, k] @ slopes[k]
        gains[name] = _quantity(estimate, odometry[k] @ J[:, k], weights, "")
    return gains


def mount_table(estimate: Fit) -> dict[str, Quantity]:
    """Where the pose sensor sits and how late it is."""
    units, size = ("m", "m", "rad", "s"), len(estimate.values)
    rows = np.eye(size)[size - len(MOUNT) :]
    return {
        name: _quantity(estimate, value, row, unit)
        for name, value, row, unit in zip(MOUNT, estimate.mount, rows, units, strict=True)
    }


def _quantity(estimate: Fit, value: float, weights: np.ndarray, unit: str) -> Quantity:
    """A number whose derivatives by the fitted values are ``weights``."""
    if not estimate.determines(weights):
        return Quantity(float(value), unit, None, None, KEPT)
    error, half = estimate.uncertainty(weights)
    return Quantity(float(value), unit, error, (float(value - half), float(value + half)), SOURCE)
