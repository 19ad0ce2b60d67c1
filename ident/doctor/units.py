"""Units of wheel speeds and body motions, found by comparing their sizes."""

from __future__ import annotations

import numpy as np

from ident.doctor.correlation import correlate
from ident.doctor.lever import WIDEST
from ident.doctor.record import Record
from ident.doctor.smoothing import BODY_SOURCES, smooth
from youbot_env.channels import SINGLE_COLUMNS

MATCH = 0.08  # relative distance from the factor of a unit
CLEAR = 0.8  # share of the wheel speeds a source must explain; noise makes it look larger
NEAR = {"body_velocity": 1.35, "pose": 1.35, "reference": 1.6}  # gains that are no unit error
FAR = 2.0  # of a measured body velocity: refused
WHEEL_REFUSED, WHEEL_TOLD = 1.5, 1.15  # one wheel against the others
# All wheels against others, that say more or less.  On a floor of friction 0.13 wheels turn 1.5 to
# 2 times as far as the robot moves, sideways 3 times; hardly any moves further than its wheels.
LEAST = {"measured": 1 / 1.5, "reference": 1 / 2.5}
COMMON = {"measured": 2.5, "reference": 2.5}
ROLLS = 0.5  # of what contradicts rolling, left once a wheel is scaled: then its scale was wrong
SINGLE_UNITS = ("rpm", "deg/s")  # what one wheel alone may be in
FEW_VALUES = 0.1  # values a row, below which a column comes in steps
FASTEST = 2.0  # m/s at the rim of a wheel
FASTEST_BODY = np.array([8.0, 8.0, 20.0])  # m/s, m/s, rad/s
BODY_UNITS = {"mm": 1e3, "cm": 1e2, "in": 1 / 0.0254}
ASKED = {"in": "inches"}  # nobody means these who works in SI: told, with what would settle it
DEGREES = 180 / np.pi


def wheel_units(record: Record) -> dict[str, float]:
    """Values per rad/s of the units in which wheel speeds are found."""
    radius, gear = record.platform.wheel_radius, record.gear or 9405 / 364
    return {
        "rpm": 30 / np.pi,
        "deg/s": 180 / np.pi,
        "turns/s": 0.5 / np.pi,
        "m/s at the rim": radius,
        "mm/s at the rim": 1e3 * radius,
        "rad/s of the motor": gear,
        "rpm of the motor": gear * 30 / np.pi,
        "encoder ticks/s (4000 a motor turn)": gear * 4000 / (2 * np.pi),
    }


def check_angle(record: Record) -> None:
    """Bring a yaw in degrees to rad; it is needed to turn the pose into body velocities."""
    pose = record.get("pose")
    if pose is None:
        return
    degrees = np.unwrap(pose[:, 2], period=360.0)
    jumps = np.abs(np.diff(pose[:, 2]))
    signals = smooth(record)
    others = [signals.signals[s][:, 2] for s in ("body_velocity", "reference")
              if s in signals.signals]  # fmt: skip
    if "wheel_velocity" in signals.signals:
        inverse = np.linalg.pinv(record.platform.jacobian_array)
        others.append((signals.signals["wheel_velocity"] @ inverse.T)[:, 2])
    turning = np.gradient(degrees, record.time)[signals.rows]
    found = bool(np.any((jumps > 300) & (jumps < 361)))
    for other in others:
        power = float(other @ other)
        gain = abs(float(turning @ other)) / power if power else 0.0
        found |= abs(gain / DEGREES - 1) < 0.25
    angle = np.deg2rad(degrees) if found else np.unwrap(pose[:, 2])
    record.set("pose", np.column_stack([pose[:, :2], angle]))
    if found:
        record.fixed("units", "yaw is in degrees", record.name("pose", [2]), "turned into rad")


def check_units(record: Record) -> None:
    """Compare the sizes of wheel speeds and body motions; fix known units, refuse others."""
    if len(smooth(record).rows) < 20:
        return
    _plausible_body(record)
    if "wheel_velocity" not in record.channels:
        _bodies(record)
        return
    gains = _gains(record)
    if not gains:
        _plausible_wheels(record)
        return
    for source, gain in gains.items():
        _body_unit(record, source, 1 / _median(gain, axis=0))
    _wheels(record, _gains(record))
    for source, gain in _gains(record).items():
        _compare(record, source, 1 / _median(gain, axis=0), "the wheels")


