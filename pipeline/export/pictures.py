"""A moment of a run as a picture: the map, a close-up of the robot, and how the belief went until then."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from numpy.typing import NDArray

from pipeline.export.canvas import BACKED, Box, Canvas, Raster, Window
from pipeline.export.legend import COLUMN, LINE, Entry, entries, height, legend
from pipeline.export.run import Moment, Run
from pipeline.export.theme import THEMES, Theme
from pipeline.recording.gaps import longest_interval
from pipeline.recording.palette import Colour
from pipeline.recording.scenes import Scenes

CLOSE = 12.0
"""Metres that the close-up shows from side to side."""
FOLLOWED = 20.0
"""Metres that a camera shows which follows the robot."""
PRINT = THEMES["print"]
HEAD = 40
"""Pixels of the line above a sheet."""
GAP = 8
"""Pixels between the pictures of a sheet."""


@dataclass(frozen=True)
class Layout:
    """Where what stands in a picture of so many pixels; ``unit`` scales type and lines, 1 at 720 rows."""

    width: int
    height: int
    map: Box
    close: Box
    panel: Box
    caption: Box
    unit: float


def full(width: int, height: int) -> Layout:
    """The map on the left, a column with close-up, curves and legend on the right, a line below that tells."""
    unit = min(height / 720, width / 1280)
    caption, column = 44 * unit, 330 * unit
    return Layout(
        width,
        height,
        map=Box(0, caption, width - column, height - caption),
        close=Box(width - column, height - column - 52 * unit, column, column),
        panel=Box(width - column, caption, column, height - column - 52 * unit - caption),
        caption=Box(0, 0, width, caption),
        unit=unit,
    )


def tile(width: int, height: int) -> Layout:
    """A small one for a sheet: map, close-up, and below them what happened."""
    unit, caption = 1.0, 50.0
    side = min(height - caption, width * 0.4)
    return Layout(
        width,
        height,
        map=Box(0, caption, width - side, height - caption),
        close=Box(width - side, caption, side, height - caption),
        panel=Box(0, 0, 0, 0),
        caption=Box(0, 0, width, caption),
        unit=unit,
    )


class Painter:
    """Draws moments of one run; what they share is drawn once.

    ``looks_at`` (n, 2), m in the map frame: what the large view follows; if None, it shows the whole map.
    """

    def __init__(
        self, run: Run, layout: Layout, theme: Theme = PRINT, looks_at: NDArray[np.float64] | None = None
    ) -> None:
        self.run, self.layout, self.theme, self._looks_at = run, layout, theme, looks_at
        low, high = run.area
        box = layout.map if looks_at is None else layout.close
        scale = min(box.width / (high[0] - low[0]), box.height / (high[1] - low[1]))
        centre = (float(low[0] + high[0]) / 2, float(low[1] + high[1]) / 2)
        self.whole = Window(box, centre, float(scale))

    def draw(self, row: int, *, title: str = "", sentence: str = "", factor: float | None = None) -> Raster:
        """The picture (height, width, 3) at a row of the run; ``sentence`` says what happened, ``factor`` how much
        quicker than it was a movie shows it."""
        layout, canvas = self.layout, self._empty()
        canvas.image(self._ground, 0, 0)
        for window, near in ((self.whole, False), (self.close(row), True)):
            canvas.clip(window.box)
            if near:
                canvas.image(_map(self.run.scenes, window, self.theme), window.box.x, window.box.y)
            _scene(canvas, window, self.run.scenes, row, layout.unit, near)
            if layout.panel.width:
                _scale_bar(canvas, window, layout.unit)
        canvas.clip(None)
        if layout.panel.width:
            self._panel(canvas, row)
        self._caption(canvas, row, title, sentence, factor)
        return canvas.pixels()

    def close(self, row: int) -> Window:
        """What is near the robot at a row of the run."""
        if self._looks_at is not None:
            x, y = self._looks_at[row]
            return Window(self.layout.map, (float(x), float(y)), self.layout.map.width / FOLLOWED)
        x, y = self.run.scenes.estimates[row, :2]
        return Window(self.layout.close, (float(x), float(y)), self.layout.close.width / CLOSE)

    def _empty(self) -> Canvas:
        return Canvas(self.layout.width, self.layout.height, self.theme)

    @cached_property
    def _ground(self) -> Raster:
        """What stands still: the map, and the words and pale curves beside it."""
        layout, canvas = self.layout, self._empty()
        canvas.image(_map(self.run.scenes, self.whole, self.theme), self.whole.box.x, self.whole.box.y)
        if layout.panel.width:
            self._legend(canvas)
            for curve in self._curves:
                curve.ground(canvas)
        return canvas.pixels()

    @cached_property
    def _curves(self) -> tuple[Curve, ...]:
        scenes, unit, box = self.run.scenes, self.layout.unit, self.layout.panel
        below = (len(self._entries) * LINE + 8) * unit
        high = (box.height - below) / 2
        places = [
            Box(box.x + 14 * unit, box.y + below + k * high + 6 * unit, box.width - 28 * unit, high - 30 * unit)
            for k in (1, 0)
        ]
        if high < 45 * unit:  # a picture as low as that has room for the map only
            return ()
        explained, spread = scenes.curves["explained"], scenes.curves["spread"]
        return (
            Curve(places[0], "share of the beams explained", scenes.times, explained, self.theme.curve, unit, 1.0),
            Curve(places[1], "spread of the particles, m", scenes.times, spread, self.theme.estimate, unit, None),
        )

    @cached_property
    def _entries(self) -> list[Entry]:
        return entries(self.run.scenes, self.theme)

    def _caption(self, canvas: Canvas, row: int, title: str, sentence: str, factor: float | None) -> None:
        box, unit, run = self.layout.caption, self.layout.unit, self.run
        clock = f"{run.scenes.times[row]:.1f} s"
        if self.layout.panel.width:
            at = canvas.text(14 * unit, 14 * unit, clock, 20 * unit, bold=True)
            left, right = max(110 * unit, 30 * unit + at), box.width - 14 * unit
            if factor is not None:
                times = f"{factor:g}\N{MULTIPLICATION SIGN}"
                right -= 20 * unit + canvas.text(right, 14 * unit, times, 20 * unit, align=1.0)
            lines = canvas.wrapped(sentence, 14 * unit, right - left)[:2]
            for k, line in enumerate(lines):
                canvas.text(left, (15 + 9 * (len(lines) - 1) - 18 * k) * unit, line, 14 * unit)
            return
        at = canvas.text(10, box.height - 20, f"{title}, {clock}" if title else clock, 15, bold=True)
        for k, line in enumerate(canvas.wrapped(sentence, 11, box.width - at - 40)[:2]):
            canvas.text(at + 24, box.height - 19 - 15 * k, line, 11)

    def _panel(self, canvas: Canvas, row: int) -> None:
        unit, run = self.layout.unit, self.run
        told = f"seed {run.seed}, scan {run.scenes.scans[row]:,}"
        canvas.text(self.layout.panel.x + 14 * unit, self.layout.height - 42 * unit, told, 12 * unit, self.theme.muted)
        for curve in self._curves:
            curve.until(canvas, row)

    def _legend(self, canvas: Canvas) -> None:
        unit, box = self.layout.unit, self.layout.panel
        left = box.x + 14 * unit
        canvas.text(left, self.layout.height - 24 * unit, self.run.name, 16 * unit, bold=True)
        tall = len(self._entries) * LINE * unit
        legend(canvas, Box(left, box.y + 4 * unit, COLUMN * unit, tall), self._entries, unit)


@dataclass(frozen=True)
class Curve:
    """Values (n,) over times (n,) s in a box: all of it pale, and what has been until now in its colour.

    ``top``: the highest value that the box has room for; the highest of the values if None.
    """

    box: Box
    words: str
    times: NDArray[np.float64]
    values: NDArray[np.float64]
    colour: Colour
    unit: float
    top: float | None

    def ground(self, canvas: Canvas) -> None:
        """What does not change."""
        box, unit = self.box, self.unit
        canvas.line(np.array([(box.x, box.y), (box.x + box.width, box.y)]), canvas.theme.muted, 0.8 * unit)
        canvas.line(self._until(len(self.times) - 1), canvas.theme.pale, 1.2 * unit)
        canvas.text(box.x, box.y + box.height + 7 * unit, self.words, 11.5 * unit)

    def until(self, canvas: Canvas, row: int) -> None:
        """What has been, and the value now."""
        box, unit, x = self.box, self.unit, self._points[row, 0]
        canvas.line(self._until(row), self.colour, 1.8 * unit)
        canvas.line(np.array([(x, box.y), (x, box.y + box.height)]), canvas.theme.ink, 1.0 * unit)
        now = "" if np.isnan(self.values[row]) else f"{self.values[row]:.2f}"
        canvas.text(box.x + box.width, box.y + box.height + 7 * unit, now, 11.5 * unit, align=1.0, bold=True)

    def _until(self, row: int) -> NDArray[np.float64]:
        """Broken where there are no scans: nothing is known of what was between."""
        gaps = np.diff(self.times[: row + 1]) > longest_interval(self.times)
        return np.insert(self._points[: row + 1], _breaks(gaps), np.nan, axis=0)

    @cached_property
    def _points(self) -> NDArray[np.float64]:
        box, since = self.box, self.times - self.times[0]
        top = float(np.nanmax(self.values, initial=1e-3)) if self.top is None else self.top
        across = box.width / max(float(since[-1]), 1e-9)
        return np.column_stack([box.x + since * across, box.y + self.values * (box.height / top)])


def moment(run: Run, at: Moment, width: int, height: int, theme: Theme = PRINT) -> Raster:
    """A picture (height, width, 3) of one moment."""
    return Painter(run, full(width, height), theme).draw(at.row, title=at.title, sentence=at.sentence)


def sheet(run: Run, moments: Sequence[Moment], width: int, theme: Theme = PRINT) -> Raster:
    """Moments side by side in two columns (one if there is one), below a line that names the run; and the legend."""
    columns = min(2, len(moments))
    wide = (width - GAP * (columns - 1)) // columns
    low, high = run.area
    aspect = float((high[1] - low[1]) / (high[0] - low[0]))
    tall = int(np.clip(0.62 * wide * aspect, 0.3 * wide, 0.75 * wide)) + 50
    painter, words = Painter(run, tile(wide, tall), theme), entries(run.scenes, theme)
    rows, free = -(-len(moments) // columns), len(moments) % columns > 0
    below = 0.0 if free else height(len(words), width - 20, 1.0) + 10
    canvas = Canvas(width, HEAD + rows * (tall + GAP) + round(below), theme)
    top = canvas.height - HEAD
    at = canvas.text(10, top + 13, run.name, 17, bold=True)
    told = f"seed {run.seed}, {len(run.scenes):,} scans in {run.scenes.times[-1]:.1f} s"
    canvas.text(at + 24, top + 13, told, 13, theme.muted)
    for k, (named, window) in enumerate((("maps", painter.whole), ("close-ups", painter.close(0)))):
        x = width - 310 + 190 * k
        canvas.text(x - 8, top + 8, named, 11, align=1.0)
        _bar(canvas, x, top + 8, window, 1.0)
    for k, one in enumerate(moments):
        picture = painter.draw(one.row, title=one.title, sentence=one.sentence)
        canvas.image(picture, (k % columns) * (wide + GAP), top - (k // columns) * (tall + GAP) - tall)
    if free:
        legend(canvas, Box(wide + GAP + 14, GAP, wide - 14, tall - 14), words, 1.4)
    else:
        legend(canvas, Box(10, 0, width - 20, below), words, 1.0)
    return canvas.pixels()


def thumbnail(run: Run, row: int, width: int, height: int) -> Raster:
    """Only the map, small, with the path until a row."""
    layout = replace(tile(width, height), map=Box(0, 0, width, height), unit=0.8)
    painter, canvas = Painter(run, layout), Canvas(width, height, PRINT)
    canvas.image(painter._ground, 0, 0)
    _scene(canvas, painter.whole, run.scenes, row, layout.unit, False)
    return canvas.pixels()


def _scene(canvas: Canvas, window: Window, scenes: Scenes, row: int, unit: float, near: bool) -> None:
    thin, thick, dot = (1.0, 2.0, 3.0) if near else (0.7, 1.6, 1.5)
    thin, thick, dot = thin * unit, thick * unit, dot * unit
    theme, heat = canvas.theme, scenes.heat[row]
    for level in np.unique(heat[:, 2]).astype(int):
        places = window.pixels(heat[heat[:, 2] == level, :2])
        canvas.squares(places, _shade(canvas, level), max(scenes.grid.resolution * window.scale, 1.0), 0.6)
    for k in range(len(scenes.hindsight)):
        canvas.line(window.pixels(scenes.hindsight[k]), theme.hindsight, thick)
    for path, colour in ((_broken(scenes.truth, row), theme.truth), (_joined(scenes, row), theme.estimate)):
        canvas.line(window.pixels(path), colour, thick, 0.8)
    laser = window.pixels(scenes.lasers[row])
    if near:
        canvas.lines(laser, window.pixels(scenes.no_return[row]), theme.no_return, thin)
    beams = (scenes.hits, theme.hit), (scenes.shorts, theme.short), (scenes.longs, theme.long)
    for ends, colour in beams:
        canvas.lines(laser, window.pixels(ends[row]), colour, thin)
    particles, levels = scenes.particles[row], scenes.levels[row]
    for level in np.unique(levels).astype(int):
        chosen = particles[levels == level]
        places, colour = window.pixels(chosen), _shade(canvas, level)
        if near:
            ticks = 7 * unit * np.column_stack([np.cos(chosen[:, 2]), np.sin(chosen[:, 2])])
            canvas.lines(places, places + ticks, colour, thin)
        canvas.dots(places, colour, dot)
    canvas.dots(window.pixels(scenes.expected[row]), theme.expected, dot if near else 1.2 * unit)
    for which, colour in ((scenes.hypotheses[row], theme.hypothesis), (scenes.ellipses[row], theme.estimate)):
        for x, y, a, b, turn in which:
            axes = (max(a * window.scale, 2 * unit), max(b * window.scale, 2 * unit))
            canvas.ellipse(window.pixels((x, y)), axes, turn, colour, thick)
    _robot(canvas, window, scenes.truth[row], theme.truth, unit)
    _robot(canvas, window, scenes.estimates[row], theme.estimate, unit)
    if not near:
        _shares(canvas, window, scenes, row, unit)


def _robot(canvas: Canvas, window: Window, pose: NDArray[np.float64], colour: Colour, unit: float) -> None:
    if np.isnan(pose[0]):
        return
    place, radius = window.pixels(pose), max(0.3 * window.scale, 6 * unit)
    ahead = np.array([np.cos(pose[2]), np.sin(pose[2])])
    canvas.ellipse(place, (radius, radius), 0.0, canvas.theme.ground, 4 * unit)
    canvas.ellipse(place, (radius, radius), 0.0, colour, 2.2 * unit)
    canvas.line(np.array([place, place + 2.2 * radius * ahead]), colour, 2.2 * unit)


def _shares(canvas: Canvas, window: Window, scenes: Scenes, row: int, unit: float) -> None:
    taken: list[tuple[float, float]] = []
    for (x, y, *_), label in zip(scenes.hypotheses[row], scenes.labels[row], strict=False):
        at = window.pixels((x, y)) + 8 * unit
        long = max(34, 7 * len(label)) * unit
        while any(abs(at[0] - a) < long and abs(at[1] - b) < 15 * unit for a, b in taken):
            at[1] += 15 * unit
        taken.append((float(at[0]), float(at[1])))
        canvas.text(at[0], at[1], label, 12 * unit, canvas.theme.name_of_share, bold=True, backed=True)


def _scale_bar(canvas: Canvas, window: Window, unit: float) -> None:
    x, y, long = window.box.x + 14 * unit, window.box.y + 14 * unit, _round_length(window) * window.scale
    canvas.fill(Box(x - 5 * unit, y - 5 * unit, long + 10 * unit, 26 * unit), canvas.theme.ground, BACKED)
    _bar(canvas, x, y, window, unit)


def _bar(canvas: Canvas, x: float, y: float, window: Window, unit: float) -> None:
    metres = _round_length(window)
    canvas.fill(Box(x, y, metres * window.scale, 4 * unit), canvas.theme.ink)
    canvas.text(x + metres * window.scale / 2, y + 8 * unit, f"{metres:g} m", 11 * unit, align=0.5)


def _round_length(window: Window) -> float:
    """Metres, of 1, 2 or 5 times a power of ten, about a fifth of what a window shows."""
    wanted = 0.22 * window.size[0]
    decade = 10 ** np.floor(np.log10(wanted))
    return float(max(k * decade for k in (1, 2, 5) if k * decade <= wanted))


def _map(scenes: Scenes, window: Window, theme: Theme) -> Raster:
    """The map's shades (h, w, 3) at the window's pixels; what is smaller than a pixel is averaged."""
    fine = int(np.clip(np.ceil(1.0 / (scenes.grid.resolution * window.scale)), 1, 4))
    wide, tall = round(window.box.width), round(window.box.height)
    x = window.centre[0] + ((np.arange(wide * fine) + 0.5) / fine - wide / 2) / window.scale
    y = window.centre[1] + ((np.arange(tall * fine) + 0.5) / fine - tall / 2) / window.scale
    x0, y0, yaw = scenes.grid.origin
    cos, sin = np.cos(yaw) / scenes.grid.resolution, np.sin(yaw) / scenes.grid.resolution
    east, north = (x - x0)[None, :], (y - y0)[:, None]
    column = np.floor(cos * east + sin * north).astype(np.int32)
    row = np.floor(cos * north - sin * east).astype(np.int32)
    inside = (column >= 0) & (column < scenes.grid.width) & (row >= 0) & (row < scenes.grid.height)
    height, width = scenes.shades.shape
    found = theme.tones[scenes.shades][np.clip(row, 0, height - 1), np.clip(column, 0, width - 1)]
    shades = np.where(inside, found, theme.unknown).astype(np.float32)
    mean = shades.reshape(tall, fine, wide, fine).mean(axis=(1, 3))
    return np.repeat(mean[::-1, :, None].astype(np.uint8), 3, axis=2)


def _joined(scenes: Scenes, row: int) -> NDArray[np.float64]:
    """The estimate's path until a row, with a NaN where it jumps."""
    return np.insert(scenes.estimates[: row + 1, :2], _breaks(~scenes.joined[1 : row + 1]), np.nan, axis=0)


def _broken(poses: NDArray[np.float64], row: int) -> NDArray[np.float64]:
    """The truth's path until a row; it jumps where somebody carried the robot."""
    places = poses[: row + 1, :2]
    return np.insert(places, _breaks(np.hypot(*np.diff(places, axis=0).T) > 1.0), np.nan, axis=0)


def _breaks(jumps: NDArray[np.bool_]) -> NDArray[np.int64]:
    return np.flatnonzero(jumps) + 1


def _shade(canvas: Canvas, level: int) -> Colour:
    red, green, blue = (int(c) for c in canvas.theme.weights[level])
    return (red, green, blue)
