"""Lettering and lengths of the top view at final size, so that they stay crisp."""

from __future__ import annotations

import importlib.util
from pathlib import Path
from types import ModuleType
from typing import Any

from youbot_env.envs.brush import Colour

PAPER, FRAME, INK, QUIET = (250, 250, 248), (188, 194, 201), (44, 52, 60), (110, 119, 129)
TEXT, SMALL, SMALLEST = 13, 11, 9  # px, heights of letters
MOST_PICTURES = 500


class Lettering:
    """Writes lines of text on a surface.

    Args:
        pygame: the module, loaded by the caller.
        surface: what is written on.
        unit: factor on all lengths, 1 for a picture of ordinary size.
    """

    def __init__(self, pygame: ModuleType, surface: Any, unit: float) -> None:
        self._pygame, self._surface, self._unit = pygame, surface, unit
        self._file = _font_file()
        self._fonts: dict[int, Any] = {}
        self._pictures: dict[tuple, Any] = {}

    def px(self, value: float) -> int:
        """Scale a length of the ordinary layout to this picture, at least 1 px."""
        return max(round(value * self._unit), 1)

    def renew(self) -> None:
        """Forget the fonts, once a frame: they die when any other code calls pygame.quit()."""
        self._fonts.clear()

    def write(
        self,
        text: str,
        at: tuple[int, int],
        align: float = 0.0,
        colour: Colour = INK,
        size: int = SMALL,
    ) -> None:
        """Write a line, vertically centred on a point; align 0 starts, 1 ends it there."""
        key = (text, size, colour)
        if key not in self._pictures:
            if len(self._pictures) >= MOST_PICTURES:
                self._pictures.clear()
            self._pictures[key] = self._font(size).render(text, True, colour)
        picture = self._pictures[key]
        width, height = picture.get_size()
        self._surface.blit(picture, (at[0] - round(align * width), at[1] - height // 2))

    def _font(self, size: int) -> Any:
        if size not in self._fonts:
            self._pygame.font.init()
            self._fonts[size] = self._pygame.font.Font(self._file, max(self.px(size), SMALLEST))
        return self._fonts[size]


def signed(value: float, decimals: int, plus: bool = False) -> str:
    """Write a number with a true minus sign, and no sign on a rounded zero."""
    rounded = round(value, decimals)
    sign = "−" if rounded < 0 else "+" if plus and rounded > 0 else ""
    return f"{sign}{abs(rounded):.{decimals}f}"


def _font_file() -> str | None:
    """Return the sans-serif font that matplotlib brings along; None selects pygame's own."""
    package = importlib.util.find_spec("matplotlib")
    if package is None or package.origin is None:
        return None
    file = Path(package.origin).parent / "mpl-data" / "fonts" / "ttf" / "DejaVuSans.ttf"
    return str(file) if file.is_file() else None
