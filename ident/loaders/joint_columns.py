"""Tables of joint states: numbered, as ``rostopic echo -p`` writes them, or a column a joint.

``field.name0`` says which joint ``field.velocity0`` is; ``/joint_states/front_left_wheel/velocity``
and ``vel_fl`` say so themselves.
"""

from __future__ import annotations

import re

import polars as pl

from ident.doctor.columns import log_name
from ident.loaders.base import Table
from ident.loaders.joint_states import FIELDS
from ident.loaders.wheel_names import match_wheels, words_of
from ident.loaders.youbot_driver import joint_name
from youbot_env.channels import channel_columns
from youbot_env.platform import Platform

NAME = re.compile(r"^(.*\b)name(\d+)$")
# Words that say what a column of a joint holds.
CHANNELS = {
    "wheel_velocity": {"velocity", "vel", "speed"},
    "wheel_position": {"position", "pos", "angle"},
    "wheel_torque": {"effort", "torque"},
    "wheel_current": {"current", "cur"},
    "wheel_voltage": {"voltage", "volt"},
    "wheel_duty": {"duty", "pwm", "power"},
}
# A command, a set value or an error of one is no measurement.
COMMANDS = {"set", "cmd", "command", "commanded", "desired", "target", "ref", "reference", "error"}


def name_joints(table: Table, platform: Platform) -> None:
    """Say which columns are those of the wheels, where their names or the table tell."""
    joints, known = _numbered(table), channel_columns(platform)
    own = {log_name(column, platform) for column in table.columns}
    for channel, words in CHANNELS.items():
        if own & set(known[channel]):
            continue  # names of a log go before
        found = {
            column: joint
            for (of, joint), column in table.aliases.items()
            if of == channel and joint in joints
        }
        if not found:
            found = {
                column: column
                for column in table.columns
                if words & set(words_of(column)) and not COMMANDS & set(words_of(column))
            }
        columns = {joint: column for column, joint in found.items()}
        wheels = match_wheels(columns, platform)
        for wheel, joint in wheels.items():
            table.names.setdefault(f"{channel}_{wheel}", columns[joint])
            if joint != joint_name(wheel):
                table.foreign = f"columns of {channel}: {', '.join(wheels.values())}"
    if joints and not any(name.startswith("wheel_") for name in table.names):
        table.unnamed = tuple(joints)


def _numbered(table: Table) -> list[str]:
    """Joints that a table numbers; their columns go by the joints' names."""
    joints = []
    for column, cells in list(table.columns.items()):
        match = NAME.match(column)
        if not (match and isinstance(cells, pl.Series) and cells.dtype == pl.String):
            continue
        named = cells.drop_nulls().unique()
        if len(named) != 1:
            continue
        joint = str(named[0]).strip("\"' ")
        joints.append(joint)
        for name, channel in FIELDS.items():
            if (full := f"{match[1]}{name}{match[2]}") in table.columns:
                table.aliases[channel, joint] = full
    return joints
