"""What an estimate means for the robot: decoded values, lumps, doubts, and what stays invisible."""

from __future__ import annotations

from typing import Any

import numpy as np

from ident.log import Log
from youbot_env.dynamics import Theta
from youbot_env.model import Model
from youbot_env.parameters import Parameters, x_scale

LUMPS = {"x1+x3": ("m0", "I1"), "x2+x3": ("I0", "I1"), "x6": ("mu1",), "x7": ("mu2",)}
# Corners of the body are farther from O than the wheels: 0.347 m against 0.279 m on the youBot.
OVERHANG = 1.25
LUMP_UNITS = {"x1+x3": "kg m^2", "x2+x3": "kg m^2", "x6": "N m s", "x7": "N m s"}


def lump_weights(model: Model) -> dict[str, tuple[np.ndarray, str]]:
    """Weights over ``model.names()`` of the combinations that all motions determine well."""
    scale = x_scale(model.platform)._asdict()
    names = model.names()
    weights = {}
    for lump, members in LUMPS.items():
        row = np.zeros(len(names))
        for member in members:
            row[names.index(member)] = scale[member]
        weights[lump] = (row, LUMP_UNITS[lump])
    return weights


def decode(model: Model) -> dict[str, tuple[float, np.ndarray]]:
    """Physical parameters and their gradients with respect to ``model.values()``.

    Only the centre of mass is not theta itself: a = (first moment) / (m0 - wheels).
    """
    values = np.array(model.values())
    theta = Theta(*values[:7])
    body = theta.m0 - len(model.platform.wheels) * model.platform.wheel_mass
    decoded = {}
    for name, value in Parameters.from_theta(theta, model.platform).as_dict().items():
        gradient = np.zeros(len(values))
        if name in ("a_x", "a_y"):
            moment = 3 if name == "a_x" else 4
            gradient[moment] = 1.0 / body
            gradient[0] = -values[moment] / body**2
        else:
            gradient[theta._fields.index(name)] = 1.0
        decoded[name] = (float(value), gradient)
    return decoded


def doubts(model: Model, quantities: dict[str, Any]) -> list[str]:
    """Say what is physically odd about identified values, with what usually causes it."""
    parameters, platform = model.parameters, model.platform
    found = []
    for problem in parameters.problems(platform):
        found.append(f"impossible: {problem}; {_usual_cause(problem)}")
    # All mass at the corners of the body gives the largest inertia its footprint allows.
    footprint = parameters.m0 * (OVERHANG * platform.reach) ** 2
    if footprint < parameters.I0 and quantities["I0"].ci95 is not None:
        found.append(
            f"I0 = {parameters.I0:.3g} kg m^2 is more than {footprint:.3g} kg m^2, all mass at the "
            "corners of the body; it has absorbed an unmodelled yaw effect (scrub, gain, delay, L "
            "too large)"
        )
    for name, quantity in quantities.items():
        if quantity.ci95 is not None and name in ("m0", "I0", "I1", "mu1", "mu2"):
            low, high = quantity.ci95
            if low <= 0 < quantity.value:
                found.append(f"{name} may be zero: its 95 % interval is [{low:.3g}, {high:.3g}]")
    return found


def invisible(logs: list[Log]) -> list[str]:
    """Say what the fit cannot notice being wrong, for logs of this kind."""
    words = []
    if any(log.drive == "voltage" for log in logs):
        words.append(
            "the drive is measured by voltage: masses, inertias and frictions are known only up to "
            "one common factor (torque per volt), and mu1 includes the back-EMF of the motors"
        )
    else:
        words.append(
            "a common error of the torque constant scales all seven parameters alike and leaves "
            "the fit as good as it is"
        )
    if all(log.body_velocity is None for log in logs):
        words += [
            "a common error of the wheel radius R scales masses by 1/R^2 and is not seen by wheels",
            "an error of L = l + h scales yaw rate and yaw inertia and is not seen by wheels",
        ]
    return words


def _usual_cause(problem: str) -> str:
    causes = {
        "I1": "it trades with mass when accelerations are weak, or the torque is delayed",
        "I0": "yaw inertia trades with I1 when the robot turns slowly; record faster turns",
        "mu": "friction that does not grow with speed (dry friction) is missing from the model",
        "m0": "accelerations are too small against friction; record faster reversals",
        "centre": "floor slope, torque offset or unequal torque constants look like it",
    }
    found = (cause for key, cause in causes.items() if problem.startswith(key))
    return next(found, "check the log")
