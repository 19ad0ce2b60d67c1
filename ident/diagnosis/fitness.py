"""Whether a log can decide anything at all."""

from __future__ import annotations

import numpy as np

from ident.log import Log

# What a record must offer before anything is named.
LEAST_SECONDS, LEAST_SPEED = 20.0, 0.03
# A wheel at its largest torque for more than this share of the time has flat tops.
MOST_CLIPPED = 0.05


def unfit(log: Log) -> str:
    """Say why a log can decide nothing, and what to record; empty when it can."""
    bent = [finding for finding in log.findings if finding.geometry]
    if bent:
        return f"{log.name}: {bent[0].message}"
    velocity = log.velocity()
    speed = float(np.sqrt(np.mean((velocity * (1.0, 1.0, log.platform.lever)) ** 2) * 3))
    if log.duration < LEAST_SECONDS:
        return (
            f"{log.name} lasts {log.duration:.3g} s; record at least {LEAST_SECONDS:g} s, better "
            "112 s of `record.py --motion calibration`"
        )
    if speed < LEAST_SPEED:
        return (
            f"{log.name} hardly moves ({speed:.3g} m/s rms); drive it along "
            "`record.py --motion calibration`"
        )
    clipped = {"drive input": log.command}
    if log.wheel_velocity is not None:
        clipped["speed"] = log.wheel_velocity
    for what, signal in clipped.items():
        size = np.abs(signal)
        share = np.mean(size >= 0.999 * size.max(axis=0), axis=0)
        wheel = int(np.argmax(share))
        if share[wheel] > MOST_CLIPPED:
            return (
                f"the {what} of wheel {log.platform.wheel_names[wheel]} in {log.name} is clipped: "
                f"{100 * share[wheel]:.0f} % of the samples are at its largest value "
                f"{size[:, wheel].max():.3g}; drive slower, or raise the limit of the sensor"
            )
    return ""
