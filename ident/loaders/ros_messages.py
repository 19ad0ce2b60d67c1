"""What is taken from each type of ROS message."""

from __future__ import annotations

import math


def _twist(twist) -> list[float]:
    return [twist.linear.x, twist.linear.y, twist.angular.z]


def _pose(pose) -> list[float]:
    q = pose.orientation
    yaw = math.atan2(2 * (q.w * q.z + q.x * q.y), 1 - 2 * (q.y**2 + q.z**2))
    return [pose.position.x, pose.position.y, yaw]


TWIST = ("linear.x", "linear.y", "angular.z")
POSE = ("x", "y", "yaw")
# Message type: (names of the fields, how to take them, whether the value is held until the next,
# place of an angle that must not jump).
FIELDS = {
    "geometry_msgs/msg/Twist": (TWIST, _twist, True, None),
    "geometry_msgs/msg/TwistStamped": (TWIST, lambda m: _twist(m.twist), True, None),
    "geometry_msgs/msg/PoseStamped": (POSE, lambda m: _pose(m.pose), False, 2),
    "geometry_msgs/msg/PoseWithCovarianceStamped": (POSE, lambda m: _pose(m.pose.pose), False, 2),
    "nav_msgs/msg/Odometry": (POSE, lambda m: _pose(m.pose.pose), False, 2),
    "sensor_msgs/msg/BatteryState": (("voltage",), lambda m: [m.voltage], False, None),
}
# Log names, message types in order of preference, a word that a good topic name holds.
PREFERENCE = (
    (
        ("reference_vx", "reference_vy", "reference_yaw_rate"),
        ("geometry_msgs/msg/Twist", "geometry_msgs/msg/TwistStamped"),
        "cmd_vel",
    ),
    (
        POSE,
        (
            "geometry_msgs/msg/PoseStamped",
            "geometry_msgs/msg/PoseWithCovarianceStamped",
            "nav_msgs/msg/Odometry",
        ),
        "base",
    ),
    (("battery_voltage",), ("sensor_msgs/msg/BatteryState",), "battery"),
)