def _gains(record: Record) -> dict[str, np.ndarray]:
    """(n, 3) sizes of wheel speeds over what each source says; NaN where it says nothing."""
    gains, signals = {}, smooth(record)
    for source in BODY_SOURCES:
        if source in signals.signals:
            evidence = correlate(signals.signals["wheel_velocity"], signals.signals[source])
            if evidence.share > CLEAR:
                gains[source] = evidence.gains(record.platform.jacobian_array)
    return gains


def _unit(size: float, units: dict[str, float]) -> str:
    """The unit whose factor a size matches, or ""."""
    near = {unit: abs(size / factor - 1) for unit, factor in units.items()}
    best = min(near, key=near.get)
    return best if near[best] < MATCH else ""


def _wheels(record: Record, gains: dict[str, np.ndarray]) -> None:
    """Find wheel speeds in other units, and wheels that turn unlike the others."""
    units = wheel_units(record)
    each = {source: _median(gain, axis=1) for source, gain in gains.items()}
    # The source nearest to the wheels is believed; what is wrong with the wheels, all show.
    sizes = min(each.values(), key=lambda size: np.nansum(np.abs(np.log(np.abs(size)))))
    typical, where = float(np.nanmedian(sizes)), record.name("wheel_velocity")
    common = _unit(typical, units)
    if common and all(_unit(float(np.nanmedian(size)), units) == common for size in each.values()):
        record.set("wheel_velocity", record.channels["wheel_velocity"] / units[common])
        what = f"wheel speeds are {typical:.4g} times what {' and '.join(each)} say: {common}"
        record.fixed("units", what, where, "turned into rad/s")
        sizes, typical = sizes / units[common], typical / units[common]
    kind = "reference" if set(each) == {"reference"} else "measured"
    if not LEAST[kind] < typical < COMMON[kind]:
        record.refuse(
            "units",
            f"wheel speeds are {typical:.3g} times as large as {' and '.join(each)} say",
            where,
            f"check the units of the wheel speeds and of {' and '.join(each)}, wheel radius and "
            "time; give a unit in brackets, NAME [rpm] or NAME [ft]",
        )
        return
    relative = np.nan_to_num(sizes / typical, nan=1.0)
    told = WHEEL_TOLD + _coarse(record.channels["wheel_velocity"])
    off = np.flatnonzero((relative < 1 / told) | (relative > told))
    if len(off) > 1 and np.all(np.abs(np.log(relative)) < np.log(WHEEL_REFUSED)):
        return  # axes that move together: their scales pass for those of wheels
    for wheel in off:
        _wheel(record, int(wheel), float(relative[wheel]), units)


def _wheel(record: Record, wheel: int, relative: float, units: dict[str, float]) -> None:
    """Tell or refuse one wheel that is off the others."""
    column = record.name("wheel_velocity", [wheel])
    what = f"this wheel turns {relative:.3g} times as fast as the others say"
    unit = _unit(relative, {unit: units[unit] for unit in SINGLE_UNITS})
    if unit:
        values = record.channels["wheel_velocity"].copy()
        values[:, wheel] /= units[unit]
        record.set("wheel_velocity", values)
        record.fixed("wheel_scale", f"{what}: {unit}", column, "turned into rad/s")
    elif 1 / WHEEL_REFUSED < relative < WHEEL_REFUSED or not _rolls(record, wheel, relative):
        record.warn("wheel_scale", what, column, "check its radius and encoder")
    else:
        remedy = "check its unit and encoder; give the unit in brackets, NAME [rpm]"
        record.refuse("wheel_scale", what, column, remedy)


def _rolls(record: Record, wheel: int, relative: float) -> bool:
    """Whether four wheels roll together once one is scaled; where it slips they do not."""
    left = np.linalg.svd(record.platform.jacobian_array)[0][:, 3:]
    if not left.shape[1]:
        return True  # three wheels never contradict each other
    speeds = smooth(record).signals["wheel_velocity"]
    scaled = speeds.copy()
    scaled[:, wheel] /= relative
    return bool(np.sum((scaled @ left) ** 2) < ROLLS * np.sum((speeds @ left) ** 2))


def _coarse(speeds: np.ndarray) -> np.ndarray:
    """(n,) steps in which speeds come, of their rms: slow wheels in coarse steps say little."""
    steps = np.zeros(speeds.shape[1])
    for column, own in enumerate(speeds.T):
        numbers = np.unique(own)
        if 1 < len(numbers) < FEW_VALUES * len(own):
            steps[column] = np.median(np.diff(numbers))
    return steps / (np.sqrt(np.mean(speeds**2, axis=0)) + 1e-300)


