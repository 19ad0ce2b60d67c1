"""Whether pose, body velocity and command claim the motion that the wheels roll.

Real rollers make sideways motion 5 to 7 % short and yaw 4 %, wheels differ by some per cent, slip
adds to it: effects that have names of their own.  A factor common to all axes has another cause, as
has one far beyond these.  It is told; what is wrong no log can say alone, so nothing is corrected.
"""

from __future__ import annotations

import numpy as np

from ident.doctor.correlation import correlate
from ident.doctor.heading import against_wheels
from ident.doctor.odometry import SCALES, Estimate, Kinematic
from ident.doctor.record import Record
from ident.doctor.smoothing import BODY_SOURCES, smooth

COMMON, EACH, SPREAD = 0.075, 0.06, 0.1  # of all axes: their mean, the least of them, their range
ALONE = 0.15  # of one axis
CLEAR = 3.0  # standard errors
PRECISE = 0.03  # standard error beyond which a scale says nothing
WHEEL = 0.075  # one wheel against the others; radii differ by up to 5 %, which has a name
BLOCKS = 10  # parts of the log, each left out once for the standard error of a wheel
SEEN, ROLLING = 0.1, 0.25  # of singular values of the wheel speeds: third by first, last by third
FOLLOWS = 0.97  # share of the wheel speeds that a source explains, to judge a single wheel by it
CAUSES = {
    ("sideways",): "slip or rollers make sideways motion short; else the unit of that column",
    ("yaw",): "the lever l + h of the wheel table (wheels to centre), or slip",
    ("forward", "sideways"): "the unit of length, or wheel radius and lever together",
}


def check_scales(record: Record) -> None:
    """Tell about factors between wheels and other witnesses of the motion."""
    if "wheel_velocity" not in record.channels or len(record.time) < 100:
        return
    _wheels(record)
    found = {source: against_wheels(record, source) for source in BODY_SOURCES}
    factors = {source: _common(k) for source, k in found.items() if k is not None}
    told = []
    for source, kinematic in found.items():
        if kinematic is None:
            continue
        if any("times as large" in f.what and f.what.startswith(source) for f in record.findings):
            continue
        if factors[source]:
            # Wheels that contradict two witnesses alike are told once.
            if not told or all(abs(factors[source] - factors[other]) > COMMON for other in told):
                _tell_common(record, source, kinematic, factors)
            told.append(source)
        elif source != "reference":
            _tell_axes(record, source, kinematic)


def _clear(kinematic: Kinematic) -> dict[str, Estimate]:
    """Scales that are known well enough to speak."""
    return {name: e for name, e in kinematic.scales.items() if e.se < PRECISE * abs(e.value)}


def _common(kinematic: Kinematic) -> float:
    """The factor common to all axes that move; 0 where there is none."""
    clear = _clear(kinematic)
    if len(clear) < 2 and "forward" not in clear:
        return 0.0
    values = np.array([e.value for e in clear.values()])
    mean = float(values.mean())
    alike = np.ptp(values) < SPREAD * abs(mean) and abs(mean - 1) > COMMON
    far = [(e.value - 1) * np.sign(mean - 1) > max(EACH, CLEAR * e.se) for e in clear.values()]
    return mean if alike and all(far) else 0.0


def _listed(scales: dict[str, Estimate]) -> str:
    return ", ".join(f"{n} {e.value:.3f} +- {1.96 * e.se:.3f}" for n, e in scales.items())


def _tell_common(
    record: Record, source: str, kinematic: Kinematic, factors: dict[str, float]
) -> None:
    factor = factors[source]
    agree = [s for s, f in factors.items() if s != source and abs(f - factor) < COMMON]
    against = [s for s, f in factors.items() if s != source and s not in agree]
    if agree:
        others = f"; so says {' and '.join(agree)}: look at the wheel speeds first"
    elif against:
        others = f"; by {' and '.join(against)} it is not: look at {source} and at time first"
    else:
        others = ""
    lengths = "time stamps scaled, " if source == "pose" else ""
    record.warn(
        "scales",
        f"{source} is {factor:.3f} times what the wheel speeds say, on all axes alike "
        f"({_listed(_clear(kinematic))}){others}",
        record.name(source),
        f"check unit and gear of the wheel speeds, wheel radius, {lengths}unit of {source}; used "
        "as it is",
        geometry=source != "reference",
    )


