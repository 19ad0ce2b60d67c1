"""What repeats in equal strokes: the part of an unwanted motion that a model could learn.

A robot that is driven straight also turns and drifts.  Where it is driven so several times alike,
what these strokes have in common has a cause that repeats with the motion; what differs between
them comes from the floor, the battery or chance, and no law of the motion explains it.  Beside real
robots that is a better floor than the noise of the sensors.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import asdict, dataclass

import numpy as np

from ident.log import Log

# A stroke: the drive pushes along one axis, by this share of the largest push of the log, with this
# share of its force, for at least this time, s.
PUSH, ALONG, LEAST = 0.1, 0.95, 0.4
# Equal strokes: this many of them; lengths within this factor, pushes correlated like this, and
# begun at less than this share of the largest speed, so that nothing before them counts.
FEWEST, LENGTHS, ALIKE, SLOW = 3, 1.5, 0.95, 0.5
# Motion across a stroke is worth a word from this share of the speed along it.
WORTH = 0.05
# From this share on what repeats is most of it; below the other, least.
MOST, LITTLE = 0.7, 0.4
# Yaw rates are ranked among speeds by what they are at this distance, m.
LEVER = 0.25
DIRECTIONS = {(0, 1): "forward", (0, -1): "backward", (1, 1): "left", (1, -1): "right",
              (2, 1): "turning left", (2, -1): "turning right"}  # fmt: skip
AXES = (("vx", "m/s"), ("vy", "m/s"), ("yaw rate", "rad/s"))


@dataclass(frozen=True)
class Repeat:
    """Motion along an axis that was not driven, in equal strokes.

    Attributes:
        stroke: direction of the strokes.
        count: how many there are.
        axis, unit: what moves besides.
        rms: of that motion.
        share: of its mean square that is common to the strokes, 0 to 1; of chance alone 0.
    """

    stroke: str
    count: int
    axis: str
    unit: str
    rms: float
    share: float

    def as_dict(self) -> dict:
        """Return what JSON shows."""
        return asdict(self)

    def __str__(self) -> str:
        if self.share > MOST:
            learn = "a law of the motion could explain it"
        elif self.share < LITTLE:
            learn = "no law of the motion explains the rest"
        else:
            learn = "a law of the motion could explain about that much"
        return (
            f"{self.axis} of {self.rms:.2g} {self.unit} in {self.count} equal strokes "
            f"{self.stroke}: {100 * self.share:.0f} % of it repeats, {learn}"
        )


def repeats(logs: Sequence[Log]) -> list[Repeat]:
    """Unwanted motion in equal strokes of each log, and what of it repeats; largest first.

    Args:
        logs: records with a drive input; the runs of one that was joined count together.
    """
    found = [one for log in logs for one in _of(log)]
    return sorted(found, key=lambda one: -one.rms * (1.0 if one.unit == "m/s" else LEVER))


def _of(log: Log) -> list[Repeat]:
    scale = np.array([1.0, 1.0, log.platform.lever])
    push, speed = log.command @ log.platform.jacobian_array / scale, log.velocity() * scale
    found, strokes = [], _strokes(log, push)
    for axis, sign in sorted({(axis, sign) for axis, sign, _, _ in strokes}):
        mine = [
            (a, b)
            for x, s, a, b in strokes
            if (x, s) == (axis, sign) and _from_rest(speed[a:b, axis])
        ]
        equal = _equal(push, mine)
        if len(equal) < FEWEST:
            continue
        moved = np.stack([speed[a:b] for a, b in equal])  # (strokes, rows, 3)
        along = np.sqrt(np.mean(moved[..., axis] ** 2))
        for other in {0, 1, 2} - {axis}:
            across = moved[..., other]
            whole = float(np.mean(across**2))
            if np.sqrt(whole) < WORTH * along:
                continue
            apart = float(np.mean(across.var(axis=0, ddof=1)))
            name, unit = AXES[other]
            rms = float(np.sqrt(whole)) / scale[other]
            share = max(0.0, 1.0 - apart / whole)
            stroke = DIRECTIONS[axis, sign]
            found.append(Repeat(stroke, len(equal), name, unit, float(rms), share))
    return found


def _strokes(log: Log, push: np.ndarray) -> list[tuple[int, int, int, int]]:
    """Axis, sign, first row and end of every stroke."""
    size = np.linalg.norm(push, axis=1)
    axis = np.abs(push).argmax(axis=1)
    strong = np.abs(push).max(axis=1)
    straight = (size > PUSH * size.max()) & (strong > ALONG * size)
    sign = np.sign(push[np.arange(len(push)), axis]).astype(int)
    kind = np.where(straight, 1 + 2 * axis + (sign > 0), 0)
    found = []
    for start, stop in log.spans:
        cuts = start + 1 + np.flatnonzero(np.diff(kind[start:stop]))
        for a, b in zip([start, *cuts], [*cuts, stop], strict=True):
            if kind[a] and log.time[b - 1] - log.time[a] >= LEAST:
                found.append((int(axis[a]), int(sign[a]), int(a), int(b)))
    return found


def _equal(push: np.ndarray, strokes: list[tuple[int, int]]) -> list[tuple[int, int]]:
    """The strokes that are driven like the one of median length, all cut to the shortest."""
    if len(strokes) < FEWEST:
        return []
    lengths = np.array([b - a for a, b in strokes])
    typical = np.argsort(lengths)[len(lengths) // 2]
    near = np.maximum(lengths, lengths[typical]) < LENGTHS * np.minimum(lengths, lengths[typical])
    rows = int(lengths[near].min())
    model = push[strokes[typical][0] :][:rows]
    return [
        (a, a + rows)
        for (a, _), close in zip(strokes, near, strict=True)
        if close and _cosine(push[a : a + rows], model) > ALIKE
    ]


def _from_rest(speed: np.ndarray) -> bool:
    return bool(abs(speed[0]) < SLOW * np.abs(speed).max())


def _cosine(one: np.ndarray, other: np.ndarray) -> float:
    return float(np.sum(one * other) / max(np.linalg.norm(one) * np.linalg.norm(other), 1e-300))
