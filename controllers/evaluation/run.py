"""Drives robots along motions and measures."""

from __future__ import annotations

import time
from collections.abc import Callable, Iterable
from dataclasses import dataclass
from typing import Any

import gymnasium as gym
import numpy as np

import youbot_env
from controllers import make
from controllers.base import Controller
from controllers.evaluation.motions import SETTLE, Motion
from controllers.evaluation.subjects import PLANTS, Subject
from youbot_env.envs.task import LOST_DISTANCE, LOST_YAW
from youbot_env.simulation import Sensors

gym.register_envs(youbot_env)

# Speeds that the driver of the robot allows would end the kinematic controller's part of the
# comparison at 1.6 rad/s of yaw.
SETTINGS = {"kinematic": {"speed_limit": 2.0, "yaw_rate_limit": 8.0}}
# Share of the torque limit from which a wheel counts as saturated.
SATURATED = 0.99


@dataclass(frozen=True)
class Trace:
    """What a run leaves, one row a control period after ``SETTLE``.

    Attributes:
        error: (N, 3) true pose less that of the reference, world frame, m, m, rad.
        torque: (N, n) commands, N m.
        seconds: (N,) time of ``predict`` on its core, s; other processes do not count.
        lost: whether the robot lost its reference; the rows end there.
    """

    error: np.ndarray
    torque: np.ndarray
    seconds: np.ndarray
    lost: bool


@dataclass(frozen=True)
class Run:
    """One run in numbers; a lost one counts with the error at which it counts as lost.

    Attributes:
        plant, robot, controller, model, reference, frequency: what ran.
        position: rms distance to the reference, m.
        heading: rms yaw error, rad.
        velocity: rms velocity of the position error, m/s.
        yaw_rate: rms rate of the yaw error, rad/s.
        effort: rms torque of a wheel, N m.
        saturation: share of wheels and periods at the torque limit.
        solve_median, solve_p99: time of ``predict`` on its core, s.
        fallbacks: periods in which a solver failed and a safe law took over.
        lost: whether the robot lost its reference.
    """

    plant: str
    robot: int
    controller: str
    model: str
    reference: str
    frequency: float
    position: float
    heading: float
    velocity: float
    yaw_rate: float
    effort: float
    saturation: float
    solve_median: float
    solve_p99: float
    fallbacks: int
    lost: bool


def run_all(
    subject: Subject,
    controller: str,
    model: str,
    motions: Iterable[Motion],
    sensors: Sensors | None = None,
) -> list[Run]:
    """Drive one robot along motions with one controller.

    Args:
        subject: the robot.
        controller: name for ``controllers.make``.
        model: name of what it believes, see ``Subject.model``.
        motions: what to follow.
        sensors: noise of the observation; None observes exactly.
    """
    driver = make(controller, subject.model(model), **SETTINGS.get(controller, {}))
    env = make_env(subject, driver, sensors)
    runs = []
    for motion in motions:
        before = _fallbacks(driver)
        trace = drive(driver, env, motion, subject.seed)
        limit, dt = driver.settings.torque_limit, driver.settings.dt
        figures = measure(trace, dt, limit, motion.speed)
        runs.append(
            Run(
                subject.plant, subject.number, controller, model, motion.name, motion.frequency,
                **figures, fallbacks=_fallbacks(driver) - before, lost=trace.lost,
            )
        )  # fmt: skip
    env.close()
    return runs


def make_env(
    subject: Subject, controller: Controller, sensors: Sensors | None = None, **options
) -> gym.Env:
    """The environment in which a controller drives a robot."""
    return gym.make(
        PLANTS[subject.plant],
        model=subject.truth,
        sensors=sensors,
        max_episode_steps=1_000_000,
        **controller.env_kwargs,
        **options,
    )


def drive(
    controller: Controller,
    env: gym.Env,
    motion: Motion,
    seed: int,
    watch: Callable[[gym.Env], None] | None = None,
) -> Trace:
    """Run one episode from the reference's own pose and velocity.

    Args:
        controller: what drives.
        env: what ``make_env`` made for it.
        motion: what is followed.
        seed: of reference and noise.
        watch: called with the environment after every measured period.
    """
    options = {"offset": (0.0, 0.0, 0.0), "follow": True, "reference": motion.reference}
    seen, info = env.reset(seed=seed, options=options)
    robot: Any = env.unwrapped
    dt = controller.settings.dt
    first, last = (round(t / dt) for t in (SETTLE, SETTLE + motion.seconds))
    errors, torques, seconds, state, lost = [], [], [], None, False
    for step in range(last):
        began = time.thread_time()
        action, state = controller.predict(
            seen, state, np.array([step == 0]), wheel_angle=robot.wheel_angle
        )
        took = time.thread_time() - began
        seen, _, lost, _, info = env.step(action)
        if step >= first or lost:
            errors.append(info["pose"] - info["reference_pose"])
            torques.append(info["torque"])
            seconds.append(took)
            if watch is not None:
                watch(env)
        if lost:
            break
    return Trace(np.array(errors), np.array(torques), np.array(seconds), bool(lost))


def measure(trace: Trace, dt: float, torque_limit: float, speed: float) -> dict[str, float]:
    """Figures of ``Run`` from a trace."""
    torque = np.abs(trace.torque)
    figures = {
        "effort": _rms(torque.ravel()),
        "saturation": float(np.mean(torque >= SATURATED * torque_limit)),
        "solve_median": float(np.median(trace.seconds)),
        "solve_p99": float(np.percentile(trace.seconds, 99)),
    }
    if trace.lost:
        lost = {"position": LOST_DISTANCE, "heading": LOST_YAW, "velocity": speed}
        return figures | lost | {"yaw_rate": LOST_YAW}
    rate = np.diff(trace.error, axis=0) / dt
    return figures | {
        "position": _rms(np.hypot(*trace.error[:, :2].T)),
        "heading": _rms(trace.error[:, 2]),
        "velocity": _rms(np.hypot(*rate[:, :2].T)),
        "yaw_rate": _rms(rate[:, 2]),
    }


def _rms(values: np.ndarray) -> float:
    return float(np.sqrt(np.mean(values**2)))


def _fallbacks(controller: Controller) -> int:
    """Failed solves so far; controllers without a solver have none."""
    return getattr(controller, "counts", {}).get("fallback", 0)
