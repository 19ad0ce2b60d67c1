"""What the top view is drawn with: a brush with smooth edges, and lettering that stays crisp.

pygame fills polygons with hard edges.  The brush magnifies the part of the picture it works on,
draws there, and scales it back.  With a factor that is a power of two, pixels that were not drawn
on come back unchanged, so a small shape costs a small part of the picture.
"""

from __future__ import annotations

import importlib.util
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np

Colour = tuple[int, int, int]


class Brush:
    """Draws on a magnified part of a surface; positions and widths in px of the surface.

    Args:
        pygame: the module, loaded by the caller.
        part: the magnified part, a surface.
        corner: its upper left corner on the surface, px.
        factor: the magnification.
    """

    def __init__(self, pygame: ModuleType, part: Any, corner: np.ndarray, factor: int) -> None:
        self._draw = pygame.draw
        self._part, self._corner, self._factor = part, corner, factor

    def fill(self, polygon: np.ndarray, colour: Colour) -> None:
        """Fill a polygon (K, 2)."""
        self._draw.polygon(self._part, colour, self._magnify(polygon).tolist())

    def dot(self, centre: np.ndarray, radius: float, colour: Colour) -> None:
        """Fill a circle."""
        self._draw.circle(self._part, colour, self._magnify(centre), radius * self._factor)

    def outline(self, polygon: np.ndarray, width: float, colour: Colour) -> None:
        """Draw a closed line through a polygon (K, 2)."""
        self.stroke(polygon, np.roll(polygon, -1, axis=0), width, colour)

    def stroke(self, starts: np.ndarray, ends: np.ndarray, width: float, colour: Colour) -> None:
        """Draw the segments from starts (S, 2) to ends (S, 2)."""
        # A filled polygon includes its border: one magnified pixel more than its corners say.
        width = max(width - 1 / self._factor, 0.1)
        for band in self._magnify(bands(starts, ends, width)).tolist():
            self._draw.polygon(self._part, colour, band)

    def _magnify(self, points: np.ndarray) -> np.ndarray:
        """Map points of the surface to the indices of magnified pixels."""
        return np.floor((points - self._corner) * self._factor)


@contextmanager
def magnified(
    pygame: ModuleType, surface: Any, points: np.ndarray, margin: float, factor: int
) -> Iterator[Brush]:
    """Lend a brush for the part of a surface around some points.

    Args:
        pygame: the module, loaded by the caller.
        surface: what is drawn on.
        points: where drawing is meant to happen, (K, 2) px.
        margin: room around these points, px.
        factor: the magnification, a power of two.

    Yields:
        The brush; what it draws outside the surface is lost.
    """
    size = np.array(surface.get_size())
    low = np.floor(points.min(axis=0) - margin).clip(0, size - 1)
    high = np.ceil(points.max(axis=0) + margin).clip(low + 1, size)
    box = pygame.Rect(low.tolist(), (high - low).tolist())
    part = surface.subsurface(box)
    large = pygame.transform.scale(part, (box.width * factor, box.height * factor))
    yield Brush(pygame, large, np.array(box.topleft), factor)
    pygame.transform.smoothscale(large, box.size, part)


def bands(starts: np.ndarray, ends: np.ndarray, width: float) -> np.ndarray:
    """Give segments (S, 2) a width: (S, 4, 2) corners, overlapping a little to close the joints."""
    along = ends - starts
    length = np.hypot(*along.T)[:, None]
    along = np.divide(along, length, out=np.zeros_like(along), where=length > 0)
    side = along[:, ::-1] * (0.5 * width, -0.5 * width)
    along *= 0.2 * width
    corners = (
        starts - along + side,
        ends + along + side,
        ends + along - side,
        starts - along - side,
    )
    return np.stack(corners, axis=1)


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
