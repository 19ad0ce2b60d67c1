"""What the KUKA youBot driver writes: names, order and signs of its base joints."""

from __future__ import annotations

from youbot_env.platform import Platform

# Paper sign = sign * driver value, for velocity, current and torque; the motors on the left are
# mounted the other way round.
SIGNS = {"fl": -1.0, "fr": 1.0, "rl": -1.0, "rr": 1.0}
CORNERS = {"rl": "bl", "rr": "br"}


def joint_name(wheel: str) -> str:
    """Joint of a wheel in ROS messages: the driver calls the rear back."""
    return f"wheel_joint_{CORNERS.get(wheel, wheel)}"


def sign(wheel: str, platform: Platform) -> float:
    """Factor from driver values to paper signs; 1 for platforms with other wheels."""
    return SIGNS[wheel] if set(platform.wheel_names) == set(SIGNS) else 1.0
