"""Lines, dots and words on a raster, straight through matplotlib's Agg: a picture in a hundredth of a second."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cache
from typing import Any

import numpy as np
from matplotlib.backends.backend_agg import RendererAgg
from matplotlib.font_manager import FontProperties
from matplotlib.path import Path as Outline
from matplotlib.transforms import Affine2D, IdentityTransform
from numpy.typing import ArrayLike, NDArray

from pipeline.export.theme import Theme
from pipeline.recording.palette import Colour

Raster = NDArray[np.uint8]

BACKED = 0.85
"""How much of what is below it the ground of words hides: so much that they can be read on a wall."""
_DOT, _RING = Outline.unit_circle(), Outline.unit_circle()
_STRAIGHT = IdentityTransform()


@dataclass(frozen=True)
class Box:
    """A rectangle of pixels: its lower left corner, counted from that of the picture, and its size."""

    x: float
    y: float
    width: float
    height: float


@dataclass(frozen=True)
class Window:
    """A box that shows a part of the map: ``centre`` (x, y) m in the map frame, ``scale`` pixels per metre."""

    box: Box
    centre: tuple[float, float]
    scale: float

    @property
    def size(self) -> tuple[float, float]:
        """What it shows, metres."""
        return (self.box.width / self.scale, self.box.height / self.scale)

    def pixels(self, points: ArrayLike) -> NDArray[np.float64]:
        """Points (..., 2) of the map frame in pixels of the picture."""
        middle = np.array([self.box.x + self.box.width / 2, self.box.y + self.box.height / 2])
        return (np.asarray(points, dtype=np.float64)[..., :2] - self.centre) * self.scale + middle


class Canvas:
    """An empty picture of so many pixels; y counts upwards. All is cut off at ``clip``'s box where one is set."""

    def __init__(self, width: int, height: int, theme: Theme) -> None:
        self.width, self.height, self.theme = width, height, theme
        self._renderer: Any = RendererAgg(width, height, 72.0)  # at 72 dpi a point of type is a pixel
        self._clip: Box | None = None
        self.fill(Box(0, 0, width, height), theme.ground)

    def pixels(self) -> Raster:
        """A copy of the picture, (height, width, 3), row 0 at the top."""
        return np.asarray(self._renderer.buffer_rgba())[..., :3].copy()

    def clip(self, box: Box | None) -> None:
        """From now on draw within this box only; None: everywhere."""
        self._clip = box

    def fill(self, box: Box, colour: Colour, alpha: float = 1.0) -> None:
        """A rectangle without an outline."""
        corners = [(0.0, 0.0), (box.width, 0.0), (box.width, box.height), (0.0, box.height), (0.0, 0.0)]
        outline = Outline(np.add(corners, (box.x, box.y)))
        self._renderer.draw_path(self._pen(colour, 0.0, alpha), outline, _STRAIGHT, _rgb(colour))

    def image(self, raster: Raster, x: float, y: float) -> None:
        """A picture (h, w, 3), row 0 at its top, with its lower left corner at x, y."""
        opaque = np.full((*raster.shape[:2], 4), 255, np.uint8)
        opaque[..., :3] = raster
        self._renderer.draw_image(self._pen(self.theme.ink, 0.0), x, y, opaque[::-1])

    def line(self, points: NDArray[np.float64], colour: Colour, width: float, alpha: float = 1.0) -> None:
        """Through points (n, 2); a NaN breaks it."""
        if len(points) > 1:
            self._renderer.draw_path(self._pen(colour, width, alpha), Outline(points), _STRAIGHT)

    def lines(self, starts: NDArray[np.float64], ends: NDArray[np.float64], colour: Colour, width: float) -> None:
        """From every one of ``starts`` (n, 2), or from the one, to every one of ``ends`` (n, 2)."""
        if not len(ends):
            return
        vertices = np.stack([np.broadcast_to(starts, ends.shape), ends], axis=1).reshape(-1, 2)
        codes = np.tile([Outline.MOVETO, Outline.LINETO], len(ends))
        self._renderer.draw_path(self._pen(colour, width), Outline(vertices, codes), _STRAIGHT)

    def dots(self, points: NDArray[np.float64], colour: Colour, radius: float, alpha: float = 1.0) -> None:
        """Discs at points (n, 2)."""
        if len(points):
            pen, grow = self._pen(colour, 0.0, alpha), Affine2D().scale(radius)
            self._renderer.draw_markers(pen, _DOT, grow, Outline(points), _STRAIGHT, (*_rgb(colour), alpha))

    def squares(self, points: NDArray[np.float64], colour: Colour, side: float, alpha: float = 1.0) -> None:
        """Squares around points (n, 2)."""
        if len(points):
            square, grow = Outline.unit_rectangle(), Affine2D().translate(-0.5, -0.5).scale(side)
            pen = self._pen(colour, 0.0, alpha)
            self._renderer.draw_markers(pen, square, grow, Outline(points), _STRAIGHT, (*_rgb(colour), alpha))

    def ellipse(self, centre: ArrayLike, axes: tuple[float, float], turn: float, colour: Colour, width: float) -> None:
        """Its outline: half axes in pixels, the first one turned by ``turn`` radians."""
        shape = Affine2D().scale(*axes).rotate(turn).translate(*np.asarray(centre, dtype=np.float64))
        self._renderer.draw_path(self._pen(colour, width), _RING, shape)

    def text(
        self, x: float, y: float, words: str, size: float, colour: Colour | None = None, *,
        bold: bool = False, align: float = 0.0, backed: bool = False
    ) -> float:  # fmt: skip
        """Words with their baseline at y, left edge at x (``align`` 1: right, 0.5: middle); returns their width.

        In the theme's ink unless ``colour`` says otherwise; ``backed``: on its ground, to be read on anything.
        """
        font = _font(size, bold)
        width, height, _ = self._renderer.get_text_width_height_descent(words, font, False)
        left = x - align * width
        if backed:
            ground = Box(left - 3, y - 0.28 * size, width + 6, max(height, size) + 0.2 * size)
            self.fill(ground, self.theme.ground, BACKED)
        self._renderer.draw_text(self._pen(colour or self.theme.ink, 1.0), left, self.height - y, words, font, 0.0)
        return float(width)

    def wrapped(self, words: str, size: float, width: float, *, bold: bool = False) -> list[str]:
        """The words on lines no wider than so many pixels."""
        lines: list[str] = []
        for word in words.split():
            longer = f"{lines[-1]} {word}" if lines else word
            fits = self._renderer.get_text_width_height_descent(longer, _font(size, bold), False)[0] <= width
            if lines and fits:
                lines[-1] = longer
            else:
                lines.append(word)
        return lines

    def _pen(self, colour: Colour, width: float, alpha: float = 1.0) -> Any:
        pen = self._renderer.new_gc()
        pen.set_linewidth(width)
        pen.set_foreground((*_rgb(colour), alpha), isRGBA=True)
        pen.set_capstyle("butt")
        if self._clip is not None:
            from matplotlib.transforms import Bbox

            pen.set_clip_rectangle(Bbox.from_bounds(*_sides(self._clip)))
        return pen


def _sides(box: Box) -> Sequence[float]:
    return (box.x, box.y, box.width, box.height)


def _rgb(colour: Colour) -> tuple[float, float, float]:
    red, green, blue = colour
    return (red / 255, green / 255, blue / 255)


@cache
def _font(size: float, bold: bool) -> FontProperties:
    return FontProperties(family="DejaVu Sans", size=size, weight="bold" if bold else "normal")
