"""From motion to a log: drive a plant along a reference, or record any rollout of an environment.

A log is a table of columns in SI units.  A row holds what the sensors show at its time and the
torque command given then, which is held until the next row.
"""

from __future__ import annotations

import io
import math
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING

import gymnasium as gym
import numpy as np

from youbot_env.backend import FLOAT
from youbot_env.channels import channel_columns
from youbot_env.model_file import write_atomically
from youbot_env.platform import Platform
from youbot_env.references import Reference
from youbot_env.simulation import AnalyticPlant, Sensors, WheelLoop
from youbot_env.simulation.sensors import IDEAL

if TYPE_CHECKING:  # MuJoCo is imported only where a plant with rollers is made
    from youbot_env.rollers import RollersPlant


class Recording:
    """Rows of a log under way.

    Attributes:
        platform: names the wheel columns.
        rows: one mapping a sample, with the keys of ``TrackingEnv.measurement``.
    """

    def __init__(self, platform: Platform):
        self.platform: Platform = platform
        self.rows: list[dict] = []

    def table(self, sensors: Sensors | None = None, seed: int | None = None) -> dict:
        """Columns by name, (N,) each.

        Args:
            sensors: noise and resolution of the channels; None records the rows as they are.
            seed: of the noise; each channel has a child of its own.

        Raises:
            ValueError: fewer than two rows.
        """
        if len(self.rows) < 2:
            raise ValueError(f"{len(self.rows)} rows were recorded; a log needs 2 or more")
        channels = {name: np.array([row[name] for row in self.rows]) for name in self.rows[0]}
        if sensors is not None:
            read = {
                "wheel_velocity": sensors.read_wheel_velocity,
                "wheel_torque": sensors.read_wheel_torque,
                "pose": sensors.read_pose,
            }
            children = np.random.SeedSequence(seed).spawn(len(read))
            for (channel, reader), child in zip(read.items(), children, strict=True):
                channels[channel] = reader(channels[channel], np.random.default_rng(child))
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
        self._recording = Recording(self.env.unwrapped.task.platform)
        return self.env.reset(**arguments)

    def step(self, action):
        """Step, and record what was measured before with the torque given then."""
        if self._recording is None:
            raise gym.error.ResetNeeded("call reset() before step()")
        row = self.env.unwrapped.measurement()
        result = self.env.step(action)
        row["wheel_torque"] = self.env.unwrapped.measurement()["wheel_torque"]
        self._recording.rows.append(row)
        return result

    def table(self, sensors: Sensors | None = None, seed: int | None = None) -> dict:
        """Columns of the log so far, see ``Recording.table``."""
        return (self._recording or Recording(self.env.unwrapped.task.platform)).table(sensors, seed)

    def save(
        self, path: str | os.PathLike, sensors: Sensors | None = None, seed: int | None = None
    ) -> Path:
        """Write the log so far as CSV, whole or not at all, and return the path."""
        return write_table(path, self.table(sensors, seed))


def record_motion(
    plant: AnalyticPlant | RollersPlant,
    reference: Reference,
    seconds: float,
    loop: WheelLoop | None = None,
    sensors: Sensors | None = None,
    seed: int | None = None,
    progress: Callable[[float], None] | None = None,
) -> dict:
    """Drive a plant along a reference by its wheel-speed loops and record a log.

    The loops see the wheel speeds as the sensors show them, as on the robot.  The plant starts at
    rest at the first pose of the reference.

    Args:
        plant: the robot; its ``dt`` is the sample time of loops and log.
        reference: the commanded motion.
        seconds: length of the log, s.
        loop: gains on board.
        sensors: noise of the record and of the loops; None for none.
        seed: of reference and noise.
        progress: called after every sample with the simulated time, s.

    Returns:
        Columns by name, (N,) each.

    Raises:
        ValueError: a length that is not at least two samples.
        FloatingPointError: the simulation left the finite numbers.
    """
    if not (math.isfinite(seconds) and round(seconds / plant.dt) >= 2):
        raise ValueError(f"seconds = {seconds}; a log lasts at least two samples of {plant.dt} s")
    loop, sensors, geometry = loop or WheelLoop(), sensors or IDEAL, plant.platform.geometry
    motion, *noises = np.random.SeedSequence(seed).spawn(4)
    speed_noise, torque_noise, pose_noise = map(np.random.default_rng, noises)
    values = reference.draw(np.random.default_rng(motion)).tolist()
    plant.reset(reference.evaluate(values, 0.0, FLOAT).pose)
    recording, integral = Recording(plant.platform), (0.0,) * len(plant.platform.wheels)
    for k in range(round(seconds / plant.dt)):
        t = k * plant.dt
        twist = reference.evaluate(values, t, FLOAT).twist(FLOAT)
        speed = sensors.read_wheel_velocity(plant.wheel_velocity, speed_noise)
        wanted = geometry.wheel_velocity(twist)
        torque, integral = loop.torque(wanted, tuple(speed.tolist()), integral, plant.dt, FLOAT)
        command = np.array(torque)
        row = {
            "time": t,
            "wheel_velocity": speed,
            "wheel_torque": sensors.read_wheel_torque(command, torque_noise),
            "pose": sensors.read_pose(plant.pose, pose_noise),
            "reference": np.array(twist),
        }
        if not np.isfinite(row["pose"]).all():
            raise FloatingPointError(
                f"the simulation diverged before t = {t:.3f} s; use a shorter sample time than "
                f"{plant.dt} s or smaller effects"
            )
        recording.rows.append(row)
        plant.step(command)
        if progress is not None:
            progress(t + plant.dt)
    return recording.table()


def write_table(
    path: str | os.PathLike, columns: dict, comments: Iterable[str] = (), decimals: int = 6
) -> Path:
    """Write a log as CSV, whole or not at all, and return the path.

    Args:
        path: of the file; folders are made.
        columns: by name, (N,) each, ``time`` first.
        comments: lines that precede the header, each behind a ``#``.
        decimals: digits after the point of all columns but time, which keeps ten digits.
    """
    # Adding zero turns the negative zeros that rounding leaves into plain ones.
    rows = np.round(np.column_stack(list(columns.values())), decimals) + 0.0
    rows[:, 0] = next(iter(columns.values()))
    text = io.StringIO()
    for comment in comments:
        text.writelines(f"# {line}\n" for line in comment.splitlines())
    text.write(",".join(columns) + "\n")
    np.savetxt(text, rows, fmt=["%.10g"] + [f"%.{decimals}f"] * (len(columns) - 1), delimiter=",")
    write_atomically(path, text.getvalue())
    return Path(path)
