"""Channels of a log and the names of their columns: one list for writing and for reading."""

from __future__ import annotations

from youbot_env.platform import Platform

SINGLE_COLUMNS = {
    "body_velocity": ("body_velocity_x", "body_velocity_y", "yaw_rate"),
    "reference": ("reference_vx", "reference_vy", "reference_yaw_rate"),
    "pose": ("x", "y", "yaw"),
    "battery_voltage": ("battery_voltage",),
}
WHEEL_CHANNELS = (
    "wheel_velocity",
    "wheel_position",
    "wheel_torque",
    "wheel_current",
    "wheel_voltage",
    "wheel_duty",
)


def channel_columns(platform: Platform) -> dict[str, tuple[str, ...]]:
    """Column names of every channel of a log for a platform, in order."""
    wheels = {
        channel: tuple(f"{channel}_{name}" for name in platform.wheel_names)
        for channel in WHEEL_CHANNELS
    }
    return wheels | SINGLE_COLUMNS
