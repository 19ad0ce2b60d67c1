"""The log doctor: every log of every format passes the same checks before anybody uses it."""

from __future__ import annotations

from ident.doctor.agreement import check_agreement
from ident.doctor.cells import check_cells
from ident.doctor.clock import check_clock
from ident.doctor.columns import examine_columns
from ident.doctor.drive import check_drive
from ident.doctor.dropouts import check_dropouts
from ident.doctor.effort import check_effort
from ident.doctor.finding import Finding, LogError, check_accepted
from ident.doctor.frozen import check_frozen
from ident.doctor.heading import check_heading
from ident.doctor.jumps import check_jumps
from ident.doctor.lever import check_lever
from ident.doctor.motion import check_length, check_motion, check_velocity
from ident.doctor.overflow import check_overflow
from ident.doctor.pieces import check_pieces
from ident.doctor.positions import check_positions
from ident.doctor.rates import check_rates
from ident.doctor.record import Record
from ident.doctor.resolution import check_resolution
from ident.doctor.scales import check_scales
from ident.doctor.signs import check_signs
from ident.doctor.spikes import check_spikes
from ident.doctor.stuck import check_stuck
from ident.doctor.table import Table
from ident.doctor.units import check_angle, check_units
from ident.doctor.unsigned import check_unsigned
from ident.doctor.wheel_odometry import check_wheel_odometry
from ident.doctor.world import check_world
from youbot_env.platform import Platform

__all__ = ["Finding", "LogError", "Record", "check_accepted", "examine"]

# In this order: each check relies on what those before it have put right.
CHECKS = (
    check_velocity,
    check_clock,
    check_cells,
    check_rates,
    check_overflow,
    check_unsigned,
    check_drive,
    check_length,
    check_dropouts,
    check_resolution,
    check_stuck,
    check_frozen,
    check_spikes,
    check_positions,
    check_angle,
    check_jumps,
    check_pieces,
    check_wheel_odometry,
    check_world,
    check_signs,
    check_heading,
    check_units,
    check_effort,
    check_motion,
    check_agreement,
    check_scales,
    check_lever,
)


def examine(
    table: Table,
    source: str,
    platform: Platform,
    mapping: dict[str, str] | None = None,
    kt: float | None = None,
    gear: float | None = None,
    accept: tuple[str, ...] = (),
) -> Record:
    """Turn the columns of a file into a record in SI units and paper signs.

    Args:
        table: columns as they stand in the file.
        source: file name, for messages.
        platform: wheel table.
        mapping: ``{log name: column}``.
        kt, gear: torque constant of a motor, N m/A, and motor turns per wheel turn.
        accept: names of findings that are no reason to refuse the log.

    Raises:
        LogError: something cannot be put right; the message names row, column, value, remedy.
    """
    record = examine_columns(table, source, platform, mapping, gear)
    record.kt, record.gear, record.accept = kt, gear, accept
    for check in CHECKS:
        check(record)
        record.stop_on_error()
    return record
