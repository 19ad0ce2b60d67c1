"""The numbers of a kinematic calibration as people name them, with units and intervals."""

from __future__ import annotations

import numpy as np

from ident.kinematics.fit import Fit
from ident.kinematics.windows import MOUNT
from ident.results import Quantity
from youbot_env.platform import Platform

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
