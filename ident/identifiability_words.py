"""Words for what a motion or a log cannot see."""

from __future__ import annotations

import numpy as np

from ident.recursive import sample_times
from ident.regression import Regression
from youbot_env import dynamics
from youbot_env.model import Model
from youbot_env.parameters import UNITS

# What a person calls the columns of theta.
SHORT = {
    "m0": "mass",
    "I0": "moment of inertia",
    "I1": "spin inertia of the wheels",
    "max": "forward offset of the centre of mass",
    "may": "lateral offset of the centre of mass",
    "mu1": "friction of the wheels",
    "mu2": "friction of the rollers",
}
# Share of the energy of a motion below which a part of it is left unmentioned.
NEGLIGIBLE = 0.01
# Rms speed of the wheels' level, m/s, below which a robot counts as standing.
STILL = 2e-3
# Entry of a direction, of its largest, from which a parameter is named.
TAKES_PART = 0.3


def null_words(
    null: np.ndarray, labels: tuple[str, ...], names: tuple[str, ...], where: str
) -> list[str]:
    """Say each direction (k, P) that leaves no trace.

    Args:
        null: directions in the coordinates of ``labels``.
        labels: (P,) ``x1`` .. and names of effects' parameters.
        names: (P,) the same as theta and effects.
        where: what does not show it, with the motion it holds.
    """
    words = []
    for row in null:
        at = np.flatnonzero(row)
        if len(at) == 1:
            words.append(f"{labels[at[0]]} ({_short(names[at[0]])}) leaves no trace in {where}")
            continue
        combination = " ".join(_term(row[k], labels[k], k == at[0]) for k in at)
        members = _listed([_short(names[k]) for k in at])
        words.append(f"{combination}: {members} cannot be told apart in {where}")
    return words


def weak_words(
    weak: np.ndarray, sizes: np.ndarray, shares: np.ndarray, names: tuple[str, ...], model: Model
) -> list[str]:
    """Say each direction (k, P) that leaves a faint trace.

    Args:
        weak: directions in sizes of the parameters.
        sizes: (P,) those sizes, SI.
        shares: (k,) by what part of its rms such a change moves the drive's force.
        names: (P,) theta and effects.
        model: units, and the mass that turns first moments into offsets.
    """
    words = []
    for row, share in zip(weak, shares, strict=True):
        row = row / row[np.argmax(np.abs(row))]
        at = [k for k in np.argsort(-np.abs(row)) if abs(row[k]) > TAKES_PART]
        members = _listed([f"{_short(names[k])} by {_amount(row[k] * sizes[k], names[k], model)}"
                           for k in at])  # fmt: skip
        words.append(
            f"{members}: such a change moves the drive's force by {100 * share:.1f} % of its rms, "
            "less than a log leaves unexplained"
        )
    return words


def describe_motion(regression: Regression, model: Model) -> str:
    """Say in a few words how the robot moves, from the columns of its regression.

    The column of the wheels' friction holds the twist, that of the mass the acceleration of the
    centre, that of the wheels' inertia the rate of the twist.
    """
    lever, weights = model.platform.lever, sample_times(regression)
    rows = regression.H / np.array([lever, lever, 1.0])[:, None]
    metric = dynamics.factorize(model.platform.geometry.wheel_metric)
    mass, inertia, friction = (rows[:, :, regression.names.index(n)] for n in ("m0", "I1", "mu1"))
    vx, vy, om = dynamics.solve(metric, tuple(friction.T))
    rate = dynamics.solve(metric, tuple(inertia.T))

    def energy(*components) -> float:
        return float(sum(np.sum(weights * c * c) for c in components))

    total = energy(vx, vy, lever * om)
    if total <= STILL**2 * weights.sum():
        return "hardly moving"
    if energy(lever * om) < NEGLIGIBLE * total:
        return "translation without turning"
    if energy(vx, vy) < NEGLIGIBLE * total:
        return "turning on the spot"
    py, px = (float(np.sum(weights * v * om)) / energy(om) for v in (vx, -vy))
    if energy(vx - py * om, vy + px * om) < NEGLIGIBLE * total:
        return f"turning about {_place(px, py)}"
    if energy(*mass.T) < NEGLIGIBLE * energy(*rate[:2]):
        return "turning while the centre keeps its velocity"
    return "translation and turning"


def _place(x: float, y: float) -> str:
    """A point of the body in words: a side, or coordinates where it lies askew."""
    if abs(x) < NEGLIGIBLE * 10 * abs(y):
        return f"a point {abs(y):.2f} m to the {'left' if y > 0 else 'right'}"
    if abs(y) < NEGLIGIBLE * 10 * abs(x):
        return f"a point {abs(x):.2f} m to the {'front' if x > 0 else 'rear'}"
    return f"the point ({x:.2f}, {y:.2f}) m of the body"


def _short(name: str) -> str:
    return SHORT.get(name, name)


def _amount(value: float, name: str, model: Model) -> str:
    """A change of a parameter with its unit; first moments as centimetres of offset."""
    if name in ("max", "may"):
        body = model.parameters.m0 - len(model.platform.wheels) * model.platform.wheel_mass
        return f"{100 * value / body:+.2g} cm"
    if name in UNITS:
        return f"{value:+.2g} {UNITS[name]}"
    identifier, flat = name.split(".")
    active = next(a for a in model.effects if a.identifier == identifier)
    return f"{value:+.2g} {active.effect.parameter_of(flat).unit}".strip()


def _term(factor: float, label: str, first: bool) -> str:
    sign = "-" if factor < 0 else "+"
    size = "" if abs(abs(factor) - 1) < 0.05 else f"{abs(factor):.2g} "
    return f"{size}{label}" if first else f"{sign} {size}{label}"


def _listed(items: list[str]) -> str:
    return items[0] if len(items) == 1 else ", ".join(items[:-1]) + " and " + items[-1]
