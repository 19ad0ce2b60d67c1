"""Whether logs can decide anything at all."""

from __future__ import annotations

import numpy as np

from ident.diagnosis.settings import SETTINGS
from ident.log import Log


def unfit(logs: list[Log]) -> str:
    """Say why logs can decide nothing together, and what to record; empty when they can."""
    for log in logs:
        bent = [finding for finding in log.findings if finding.geometry]
        if bent:
            return f"{log.name}: {bent[0].message}"
    seconds, names = sum(log.duration for log in logs), " + ".join(log.name for log in logs)
    if seconds < SETTINGS.least_seconds:
        lasts = "lasts" if len(logs) == 1 and not logs[0].runs else "together last"
        return (
            f"{names} {lasts} {seconds:.3g} s; record at least {SETTINGS.least_seconds:g} s, "
            "better 112 s of `youbot record --motion calibration`"
        )
    level = np.concatenate([log.velocity() * (1.0, 1.0, log.platform.lever) for log in logs])
    speed = float(np.sqrt(np.mean(level**2) * 3))
    if speed < SETTINGS.least_speed:
        return (
            f"{names} hardly moves ({speed:.3g} m/s rms); drive it along "
            "`youbot record --motion calibration`"
        )
    return next(filter(None, map(_clipped, logs)), "")


def _clipped(log: Log) -> str:
    """Say which signal of a log has flat tops; empty when none has."""
    signals = {"drive input": log.command}
    if log.wheel_velocity is not None:
        signals["speed"] = log.wheel_velocity
    for what, signal in signals.items():
        size = np.abs(signal)
        share = np.mean(size >= 0.999 * size.max(axis=0), axis=0)
        wheel = int(np.argmax(share))
        if share[wheel] > SETTINGS.most_clipped:
            return (
                f"the {what} of wheel {log.platform.wheel_names[wheel]} in {log.name} is clipped: "
                f"{100 * share[wheel]:.0f} % of the samples are at its largest value "
                f"{size[:, wheel].max():.3g}; drive slower, or raise the limit of the sensor"
            )
    return ""
