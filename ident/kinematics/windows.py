"""Odometry over short windows against the measured pose, with exact derivatives.

In every window the robot starts at an unknown pose, which is eliminated; what counts is how far it
came.  All samples of a window are used, and the noise of the wheel speeds has no time to add up.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from ident.decimate import decimated
from ident.log import Log

# Pose and wheel clocks may differ by this much, s; windows keep the distance from gaps and ends.
LONGEST_DELAY = 0.3
# Samples closer than the first, s, are averaged over about the second: a motion of a robot has
# nothing to show in between.
DENSE, THINNED = 4e-3, 8e-3
MOUNT = ("offset_x", "offset_y", "offset_yaw", "delay")
TURN = np.array([[0.0, -1.0], [1.0, 0.0]])  # a quarter turn, counter-clockwise


class Odometry(NamedTuple):
    """Motion since the start of each window, in the body frame of that start.

    Attributes:
        yaw: (W, K) rad; place: (W, K, 2) m.
        velocity: (W, K, 3) body velocities.
        yaw_slope: (W, K, n) derivatives of yaw by the third row of W (the wheel angles).
        place_slope: (W, K, 2, 3, n) derivatives of place by the entries of W.
    """

    yaw: np.ndarray
    place: np.ndarray
    velocity: np.ndarray
    yaw_slope: np.ndarray | None
    place_slope: np.ndarray | None


def integrate(
    step: np.ndarray, speed: np.ndarray, odometry: np.ndarray, slopes: bool = True
) -> Odometry:
    """Integrate wheel speeds that run straight from sample to sample.

    Args:
        step: (W, K - 1) time between samples, s.
        speed: (W, K, n) wheel speeds, rad/s.
        odometry: (3, n) matrix W of ``v = W phi'``.
        slopes: whether derivatives are wanted.

    The heading half way through a step stands for the step: an error of (Omega dt)^2 / 24.
    """
    velocity = speed @ odometry.T
    turned = 0.5 * (speed[:, 1:] + speed[:, :-1]) * step[..., None]
    moved = turned @ odometry.T
    yaw = _sums(moved[..., 2])
    rotation = rotate(0.5 * (yaw[:, 1:] + yaw[:, :-1]))
    shift = np.einsum("wkab,wkb->wka", rotation, moved[..., :2])
    place = _sums(shift)
    if not slopes:
        return Odometry(yaw, place, velocity, None, None)
    angle = _sums(turned)
    middle = 0.5 * (angle[:, 1:] + angle[:, :-1])
    along = np.einsum("wkab,wkj->wkabj", rotation, turned)
    about = np.einsum("ab,wkb,wkj->wkaj", TURN, shift, middle)
    place_slope = _sums(np.concatenate([along, about[:, :, :, None]], axis=3))
    return Odometry(yaw, place, velocity, angle, place_slope)


def rotate(angle: np.ndarray) -> np.ndarray:
    """Rotation matrices (..., 2, 2) from a frame turned by ``angle`` into the fixed one."""
    c, s = np.cos(angle), np.sin(angle)
    return np.stack([np.stack([c, -s], axis=-1), np.stack([s, c], axis=-1)], axis=-2)


def _sums(parts: np.ndarray) -> np.ndarray:
    """Running sums along the samples, from zero."""
    return np.concatenate([np.zeros_like(parts[:, :1]), np.cumsum(parts, axis=1)], axis=1)


@dataclass(frozen=True)
class Windows:
    """A log cut into W windows of K samples each.

    Attributes:
        time: (W, K) s; pose: (W, K, 3) m, m, rad.
        fresh: (W, K) whether the pose is new, not the last one held.
        piece: (W,) number of the contiguous piece, ascending.
        run: (W,) number of the log, of several that were joined.
        source: time and wheel speeds of each piece.
    """

    time: np.ndarray
    pose: np.ndarray
    fresh: np.ndarray
    piece: np.ndarray
    run: np.ndarray
    source: tuple[tuple[np.ndarray, np.ndarray], ...]

    def speed(self, delay: float) -> np.ndarray:
        """(W, K, n) wheel speeds ``delay`` seconds before each pose's time stamp, rad/s."""
        speed = np.empty((*self.time.shape, self.source[0][1].shape[1]))
        ends = np.searchsorted(self.piece, np.arange(len(self.source) + 1))
        for number, (time, measured) in enumerate(self.source):
            here = slice(ends[number], ends[number + 1])
            late = self.time[here] - delay
            for wheel in range(measured.shape[1]):
                speed[here, :, wheel] = np.interp(late, time, measured[:, wheel])
        return speed

    def of_run(self, number: int) -> Windows:
        """The windows of one log."""
        here = np.flatnonzero(self.run == number)
        first, last = self.piece[here[0]], self.piece[here[-1]]
        return Windows(
            self.time[here], self.pose[here], self.fresh[here], self.piece[here] - first,
            self.run[here], self.source[first : last + 1],
        )  # fmt: skip

    def residual(self, odometry: np.ndarray, mount: np.ndarray, slopes: bool = True):
        """Measured pose less odometry at a mount, in the frame of each window's start.

        Args:
            odometry: (3, n) matrix W.
            mount: offset_x, offset_y m, offset_yaw rad, delay s.
            slopes: whether derivatives are wanted.

        Returns:
            ``(residual (W, K, 3) m, m, rad, slopes (W, K, 3, 3 n + 4), nuisance (W, K, 3))``: the
            derivatives are those of the odometry by W and the mount, and by the heading at the
            start of the window.
        """
        offset, turn, delay = mount[:2], mount[2], mount[3]
        speed = self.speed(delay)
        way = integrate(np.diff(self.time, axis=1), speed, odometry, slopes)
        heading = self._mean(self.pose[..., 2] - way.yaw)
        arm = rotate(way.yaw) @ offset
        there = way.place + arm
        back = rotate(turn - heading)
        seen = np.einsum("wab,wkb->wka", back, self.pose[..., :2])
        residual = np.empty(self.pose.shape)
        residual[..., :2] = seen - there
        residual[..., :2] -= self._mean(residual[..., :2])[:, None]
        residual[..., 2] = self.pose[..., 2] - heading[:, None] - way.yaw
        if not slopes:
            return residual, None, None
        count = odometry.shape[1]
        design = np.zeros((*self.pose.shape, 3 * count + 4))
        place = way.place_slope.reshape(*self.time.shape, 2, 3 * count)
        design[..., :2, : 3 * count] = place
        armed = (arm @ TURN.T)[..., None] * way.yaw_slope[:, :, None]
        design[..., :2, 2 * count : 3 * count] += armed
        design[..., 2, 2 * count : 3 * count] = way.yaw_slope
        design[..., :2, 3 * count : 3 * count + 2] = rotate(way.yaw)
        swing = there @ TURN.T  # what turning the start of the window does
        design[..., :2, 3 * count + 2] = -swing
        drift = way.velocity[..., :2] + way.velocity[..., 2:] * (TURN @ offset)
        design[..., :2, 3 * count + 3] = -np.einsum("wkab,wkb->wka", rotate(way.yaw), drift)
        design[..., 2, 3 * count + 3] = -way.velocity[..., 2]
        nuisance = np.concatenate([swing, np.ones((*self.time.shape, 1))], axis=-1)
        for part in (design[..., :2, :], nuisance[..., :2]):
            part -= self._mean(part)[:, None]
        return residual, design, nuisance

    def _mean(self, values: np.ndarray) -> np.ndarray:
        """Mean over the fresh samples of each window."""
        weight = self.fresh / self.fresh.sum(axis=1, keepdims=True)
        return np.einsum("wk,wk...->w...", weight, values)


