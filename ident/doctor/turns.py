"""Wrong axes of one source of body motion: signs, exchanged axes, a frame that is turned."""

from __future__ import annotations

import itertools
from dataclasses import dataclass

import numpy as np

from ident.doctor.record import Record

QUARTER = np.pi / 2
# Names of the first, second and third axis of each source.
AXES = {
    "body_velocity": ("V_X", "V_Y", "yaw rate"),
    "reference": ("V_X", "V_Y", "yaw rate"),
    "pose": ("x", "y", "yaw"),
}


@dataclass(frozen=True)
class Turn:
    """What a source shows of a body motion: ``shown = matrix @ motion``.

    Attributes:
        cells: the (3, 3) orthogonal matrix, row by row; yaw stays yaw, with either sign.
    """

    cells: tuple[float, ...] = (1.0, 0.0, 0.0, 0.0, 1.0, 0.0, 0.0, 0.0, 1.0)

    @property
    def matrix(self) -> np.ndarray:
        """(3, 3)."""
        return np.array(self.cells).reshape(3, 3)

    @property
    def wrong(self) -> bool:
        """Whether it changes anything."""
        return self != RIGHT

    @property
    def rotates(self) -> bool:
        """Whether it is another frame, turned about the vertical, and no mirror."""
        matrix = self.matrix
        return bool(matrix[2, 2] > 0 and np.linalg.det(matrix[:2, :2]) > 0 and self.wrong)

    @property
    def angle(self) -> float:
        """Rad, by which the motion is seen turned, where it rotates."""
        return float(np.arctan2(self.matrix[1, 0], self.matrix[0, 0]))

    @property
    def columns(self) -> int:
        """Number of columns that it touches."""
        return int(np.sum(np.abs(self.matrix - np.eye(3)).max(axis=1) > 1e-9))

    def undo(self, shown: np.ndarray) -> np.ndarray:
        """(N, 3) motions from what is shown."""
        return shown @ self.matrix

    def words(self, source: str) -> str:
        """Say it for people: ``V_X and V_Y exchanged, yaw rate with the other sign``."""
        names, matrix = AXES[source], self.matrix
        if self.rotates:
            return f"turned by {np.rad2deg(self.angle):.0f} deg"
        exchanged = abs(matrix[0, 1]) > 0.5
        shown = matrix[[1, 0, 2]] if exchanged else matrix
        negated = [names[k] for k in range(3) if shown[k, k] < 0]
        parts = [f"{names[0]} and {names[1]} exchanged"] if exchanged else []
        parts += [f"{', '.join(negated)} with the other sign"] if negated else []
        return ", ".join(parts)


def turn_by(angle: float, mirrored: bool = False, yaw: int = 1) -> Turn:
    """Turn by an angle, rad; ``mirrored`` exchanges left and right before."""
    c, s, side = float(np.cos(angle)), float(np.sin(angle)), -1.0 if mirrored else 1.0
    cells = (c, -s * side, 0.0, s, c * side, 0.0, 0.0, 0.0, float(yaw))
    return Turn(tuple(round(cell, 9) + 0.0 for cell in cells))


RIGHT = Turn()
# Those that only exchange and negate axes, the fewest columns first.
TURNS = sorted(
    {
        turn_by(quarter * QUARTER, mirrored, yaw)
        for quarter, mirrored, yaw in itertools.product(range(4), (False, True), (1, -1))
    },
    key=lambda turn: (turn.columns, turn.cells),
)


def put_right(record: Record, source: str, turn: Turn) -> None:
    """Give a source the axes of the robot; a pose can only be rotated."""
    values = record.channels[source]
    if source == "pose":
        record.set(source, values + np.array([0.0, 0.0, turn.angle]))
    else:
        record.set(source, turn.undo(values))
