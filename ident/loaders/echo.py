"""Tables of ``rostopic echo -p`` on joint states: ``field.name0``, ``field.velocity0``, ..."""

from __future__ import annotations

import re

import polars as pl

from ident.loaders.base import Table
from ident.loaders.joint_states import FIELDS
from ident.loaders.wheel_names import match_wheels
from youbot_env.platform import Platform

NAME = re.compile(r"^(.*\b)name(\d+)$")


def name_joints(table: Table, platform: Platform) -> None:
    """Let columns of numbered joints go by the joints' names, where the table holds these."""
    joints: dict[str, tuple[str, str]] = {}
    for column, cells in table.columns.items():
        match = NAME.match(column)
        if match and isinstance(cells, pl.Series) and cells.dtype == pl.String:
            named = cells.drop_nulls().unique()
            if len(named) == 1:
                joints[str(named[0]).strip("\"' ")] = match.groups()
    wheels = match_wheels(joints, platform)
    by_joint = {joint: wheel for wheel, joint in wheels.items()}
    for joint, (stem, number) in joints.items():
        for name, channel in FIELDS.items():
            column = f"{stem}{name}{number}"
            if column in table.columns:
                table.aliases[channel, joint] = column
                if joint in by_joint:
                    table.names.setdefault(f"{channel}_{by_joint[joint]}", column)
    if joints and not wheels:
        table.unnamed = tuple(joints)
