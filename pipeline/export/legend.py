"""What the colours of a picture mean."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from pipeline.export.canvas import Box, Canvas
from pipeline.export.theme import Theme
from pipeline.recording.palette import Colour
from pipeline.recording.scenes import Scenes

Entry = tuple[str, Sequence[Colour]]
"""Words, and the colour or colours that they stand beside."""
LINE, COLUMN = 16.0, 240.0
"""Pixels from line to line and from column to column, at a ``unit`` of 1."""


def entries(scenes: Scenes, theme: Theme) -> list[Entry]:
    """What is drawn of this run: what it lacks needs no explanation."""
    found: list[tuple[str, Colour, bool]] = [
        ("estimate, its path, 2 sigma", theme.estimate, True),
        ("other hypotheses, share of weight", theme.hypothesis, len(scenes.hypotheses.values) > 0),
        ("beams that fit the map", theme.hit, True),
        ("that something stopped short", theme.short, True),
        ("that went on behind a wall", theme.long, True),
        ("where the map ends them", theme.expected, True),
        ("no return (stubs)", theme.no_return, len(scenes.no_return.values) > 0),
        ("known in hindsight", theme.hindsight, len(scenes.hindsight) > 0),
        ("truth", theme.truth, not bool(np.isnan(scenes.truth).all())),
    ]
    heavier = "darker" if theme.floor > theme.wall else "lighter"
    shades = [(int(red), int(green), int(blue)) for red, green, blue in theme.weights]
    return [*((words, [colour]) for words, colour, there in found if there), (f"particles; {heavier}: heavier", shades)]


def height(count: int, width: float, unit: float) -> float:
    """Pixels that so many entries need in a box of this width."""
    return -(-count // _columns(width, unit)) * LINE * unit


def legend(canvas: Canvas, box: Box, shown: Sequence[Entry], unit: float) -> None:
    """The entries from the top of the box down, in as many columns as it has room for."""
    lines = -(-len(shown) // _columns(box.width, unit))
    for k, (words, colours) in enumerate(shown):
        x, y = box.x + (k // lines) * COLUMN * unit, box.y + box.height - (k % lines + 1) * LINE * unit + 5 * unit
        step = 14 * unit / len(colours)
        for i, colour in enumerate(colours):
            canvas.fill(Box(x + i * step, y, step + 0.5, 5.5 * unit), colour)
        canvas.text(x + 22 * unit, y - 2 * unit, words, 11.5 * unit)


def _columns(width: float, unit: float) -> int:
    return max(int(width // (COLUMN * unit)), 1)
