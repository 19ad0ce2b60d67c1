"""One log written in the formats of others, as the youBot driver and its users write them."""

from pathlib import Path

import numpy as np
import polars as pl

from ident.log import Log
from youbot_env.platform import youbot

RAW = np.array([-1.0, 1.0, -1.0, 1.0])  # driver value = sign * paper value: fl, fr, bl, br
JOINTS = [f"wheel_joint_{corner}" for corner in ("fl", "fr", "bl", "br")]


def make(count: int = 1500, dt: float = 0.02, platform=None) -> Log:
    """A motion on all axes with the torques of 40 kg and viscous friction."""
    platform = platform or youbot()
    t = 100.0 + np.arange(count) * dt
    rates, sizes = np.array([0.9, 1.3, 0.7]), np.array([0.3, 0.2, 0.5])
    v = sizes * np.sin(rates * t[:, None] + [0.0, 1.0, 2.0])
    a = sizes * rates * np.cos(rates * t[:, None] + [0.0, 1.0, 2.0])
    wrench = v * [190.0, 400.0, 42.0] + a * [45.0, 45.0, 6.0]
    pose = np.zeros((count, 3))
    pose[:, 2] = np.cumsum(v[:, 2]) * dt
    c, s = np.cos(pose[:, 2]), np.sin(pose[:, 2])
    pose[:, 0] = np.cumsum(c * v[:, 0] - s * v[:, 1]) * dt
    pose[:, 1] = np.cumsum(s * v[:, 0] + c * v[:, 1]) * dt
    J = platform.jacobian_array
    return Log("made", platform, t, v @ J.T, None, wrench @ np.linalg.pinv(J), None, v, pose)


def write_duty(path: Path, good: Log, battery: np.ndarray, scale: float = 1.0) -> Path:
    columns = {"time": good.time, "battery_voltage": battery}
    for column, wheel in enumerate(good.platform.wheel_names):
        columns[f"wheel_velocity_{wheel}"] = good.wheel_velocity[:, column]
        columns[f"wheel_duty_{wheel}"] = 0.08 * good.wheel_velocity[:, column] * scale
    pl.DataFrame(columns).write_csv(path)
    return path


def write_bag(path: Path, good: Log, kind: str, offset: float = 0.0) -> Path:
    """Write what the stock driver publishes: casters, the arm on the same topic, raw signs."""
    from rosbags.typesys import Stores, get_typestore

    if kind == "ros1":
        from rosbags.rosbag1 import Writer

        store, writer = get_typestore(Stores.ROS1_NOETIC), Writer(path)
    else:
        from rosbags.rosbag2 import StoragePlugin, Writer

        store = get_typestore(Stores.ROS2_HUMBLE)
        plugin = StoragePlugin.MCAP if kind == "mcap" else StoragePlugin.SQLITE3
        writer = Writer(path, version=9, storage_plugin=plugin)
    types = store.types
    serialize = store.serialize_ros1 if kind == "ros1" else store.serialize_cdr
    time_type = types["builtin_interfaces/msg/Time"]

    def header(stamp: float):
        nanoseconds = round(stamp * 1e9)
        values = {"stamp": time_type(nanoseconds // 10**9, nanoseconds % 10**9), "frame_id": "odom"}
        if kind == "ros1":
            values["seq"] = 0
        return types["std_msgs/msg/Header"](**values)

    def vector(name: str, x: float, y: float, z: float):
        return types[f"geometry_msgs/msg/{name}"](x, y, z)

    with writer:
        kinds = {
            "/joint_states": "sensor_msgs/msg/JointState",
            "/cmd_vel": "geometry_msgs/msg/Twist",
            "/odom": "nav_msgs/msg/Odometry",
        }
        links = {t: writer.add_connection(t, k, typestore=store) for t, k in kinds.items()}

        def write(topic: str, stamp: float, message) -> None:
            writer.write(links[topic], round(stamp * 1e9), serialize(message, kinds[topic]))

        position = np.cumsum(good.wheel_velocity, axis=0) * good.dt
        state = types["sensor_msgs/msg/JointState"]
        names = [*JOINTS, *(joint.replace("wheel", "caster") for joint in JOINTS)]
        zeros = np.zeros(4)
        for row, t in enumerate(good.time):
            now = t + offset
            # The command arrives before the sample at which it is in force.
            twist = types["geometry_msgs/msg/Twist"](
                vector("Vector3", *good.reference[row, :2], 0.0),
                vector("Vector3", 0.0, 0.0, good.reference[row, 2]),
            )
            write("/cmd_vel", now - 1e-3, twist)
            arm = state(header(t), ["arm_joint_1"], np.ones(1), np.ones(1), np.ones(1))
            write("/joint_states", now, arm)
            values = (position[row], good.wheel_velocity[row] * RAW, good.wheel_torque[row] * RAW)
            values = [np.concatenate([v, zeros]) for v in values]
            order = np.roll(np.arange(8), row % 8)  # joints are found by name
            base = state(header(t), [names[k] for k in order], *(v[order] for v in values))
            write("/joint_states", now, base)
            x, y, yaw = good.pose[row]
            turn = types["geometry_msgs/msg/Quaternion"](0.0, 0.0, np.sin(yaw / 2), np.cos(yaw / 2))
            pose = types["geometry_msgs/msg/Pose"](vector("Point", x, y, 0.0), turn)
            pose = types["geometry_msgs/msg/PoseWithCovariance"](pose, np.zeros(36))
            still = types["geometry_msgs/msg/TwistWithCovariance"](twist, np.zeros(36))
            odometry = types["nav_msgs/msg/Odometry"](header(t), "base_link", pose, still)
            write("/odom", now, odometry)
    return path


def write_traces(folder: Path, good: Log, names: list[str]) -> Path:
    for column, name in enumerate(names):
        values = np.full((len(good.time), 29), np.nan)
        values[:, 0] = (good.time - good.time[0]) * 1000 + 0.2 * column
        raw = RAW[column]
        values[:, 8] = raw * np.cumsum(good.wheel_velocity[:, column]) * good.dt
        values[:, 10] = raw * good.wheel_velocity[:, column]
        values[:, 13] = raw * good.wheel_torque[:, column]
        values[:, 15:] = 0
        place = folder / name
        place.mkdir(parents=True)
        (place / "ParametersAtBegin").write_text(f"Name: {name}\n")
        header = f"# Name: {name}\n# Firmware 1.48 \n# time [milliseconds] angle setpoint [rad] ..."
        rows = "\n".join(" ".join(f"{value:.9g}" for value in row) + " " for row in values)
        (place / "jointDataTrace").write_text(f"{header}\n{rows}\n")
    return folder
