"""Whether logs to judge by are of a robot that weighs, rolls or pulls like the fitted one.

Another payload, floor or battery makes a right model look wrong, and a search for effects would
mend it with one that the robot does not have.  One number of the robot that differs is told by what
it explains: the equations are solved on the fitted logs, and of what they leave on another log one
change must explain most.  A motion that shows other shares of an effect that is missing also leaves
an error, but of a shape that no such change has.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace

import numpy as np
from scipy.special import stdtrit

from ident.doctor.finding import Finding
from ident.log import Log
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
# A clock that was found with the fitted logs' may stand for a part of a change.  Where the other
# log's own fit removes less than this share of the squared error even so, it cannot stand for half.
TRACE = 0.25
# Changes that explain up to this share less than the best are told as well.
ALIKE = 0.1
# Shares of the fitted value below which a difference is none: intervals of single logs are as wide.
LEAST = 0.1
# Another robot is another from the first row on: in each of so many parts of the log the change
# must reach this share of its mean, within two standard errors, or it is something that happened.
PARTS, LASTS = 3, 0.5
# Independent stretches of time, s, and how many are needed.
STRETCH, FEWEST = 2.0, 6


def disagreements(logs: Sequence[Log], tests: Sequence[Log], model: Model) -> dict[str, Finding]:
    """Logs to judge by that disagree with the fitted ones, by name, with what differs.

    What a right model leaves on a log of another load, floor or battery is the difference, which no
    effect should stand for and no effect be refused for.

    Args:
        logs: records that are fitted; they state what was found of their recording, as a clock that
            is late is no load.
        tests: records to judge by, of the same platform, likewise; their recording was found
            without the fitted ones, or a load would be put down to a clock.  Where short ones were
            joined, all of them are named if together they disagree, else those that do alone.
        model: any model of the platform; effects of the robot in it act in all logs.
    """
    found: dict[str, Finding] = {}
    for log, mine, known in _judged(logs, tests, model):
        names = log.run_names
        whole = _difference(log, mine, known)
        if whole is not None:
            found |= dict.fromkeys(names, whole)
        elif len(names) > 1:
            run = log.run_of(mine.time)
            alone = (_difference(log, _rows(mine, run == k), known) for k in range(len(names)))
            found |= {name: one for name, one in zip(names, alone, strict=True) if one is not None}
    return found


def may_disagree(logs: Sequence[Log], tests: Sequence[Log], model: Model) -> bool:
    """Whether logs might disagree once their clocks were found without each other.

    Arguments as of ``disagreements``, but for clocks that were found together, which cost half.
    """
    for log, mine, known in _judged(logs, tests, model):
        run, count = log.run_of(mine.time), len(log.run_names)
        each = [run == k for k in range(count)] if count > 1 else []
        for rows in (np.ones(len(run), bool), *each):
            one = _rows(mine, rows)
            if (
                np.ptp(one.time) > STRETCH * (FEWEST - 1)
                and _misfit(one.residual(known), one) > TRACE
            ):
                return True
    return False


def with_disagreements(tests: Sequence[Log], found: Mapping[str, Finding]) -> list[Log]:
    """Logs with what ``disagreements`` found of them; a joined one with that of its runs."""
    told = []
    for log in tests:
        names = log.run_names
        there = [name for name in names if name in found]
        alike = len(there) == len(names) and len({found[name] for name in there}) == 1
        named = [found[names[0]]] if alike else [
            replace(found[name], where=f"{name}, {found[name].where}") for name in there
        ]  # fmt: skip
        told.append(replace(log, findings=(*log.findings, *named)) if named else log)
    return told


def may_judge(log: Log, found: Mapping[str, Finding]) -> bool:
    """Whether a log, or a run of it, agrees with the fitted ones."""
    return not all(name in found for name in log.run_names)


def not_used(found: Mapping[str, Finding]) -> str:
    """Why logs did not judge, in words to put behind a sentence; empty where all did."""
    names: dict[str, list[str]] = {}
    for name, finding in found.items():
        names.setdefault(finding.what, []).append(name)
    return "".join(
        f"; {', '.join(who)} {'was' if len(who) == 1 else 'were'} not used to judge: {what}"
        for what, who in names.items()
    )


def _judged(
    logs: Sequence[Log], tests: Sequence[Log], model: Model
) -> Iterator[tuple[Log, Regression, np.ndarray]]:
    """Every log to judge by that has rows, its equations, and the fitted values (P,)."""
    if any(log.wheel_torque is None and log.wheel_voltage is None for log in (*logs, *tests)):
        return
    if any(log.window is not None for log in logs):  # forces alone do not tell a load from a floor
        return
    robots = {a.identifier: a.values for a in model.effects if a.effect.scope() == "robot"}
    start = replace(model, platform=logs[0].platform, effects=(), covariance=None)
    start = start.with_effects(dict.fromkeys(FRICTION) | robots)
    try:
        known = _solved(Regression.join([build_regression(log, start) for log in logs]))
    except ValueError:
        return
    for log in tests:
        try:
            mine = build_regression(log, start)
        except ValueError:
            continue
        if len(mine.time):
            yield log, mine, known


def _misfit(left: np.ndarray, mine: Regression) -> float:
    """Share of the squared error (N, 3) that a fit to these rows alone removes."""
    own = float(np.sum(mine.residual(_solved(mine)) ** 2))
    return 1.0 - own / max(float(np.sum(left**2)), 1e-300)


def _rows(regression: Regression, rows: np.ndarray) -> Regression:
    """Some rows (N,) of a regression."""
    kept = {name: getattr(regression, name)[rows] for name in ("H", "y", "time", "piece")}
    return replace(regression, **kept)


def _difference(log: Log, mine: Regression, known: np.ndarray) -> Finding | None:
    """What of the robot differs in these rows of a log from the fitted values (P,), if one does."""
    if not len(mine.time):
        return None
    left = mine.residual(known)
    group = np.unique((mine.time - mine.time[0]) // STRETCH, return_inverse=True)[1]
    count = int(group[-1]) + 1
    better = _misfit(left, mine)
    if count < FEWEST or better < BETTER:
        return None
    whole = float(np.sum(left**2))
    found = []
    for kind, name, cause in KINDS:
        # A drive that pulls otherwise changes all that it is the sum of by one share.
        # Wheels that have a value each change alike.
        at = [k for k, one in enumerate(mine.names) if one == name or one.startswith(f"{name}_")]
        column = mine.H[..., at].sum(axis=-1) if name else mine.H @ known
        value = float(np.mean(known[at])) if name else 1.0
        if not np.any(column):
            continue
        change, se = _change(column, left, group)
        gain = (whole - float(np.sum((left - change * column) ** 2))) / (better * whole)
        half = float(stdtrit(count - 1, 0.975)) * se
        large = abs(change) > max(half, LEAST * abs(value))
        if gain > MOST and large and _lasts(column, left, change, group):
            found.append((gain, kind, name, cause, value, change, half))
    if not found:
        return None
    found.sort(reverse=True)
    alike = [_words(one, log) for one in found if one[0] > found[0][0] - ALIKE]
    return Finding(
        "warning",
        f"the robot is not the one of the fitted log: {'; or '.join(alike)} would explain "
        f"{100 * found[0][0]:.0f} % of what the fitted values miss here and a fit to this log does "
        "not",
        "against the fitted logs",
        "judge by a log of the same load, floor and battery, or fit each log by itself",
        NAME,
    )


def _lasts(column: np.ndarray, left: np.ndarray, change: float, group: np.ndarray) -> bool:
    """Tell whether a change is there throughout; rows (N, 3), stretch (N,) of each."""
    for part in np.array_split(np.arange(group[-1] + 1), PARTS):
        rows = np.isin(group, part)
        if not np.any(column[rows]):
            continue
        own, se = _change(column[rows], left[rows], group[rows])
        if np.sign(change) * own + 2.0 * se < LASTS * abs(change):
            return False
    return True


def _change(column: np.ndarray, left: np.ndarray, group: np.ndarray) -> tuple[float, float]:
    """How much of a column (N, 3) is in what is left, and its error by the scatter of stretches."""
    strength = float(np.sum(column**2))
    change = float(np.sum(column * left)) / strength
    scores = np.bincount(group, np.sum(column * (left - change * column), axis=1))
    return change, float(np.linalg.norm(scores)) / strength


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
