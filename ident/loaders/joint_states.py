"""Joint states of a bag: which publisher holds the wheels, and which joint is which wheel."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from ident.loaders.base import Table
from ident.loaders.wheel_names import match_wheels
from ident.loaders.youbot_driver import joint_name, sign
from youbot_env.platform import Platform

JOINTS = "sensor_msgs/msg/JointState"
# Fields of a message and the channels that they fill.
FIELDS = {"position": "wheel_position", "velocity": "wheel_velocity", "effort": "wheel_torque"}
WANTED = ("velocity", "effort", "position")  # first what is missed most


class Publisher(NamedTuple):
    """What tells publishers on one topic apart.

    Attributes:
        topic: name of the topic.
        node: name of the node; empty where the bag does not keep it.
        frame: ``frame_id`` of the headers.
        joints: names of the joints, sorted.
        fields: which of position, velocity and effort have values.
    """

    topic: str
    node: str
    frame: str
    joints: tuple[str, ...]
    fields: tuple[str, ...]

    def __str__(self) -> str:
        where = " ".join(filter(None, (self.node, self.frame and f"frame {self.frame!r}")))
        has = " and ".join(self.fields) or "no value at all"
        names = ", ".join(self.joints[:12]) + (", ..." if len(self.joints) > 12 else "")
        return f"{self.topic}{' from ' + where if where else ''}: {has} of {names}"


@dataclass
class States:
    """Messages of one publisher.

    Attributes:
        stamps: header stamps, s; zero where a message has none.
        received: time of reception, s.
        rows: positions, velocities and efforts, each in the order of the joints' names.
    """

    stamps: list[float] = field(default_factory=list)
    received: list[float] = field(default_factory=list)
    rows: list[np.ndarray] = field(default_factory=list)

    def shows(self, name: str, publisher: Publisher) -> bool:
        """Whether a field has other values than zeros, which some publishers fill in."""
        if name not in publisher.fields:
            return False
        count, place = len(publisher.joints), tuple(FIELDS).index(name)
        return any(row[place * count : (place + 1) * count].any() for row in self.rows)

    @property
    def steady(self) -> int:
        """How many different times the messages have."""
        return len(set(self.stamps if all(self.stamps) else self.received))


class JointStates:
    """All joint states of a bag, by publisher."""

    def __init__(self) -> None:
        self.publishers: dict[Publisher, States] = {}
        self._orders: dict[tuple[str, ...], np.ndarray] = {}

    def add(self, topic: str, node: str, message, stamp: float, received: float) -> None:
        """Take a message in; joints may stand in any order."""
        names = tuple(message.name)
        order = self._orders.get(names)
        if order is None:
            order = self._orders[names] = np.argsort(names, kind="stable")
        there = {name: np.asarray(getattr(message, name), float) for name in FIELDS}
        there = {
            name: v
            for name, v in there.items()
            if len(v) == len(names) and len(v) and not np.isnan(v).all()
        }
        joints = tuple(names[k] for k in order)
        publisher = Publisher(topic, node, message.header.frame_id, joints, tuple(there))
        states = self.publishers.setdefault(publisher, States())
        empty = np.full(len(names), np.nan)
        states.rows.append(np.concatenate([there.get(name, empty)[order] for name in FIELDS]))
        states.stamps.append(stamp)
        states.received.append(received)

    def choose(self, platform: Platform) -> Publisher | None:
        """The publisher of the wheels: with their names, speeds and efforts, and most messages.

        Where no names fit, one with speeds of enough joints, so that they can be mapped.
        """
        count = len(platform.wheels)
        usable = [p for p in self.publishers if len(p.joints) >= count and p.fields]

        def worth(publisher: Publisher) -> tuple:
            named = bool(match_wheels(publisher.joints, platform))
            states = self.publishers[publisher]
            return named, *(states.shows(name, publisher) for name in WANTED), states.steady

        return max(usable, key=worth, default=None)

    def rivals(self, chosen: Publisher, platform: Platform) -> list[Publisher]:
        """Other publishers of joints that the chosen one holds too."""
        held = set(match_wheels(chosen.joints, platform).values() or chosen.joints)
        return [p for p in self.publishers if p != chosen and held & set(p.joints)]

    def fill(self, table: Table, chosen: Publisher, platform: Platform) -> None:
        """Add position, velocity and effort of every joint, the wheels' under their log names.

        Positions of the stock youBot driver are in paper signs already, velocities and efforts are
        not; the doctor checks one against the other.
        """
        rows = np.array(self.publishers[chosen].rows)
        wheels = match_wheels(chosen.joints, platform)
        by_joint = {joint: wheel for wheel, joint in wheels.items()}
        driver = all(joint == joint_name(wheel) for wheel, joint in wheels.items())
        for place, (name, channel) in enumerate(FIELDS.items()):
            values = rows[:, place * len(chosen.joints) : (place + 1) * len(chosen.joints)]
            if name not in chosen.fields or (name == "effort" and not np.nan_to_num(values).any()):
                continue
            for column, joint in enumerate(chosen.joints):
                wheel = by_joint.get(joint)
                factor = sign(wheel, platform) if wheel and driver and name != "position" else 1.0
                full = f"{chosen.topic}.{name}.{joint}"
                table.columns[full] = factor * values[:, column]
                table.aliases[channel, joint] = full
                if wheel:
                    table.names[f"{channel}_{wheel}"] = full
        if not wheels:
            table.unnamed = chosen.joints
        if wheels and driver and {sign(wheel, platform) for wheel in wheels} != {1.0}:
            table.tell("signs of the youBot driver", chosen.topic, "turned into paper signs")
        if wheels and not driver:
            table.foreign = "joints " + ", ".join(wheels.values())
