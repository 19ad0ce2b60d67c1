"""Records of robots with real rollers; what they do beyond the equations is their own secret."""

from __future__ import annotations

import numpy as np

from ident.benchmark.conditions import Conditions
from ident.benchmark.robots import draw_robots
from ident.log import Log
from youbot_env.channels import channel_columns
from youbot_env.model import Model
from youbot_env.recording import record_motion
from youbot_env.references import Reference
from youbot_env.rollers import RollersPlant
from youbot_env.simulation import Sensors

RATE = 100.0
CHANNELS = ("wheel_velocity", "wheel_torque", "pose", "reference")


def draw_rolling_robot(seed: np.random.SeedSequence) -> Model:
    """First robot drawn whose parameters bodies with real wheels can have."""
    for robot in draw_robots(50, seed):
        try:
            RollersPlant(robot, 1 / RATE)
        except ValueError:
            continue
        return robot
    raise ValueError("none of 50 robots can be built with real wheels; widen the draw")


def record_rolling(
    name: str,
    robot: Model,
    motion: Reference,
    seconds: float,
    seed: np.random.SeedSequence,
    conditions: Conditions,
) -> Log:
    """Drive a robot with real rollers and return what its sensors show."""
    plant, number = RollersPlant(robot, 1 / conditions.rate), int(seed.generate_state(1)[0])
    columns = record_motion(
        plant, motion, seconds, None, Sensors(), number, **conditions.rows(robot)
    )
    names = channel_columns(robot.platform)
    channels = {
        channel: np.column_stack([columns[column] for column in names[channel]])
        for channel in CHANNELS
    }
    return Log(name, robot.platform, columns["time"], **channels)
