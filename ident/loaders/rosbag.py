"""ROS 1 bags and ROS 2 bags (sqlite3, MCAP), read without ROS.

Wheels come from joint states, by name; the command from twists; the pose from pose messages, else
from odometry.  Everything is brought to the time stamps of the joint states.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
import yaml

from ident.loaders.base import Loader, Table, head, refuse
from ident.loaders.joint_states import JOINTS, JointStates
from ident.loaders.ros_messages import FIELDS, PREFERENCE
from youbot_env.platform import Platform
from youbot_env.strict_yaml import read_yaml

MAGIC = {b"#ROSBAG V": "ROS 1", b"\x89MCAP0\r\n": "MCAP", b"SQLite format 3": "sqlite3"}
CLOCK_TOLERANCE = 0.05  # s, between the clocks of two topics


@dataclass
class Topic:
    """Messages of one topic.

    Attributes:
        kind: message type.
        stamps: header stamps, s; zero or NaN where a message has none.
        received: time of reception, s.
        rows: values of each message.
    """

    kind: str
    stamps: list[float] = field(default_factory=list)
    received: list[float] = field(default_factory=list)
    rows: list[list[float]] = field(default_factory=list)


class RosbagLoader(Loader):
    """Bags of ROS 1 and ROS 2."""

    identifier = "rosbag"
    title = "ROS 1 or ROS 2 bag"

    def recognises(self, path: Path) -> bool:
        """First bytes of a bag, or a folder with the metadata of one."""
        if path.is_dir():
            return (path / "metadata.yaml").is_file()
        return path.is_file() and head(path, 16).startswith(tuple(MAGIC))

    def read(self, path: Path, platform: Platform) -> Table:
        """Collect the topics and bring them to one time."""
        topics, states = _collect(path)
        base = states.choose(platform)
        if base is None:
            joints = sorted({name for p in states.publishers for name in p.joints})
            what = f"joints {joints}" if joints else f"topics of known types: {sorted(topics)}"
            raise refuse(
                path,
                f"no joint states of {len(platform.wheels)} wheels; {what}",
                "bag",
                "record the joint states of the base",
            )
        chosen = states.publishers[base]
        received, stamps = np.array(chosen.received), np.array(chosen.stamps)
        time = stamps if np.all(stamps > 0) else received
        table = Table({"time": time}, np.arange(1, len(time) + 1), "message")
        table.names = {"time": "time"}
        if time is received:
            table.tell("joint states without header stamps", base.topic, "time of reception used")
        for other in states.rivals(base, platform):
            table.tell(
                f"two publishers of the same joints: {len(time)} messages of {base}; "
                f"{len(states.publishers[other].rows)} messages of {other}",
                other.topic,
                "the latter are left out; let one node alone publish the wheels",
            )
        states.fill(table, base, platform)
        shift = float(np.median(time - received))
        for name, topic in sorted(topics.items()):
            _resample(table, name, topic, time, shift)
        _name(table, topics)
        return table


def _collect(path: Path) -> tuple[dict[str, Topic], JointStates]:
    try:
        from rosbags.highlevel import AnyReader
        from rosbags.typesys import Stores, get_typestore
    except ImportError as error:
        raise refuse(
            path, "reading bags needs the package rosbags", "bag", "pip install rosbags"
        ) from error
    if path.is_dir():
        # The library's own reader of YAML writes aliases of aliases out, and does not end.
        try:
            read_yaml(path / "metadata.yaml")
        except (yaml.YAMLError, UnicodeDecodeError) as error:
            text = " ".join(str(error).split())[:200]
            remedy = "write it again (ros2 bag reindex)"
            raise refuse(path, f"damaged metadata ({text})", "metadata.yaml", remedy) from error
    topics: dict[str, Topic] = {}
    states = JointStates()
    try:
        store = get_typestore(Stores.ROS2_HUMBLE)
        with AnyReader([path], default_typestore=store) as reader:
            known = [c for c in reader.connections if c.msgtype in FIELDS or c.msgtype == JOINTS]
            for connection, stamp, raw in reader.messages(known) if known else ():
                message = reader.deserialize(raw, connection.msgtype)
                header = getattr(message, "header", None)
                seconds = header.stamp.sec + 1e-9 * header.stamp.nanosec if header else np.nan
                if connection.msgtype == JOINTS:
                    node = getattr(connection.ext, "callerid", None) or ""
                    states.add(connection.topic, node, message, seconds, stamp * 1e-9)
                    continue
                topic = topics.setdefault(connection.topic, Topic(connection.msgtype))
                topic.stamps.append(seconds)
                topic.received.append(stamp * 1e-9)
                topic.rows.append(FIELDS[connection.msgtype][1](message))
    # A damaged bag makes the library fail in many ways (struct, database, memory, its own).
    except Exception as error:
        raise refuse(
            path,
            f"damaged bag ({type(error).__name__}: {str(error)[:200]})",
            "bag",
            "copy it again, or repair it (rosbag reindex, ros2 bag reindex)",
        ) from error
    return topics, states


def _resample(table: Table, name: str, topic: Topic, time: np.ndarray, shift: float) -> None:
    """Bring a topic to the time of the joint states: commands are held, the rest interpolated."""
    fields, _, held, angle = FIELDS[topic.kind]
    received, stamps = np.array(topic.received) + shift, np.array(topic.stamps)
    own = received
    if np.all(stamps > 0):
        offset = float(np.median(stamps - received))
        if abs(offset) < CLOCK_TOLERANCE:
            own = stamps
        else:
            table.tell(f"its clock is off by {offset:.3f} s", name, "time of reception used")
    order = np.argsort(own, kind="stable")
    own, rows = own[order], np.array(topic.rows)[order]
    if angle is not None:
        rows[:, angle] = np.unwrap(rows[:, angle])
    if held:  # no command before the first: the robot stands
        index = np.searchsorted(own, time, side="right") - 1
        values = np.where(index[:, None] >= 0, rows[np.maximum(index, 0)], 0.0)
    else:
        columns = [np.interp(time, own, c, left=np.nan, right=np.nan) for c in rows.T]
        values = np.stack(columns, axis=1)
    for column, field_name in enumerate(fields):
        table.columns[f"{name}.{field_name}"] = values[:, column]


def _name(table: Table, topics: dict[str, Topic]) -> None:
    """Choose the topic of each channel: the preferred type, and names that say what they are."""
    for names, kinds, word in PREFERENCE:
        for kind in kinds:
            found = sorted(n for n, t in topics.items() if t.kind == kind)
            found.sort(key=lambda n: word not in n)
            if found:
                fields = FIELDS[kind][0]
                chosen = zip(names, fields, strict=True)
                table.names |= {log_name: f"{found[0]}.{f}" for log_name, f in chosen}
                break