def cut_windows(log: Log, seconds: float | None) -> Windows:
    """Cut a log with wheel speeds and pose into windows.

    Args:
        log: the log.
        seconds: length of a window, s; None takes the longest contiguous piece whole.

    Raises:
        ValueError: wheel speeds or pose are missing, or no contiguous piece is long enough.
    """
    require_channels(log)
    pieces, index, numbers, begin = log.pieces(), [], [], 0
    longest = max(piece.duration for piece in pieces)
    for number, piece in enumerate(pieces):
        time = piece.time
        first = int(np.searchsorted(time, time[0] + LONGEST_DELAY))
        last = int(np.searchsorted(time, time[-1] - LONGEST_DELAY, side="right"))
        length = last - first if seconds is None else max(3, round(seconds / log.dt) + 1)
        starts = range(first, last - length + 1, max(length - 1, 1))
        if seconds is None and (index or length < 3 or piece.duration < longest):
            starts = range(0)
        index += [begin + start + np.arange(length) for start in starts]
        numbers += [number] * len(starts)
        begin += len(time)
    if not index:
        raise ValueError(
            f"log {log.name!r} lasts {log.duration:.3g} s and has no contiguous piece of "
            f"{(seconds or 0.0) + 2 * LONGEST_DELAY:.3g} s; record longer without gaps"
        )
    rows, pose = np.array(index), log.pose.copy()
    pose[:, 2] = np.unwrap(pose[:, 2])
    changed = np.append(True, np.any(np.diff(pose, axis=0) != 0.0, axis=1))
    fresh = changed[rows]
    fresh[fresh.sum(axis=1) < 3] = True  # at rest without noise a pose may well stay the same
    source = tuple((piece.time, piece.wheel_velocity) for piece in pieces)
    runs = log.run_of(log.time[rows[:, 0]])
    return Windows(log.time[rows], pose[rows], fresh, np.array(numbers), runs, source)


def sparse(log: Log) -> Log:
    """The log with means over about 8 ms in place of its samples, where these are denser than 4 ms.

    Raises:
        ValueError: a channel that is needed is missing.
    """
    require_channels(log)
    return log if log.dt > DENSE else decimated(log, THINNED)


def require_channels(log: Log) -> None:
    """Refuse a log without wheel speeds or an independent pose.

    Raises:
        ValueError: says which is missing.
    """
    if log.wheel_velocity is None:
        raise ValueError(
            f"log {log.name!r} has no wheel speeds (wheel_velocity_*); kinematic calibration "
            "compares wheels with the pose, and body velocities cannot stand for them"
        )
    if log.pose is None and any(f.name == "wheel_odometry" for f in log.findings):
        raise ValueError(
            f"the pose of log {log.name!r} was computed from its wheel speeds and says nothing "
            "about the robot; kinematic calibration needs one measured independently of the "
            "wheels, by motion capture or lidar"
        )
    if log.pose is None:
        raise ValueError(
            f"log {log.name!r} has no pose (x, y, yaw); kinematic calibration needs one measured "
            "independently of the wheels, by motion capture or lidar"
        )