def _bodies(record: Record) -> None:
    """Without wheel speeds: compare the pose with the measured body velocity."""
    signals = smooth(record).signals
    if not {"pose", "body_velocity"} <= set(signals):
        return
    evidence = correlate(signals["body_velocity"], signals["pose"])
    if evidence.share < CLEAR:
        return
    axes = 1 / _median(evidence.gains(np.eye(3)), axis=0)
    _body_unit(record, "pose", axes)
    _body_unit(record, "body_velocity", 1 / axes)


def _median(gain: np.ndarray, axis: int) -> np.ndarray:
    """Medians of the numbers there are."""
    masked = np.ma.masked_invalid(gain)
    return np.ma.median(masked, axis=axis).filled(np.nan)


def _body_unit(record: Record, source: str, axes: np.ndarray) -> None:
    """Bring a body motion in mm, cm or degrees to SI.

    Args:
        record: the log.
        source: the channel.
        axes: (3,) its size over what the others say; NaN where unknown.
    """
    factors, told = np.ones(3), []
    lengths = axes[:2][~np.isnan(axes[:2])]
    unit = _unit(float(np.mean(lengths)), BODY_UNITS) if len(lengths) else ""
    if unit:
        factors[:2] = BODY_UNITS[unit]
        told.append(unit)
    if source != "pose" and _unit(float(axes[2]), {"deg": DEGREES}):  # yaw was checked before
        factors[2] = DEGREES
        told.append("deg")
    if told:
        record.set(source, record.channels[source] / factors)
        what = f"{source} is in {' and '.join(ASKED.get(unit, unit) for unit in told)}"
        if unit in ASKED:
            size = f"{float(np.mean(lengths)):.4g} times what the others say"
            pairs = zip(SINGLE_COLUMNS[source][:2], record.columns[source], strict=False)
            word = unit if source == "pose" else f"{unit}/s"
            declared = " ".join(f"--map {name}='{column} [{word}]'" for name, column in pairs)
            remedy = f"turned into m; is it so? then say it with {declared}"
            record.warn("units", f"{what}: {size}", record.name(source, [0, 1]), remedy)
        else:
            record.fixed("units", what, record.name(source), "turned into SI units")


def _compare(record: Record, source: str, axes: np.ndarray, witness: str) -> None:
    """Tell about a body motion whose size contradicts the wheels."""
    near = NEAR[source]
    wrong = [k for k in range(3) if not (np.isnan(axes[k]) or 1 / near < axes[k] < near)]
    if not wrong or (wrong == [2] and source != "reference" and 1 / WIDEST < axes[2] < WIDEST):
        return  # the latter is what a wrong lever does, which is looked at by itself
    far = max(max(axes[k], 1 / axes[k]) for k in wrong) > FAR
    what = (
        f"{source} is {', '.join(f'{axes[k]:.3g}' for k in wrong)} times as large as {witness} say"
    )
    where = record.name(source, wrong)
    remedy = (
        "check units of these columns and of the wheel speeds, wheel radius and time; give a unit "
        "in brackets, NAME [mm]"
    )
    if far and source == "body_velocity":
        record.refuse("units", what, where, remedy)
    else:
        # A robot need not do what it is told; what it is seen to do it does.
        record.warn("units", what, where, remedy, geometry=source != "reference" and wrong != [1])


def _plausible_body(record: Record) -> None:
    """Refuse body velocities that no such platform reaches."""
    measured = record.get("body_velocity")
    if measured is None or "wheel_velocity" in record.channels or "pose" in record.channels:
        return
    fastest = np.percentile(np.abs(measured), 99, axis=0)
    for axis in np.flatnonzero(fastest > FASTEST_BODY):
        record.refuse(
            "units",
            f"values up to {fastest[axis]:.4g} cannot be m/s and rad/s",
            record.name("body_velocity", [axis]),
            "these are mm/s, in/s or deg/s: give the unit in brackets, NAME [mm/s]",
        )


def _plausible_wheels(record: Record) -> None:
    """Without any witness: refuse wheel speeds that no such platform reaches."""
    fastest = float(np.percentile(np.abs(record.channels["wheel_velocity"]), 99))
    if fastest * record.platform.wheel_radius > FASTEST:
        record.refuse(
            "units",
            f"wheels turn up to {fastest:.4g} rad/s, {fastest * record.platform.wheel_radius:.3g} "
            "m/s at the rim",
            record.name("wheel_velocity"),
            "these are rpm, deg/s or ticks/s: give the unit in brackets, NAME [rpm]",
        )
