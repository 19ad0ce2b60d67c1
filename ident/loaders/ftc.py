"""Logs of robots of the FIRST Tech Challenge, known by the header of their telemetry tables.

Duty cycles of four mecanum wheels with the battery voltage, and pose and body velocities from
dead wheels and an inertial sensor: field frame x, y, angle; body frame velocities.
"""

from __future__ import annotations

from pathlib import Path

from ident.loaders.base import Table
from ident.loaders.delimited import DelimitedLoader, header
from youbot_env.platform import Platform

NAMES = {
    "wheel_duty_fl": "fl",
    "wheel_duty_fr": "fr",
    "wheel_duty_rl": "bl",
    "wheel_duty_rr": "br",
    "x": "x_position",
    "y": "y_position",
    "yaw": "angle",
    "body_velocity_x": "x_velocity",
    "body_velocity_y": "y_velocity",
    "yaw_rate": "angular_velocity",
    "battery_voltage": "battery_voltage",
    "time": "time",
}


class FtcLoader(DelimitedLoader):
    """CSV with the column names of these robots; no option is needed."""

    identifier = "ftc"
    title = "FTC mecanum telemetry (CSV)"
    priority = 10

    def recognises(self, path: Path) -> bool:
        """All twelve names stand in the header."""
        return path.is_file() and set(NAMES.values()) <= set(header(path))

    def _table(self, path: Path, platform: Platform, most_rows: int | None) -> Table:
        """Read the table and say which column is what."""
        table = super()._table(path, platform, most_rows)
        table.names = dict(NAMES)
        table.foreign = "header of an FTC robot"
        return table
