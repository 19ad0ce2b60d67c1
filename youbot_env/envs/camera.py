"""The camera of the top view: which part of the floor is seen, and where a point falls on it."""

from __future__ import annotations

import math

import numpy as np

WHOLE_PATH = 6.0  # m; a reference path up to this size is shown whole, and the view stands still
PADDING = 0.94  # share of the view that its content may take at first
FREE_ZONE = 0.2  # share of the spare room that a robot crosses before the view follows
ZOOM_IN = 2.6  # the view closes in when it is this many times wider than needed
SETTLING = 0.25  # s, time constant of the camera's motion
SPANS = (2.0, 2.5, 3.0, 3.5, 4.0, 5.0, 6.0, 8.0, 12.0)  # m, zoom steps across the shorter side


class Camera:
    """A view of the floor that keeps robot and reference in frame without jitter.

    A reference path of moderate size is framed once, and the view then rests.  Otherwise the view
    follows only what leaves its middle, zooms in steps, and eases from one aim to the next.

    Args:
        width, height: the view, px.
        fps: frames per second, 1/s.

    Attributes:
        centre: the floor point in the middle of the view, m; None before the first frame.
        span: what the shorter side of the view covers, m.
    """

    def __init__(self, width: float, height: float, fps: float) -> None:
        self.size = np.array([width, height], dtype=float)
        self.centre: np.ndarray | None = None
        self.span = 1.0
        self._blend = 1.0 - math.exp(-1.0 / (fps * SETTLING))
        self._aim_centre = np.zeros(2)
        self._aim_span = 1.0

    @property
    def resting(self) -> bool:
        """Whether the view has arrived where it was moving to."""
        return self.span == self._aim_span and np.array_equal(self.centre, self._aim_centre)

    @property
    def scale(self) -> float:
        """Pixels a metre."""
        return float(self.size.min()) / self.span

    @property
    def extent(self) -> np.ndarray:
        """What the view covers, (x, y) m."""
        return self.size / self.scale

    def project(self, points: np.ndarray) -> np.ndarray:
        """Map floor points (..., 2) m to view points (..., 2) px, y downwards."""
        return (np.asarray(points) - self.centre) * (self.scale, -self.scale) + self.size / 2

    def follow(self, bodies: np.ndarray, margin: float, path: np.ndarray) -> None:
        """Move the view by one frame.

        Args:
            bodies: points that must be seen, (K, 2) m.
            margin: room needed around each of them, m.
            path: reference path, (M, 2) m; seen whole while it is not too large.
        """
        near = np.array([bodies.min(axis=0) - margin, bodies.max(axis=0) + margin])
        both = np.concatenate([near, path - margin, path + margin])
        whole = np.array([both.min(axis=0), both.max(axis=0)])
        lost = self.centre is None or np.any(
            np.abs(near.mean(axis=0) - self.centre) > self.extent / 2
        )
        if self._needed(whole) <= WHOLE_PATH:
            self._aim(whole, 1.0, lost)
        else:
            self._aim(near, FREE_ZONE, lost)
        if lost:  # the first frame, or a new episode elsewhere
            self.centre, self.span = self._aim_centre.copy(), self._aim_span
            return
        self.centre = self.centre + self._blend * (self._aim_centre - self.centre)
        self.span *= (self._aim_span / self.span) ** self._blend
        if np.abs(self._aim_centre - self.centre).max() * self.scale < 0.1:
            self.centre = self._aim_centre.copy()
        if abs(self._aim_span / self.span - 1.0) < 1e-4:
            self.span = self._aim_span
        self.span = max(self.span, self._needed(near))
        spare = np.maximum(self.extent - np.ptp(near, axis=0), 0.0) / 2
        self.centre = np.clip(self.centre, near.mean(axis=0) - spare, near.mean(axis=0) + spare)

    def _needed(self, box: np.ndarray) -> float:
        """Span that a box (2, 2) m just fits into, m."""
        return float(np.max(np.ptp(box, axis=0) / self.size) * self.size.min())

    def _aim(self, box: np.ndarray, free: float, afresh: bool) -> None:
        """Choose zoom step and centre to move to, so that a box uses a share of the spare room."""
        needed, middle = self._needed(box), box.mean(axis=0)
        closer = _zoom_step(needed / PADDING)
        too_wide = closer < self._aim_span and needed * ZOOM_IN < self._aim_span
        if afresh or needed > self._aim_span or too_wide:
            self._aim_centre, self._aim_span = middle, closer
            return
        extent = self.size / self.size.min() * self._aim_span
        spare = free * (extent - np.ptp(box, axis=0)).clip(min=0.0) / 2
        self._aim_centre = np.clip(self._aim_centre, middle - spare, middle + spare)


def _zoom_step(needed: float) -> float:
    """Return the smallest zoom step that covers a span, m."""
    beyond = SPANS[-1] * 2.0 ** max(math.ceil(math.log2(needed / SPANS[-1])), 0)
    return next((span for span in SPANS if span >= needed), beyond)


def round_length(at_most: float) -> float:
    """Return the largest of 1, 2, 5, 10, ... (any power of ten) that is not above a length, m."""
    power = 10.0 ** math.floor(math.log10(at_most))
    return next(step * power for step in (5.0, 2.0, 1.0) if step * power <= at_most * (1 + 1e-9))
