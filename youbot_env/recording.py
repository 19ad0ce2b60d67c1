"""From motion to a log: drive a plant along a reference, or record any rollout of an environment.

A log is a table of columns in SI units.  A row holds what the sensors show at its time and the
torque command given then.  Where the wheel loops run at the log's rate that command is held until
the next row; faster loops change it in between, and a row may then hold its mean instead.
"""

from __future__ import annotations

import io
import math
import os
from collections.abc import Callable, Iterable
from pathlib import Path
from typing import TYPE_CHECKING, Any

import gymnasium as gym
import numpy as np

from youbot_env.backend import FLOAT, NUMPY
from youbot_env.channels import channel_columns
from youbot_env.model_file import write_atomically
from youbot_env.platform import Platform
from youbot_env.references import Reference
from youbot_env.references.eased import EASE_IN, Eased
from youbot_env.simulation import (
    IDEAL,
    AnalyticPlant,
    Instrument,
    LoopInstants,
    Sensors,
    WheelLoop,
    pick_rows,
)

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
        return _columns(self.platform, channels)


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
        self._robot: Any = env.unwrapped
        self._recording: Recording | None = None

    def reset(self, **arguments):
        """Start a new episode and a new recording."""
        self._recording = Recording(self._robot.task.platform)
        return self.env.reset(**arguments)

    def step(self, action):
        """Step, and record what was measured before with the torque given then."""
        if self._recording is None:
            raise gym.error.ResetNeeded("call reset() before step()")
        row = self._robot.measurement()
        result = self.env.step(action)
        row["wheel_torque"] = self._robot.measurement()["wheel_torque"]
        self._recording.rows.append(row)
        return result

    def table(self, sensors: Sensors | None = None, seed: int | None = None) -> dict:
        """Columns of the log so far, see ``Recording.table``."""
        return (self._recording or Recording(self._robot.task.platform)).table(sensors, seed)

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
    loop_rate: float | None = None,
    row: str = "sampled",
    instrument: Instrument | None = None,
    ease: float = EASE_IN,
) -> dict:
    """Drive a plant along a reference by its wheel-speed loops and record a log.

    The loops see the wheel speeds as the sensors show them, as on the robot, and a row holds the
    very reading that the loops had at its instant.  The plant starts at rest at the first pose of
    the reference.

    Args:
        plant: the robot; its ``dt`` is the time between rows, s.  Where the loops are faster, a
            robot like it is driven.
        reference: the commanded motion, which is eased in from rest.
        seconds: length of the log, s.
        loop: gains on board.
        sensors: noise of the record and of the loops; None for none.
        seed: of reference and noise.
        progress: called after every row with the simulated time, s.
        loop_rate: rate of the loops, Hz; a row takes the nearest whole number of loop steps.  None:
            one, so that the torque of a row is held until the next.
        row: ``sampled`` or ``averaged`` torque, see ``simulation.rows.pick_rows``.
        instrument: changes the channels at the loop instants before rows are picked, see there.
        ease: how long the reference takes to come up to speed, s.

    Returns:
        Columns by name, (N,) each.

    Raises:
        ValueError: a length that is not at least two samples, or loops slower than the log.
        FloatingPointError: the simulation left the finite numbers.
    """
    if not (math.isfinite(seconds) and round(seconds / plant.dt) >= 2):
        raise ValueError(f"seconds = {seconds}; a log lasts at least two samples of {plant.dt} s")
    sensors, platform, sample = sensors or IDEAL, plant.platform, plant.dt
    motion, *noises = np.random.SeedSequence(seed).spawn(5)
    speed_noise, torque_noise, pose_noise, body_noise = map(np.random.default_rng, noises)
    at = LoopInstants.of(np.arange(round(seconds / sample)) * sample, loop_rate)
    per_row = int(at.row[1])
    if per_row > 1:
        try:
            plant = plant.sampled(sample / per_row)
        except ValueError as error:
            raise ValueError(
                f"loops at {loop_rate:g} Hz, {per_row} steps a row of {sample:g} s: {error}"
            ) from error
    eased = Eased(of=reference, seconds=ease)
    values = eased.draw(np.random.default_rng(motion)).tolist()
    twist = eased.evaluate(values, at.time, NUMPY).twist(NUMPY)
    twist = np.column_stack(np.broadcast_arrays(*twist, at.time)[:3])
    loop, integral = loop or WheelLoop(), (0.0,) * len(platform.wheels)
    speed, command = (np.empty((len(twist), len(integral))) for _ in range(2))
    moved = np.empty((len(twist), 6))
    plant.reset(eased.evaluate(values, 0.0, FLOAT).pose)
    set_points = np.column_stack(platform.geometry.wheel_velocity(tuple(twist.T)))
    for k, wanted in enumerate(set_points.tolist()):
        speed[k] = sensors.read_wheel_velocity(plant.wheel_velocity, speed_noise)
        moved[k] = plant.motion()
        torque, integral = loop.torque(wanted, tuple(speed[k].tolist()), integral, plant.dt, FLOAT)
        command[k] = torque
        plant.step(command[k])
        if k % per_row:
            continue
        if not np.isfinite(moved[k]).all():
            raise FloatingPointError(
                f"the simulation diverged before t = {at.time[k]:.3f} s; use a shorter sample time "
                f"than {plant.dt:g} s or smaller effects"
            )
        if progress is not None:
            progress(at.time[k] + sample)
    dense = {
        "time": at.time,
        "wheel_velocity": speed,
        "wheel_torque": command,
        "pose": moved[:, :3],
        "velocity": moved[:, 3:],
        "reference": twist,
    }
    rows = pick_rows(dense, at.row, row, instrument)
    rows["wheel_torque"] = sensors.read_wheel_torque(rows["wheel_torque"], torque_noise)
    rows["pose"] = sensors.read_pose(rows["pose"], pose_noise)
    if "body_velocity" in rows:
        rows["body_velocity"] = sensors.read_body_velocity(rows["body_velocity"], body_noise)
    return _columns(platform, rows)


def _columns(platform: Platform, channels: dict) -> dict:
    """Columns by name, ``time`` first, of channels (N, ...)."""
    columns, names = {"time": channels["time"]}, channel_columns(platform)
    for channel, values in channels.items():
        if channel != "time":
            columns |= dict(zip(names[channel], values.T, strict=True))
    return columns


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
