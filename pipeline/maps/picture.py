"""A map as a small picture inside a page: what a notebook shows of a map or a run."""

from __future__ import annotations

import base64
import io
from collections.abc import Sequence
from html import escape

import numpy as np
from numpy.typing import ArrayLike, NDArray
from PIL import Image

from pipeline.maps.occupancy_grid import OccupancyGrid, part_that_is_known

WIDEST, HIGHEST = 640, 480
"""Pixels of a picture, at most."""
UNKNOWN = 0.85
"""Grey level of what the map does not know."""
POINTS = 1000
"""A path is drawn with so many points at most."""
JUMP = 1.0
"""m: where a path leaps farther between two points it is broken, not drawn across the map."""

Path = tuple[str, ArrayLike, str]
"""A name, poses (n, 2 or 3) in the map frame, m, and a colour as CSS has it."""


def map_svg(grid: OccupancyGrid, paths: Sequence[Path] = ()) -> str:
    """An SVG element with the known part of the map as an image inside it, and paths on it."""
    known = grid.known.astype(np.uint8)
    rows, columns = part_that_is_known(known, np.array([False, True]))
    high, wide = rows.stop - rows.start, columns.stop - columns.start
    step = max(1, -(-wide // WIDEST), -(-high // HIGHEST))  # cells a pixel
    scale = min(WIDEST / wide, HIGHEST / high, 4.0)  # pixels of the page a cell
    lines = []
    for name, poses, colour in paths:
        points = _points(grid, poses) - [columns.start, rows.start]
        points[:, 1] = high - points[:, 1]
        lines += [_polyline(name, part * scale, colour) for part in _parts(points, JUMP / grid.resolution)]
    width, height = wide * scale, high * scale
    # A pixel holds step x step cells: the last ones reach over the edge, on the right and, since y goes up, at the top.
    drawn_wide, drawn_high = (-(-side // step) * step * scale for side in (wide, high))
    place = f'y="{height - drawn_high:.1f}" width="{drawn_wide:.1f}" height="{drawn_high:.1f}"'
    png = _png(grid.occupancy[rows, columns], step)
    return (
        f'<svg xmlns="http://www.w3.org/2000/svg" width="{width:.0f}" height="{height:.0f}" '
        f'viewBox="0 0 {width:.0f} {height:.0f}">'
        f'<image {place} preserveAspectRatio="none" style="image-rendering: pixelated" '
        f'href="data:image/png;base64,{png}"/>{"".join(lines)}</svg>'
    )


def figure(svg: str, caption: str) -> str:
    """The picture with a line of plain text below it, whatever that holds."""
    return f'<figure style="margin: 0">{svg}<figcaption>{escape(caption)}</figcaption></figure>'


def css(colour: tuple[int, int, int]) -> str:
    """Red, green and blue from 0 to 255 as CSS has them."""
    return f"rgb{colour}"


def _png(occupancy: NDArray[np.float32], step: int) -> str:
    """The map in grey as base64, the darkest of each step x step cells, so that thin walls stay."""
    shade = np.where(np.isnan(occupancy), np.float32(UNKNOWN), np.float32(1.0) - occupancy)
    high, wide = (-(-side // step) * step for side in shade.shape)
    padded = np.ones((high, wide), np.float32)
    padded[: shade.shape[0], : shade.shape[1]] = shade
    darkest = padded.reshape(high // step, step, wide // step, step).min(axis=(1, 3))
    file = io.BytesIO()
    Image.fromarray((255.0 * np.clip(darkest[::-1], 0.0, 1.0)).astype(np.uint8)).save(file, "PNG")
    return base64.b64encode(file.getvalue()).decode("ascii")


def _points(grid: OccupancyGrid, poses: ArrayLike) -> NDArray[np.float64]:
    """(n, 2) column and row of poses, in cells; those that are no numbers are left out."""
    places = np.asarray(poses, dtype=np.float64)[:, :2]
    places = places[np.isfinite(places).all(axis=1)]
    thinned = places[:: max(1, -(-len(places) // POINTS))]
    return grid.to_grid(np.column_stack([thinned, np.zeros(len(thinned))]))[:, :2] / grid.resolution


def _parts(points: NDArray[np.float64], jump: float) -> list[NDArray[np.float64]]:
    steps = np.hypot(*np.diff(points, axis=0).T) if len(points) > 1 else np.zeros(0)
    return [part for part in np.split(points, np.flatnonzero(steps > jump) + 1) if len(part) > 1]


def _polyline(name: str, points: NDArray[np.float64], colour: str) -> str:
    places = " ".join(f"{x:.1f},{y:.1f}" for x, y in points)
    drawn = f'fill="none" stroke="{escape(colour)}" stroke-width="2"'
    return f'<polyline points="{places}" {drawn}><title>{escape(name)}</title></polyline>'
