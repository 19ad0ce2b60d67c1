"""Wheel speeds from wheel angles, where a log has no speeds or far coarser ones."""

from __future__ import annotations

import itertools

import numpy as np

from ident.doctor.declared import factor_of
from ident.doctor.motion import check_velocity
from ident.doctor.record import Record

# Speeds are taken from angles whose changes scatter this many times less: they are means over two
# rows, so little gain is none.  Steps alone do not tell: on 72 runs of a real robot with three omni
# wheels a tick is fine, yet ticks are read up to 17 ms before their row, and their changes scatter
# 1.1 to 2.7 times as much as the speeds logged in steps of 2.8 rad/s of the motor.
FINER = 2.0
COARSE = 0.01  # of the largest speed: finer steps do no harm
ALIKE = 0.1  # relative difference between the sizes of speeds and changes of the angles
AGREE = 0.9  # correlation of a logged speed with the change of its angle
FEW = 0.2  # distinct values a row, below which a column comes in steps
SAME = 1e-6  # of the largest value: what differs by less is the same, but for rounding
SHARP = 0.05  # relative standard error of the ticks a turn that is good enough
WORD = 65536.0  # ticks after which a 16-bit counter begins again


def check_rates(record: Record) -> None:
    """Turn ticks into angles, and take speeds from angles where these are finer."""
    angle, speed = record.get("wheel_position"), record.get("wheel_velocity")
    if angle is None:
        check_velocity(record)  # the angles may have been all there was
        return
    first = f"wheel_position_{record.platform.wheel_names[0]}"
    unit = record.units.get(first, "")
    ticks = unit.startswith(("ticks", "counts", "inc"))
    if ticks:
        angle = _without_wraps(
            record, angle, WORD * factor_of(unit, first, record.platform, record.gear)
        )
    rate = rates(record, angle)
    if ticks and " of " not in unit:
        factor = None if speed is None else _turn(record, speed, rate)
        if factor is None:
            record.refuse(
                "units",
                "ticks, and nothing tells how many make a turn of the wheel",
                record.name("wheel_position"),
                f"give it for each wheel, --map {first}='NAME [ticks of N]', with "
                "'motor' behind N where they make a turn of the motor",
                final=True,
            )
            return
        angle, rate = factor * angle, factor * rate
    record.set("wheel_position", angle)
    where = record.name("wheel_position")
    if speed is None:
        record.set("wheel_velocity", rate)
        record.columns["wheel_velocity"] = record.columns["wheel_position"]
        remedy = "taken from the change of the angles over two rows"
        record.fixed("velocities", "no wheel speeds", where, remedy)
        return
    if not ticks and not _same_size(speed, rate):
        return  # of another unit, and nobody says of which
    largest = float(np.percentile(np.abs(speed), 99))
    step, least = _step(speed), max(_step(np.diff(own)) for own in angle.T) / (2 * record.dt)
    logged = max(_scatter(speed), step / np.sqrt(12))
    found = max(_scatter(rate), least / np.sqrt(12))
    if step > COARSE * largest and logged > FINER * found and _alike(speed, rate):
        # Opposite signs are for the check of signs to judge.
        record.set("wheel_velocity", rate * np.where(np.sum(speed * rate, axis=0) < 0, -1.0, 1.0))
        record.fixed(
            "units",
            f"wheel speeds come in steps of {step:.3g} rad/s and scatter by {logged:.2g}, the "
            f"change of their angles over two rows by {found:.2g}",
            where,
            "the speeds are taken from the angles",
        )


def rates(record: Record, angle: np.ndarray) -> np.ndarray:
    """(N, n) rates of angles: over the rows before and after, at an end over one row."""
    rate = np.empty_like(angle)
    edges = [0, *np.flatnonzero(record.breaks[1:]) + 1, len(angle)]
    for begin, end in itertools.pairwise(edges):
        before = np.maximum(np.arange(begin, end) - 1, begin)
        after = np.minimum(np.arange(begin, end) + 1, end - 1)
        step = record.time[after] - record.time[before]
        alone = step <= 0  # a piece of one row
        moved = angle[after] - angle[before]
        rate[begin:end] = np.where(alone[:, None], 0.0, moved / np.where(alone, 1.0, step)[:, None])
    return rate


def _without_wraps(record: Record, angle: np.ndarray, period: float) -> np.ndarray:
    """Angles from counters that run over after ``period``, put together."""
    jumps = np.abs(np.diff(angle, axis=0))
    if not np.any((jumps > 0.75 * period) & (jumps < 1.25 * period)):
        return angle
    columns = np.flatnonzero(np.any(jumps > 0.75 * period, axis=0))
    record.fixed(
        "units", "counters of 16 bits run over", record.name("wheel_position", columns), "unwrapped"
    )
    return np.unwrap(angle, period=period, axis=0)


def _turn(record: Record, speed: np.ndarray, rate: np.ndarray) -> float | None:
    """Rad of the wheel a tick, from the logged speeds of all wheels; None where they say nothing.

    All encoders are alike; one may count backwards, which is left to the check of signs.
    """
    if not _alike(speed, rate):
        return None
    # Sums over rows that surely move: noise of the one is no slope of the other.
    sure = np.where(np.abs(speed) > 0.5 * np.abs(speed).max(), np.sign(speed), 0.0)
    turned = float(np.sum(np.abs(sure * rate)))
    if not turned:
        return None
    factor = float(np.sum(np.abs(sure * speed))) / turned
    left = (np.abs(speed) - factor * np.abs(rate))[sure != 0]
    spread = float(np.sqrt(np.sum(left**2))) / turned
    if spread > SHARP * factor:
        return None
    count = 2 * np.pi / factor
    text = f"{count:.5g} ticks a turn of the wheel"
    if record.gear:
        text += f", {count / record.gear:.5g} a turn of the motor"
    record.fixed("units", f"{text} (+- {spread / factor:.1%}), from the logged speeds",
                 record.name("wheel_position"), "turned into rad")  # fmt: skip
    return factor


def _alike(speed: np.ndarray, rate: np.ndarray) -> bool:
    """Whether speeds and changes of the angles show the same motion, for either sign."""
    size = np.sqrt(np.sum(speed**2, axis=0) * np.sum(rate**2, axis=0))
    weight = np.sum(speed**2, axis=0)
    with np.errstate(invalid="ignore", divide="ignore"):
        each = np.abs(np.sum(speed * rate, axis=0)) / size
    moving = weight > 0.05 * weight.max()
    return bool(np.all(np.nan_to_num(each[moving]) > AGREE))


def _same_size(speed: np.ndarray, rate: np.ndarray) -> bool:
    """Whether changes of the angles are as large as the speeds say."""
    size = float(np.sum(np.abs(rate)))
    return bool(size and abs(float(np.sum(np.abs(speed))) / size - 1) < ALIKE)


def _scatter(values: np.ndarray) -> float:
    """Rms noise from row to row: third differences hold hardly anything of a motion."""
    return float(np.sqrt(np.mean(np.diff(values, 3, axis=0) ** 2) / 20)) if len(values) > 3 else 0.0


def _step(values: np.ndarray) -> float:
    """Size of the steps that values come in; 0 where hardly any value occurs twice."""
    found = np.sort(np.abs(values), axis=None)
    gaps = np.diff(found)
    gaps = gaps[gaps > SAME * found[-1]]
    return float(np.median(gaps)) if 2 <= len(gaps) < FEW * values.size else 0.0
