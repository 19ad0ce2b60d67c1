"""The drive input: currents become torques, duty cycles become voltages."""

from __future__ import annotations

import numpy as np

from ident.doctor.record import Record, runs

YOUBOT_KT, YOUBOT_GEAR = 0.0335, 9405 / 364  # N m/A and motor turns a wheel turn, from its driver
MOST_AMPERE = 60.0  # beyond that the numbers are milliampere
DEAD_BATTERY = 1.0  # V
MOST_PERCENT = 150.0  # beyond that a duty is neither a fraction nor per cent


def check_drive(record: Record) -> None:
    """Leave ``wheel_torque`` (N m) or ``wheel_voltage`` (V) in the record, or refuse it."""
    _battery(record)
    if "wheel_torque" not in record.channels and "wheel_current" in record.channels:
        _current(record)
    if "wheel_voltage" not in record.channels and "wheel_duty" in record.channels:
        _duty(record)
    if not {"wheel_torque", "wheel_voltage"} & set(record.channels):
        _nothing(record)


def _current(record: Record) -> None:
    current, kt, gear = record.channels["wheel_current"], record.kt, record.gear
    where = record.name("wheel_current")
    if np.percentile(np.abs(current), 99) > MOST_AMPERE:
        current = current * 1e-3
        record.fixed(
            "units", f"currents up to {np.abs(current).max() * 1e3:.0f}: mA", where, "turned to A"
        )
    if (kt is None or gear is None) and record.platform.name != "youbot":
        record.refuse(
            "drive",
            "currents, but no torque constant or gear ratio",
            where,
            "give kt (N m per A at the motor) and gear (motor turns per wheel turn)",
            final=True,
        )
        return
    kt = YOUBOT_KT if kt is None else kt
    gear = YOUBOT_GEAR if gear is None else gear
    record.channels["wheel_torque"] = current * kt * gear
    record.columns["wheel_torque"] = record.columns["wheel_current"]
    record.fixed(
        "drive",
        f"wheel torque = current x kt {kt:.5g} N m/A x gear {gear:.5g}",
        where,
        "turned into N m at the wheel, before gear losses",
    )


def _duty(record: Record) -> None:
    duty, where = record.channels["wheel_duty"], record.name("wheel_duty")
    largest = float(np.percentile(np.abs(duty), 99.5))
    if largest > MOST_PERCENT:
        record.refuse(
            "duty",
            f"duty up to {largest:.4g}",
            where,
            "give duty as a fraction, -1 to 1",
            final=True,
        )
        return
    if largest > 3.0:
        duty = duty / 100
        record.fixed("duty", f"duty up to {largest:.4g}: per cent", where, "divided by 100")
    beyond = np.abs(duty) > 1
    if beyond.any():
        record.fixed(
            "duty",
            f"{int(beyond.sum())} duties beyond 1, up to {np.abs(duty).max():.4g}",
            where,
            "clipped to -1 ... 1 as the motor controller does",
        )
    if "battery_voltage" not in record.channels:
        record.refuse(
            "duty",
            "duty cycles, but no battery_voltage",
            where,
            "add battery_voltage, V, to the log",
            final=True,
        )
        return
    record.channels["wheel_voltage"] = np.clip(duty, -1, 1) * record.channels["battery_voltage"]
    record.columns["wheel_voltage"] = record.columns["wheel_duty"]


def _battery(record: Record) -> None:
    """Repair samples at 0 V: the robot that wrote them was running."""
    battery = record.get("battery_voltage")
    if battery is None:
        return
    if np.median(np.abs(battery)) > 1000:
        battery *= 1e-3
        record.fixed("units", "battery in mV", record.name("battery_voltage"), "turned into V")
    dead = battery[:, 0] < DEAD_BATTERY
    if not dead.any():
        return
    where = record.place(int(np.flatnonzero(dead)[0]), "battery_voltage")
    what = f"battery below {DEAD_BATTERY} V in {dead.mean():.0%} of the log"
    if dead.mean() > 0.2 and record.refuse(
        "battery", what, where, "record the battery voltage, V", final=bool(dead.all())
    ):
        return
    good = np.flatnonzero(~dead)
    battery[dead, 0] = np.interp(np.flatnonzero(dead), good, battery[good, 0])
    longest = max(end - begin for begin, end in runs(dead))
    record.fixed(
        "battery",
        f"battery at {0.0:.0f} V in {int(dead.sum())} samples ({longest} in a row): glitches",
        where,
        "replaced by the neighbouring values",
    )


def _nothing(record: Record) -> None:
    """Without a drive input only kinematics can be learnt, and from an independent motion."""
    wheels = record.platform.wheel_names
    what = f"there is no drive input of the wheels {', '.join(wheels)}"
    remedy = (
        f"add wheel_torque_{wheels[0]} ..., wheel_current_*, wheel_voltage_*, or wheel_duty_* with "
        "battery_voltage (rename with --map NAME=COLUMN)"
    )
    if "wheel_velocity" in record.channels and {"pose", "body_velocity"} & set(record.channels):
        record.warn("drive", what, "header", f"good for kinematics alone; for dynamics {remedy}")
        return
    remedy += "; a record of one motor on a bench says nothing about the platform"
    record.refuse("drive", what, "header", remedy, final=True)
