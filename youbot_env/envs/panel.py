"""The side panel of the top view: one signed bar for each wheel torque, and the legend."""

from __future__ import annotations

import math
from types import ModuleType
from typing import Any

import numpy as np

from youbot_env.envs.lettering import INK, PAPER, QUIET, TEXT, Lettering, signed
from youbot_env.envs.scene import BODY, DRIVEN, EDGE, REFERENCE, SATURATED

TORQUE, TROUGH = (92, 148, 190), (232, 235, 239)
OVERSHOOT = 1.12  # a bar may pass its limit by this factor before it ends
LEGEND = ("driven path", "reference path", "robot", "reference pose", "saturated")
ROW = 20  # px, height of a line of the legend


class Panel:
    """Draws torque bars and legend on a part of a surface.

    Args:
        pygame: the module, loaded by the caller.
        surface: what is drawn on.
        box: the part of it, a ``pygame.Rect``.
        lettering: writes on the same surface.
        names: wheel names in table order.
    """

    def __init__(
        self,
        pygame: ModuleType,
        surface: Any,
        box: Any,
        lettering: Lettering,
        names: tuple[str, ...],
    ) -> None:
        self._pygame, self._surface, self._box = pygame, surface, box
        self._letters, self._names = lettering, names

    def draw(self, torque: np.ndarray, limit: float, saturated: np.ndarray) -> None:
        """Draw one frame; arguments as in ``TopView.draw``."""
        self._draw_torques(torque, limit, saturated)
        self._draw_legend()

    def _draw_torques(self, torque: np.ndarray, limit: float, saturated: np.ndarray) -> None:
        box, px, write = self._box, self._letters.px, self._letters.write
        write("Wheel torque, N m", (box.left, box.top + px(7)), size=TEXT)
        limited = math.isfinite(limit)
        scale = limit if limited else _power_of_two_above(float(np.abs(torque).max()))
        room = box.height - px(ROW) * len(LEGEND) - px(70)
        pitch = min(px(44), room // len(torque))
        top = box.top + px(32)
        for name, value, full in zip(self._names, torque.tolist(), saturated, strict=True):
            write(name, (box.left, top))
            number = signed(value, 2, plus=True)
            write(number, (box.right, top), 1.0, SATURATED if full else INK)
            self._draw_bar(top + px(10), value / scale, limited, SATURATED if full else TORQUE)
            top += pitch
        note = f"limit ±{limit:.3g} N m" if limited else f"no limit, full scale {scale:g} N m"
        write(note, (box.centerx, top), 0.5, QUIET)

    def _draw_bar(self, top: int, share: float, limited: bool, colour: tuple) -> None:
        """Draw a bar from the middle: a share of -1 to 1 reaches the limit marks."""
        box, px = self._box, self._letters.px
        height, middle = px(10), box.centerx
        half = box.width / 2 / OVERSHOOT
        self._rect(TROUGH, box.left, top, box.width, height)
        length = round(min(max(share, -OVERSHOOT), OVERSHOOT) * half)
        self._rect(colour, min(middle, middle + length), top, abs(length), height)
        for mark in (-round(half), round(half)) if limited else ():
            self._rect(INK, middle + mark, top, 1, height)
        self._rect(INK, middle, top - px(2), 1, height + 2 * px(2))

    def _draw_legend(self) -> None:
        box, px = self._box, self._letters.px
        for row, label in enumerate(LEGEND):
            y = box.bottom - px(9) - px(ROW) * (len(LEGEND) - 1 - row)
            self._letters.write(label, (box.left + px(35), y))
            if label == "driven path":
                self._rect(DRIVEN, box.left, y - px(1), px(26), px(2))
            elif label == "reference path":
                for start in (0, 10, 20):
                    self._rect(REFERENCE, box.left + px(start), y - px(1), px(6), px(2))
            elif label == "saturated":
                self._rect(SATURATED, box.left, y - px(6), px(26), px(12))
            else:
                fill, edge = (BODY, EDGE) if label == "robot" else (PAPER, REFERENCE)
                sample = self._pygame.Rect(box.left, y - px(6), px(26), px(12))
                draw = self._pygame.draw.rect
                draw(self._surface, fill, sample, border_radius=px(3))
                draw(self._surface, edge, sample, px(1.5), border_radius=px(3))

    def _rect(self, colour: tuple, left: int, top: int, width: int, height: int) -> None:
        self._surface.fill(colour, (left, top, width, height))


def _power_of_two_above(value: float) -> float:
    """Return the smallest power of two, at least 1, that is not below a value."""
    return 2.0 ** math.ceil(math.log2(max(value, 1.0)))
