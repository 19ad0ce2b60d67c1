"""One motion seen by two sensors: scales, mount, clock and bias as one linear regression.

A source of body velocities (wheels, a velocity sensor, a command) is integrated along the measured
heading; what a pose moves in a second is regressed on it.  Two sources of body velocities are
compared likewise, without turning.  The unknowns enter linearly, and their standard errors come
from clusters of windows, so that slip, ripple and drift of any colour count::

    change of place = change of [ sum of M_ij int R e_i u_j dt + sum of l_k int Omega R z x e_k dt
                                  - shift * velocity ]
    change of yaw   = change of [ scale * int Omega dt + bias * t - shift * Omega ]

M = scales and mounting angle, l = where the target's sensor stands, shift = how late the target is.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from youbot_env.platform import Platform

SECONDS = 1.0  # between the ends of a window
AVERAGED = 0.04  # s to either side, over which both ends are averaged: noise of the pose
OVERLAP = 4  # windows that begin within one window
CLUSTERS, FEWEST_CLUSTERS = 40, 6  # standard errors from fewer say nothing
FAR = 0.01  # s, shift beyond which its second order counts
ROUNDS = 3  # the shift multiplies the scales, and each axis is weighed by its residual
MOVED = 0.02  # rms of an axis over that of the busiest (yaw at the radius of the wheels): at rest
AFAR = 1e8  # of an information matrix with unit diagonal, condition beyond which nothing is said
INFLATED = 1e3  # variance inflation beyond which a column is the others' and the sensors' noise
# M_xx = M_yy and M_yx = -M_xy: what a motion along one oblique line shows.
SIMILAR = np.zeros((9, 2))
SIMILAR[[0, 3], 0], SIMILAR[1, 1], SIMILAR[2, 1] = 1.0, 1.0, -1.0
SCALES = ("forward", "sideways", "yaw")


class Estimate(NamedTuple):
    """A number and its standard error; NaN and infinity where the record does not show it."""

    value: float
    se: float

    def differs(self, expected: float, times: float = 4.0) -> bool:
        """Whether it is further from a number than so many standard errors."""
        return bool(abs(self.value - expected) > times * self.se)

    @property
    def known(self) -> bool:
        """Whether the record shows it at all."""
        return bool(np.isfinite(self.value) and np.isfinite(self.se))


class Kinematic(NamedTuple):
    """What a target shows of the motion that a source claims.

    Attributes:
        forward, sideways, yaw: size of the target's motion over the source's, one an axis.
        angle: rad, by which the target's axes see the motion turned counter-clockwise.  Of a body
            velocity: minus the angle by which its sensor is mounted.
        shift: s, by which the target is late.
        bias: rad/s, constant yaw rate that the target adds.
        lever_x, lever_y: m, place of the target's sensor in the axes of the source.
        matrix: (2, 2) M, motion in the plane by the target over that by the source.
        windows: windows that were compared.
    """

    forward: Estimate
    sideways: Estimate
    yaw: Estimate
    angle: Estimate
    shift: Estimate
    bias: Estimate
    lever_x: Estimate
    lever_y: Estimate
    matrix: np.ndarray
    windows: int

    @property
    def scales(self) -> dict[str, Estimate]:
        """Scales of the axes that the record shows, to a tenth or better."""
        every = {name: getattr(self, name) for name in SCALES}
        return {n: e for n, e in every.items() if e.known and e.se < 0.1 * abs(e.value)}


def pose_against(
    time: np.ndarray,
    pose: np.ndarray,
    twist: np.ndarray,
    starts: tuple[int, ...] = (0,),
    reach: float = 0.4,
    biased: bool = False,
) -> Kinematic | None:
    """Compare a pose with the motion that body velocities claim.

    Args:
        time: (N,) s.
        pose: (N, 3) x, y m, yaw rad without jumps.
        twist: (N, 3) body velocities of the source, m/s, m/s, rad/s.
        starts: rows at which a contiguous piece begins.
        reach: m, that makes yaw comparable with the other axes: radius of the wheels' circle.
        biased: the yaw rate comes from a gyro, whose bias is asked for.

    Returns:
        None where the record is too short.
    """
    return _compare(time, pose, twist, pose[:, 2], starts, reach, biased)


def velocity_against(
    time: np.ndarray,
    measured: np.ndarray,
    twist: np.ndarray,
    starts: tuple[int, ...] = (0,),
    reach: float = 0.4,
) -> Kinematic | None:
    """Compare body velocities (or a command), (N, 3), with those that another source claims."""
    step = np.diff(time, prepend=time[0])
    target = np.cumsum(_middle(measured) * step[:, None], axis=0)
    return _compare(time, target, twist, None, starts, reach, True)


def pose_against_wheels(log) -> Kinematic | None:
    """Pose of a log against its wheel speeds; ``log`` is a ``Log``."""
    rolled = wheel_twist(log.wheel_velocity, log.platform)
    seen = pose_against(log.time, log.pose, rolled, log.starts, log.platform.reach)
    if seen is None or not seen.shift.known or abs(seen.shift.value) < FAR:
        return seen
    # A shift enters linearly where it is short; a long one is taken out and looked at again.
    first = seen.shift.value
    moved = [np.interp(log.time - first, log.time, column) for column in rolled.T]
    again = pose_against(
        log.time, log.pose, np.stack(moved, axis=1), log.starts, log.platform.reach
    )
    return again._replace(shift=Estimate(first + again.shift.value, again.shift.se))


def body_against(log, source: str = "wheels") -> Kinematic | None:
    """Sensor of body velocities of a log against its wheels, or against its pose.

    Against the pose the target is the pose and the source the sensor: scales are those of the pose
    over the sensor, the angle is the one by which the sensor is mounted, the bias is minus the
    gyro's, the shift is that of the pose, and the lever leads from the sensor to the tracked point.
    """
    reach = log.platform.reach
    if source == "pose":
        return pose_against(log.time, log.pose, log.body_velocity, log.starts, reach, biased=True)
    rolled = wheel_twist(log.wheel_velocity, log.platform)
    return velocity_against(log.time, log.body_velocity, rolled, log.starts, reach)


def wheel_twist(speeds: np.ndarray, platform: Platform) -> np.ndarray:
    """(N, 3) body velocities by the wheel speeds (N, n), rad/s, of a platform."""
    return speeds @ np.linalg.pinv(platform.jacobian_array).T


def _compare(time, target, twist, heading, starts, reach, biased) -> Kinematic | None:
    """Regress the target's motion on the source's; ``heading`` (N,) turns it, None does not."""
    places, yaws, first = _columns(time, twist, heading)
    rows, length, half = _windows(time, starts)
    cluster = _clusters(time[rows], np.ptp(time))
    if not len(rows) or cluster.max() + 1 < FEWEST_CLUSTERS:
        return None

    def change(values: np.ndarray) -> np.ndarray:
        total = np.concatenate([np.zeros((1, *values.shape[1:])), np.cumsum(values, axis=0)])
        ends = (total[rows + k + half + 1] - total[rows + k - half] for k in (length, 0))
        late, early = ends
        return (late - early) / (2 * half + 1)

    wanted, moved, turned = change(target), change(places), change(yaws)
    velocity = change(np.column_stack([first, _middle(twist)[:, 2]]))  # as M = 1 sees it
    size = np.sqrt(np.mean(np.sum(moved**2, axis=2), axis=0))
    sizes = np.array([size[0], size[2], reach * np.sqrt(np.mean(turned[:, 0] ** 2))])
    moves = sizes > MOVED * sizes.max()
    M, scale_yaw, weights = np.eye(2), 1.0, np.ones(3)
    bases = _bases(moves, biased)
    for _ in range(ROUNDS):
        # Unknowns: M_xx, M_yx, M_xy, M_yy, l_x, l_y, shift, yaw scale, bias.
        A = np.zeros((len(rows), 3, 9))
        A[:, :2, :6] = np.swapaxes(moved, 1, 2)
        A[:, :2, 6] = -_turned_by(velocity, moved, M)
        A[:, 2, 6] = -scale_yaw * velocity[:, -1]
        A[:, 2, 7:] = turned
        scaled = wanted / weights
        for basis in bases:  # fewer unknowns, until the record tells those of the plane apart
            solved, covariance = _solve(A @ basis / weights[None, :, None], scaled, cluster)
            if not np.isnan(solved[np.any(basis[:4] != 0, axis=0)]).any():
                break
        value, spread = _spread_out(basis, solved, covariance)
        found = np.where(np.isfinite(value), value, 0.0)
        left = wanted - A @ found
        weights = np.sqrt(np.mean(left**2, axis=0)) + 1e-9
        weights[:2] = np.sqrt(np.mean(weights[:2] ** 2))
        M = np.where(np.isfinite(value[:4]), value[:4], [1.0, 0, 0, 1.0]).reshape(2, 2).T
        scale_yaw = value[7] if np.isfinite(value[7]) else 1.0
    return _kinematic(value, spread, M, len(rows))


def _bases(moves: np.ndarray, biased: bool) -> list[np.ndarray]:
    """(9, p) unknowns to solve for: all, without a lever, with one scale for the whole plane.

    Args:
        moves: (3,) axes that move at all.
        biased: whether a constant yaw rate is asked for.
    """
    x, y, turns = moves
    used = np.array([x, x, y, y, turns, turns, True, turns, biased])
    no_lever = used & ~np.isin(np.arange(9), (4, 5))
    bases = [np.eye(9)[:, used], np.eye(9)[:, no_lever]]
    if x and y:
        bases.append(np.column_stack([SIMILAR, np.eye(9)[:, 4:][:, no_lever[4:]]]))
    return bases


def _columns(time, twist, heading):
    """Integrals that the unknowns multiply.

    Returns:
        places (N, 6, 2) of M_xx, M_yx, M_xy, M_yy, l_x, l_y; yaws (N, 2) of scale and bias;
        first (N, 4): R e_x u_x + R e_y u_y and their quarter turns, for the shift.
    """
    step = np.diff(time, prepend=time[0])[:, None]
    speed = _middle(twist)
    angle = np.zeros(len(time)) if heading is None else _middle(heading)
    # The heading half way through a step stands for the step.
    c, s = np.cos(angle), np.sin(angle)
    ex, ey = np.column_stack([c, s]), np.column_stack([-s, c])
    u, v, turn = (speed[:, [k]] for k in range(3))
    rates = np.stack([ex * u, ey * u, ex * v, ey * v, ey * turn, -ex * turn], axis=1)
    angle = np.zeros(len(time)) if heading is None else heading
    c, s = np.cos(angle), np.sin(angle)
    now = np.column_stack([c * twist[:, 0], s * twist[:, 0], -s * twist[:, 1], c * twist[:, 1]])
    places = np.cumsum(rates * step[:, None], axis=0)
    yaws = np.column_stack([np.cumsum(turn[:, 0] * step[:, 0]), time - time[0]])
    return places, yaws, now


def _middle(values: np.ndarray) -> np.ndarray:
    """(N, ...) means of each sample and the one before."""
    return 0.5 * (values + np.concatenate([values[:1], values[:-1]]))


def _turned_by(velocity: np.ndarray, moved: np.ndarray, M: np.ndarray) -> np.ndarray:
    """(W, 2) change of the velocity of the target, as M sees it."""
    forward, sideways = velocity[:, :2], velocity[:, 2:4]
    left = np.array([[0.0, 1.0], [-1.0, 0.0]])  # row vectors: a quarter turn counter-clockwise
    return (M[0, 0] * forward + M[1, 0] * forward @ left + M[1, 1] * sideways
            - M[0, 1] * sideways @ left)  # fmt: skip


def _windows(time: np.ndarray, starts: tuple[int, ...]) -> tuple[np.ndarray, int, int]:
    """Rows at which windows begin, their length and the half width of their ends, in samples."""
    dt = float(np.median(np.diff(time)))
    length, half = max(1, round(SECONDS / dt)), round(AVERAGED / dt)
    piece = np.zeros(len(time), int)
    piece[list(starts[1:])] = 1
    piece = np.cumsum(piece)
    rows = np.arange(half, len(time) - length - half, max(1, length // OVERLAP))
    return rows[piece[rows - half] == piece[rows + length + half]], length, half


def _clusters(time: np.ndarray, duration: float) -> np.ndarray:
    """(W,) number of the stretch of the record in which each window begins."""
    stretch = np.floor((time - time[:1]) / max(2 * SECONDS, duration / CLUSTERS))
    return np.unique(stretch, return_inverse=True)[1]


def _solve(A: np.ndarray, wanted: np.ndarray, cluster: np.ndarray):
    """Least squares with a covariance from clusters of windows.

    Args:
        A: (W, 3, p).
        wanted: (W, 3).
        cluster: (W,) number of the cluster of each window.

    Returns:
        (p,) values and (p, p) covariance; infinite variance where the columns do not tell.
    """
    count = A.shape[-1]
    flat = A.reshape(-1, count)
    size = np.sqrt(np.mean(flat**2, axis=0)) + 1e-300
    flat = flat / size
    inverse = np.linalg.pinv(flat.T @ flat, rcond=1 / AFAR, hermitian=True)
    values = inverse @ flat.T @ wanted.reshape(-1)
    left = (wanted.reshape(-1) - flat @ values).reshape(-1, 3)
    scores = np.einsum("wkp,wk->wp", A / size, left)
    groups = int(cluster.max()) + 1
    sums = np.zeros((groups, count))
    np.add.at(sums, cluster, scores)
    covariance = inverse @ (sums.T @ sums) @ inverse * groups / max(1, groups - 1)
    # What the record cannot tell apart: no unit vector then comes back from the inverse.
    lost = np.abs(np.diag(inverse @ (flat.T @ flat)) - 1) > 1e-3
    lost |= np.diag(inverse) * len(flat) > INFLATED
    covariance[lost, lost] = np.inf
    values = np.where(lost, np.nan, values / size)
    return values, covariance / np.outer(size, size)


def _spread_out(basis: np.ndarray, solved: np.ndarray, covariance: np.ndarray):
    """(9,) values and (9, 9) covariance of all unknowns; NaN and infinity where nothing is said.

    Args:
        basis: (9, p) unknowns that each solved number stands for.
        solved: (p,), covariance: (p, p) what was solved for.
    """
    known = np.isfinite(solved)
    value = basis[:, known] @ solved[known]
    spread = basis[:, known] @ covariance[np.ix_(known, known)] @ basis[:, known].T
    silent = ~np.any(basis[:, known] != 0, axis=1)
    value[silent] = np.nan
    spread[silent, silent] = np.inf
    return value, spread


def _kinematic(value: np.ndarray, spread: np.ndarray, M: np.ndarray, windows: int) -> Kinematic:
    def estimate(k: int) -> Estimate:
        return Estimate(float(value[k]), float(np.sqrt(spread[k, k])))

    def norm(k: int) -> Estimate:
        """Length of a column of M."""
        column, part = value[k : k + 2], spread[k : k + 2, k : k + 2]
        if not np.isfinite(column).all():
            return Estimate(np.nan, np.inf)
        length = float(np.hypot(*column))
        along = column / (length + 1e-300)
        return Estimate(length, float(np.sqrt(along @ part @ along)))

    known = np.isfinite(value[:4])
    # Angle of the rotation next to M, by the axes that moved.
    sine, cosine = (0.0, 1.0, -1.0, 0.0), (1.0, 0.0, 0.0, 1.0)
    S, C = (np.where(known, w, 0.0) @ np.where(known, value[:4], 0.0) for w in (sine, cosine))
    slope = np.where(known, C * np.array(sine) - S * np.array(cosine), 0.0) / (S**2 + C**2 + 1e-300)
    part = np.where(np.outer(known, known), spread[:4, :4], 0.0)
    angle = Estimate(float(np.arctan2(S, C)), float(np.sqrt(slope @ part @ slope)))
    if not known.any():
        angle = Estimate(np.nan, np.inf)
    return Kinematic(
        norm(0), norm(2), estimate(7), angle, estimate(6), estimate(8), estimate(4), estimate(5),
        M, windows,
    )  # fmt: skip
