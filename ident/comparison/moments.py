"""What a log shows at each row of its regression: the signals an error may depend on.

Every signal passes the filter of the regression, so that a force and what may have caused it meet
in the same row.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.integrate import cumulative_trapezoid

from ident.filters import FirstOrderFilter
from ident.log import Log
from ident.regression import CORNER, Regression
from youbot_env.platform import Platform


@dataclass(frozen=True)
class Moments:
    """Filtered signals at N rows, for a platform with n wheels.

    Attributes:
        platform: wheel table.
        drive: what drives the wheels, ``torque`` or ``voltage``.
        time: (N,) s from the start of the log.
        velocity: (N, 3) body velocities, m/s, m/s, rad/s.
        wheel_speed: (N, n) rad/s, measured or, where they are not, of the ideal wheels.
        command: (N, n) drive input, N m or V.
        pose: (N, 3) x, y m and yaw rad, world frame; None where it was not measured.
        wheel_angle: (N, n) rad from the start; None where wheel speeds were not measured, or where
            gaps make the angle of one piece unknown in the next.
        of_runs: whether the log is of many runs, which have no common time.
    """

    platform: Platform
    drive: str
    time: np.ndarray
    velocity: np.ndarray
    wheel_speed: np.ndarray
    command: np.ndarray
    pose: np.ndarray | None
    wheel_angle: np.ndarray | None
    of_runs: bool = False

    @classmethod
    def of(cls, log: Log, regression: Regression, corner: float = CORNER) -> Moments:
        """Filter the signals of a log and take the rows of its regression."""
        pieces = log.pieces()
        angles = log.wheel_velocity is not None and len(pieces) == 1
        found: dict[str, list[np.ndarray]] = {}
        for number in np.unique(regression.piece):
            piece = pieces[number]
            rows = np.searchsorted(piece.time, regression.time[regression.piece == number])
            filters = FirstOrderFilter(piece.time, corner)
            signals = {"velocity": piece.velocity(), "command": piece.command, "pose": piece.pose}
            signals["wheel_speed"] = wheel_speed(piece)
            if angles:
                signals["wheel_angle"] = cumulative_trapezoid(
                    piece.wheel_velocity, piece.time, axis=0, initial=0.0
                )
            for name, values in signals.items():
                if values is not None:
                    held = filters.linear(values, start=values[0])
                    found.setdefault(name, []).append(held[rows])
        joined = {name: np.concatenate(parts) for name, parts in found.items()}
        return cls(
            log.platform,
            log.drive,
            regression.time - log.time[0],
            joined["velocity"],
            joined["wheel_speed"],
            joined["command"],
            joined.get("pose"),
            joined.get("wheel_angle"),
            bool(log.runs),
        )

    @property
    def speed(self) -> np.ndarray:
        """(N,) size of the body velocity, turning counted at the lever L, m/s."""
        return np.linalg.norm(self.velocity * (1.0, 1.0, self.platform.lever), axis=1)


def wheel_speed(log: Log) -> np.ndarray:
    """(N, n) wheel speeds, rad/s: measured, else those of ideal wheels at the body's velocity."""
    if log.wheel_velocity is not None:
        return log.wheel_velocity
    return log.velocity() @ log.platform.jacobian_array.T


def wheel_torques(residual: np.ndarray, platform: Platform) -> np.ndarray:
    """Smallest wheel torques (N, n), N m, that would make up for a residual force (N, 3).

    Args:
        residual: rows of a regression: (L F_X, L F_Y, M_O), N m.
        platform: wheel table.
    """
    wrench = residual / (platform.lever, platform.lever, 1.0)
    return wrench @ np.linalg.pinv(platform.jacobian_array)