def _tell_axes(record: Record, source: str, kinematic: Kinematic) -> None:
    """Tell axes that are far off, each with what would explain it."""
    off = {
        name: e
        for name, e in _clear(kinematic).items()
        if abs(e.value - 1) > ALONE and e.differs(1.0, CLEAR)
    }
    if not off or set(off) == {"yaw"}:
        return  # yaw alone is looked at with the lever
    cause = CAUSES.get(tuple(off), "units of these columns, the wheel table, or slip")
    record.warn(
        "scales",
        f"{source} is not what the wheel speeds say: {_listed(off)} times as much",
        record.name(source, [SCALES.index(name) for name in off]),
        f"check: {cause}; used as it is",
        geometry=set(off) != {"sideways"},
    )


def _wheels(record: Record) -> None:
    """Tell a wheel whose speed is out of proportion to the others."""
    scales, most = _by_rolling(record), 2
    words = "the wheels roll together"
    if scales is None:
        (scales, words), most = _by_motion(record), 1
    if scales is None:
        return
    value, se = scales
    off = np.flatnonzero((np.abs(value - 1) > WHEEL) & (np.abs(value - 1) > CLEAR * se))
    if len(off) > most:
        return  # what all wheels share is no fault of a wheel: slip, or scales of the axes
    for wheel in off:
        where = record.name("wheel_velocity", [int(wheel)])
        if any(f.where == where and "this wheel turns" in f.what for f in record.findings):
            continue
        record.warn(
            "wheel_scale",
            f"this wheel turns {value[wheel]:.3f} +- {1.96 * se[wheel]:.3f} times as fast as the "
            f"others say, if {words}",
            where,
            "check its radius, encoder and gear; used as it is",
        )


def _by_rolling(record: Record) -> tuple[np.ndarray, np.ndarray] | None:
    """Scale of each wheel by the redundancy of the speeds alone, and its standard error.

    Four wheels that roll obey ``n . phi' = 0``; if wheel k shows ``s_k`` times its speed, the
    record obeys ``(n / s) . phi' = 0``.
    """
    left = np.linalg.svd(record.platform.jacobian_array)[0][:, 3:]
    speeds = smooth(record).signals.get("wheel_velocity")
    if left.shape[1] != 1 or speeds is None or len(speeds) < 10 * BLOCKS:
        return None
    blocks = np.array_split(speeds - speeds.mean(axis=0), BLOCKS)
    grams = np.array([block.T @ block for block in blocks])
    total = grams.sum(axis=0)
    sizes = np.sqrt(np.maximum(np.linalg.eigvalsh(total)[::-1], 0.0))
    if sizes[2] < SEEN * sizes[0] or sizes[3] > ROLLING * sizes[2]:
        return None
    value = _null(total, left[:, 0])
    fewer = np.array([_null(total - gram, left[:, 0]) for gram in grams])
    se = np.sqrt((BLOCKS - 1) / BLOCKS * np.sum((fewer - fewer.mean(axis=0)) ** 2, axis=0))
    return value, se


def _null(gram: np.ndarray, left: np.ndarray) -> np.ndarray:
    """(n,) scales of wheels from the direction in which they do not move."""
    scales = left / np.linalg.eigh(gram)[1][:, 0]
    return scales / np.median(scales)


def _by_motion(record: Record):
    """Scale of each wheel by the best witness of the body motion, and its standard error."""
    signals = smooth(record).signals
    for source in BODY_SOURCES:
        if source not in signals or not np.any(signals[source]):
            continue
        evidence = correlate(signals["wheel_velocity"], signals[source])
        if evidence.share < FOLLOWS or evidence.rows is None:
            continue  # where axes move together, their scales pass for those of wheels
        gains = np.ma.masked_invalid(evidence.gains(record.platform.jacobian_array))
        value = np.ma.median(gains / np.ma.median(gains, axis=0), axis=1).filled(np.nan)
        return (value / np.nanmedian(value), np.full(len(value), WHEEL / 10)), f"{source} is right"
    return None, ""
