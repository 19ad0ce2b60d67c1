"""Many logs as one record of wheels and pose, each with a pose frame and clock of its own."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from ident.decimate import decimated
from ident.kinematics.fit import EXPLAINED, MOVES, Fit
from ident.kinematics.windows import Windows, cut_windows, require_channels, sparse
from ident.log import CHANNELS, Log
from ident.pooling import joined
from youbot_env.platform import Platform

NEEDED = ("wheel_velocity", "pose")


def one_record(
    logs: Sequence[Log], platform: Platform, window: float
) -> tuple[Log, dict[str, str]]:
    """Logs as one record, every contiguous piece of them a piece of it.

    Denser logs are decimated to about the rate of the slowest, so that windows of equally many
    samples last equally long.

    Args:
        logs: measured records of one robot.
        platform: nominal wheel table.
        window: length of a window, s.

    Returns:
        The record, and by name why a log is no part of it.

    Raises:
        ValueError: no log is of use; says why the first is not.
    """
    used, left = [], {}
    for log in logs:
        try:
            require_wheels(log, platform)
            require_channels(log)
            cut_windows(log, window)
            used.append(sparse(log))
        except ValueError as error:
            if len(logs) == 1:
                raise
            left[log.name] = str(error)
    if not used:
        name, reason = next(iter(left.items()))
        raise ValueError(f"{reason} (none of the {len(logs)} logs can be used; first {name!r})")
    if len(used) == 1:
        return used[0], left
    slowest = max(log.dt for log in used)
    spare = {channel: None for channel in CHANNELS if channel not in NEEDED}
    return joined([replace(decimated(log, slowest), recording={}, **spare) for log in used]), left


def require_wheels(log: Log, platform: Platform) -> None:
    """Refuse a log with other wheels.

    Raises:
        ValueError: its wheels have other names than those of the platform.
    """
    if platform.wheel_names != log.platform.wheel_names:
        raise ValueError(
            f"log {log.name!r} has wheels {log.platform.wheel_names}, the platform "
            f"{platform.name!r} has {platform.wheel_names}; give the platform of the log"
        )


def contradicting(windows: Windows, estimate: Fit, log: Log) -> dict[str, str]:
    """Runs of a joined record whose pose the wheels of the others cannot explain, by name."""
    residual, _, _ = windows.residual(estimate.rolling.odometry, estimate.mount, slopes=False)
    runs, found = windows.run, {}
    spread = windows.pose.var(axis=1)
    squares = np.mean(residual**2, axis=1)
    for number in np.unique(runs):
        here = runs == number
        moves, left = (part[here].mean(axis=0) for part in (spread, squares))
        for axis, least, unit in ((slice(0, 2), MOVES[0], "m"), (slice(2, 3), MOVES[1], "rad")):
            way, rest = (float(np.sqrt(np.mean(part[axis]))) for part in (moves, left))
            if way > least and rest > EXPLAINED * way:
                found[log.run_name(number)] = (
                    f"its pose moves by {way:.3g} {unit} within windows, of which {rest:.3g} "
                    f"{unit} contradict the wheels; check units, signs and clock of the pose"
                )
    return found
