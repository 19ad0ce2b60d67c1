"""The top view of a platform on its floor, with its wheel torques: pictures or a window."""

from __future__ import annotations

import logging
import math
import os
from types import ModuleType
from typing import Any

import numpy as np
from gymnasium.error import DependencyNotInstalled, Error

from youbot_env.envs.camera import round_length
from youbot_env.envs.drawing import FRAME, INK, PAPER, QUIET, TEXT, Lettering, signed
from youbot_env.envs.scene import BODY, DRIVEN, EDGE, FLOOR, REFERENCE, SATURATED, Scene
from youbot_env.platform import Platform

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


MODES = ("rgb_array", "human")
LOGGER = logging.getLogger(__name__)


class TopView:
    """Draws a platform, its reference, both paths and the wheel torques.

    Args:
        platform: the wheel table; gives footprint, wheels and rollers.
        mode: ``"rgb_array"`` (pictures, needs no display) or ``"human"`` (a window).
        fps: frames per second, 1/s; the window keeps to it.
        size: width and height of the picture, px.

    Raises:
        ValueError: an unknown mode, a frame rate that is not positive or a picture too small.
        DependencyNotInstalled: pygame is missing.
    """

    def __init__(
        self, platform: Platform, mode: str, fps: float, size: tuple[int, int] = (720, 540)
    ) -> None:
        if mode not in MODES:
            raise ValueError(f"render mode {mode!r} is unknown; use one of {MODES}")
        if not (math.isfinite(fps) and fps > 0):
            raise ValueError(f"fps = {fps} must be positive; give the frames per second")
        width, height = int(size[0]), int(size[1])
        if width < 480 or height < 360:
            raise ValueError(f"size = {size} px leaves no room; use at least (480, 360)")
        pygame = self._pygame = _import_pygame()
        self.platform, self.mode, self.fps = platform, mode, fps
        unit = min(width / 720, height / 540)
        self._frame = pygame.Surface((width, height), 0, 32)
        self._letters = Lettering(pygame, self._frame, unit)
        px = self._letters.px
        side = pygame.Rect(width - px(176), px(16), px(160), height - px(82))
        self._view = pygame.Rect(px(48), px(16), side.left - px(68), height - px(82))
        self._scene = Scene(pygame, platform, self._view.size, fps, unit)
        self._panel = Panel(pygame, self._frame, side, self._letters, platform.wheel_names)
        self._window = self._clock = None
        self._window_closed = False

    def draw(
        self,
        pose: np.ndarray,
        reference_pose: np.ndarray,
        path: np.ndarray,
        reference_path: np.ndarray,
        torque: np.ndarray,
        torque_limit: float,
        caption: str,
    ) -> np.ndarray | None:
        """Draw one frame.

        Args:
            pose: (x, y, yaw) of the robot, m and rad.
            reference_pose: the same of the reference.
            path: driven path, (N, 2) m; may be empty.
            reference_path: past and future of the reference, (M, 2) m; may be empty.  Dashes start
                at its first point: give the same path in every frame, and they lie still.
            torque: wheel torques in the order of the wheel table, N m.
            torque_limit: magnitude at which they saturate, N m; infinite where there is no limit.
            caption: the line below the picture.

        Returns:
            The picture, (height, width, 3) uint8, or None in mode ``"human"``.

        Raises:
            ValueError: a shape that does not fit, or a value that is not finite.
            gymnasium.error.Error: mode ``"human"`` and no display to open a window on.
        """
        pose = _checked("pose", pose, (3,))
        reference_pose = _checked("reference_pose", reference_pose, (3,))
        path = _checked("path", path, (-1, 2))
        reference_path = _checked("reference_path", reference_path, (-1, 2))
        torque = _checked("torque", torque, (len(self.platform.wheels),))
        if not torque_limit > 0:
            raise ValueError(f"torque_limit = {torque_limit} N m must be positive")
        saturated = np.abs(torque) >= torque_limit * (1 - 1e-6)

        self._letters.renew()
        self._frame.fill(PAPER)
        view = self._frame.subsurface(self._view)
        self._scene.draw(view, pose, reference_pose, path, reference_path, saturated)
        self._draw_scales()
        self._panel.draw(torque, torque_limit, saturated)
        foot = self._frame.get_height() - self._letters.px(17)
        self._letters.write(caption, (self._view.left, foot), size=TEXT)
        return self._show()

    def close(self) -> None:
        """Close the window; further frames of mode ``"human"`` are not shown."""
        if self._window is not None:
            self._pygame.display.quit()
        self._window, self._window_closed = None, True

    def _show(self) -> np.ndarray | None:
        """Hand the frame out or put it on the window, keeping the frame rate."""
        pygame = self._pygame
        if self.mode == "rgb_array":
            width, height = self._frame.get_size()
            pixels = bytearray(pygame.image.tobytes(self._frame, "RGB"))
            return np.frombuffer(pixels, dtype=np.uint8).reshape(height, width, 3)
        if self._window_closed:
            return None
        if (
            self._window is None or not pygame.display.get_init()
        ):  # other code may call pygame.quit()
            self._window, self._clock = self._open_window(), pygame.time.Clock()
        if any(event.type == pygame.QUIT for event in pygame.event.get()):
            self.close()  # the user closed the window; the simulation goes on without it
            return None
        self._window.blit(self._frame, (0, 0))
        pygame.display.flip()
        self._clock.tick(self.fps)
        return None

    def _open_window(self) -> Any:
        display = self._pygame.display
        try:
            display.init()
            # Without a display SDL draws off screen, as for Gymnasium's own environments: a run
            # that asked for a window on a server goes on, and the log says why there is none.
            if display.get_driver() == "offscreen":
                LOGGER.info("no display was found; render mode 'human' draws off screen")
            window = display.set_mode(self._frame.get_size())
        except self._pygame.error as error:
            raise Error(
                f"render mode 'human' found no display ({error}); use render_mode='rgb_array', or "
                "run where windows can be opened"
            ) from error
        display.set_caption(f"{self.platform.name}: top view")
        return window

    def _draw_scales(self) -> None:
        """Draw the frame of the view, metre labels and the scale bar."""
        view, px, write = self._view, self._letters.px, self._letters.write
        self._pygame.draw.rect(self._frame, FRAME, view.inflate(2, 2), 1)
        spacing = self._scene.spacing()
        decimals = max(0, -math.floor(math.log10(spacing) + 1e-9))
        below, beside = view.bottom + px(12), view.left - px(7)
        write("m", (beside, below), 1.0, QUIET)
        for value, pixel in self._scene.ticks(0, spacing):
            if pixel > px(14):  # clear of the unit in the corner
                write(signed(value, decimals), (view.left + round(pixel), below), 0.5, QUIET)
        for value, pixel in self._scene.ticks(1, spacing):
            write(signed(value, decimals), (beside, view.top + round(pixel)), 1.0, QUIET)

        covered = float(self._scene.camera.extent[0])
        length = round_length(covered / 4)
        bar = self._pygame.Rect(0, 0, round(length / covered * view.width), px(3))
        bar.bottomright = (view.right - px(16), view.bottom - px(13))
        self._frame.fill(FLOOR, bar.inflate(px(12), px(30)).move(0, -px(8)))
        self._frame.fill(INK, bar)
        for end in (bar.left, bar.right - 1):
            self._frame.fill(INK, (end, bar.top - px(3), 1, bar.height + 2 * px(3)))
        write(f"{length:g} m", (bar.centerx, bar.top - px(9)), 0.5)


def _import_pygame() -> ModuleType:
    """Load pygame without its greeting, which would end up in the output of a program."""
    os.environ.setdefault("PYGAME_HIDE_SUPPORT_PROMPT", "1")
    try:
        import pygame
    except ImportError as error:
        raise DependencyNotInstalled(
            "rendering needs pygame, which is not installed; run `pip install pygame`"
        ) from error
    return pygame


def _checked(name: str, value: np.ndarray, shape: tuple[int, ...]) -> np.ndarray:
    """Return an array of a shape (-1: any length), all finite."""
    array = np.asarray(value, dtype=float)
    if array.size == 0 and shape[0] == -1:
        return array.reshape(0, *shape[1:])
    fits = array.ndim == len(shape) and all(
        want in (-1, have) for want, have in zip(shape, array.shape, strict=True)
    )
    if not fits:
        raise ValueError(f"{name} has shape {array.shape}; the top view needs {shape}")
    if not np.isfinite(array).all():
        bad = np.argwhere(~np.isfinite(array))[0].tolist()
        raise ValueError(f"{name}{bad} = {array[tuple(bad)]}; the top view needs finite values")
    return array
