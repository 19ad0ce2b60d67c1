"""From motion to a log: drive a plant along a reference, or record any rollout of an environment.

A log is a table of columns in SI units.  A row holds what the sensors show at its time and the torque
command given then, which is held until the next row.
"""

from __future__ import annotations

import os
from collections.abc import Callable
from pathlib import Path
from typing import Any

import gymnasium as gym
import numpy as np

from youbot_env.backend import FLOAT, NUMPY
from youbot_env.model_file import write_atomically
from youbot_env.platform import Platform
from youbot_env.references import Reference
from youbot_env.simulation import Sensors, WheelLoop

SINGLE_COLUMNS = {
    "body_velocity": ("body_velocity_x", "body_velocity_y", "yaw_rate"),
    "reference": ("reference_vx", "reference_vy", "reference_yaw_rate"),
    "pose": ("x", "y", "yaw"),
    "battery_voltage": ("battery_voltage",),
}
WHEEL_CHANNELS = ("wheel_velocity", "wheel_torque", "wheel_voltage")


def channel_columns(platform: Platform) -> dict[str, tuple[str, ...]]:
    """Column names of every channel of a log for a platform."""
    wheels = {
        channel: tuple(f"{channel}_{name}" for name in platform.wheel_names)
        for channel in WHEEL_CHANNELS
    }
    return wheels | SINGLE_COLUMNS


class Recording:
    """Rows of a log under way.

    Attributes:
        platform: names the wheel columns.
        rows: one mapping a sample, with the keys of ``TrackingEnv.measurement``.
    """

    def __init__(self, platform: Platform):
        self.platform, self.rows = platform, []

    def table(self, sensors: Sensors | None = None, seed: int | None = None) -> dict:
        """Columns by name, (N,) each.

        Args:
            sensors: noise and resolution of the channels; None records the truth.
            seed: of the noise; each channel has a child of its own.

        Raises:
            ValueError: fewer than two rows.
        """
        if len(self.rows) < 2:
            raise ValueError(f"{len(self.rows)} rows were recorded; step the environment first")
        channels = {name: np.array([row[name] for row in self.rows]) for name in self.rows[0]}
        if sensors is not None:
            children = np.random.SeedSequence(seed).spawn(3)
            wheel, torque, pose = (np.random.default_rng(child) for child in children)
            channels["wheel_velocity"] = sensors.read_wheel_velocity(
                channels["wheel_velocity"], wheel
            )
            channels["wheel_torque"] = sensors.read_wheel_torque(channels["wheel_torque"], torque)
            channels["pose"] = sensors.read_pose(channels["pose"], pose)
        columns = {"time": channels.pop("time")}
        names = channel_columns(self.platform)
        for channel, values in channels.items():
            columns |= dict(zip(names[channel], values.T, strict=True))
        return columns


class RecordLog(gym.Wrapper):
    """Record the current episode of a youBot environment, whoever drives it.

    >>> env = RecordLog(gym.make("YouBot-v0"))        # any policy, either plant
    >>> ...                                           # one episode
    >>> env.save("logs/mine.csv", sensors=Sensors(), seed=1)
    """

    def __init__(self, env: gym.Env):
        super().__init__(env)
        if not hasattr(env.unwrapped, "measurement"):
            raise ValueError(f"{env} has no measurements to record; use a youBot environment")
        self._recording: Recording | None = None

    def reset(self, **arguments):
        """Start a new episode and a new recording."""
        result = self.env.reset(**arguments)
        self._recording = Recording(self.env.unwrapped.task.platform)
        return result

    def step(self, action):
        """Step, and record what was measured before with the torque given then."""
        row = self.env.unwrapped.measurement()
        result = self.env.step(action)
        row["wheel_torque"] = self.env.unwrapped.measurement()["wheel_torque"]
        if self._recording is not None:
            self._recording.rows.append(row)
        return result

    def table(self, sensors: Sensors | None = None, seed: int | None = None) -> dict:
        """Columns of the log so far, see ``Recording.table``."""
        return (self._recording or Recording(self.env.unwrapped.task.platform)).table(sensors, seed)

    def save(self, path, sensors: Sensors | None = None, seed: int | None = None) -> Path:
        """Write the log so far as CSV, whole or not at all."""
        return write_table(path, self.table(sensors, seed))


def record_motion(
    plant: Any,
    reference: Reference,
    seconds: float,
    loop: WheelLoop | None = None,
    sensors: Sensors | None = None,
    seed: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> dict:
    """Drive a plant along a reference by its wheel-speed loops and record a log.

    The loops see the wheel speeds as the sensors show them, as on the robot.

    Args:
        plant: ``AnalyticPlant`` or ``RollersPlant``.
        reference: the commanded motion.
        seconds: length of the log, s.
        loop: gains on board.
        sensors: noise of the record and of the loops; None for none.
        seed: of reference and noise.
        progress: called with the simulated time, s.

    Returns:
        Columns by name, (N,) each.
    """
    children = np.random.SeedSequence(seed).spawn(2)
    values = reference.draw(np.random.default_rng(children[0])).tolist()
    noise, late = (np.random.default_rng(child) for child in children[1].spawn(2))
    loop, geometry = loop or WheelLoop(), plant.platform.geometry
    first = reference.evaluate(values, 0.0, FLOAT)
    plant.reset(first.pose)
    recording, integral = Recording(plant.platform), (0.0,) * len(plant.platform.wheels)
    for k in range(round(seconds / plant.dt)):
        t = k * plant.dt
        twist = reference.evaluate(values, t, FLOAT).twist(FLOAT)
        speed = plant.wheel_velocity
        if sensors is not None:
            speed = sensors.read_wheel_velocity(speed, noise)
        torque, integral = loop.torque(
            geometry.wheel_velocity(twist), tuple(speed.tolist()), integral, plant.dt, FLOAT
        )
        shown = np.array(torque)
        pose = plant.pose
        if sensors is not None:
            shown, pose = sensors.read_wheel_torque(shown, late), sensors.read_pose(pose, late)
        recording.rows.append(
            {"time": t, "wheel_velocity": speed, "wheel_torque": shown, "pose": pose,
             "reference": np.array(twist)}
        )  # fmt: skip
        plant.step(np.array(torque))
        if progress is not None:
            progress(t)
    return recording.table()


def write_table(path: str | os.PathLike, columns: dict, comments: tuple[str, ...] = ()) -> Path:
    """Write columns (N,) by name as CSV with ``#`` comments, whole or not at all."""
    lines = [f"# {comment}" for comment in comments] + [",".join(columns)]
    for row in np.column_stack(list(columns.values())):
        lines.append(",".join(f"{value:.6g}" for value in row))
    # Time needs all its digits: six would repeat stamps after a thousand seconds.
    times = columns["time"]
    start = len(comments) + 1
    for k, time in enumerate(times):
        lines[start + k] = f"{time:.6f}," + lines[start + k].split(",", 1)[1]
    write_atomically(path, "\n".join(lines) + "\n")
    return Path(path)
