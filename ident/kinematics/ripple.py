"""Do the wheels roll on finite rollers?  It shows where wheels contradict each other.

A finite roller makes the Jacobian swing with the phase of the wheel (effect ``roller_ripple``), six
times a turn.  A motion that goes to and fro passes the same phases again and again, so the ripple
does not average out: it looks like unequal radii and a tilted sensor, alike in every stretch of
time.  Hence it is found from the wheels alone, and taken out of their speeds.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace

import numpy as np

from ident import dead_reckoning
from ident.contradiction import contradiction
from ident.distributions import fisher_above, student_quantile
from ident.estimators import CLUSTERS
from ident.kinematics.fit import leave_one_out
from ident.kinematics.wheels import middle_phases, ripple_geometry
from ident.log import Log
from ident.signals import body_velocity
from youbot_env.effects.roller_ripple import PITCH
from youbot_env.platform import Platform

# Share of the exact ripple from which on rollers are said to be seen; chance of saying so wrongly.
SEEN_SIZE, SEEN_P = 0.3, 1e-4
LARGEST_SIZE = 2.0
# Phases of less than this, rad, on all wheels are none: where they were zero, drift of the wheel
# angles by slip showed up to 16 degrees on twelve records of robots with real rollers.
MISPLACED = math.radians(20.0)
# Body velocities need the ripple and the ripple needs them; each round gains a digit.
ROUNDS = 4


@dataclass(frozen=True)
class Ripple:
    """What the contradictions of the wheels say about finite rollers.

    Attributes:
        size: ripple found over that of exact rollers, mean of the wheels.
        ci95: its 95 % interval.
        p_value: of "no ripple on any wheel".
        phases: (n,) roller phases at the start of the piece they were found in, rad.
    """

    size: float
    ci95: tuple[float, float]
    p_value: float
    phases: np.ndarray

    @property
    def seen(self) -> bool:
        """Whether the wheels clearly ripple as finite rollers do."""
        return self.p_value < SEEN_P and self.size > SEEN_SIZE


def find_ripple(piece: Log, platform: Platform) -> Ripple | None:
    """Look for the roller ripple in one contiguous piece of a log.

    Returns:
        None where wheels cannot contradict each other or rollers cannot ripple.
    """
    count = len(platform.wheels)
    straight = all(wheel.roller_angle == 0.0 for wheel in platform.wheels)
    if count <= 3 or straight or len(piece.time) < CLUSTERS * count:
        return None
    try:
        cosine, sine = _harmonics(platform)
    except ValueError:  # six such rollers would not make a wheel
        return None
    J, speed, angle = platform.jacobian_array, piece.wheel_velocity, wheel_angles(piece)
    against = np.eye(count) - J @ np.linalg.pinv(J)
    v, found = speed @ np.linalg.pinv(J).T, None
    phases = np.zeros(count)
    for _ in range(ROUNDS):
        turned = 2 * math.pi / PITCH * (angle + phases)
        c, s = np.cos(turned), np.sin(turned)
        even, odd = v @ cosine.T, v @ sine.T  # size of the harmonic at this velocity, (N, n)
        along, ahead = even * c + odd * s, odd * c - even * s
        if found is not None:  # the phases are nearly known: the exact shape in place of a sine
            exact = ripple_geometry(platform, angle.T, 1.0, phases).wheel_velocity(tuple(v.T))
            along = np.stack(exact, axis=1) - v @ J.T
        pair = np.stack([along, ahead], axis=2)
        design = [np.einsum("ai,nij->naij", against, pair)]
        design.append(np.einsum("ai,nj->naij", against, v))
        columns = np.concatenate([part.reshape(*speed.shape, -1) for part in design], axis=2)
        found = _solve(columns, speed @ against.T, phases)
        phases = found.phases
        v = np.stack(_velocity(piece, platform, found, angle)[0], axis=1)
    return found


def without_ripple(log: Log, platform: Platform) -> tuple[Log, Ripple | None]:
    """The log with the wheel speeds that ideal rollers would have shown in the same motion.

    Roller phases are found in every contiguous piece by itself.

    Returns:
        ``(log, ripple of its longest piece)``; the log as it was where no ripple is seen.
    """
    pieces = log.pieces()
    longest = max(pieces, key=lambda piece: piece.duration)
    ripple, speeds = find_ripple(longest, platform), []
    if ripple is None or not ripple.seen:
        return log, ripple
    for piece in pieces:
        own = ripple if piece is longest else find_ripple(piece, platform)
        speeds.append(piece.wheel_velocity)
        if own is None or not own.seen:
            continue
        v, rippled = _velocity(piece, platform, own, wheel_angles(piece))
        ideal = np.stack(platform.geometry.wheel_velocity(v), axis=1)
        speeds[-1] = piece.wheel_velocity + ideal - np.stack(rippled, axis=1)
    return replace(log, wheel_velocity=np.concatenate(speeds)), ripple


def ripple_share(log: Log) -> float:
    """Share of the squared contradiction of the wheels, beyond noise, that finite rollers make.

    Nothing else that acts on the robot has a part in it, as in the error of a free run.
    """
    return log.memo.of(("ripple share",), lambda: _ripple_share(log))


def _ripple_share(log: Log) -> float:
    """The same, worked out."""
    if log.wheel_velocity is None or (whole := contradiction(log)) is None:
        return 0.0
    left = contradiction(without_ripple(log, log.platform)[0])
    excess = whole[0] - whole[1]
    return 1.0 - max(left[0] - left[1], 0.0) / excess if excess > 0 else 0.0


def roller_phases(log: Log) -> np.ndarray | None:
    """(n,) roller phases where a law takes the wheel angles of a log to be zero, rad.

    Returns:
        None where the wheels do not ripple, or as if all phases were zero.
    """
    phases = seen_phases(log)
    return None if phases is None or np.abs(phases).max() < MISPLACED else phases


def with_phases_of(first: Log, log: Log) -> Log:
    """The log with wheel angles that are zero at the roller phases of another log of the robot.

    Where encoders do not count the angles they are zero where a record begins.
    """
    if log.wheel_angle is not None or first.wheel_angle is not None:
        return log
    theirs, mine = seen_phases(first), seen_phases(log)
    if theirs is None or mine is None:
        return log
    turned = _within(mine - theirs)
    if np.abs(turned).max() < MISPLACED:
        return log
    return replace(log, wheel_angle=dead_reckoning.wheel_angles(log) + turned)


def seen_phases(log: Log) -> np.ndarray | None:
    """(n,) roller phases where wheel angles are zero, rad; None where the wheels do not ripple."""
    # Every round of a diagnosis asks for them.
    return log.memo.of(("roller phases",), lambda: _phases_found(log))


def _phases_found(log: Log) -> np.ndarray | None:
    """The same, worked out."""
    if log.wheel_velocity is None:
        return None
    pieces = log.pieces()
    number = int(np.argmax([piece.duration for piece in pieces]))
    ripple = find_ripple(pieces[number], log.platform)
    if ripple is None or not ripple.seen:
        return None
    begin = log.spans[number][0]
    return _within(ripple.phases - dead_reckoning.wheel_angles(log)[begin])


def _within(phases: np.ndarray) -> np.ndarray:
    """Phases moved by whole rollers to where they are smallest."""
    return phases - PITCH * np.round(phases / PITCH)


def wheel_angles(piece: Log) -> np.ndarray:
    """(N, n) wheel angles integrated from their speeds, zero at the first sample, rad."""
    speed = piece.wheel_velocity
    areas = 0.5 * (speed[1:] + speed[:-1]) * np.diff(piece.time)[:, None]
    return np.concatenate([np.zeros((1, speed.shape[1])), np.cumsum(areas, axis=0)])


def _velocity(piece: Log, platform: Platform, ripple: Ripple, angle: np.ndarray) -> tuple:
    """Body velocities of wheels on finite rollers, and the wheel speeds that belong to them."""
    geometry = ripple_geometry(platform, angle.T, ripple.size, ripple.phases)
    v = body_velocity(geometry, tuple(piece.wheel_velocity.T))
    return v, geometry.wheel_velocity(v)


def _harmonics(platform: Platform) -> tuple[np.ndarray, np.ndarray]:
    """First harmonic of J over the roller phase, cosine and sine, (n, 3) each."""
    phases, count = middle_phases(), len(platform.wheels)
    rows = ripple_geometry(platform, (phases,) * count, 1.0, (0.0,) * count).jacobian
    entries = [[np.broadcast_to(entry, phases.shape) for entry in row] for row in rows]
    turned = 2 * math.pi / PITCH * phases
    both = (2 * np.array(entries) @ wave / len(phases) for wave in (np.cos(turned), np.sin(turned)))
    return tuple(both)


def _solve(design: np.ndarray, y: np.ndarray, phases: np.ndarray) -> Ripple:
    """Sizes of the wheels' ripples and what the phases lack, uncertainty from clusters.

    Args:
        design: (N, n, ...) columns: the ripple of each wheel at the given phases and a quarter of a
            period ahead, then others.
        y: (N, n) contradictions, rad/s.
        phases: (n,) rad.
    """
    count = len(phases)
    groups = np.array_split(np.arange(len(y)), CLUSTERS)
    flat = [(design[g].reshape(-1, design.shape[2]), y[g].ravel()) for g in groups]
    gram = np.array([X.T @ X for X, _ in flat])
    side = np.array([X.T @ b for X, b in flat])
    scale = np.sqrt(np.maximum(np.diag(gram.sum(axis=0)), 1e-30))
    gram, side = gram / scale[:, None] / scale, side / scale
    # Columns of the velocities take away what a wrong Jacobian leaves; some depend on others.
    strength, directions = np.linalg.eigh(gram.sum(axis=0))
    basis = directions[:, strength > 1e-9 * strength[-1]]
    gram, side = basis.T @ gram @ basis, side @ basis
    fitted = np.linalg.solve(gram.sum(axis=0), side.sum(axis=0))
    shifts = leave_one_out(gram, side - gram @ fitted) @ basis.T / scale
    harmonic, shifts = (basis @ fitted / scale)[: 2 * count], shifts[:, : 2 * count]
    covariance = shifts.T @ shifts
    statistic = harmonic @ np.linalg.pinv(covariance, hermitian=True) @ harmonic / (2 * count)
    p_value = float(fisher_above(statistic, 2 * count, len(groups) - 2 * count))
    pairs = harmonic.reshape(count, 2)
    sizes = np.hypot(*pairs.T)
    direction = (pairs / np.maximum(sizes, 1e-12)[:, None]).ravel() / count
    half = student_quantile(0.975, len(groups) - 1) * np.sqrt(direction @ covariance @ direction)
    size = min(float(sizes.mean()), LARGEST_SIZE)
    turned = phases + np.arctan2(pairs[:, 1], pairs[:, 0]) * PITCH / (2 * math.pi)
    return Ripple(size, (size - float(half), size + float(half)), p_value, _within(turned))
