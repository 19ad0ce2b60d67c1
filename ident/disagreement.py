"""Whether logs to judge by are of a robot that weighs, rolls or pulls like the fitted one.

Another payload, floor or battery makes a right model look wrong, and a search for effects would
mend it with one that the robot does not have.  One number of the robot that differs is told by what
it explains: the equations are solved on the fitted logs, and of what they leave on another log one
change must explain most.  A motion that shows other shares of an effect that is missing also leaves
an error, but of a shape that no such change has.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from scipy.special import stdtrit

from ident.doctor.finding import Finding
from ident.log import Log
from ident.pooling import pooled
from ident.regression import Regression, build_regression
from youbot_env.model import Model
from youbot_env.parameters import UNITS

NAME = "differs"
# Laws of dry friction beside the seven parameters: without them they would bend the others.
FRICTION = ("wheel_coulomb_friction", "roller_coulomb_friction", "body_dry_friction")
# What may differ: a name, the parameter, and what would make it so.
KINDS = (
    ("mass", "m0", "another payload"),
    ("viscous friction of the wheels", "mu1", "warmer gears, or another floor"),
    ("dry friction of the wheels", "wheel_coulomb_friction.fc", "another floor, or wear"),
    ("pull of the drive", "", "another battery, torque constant or gear"),
)
# A fit to the other log alone must leave at most this share of the squared error, and one change
# remove at least that share of what such a fit removes.
BETTER, MOST = 0.5, 0.7
# Changes that explain up to this share less than the best are told as well.
ALIKE = 0.1
# Shares of the fitted value below which a difference is none: intervals of single logs are as wide.
LEAST = 0.1
# Independent stretches of time, s, and how many are needed.
STRETCH, FEWEST = 2.0, 6


def with_disagreement(logs: Sequence[Log], tests: Sequence[Log], model: Model) -> list[Log]:
    """Logs to judge by, each with a finding where it disagrees with the fitted logs.

    Args:
        logs: records that are fitted.
        tests: records to judge by, of the same platform.
        model: any model of the platform; effects of the robot in it act in both.
    """
    if any(log.wheel_torque is None and log.wheel_voltage is None for log in (*logs, *tests)):
        return list(tests)
    robots = {a.identifier: a.values for a in model.effects if a.effect.scope() == "robot"}
    start = replace(model, platform=logs[0].platform, effects=(), covariance=None)
    start = start.with_effects(dict.fromkeys(FRICTION) | robots)
    try:
        fitted = Regression.join([build_regression(log, start) for log in pooled(logs)])
    except ValueError:
        return list(tests)
    known = _solved(fitted)
    return [_told(log, fitted, known, start) for log in tests]


def of_the_same_robot(
    logs: Sequence[Log], tests: Sequence[Log], model: Model
) -> tuple[list[Log], str]:
    """Logs that may judge, and of the others, in words, why they may not.

    What a right model leaves on a log of another load, floor or battery is the difference, which no
    effect should stand for and no effect be refused for.

    Args:
        logs: records that are fitted, their instruments undone: a clock that is late is no load.
        tests: records to judge by, likewise.
        model: any model of the platform.
    """
    tests = [replace(t, findings=tuple(f for f in t.findings if f.name != NAME)) for t in tests]
    tests = with_disagreement(logs, tests, model)
    apart = {log.name: f.what for log in tests for f in log.findings if f.name == NAME}
    said = "".join(f"; {name} was not used to judge: {what}" for name, what in apart.items())
    return [log for log in tests if log.name not in apart], said


def _told(log: Log, fitted: Regression, known: np.ndarray, model: Model) -> Log:
    """The log with a finding, if one number of the robot differs from the fitted one."""
    try:
        mine = build_regression(log, model)
    except ValueError:
        return log
    left = mine.residual(known)
    group = np.unique((mine.time - mine.time[0]) // STRETCH, return_inverse=True)[1]
    count = int(group[-1]) + 1
    whole, own = float(np.sum(left**2)), float(np.sum(mine.residual(_solved(mine)) ** 2))
    if count < FEWEST or own > BETTER * whole:
        return log
    found = []
    for kind, name, cause in KINDS:
        # A drive that pulls otherwise changes all that it is the sum of by one share.
        at = mine.names.index(name) if name else None
        column = mine.H @ known if at is None else mine.H[..., at]
        value = 1.0 if at is None else float(known[at])
        strength = float(np.sum(column**2))
        if strength == 0.0:
            continue
        change = float(np.sum(column * left)) / strength
        error = left - change * column
        gain = (whole - float(np.sum(error**2))) / (whole - own)
        scores = np.bincount(group, np.sum(column * error, axis=1))
        se = float(np.linalg.norm(scores)) / strength
        half = float(stdtrit(count - 1, 0.975)) * se
        if gain > MOST and abs(change) > max(half, LEAST * abs(value)):
            found.append((gain, kind, name, cause, value, change, half))
    if not found:
        return log
    found.sort(reverse=True)
    alike = [_words(one, log) for one in found if one[0] > found[0][0] - ALIKE]
    finding = Finding(
        "warning",
        f"the robot is not the one of the fitted log: {'; or '.join(alike)} would explain "
        f"{100 * found[0][0]:.0f} % of what the fitted values miss here and a fit to this log does "
        "not",
        "against the fitted logs",
        "judge by a log of the same load, floor and battery, or fit each log by itself",
        NAME,
    )
    return replace(log, findings=(*log.findings, finding))


def _words(one: tuple, log: Log) -> str:
    """One number that differs, by how much, and what would make it so."""
    _, kind, name, cause, value, change, half = one
    share = f"{100 * change / value:+.0f} %" if value else ""
    if not name:
        return f"a {kind} of {share} +- {100 * half:.0f} % ({cause})"
    if log.drive == "voltage":
        # Units are those of volts: only shares of the fitted value mean something.
        return f"a {kind} of {share} +- {100 * half / abs(value):.0f} % ({cause})"
    unit = UNITS.get(name, "N m")
    return f"a {kind} of {change:+.3g} {unit} +- {half:.2g} {unit}, {share} ({cause})"


def _solved(regression: Regression) -> np.ndarray:
    """(P,) least squares, with directions that leave no trace at zero."""
    columns, y = regression.rows
    scale = np.linalg.norm(columns, axis=0)
    scale = np.where(scale > 0, scale, 1.0)
    return np.linalg.lstsq(columns / scale, y, rcond=1e-6)[0] / scale
