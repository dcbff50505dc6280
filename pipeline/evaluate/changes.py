"""The ways in which a map can be wrong: each draws one piece of change, and finds a place for it or not."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from typing import Final

import numpy as np
from numpy.typing import NDArray

from pipeline.evaluate.metrics import Array
from pipeline.evaluate.scene import CLEAR, Cells, Scene, Sketch

DOOR: Final = (0.7, 1.2)
"""m: how wide a door is that is open on the map."""
GAP: Final = (0.6, 1.6)
"""m: how wide a gap is that a door on the map may shut; of a corridor that the robot drives through, twice that."""
PATCH: Final = (2.0, 5.0)
BOX: Final = (0.5, 1.5)
PIECE: Final = (1.0, 4.0)
SHIFT: Final = (0.3, 1.5)
"""m: sides of a patch and of a box, the length of a piece of wall, and how far it is put."""

Kind = Callable[[Scene, Sketch, np.random.Generator, float], Sketch | None]
"""Draws a piece of change, of its usual size or a smaller one (by a factor); None if it found no place."""


# --- the kinds ----------------------------------------------------------------------------------------------------


def _doors(scene: Scene, sketch: Sketch, rng: np.random.Generator, _: float) -> Sketch | None:
    """A door that was open when the map was made, and is shut now; or the other way round, off the robot's way."""
    return _opened(scene, sketch, rng) if rng.random() < 0.5 else _shut_beside(scene, sketch, rng)


def _opened(scene: Scene, sketch: Sketch, rng: np.random.Generator) -> Sketch | None:
    """A gap in a wall; what the wall hides between floor and floor is floor as well."""
    at, along = _on_a_wall(scene, rng)
    across = np.array([-along[1], along[0]])
    depth = 2.0 * scene.half + 0.1
    cells = scene.cells(at, along, 0.5 * rng.uniform(*DOOR), depth)
    sides = [at + side * (depth / scene.grid.resolution + 1.0) * across for side in (-1.0, 1.0)]
    through = all(_is_floor(scene, sketch, side) for side in sides)
    return _taken(scene, sketch, cells, cells if through else scene.built(sketch, cells), scene.floor)


def _shut_beside(scene: Scene, sketch: Sketch, rng: np.random.Generator) -> Sketch | None:
    at = _drawn_from(scene.beside, rng)
    return None if at is None else _shut_at(scene, sketch, at, GAP, CLEAR)


def _shut(scene: Scene, sketch: Sketch, rng: np.random.Generator, _: float) -> Sketch | None:
    """A door across the robot's way, mapped as a wall: at the narrowest of a few places that it passes."""
    way = scene.drive.way[rng.integers(len(scene.drive.way), size=5)][:, ::-1]
    widths = [_narrowest(scene, sketch, at)[0] for at in way]
    return _shut_at(scene, sketch, way[int(np.argmin(widths))], (GAP[0], 2.0 * GAP[1]), -1.0)


def _shut_at(scene: Scene, sketch: Sketch, at: Array, gap: tuple[float, float], clear: float) -> Sketch | None:
    """A wall across the gap at a place, if it is one, no other was shut close by, and it keeps clear of the way, m."""
    width, middle, along = _narrowest(scene, sketch, at)
    if not gap[0] <= width <= gap[1] or sketch.put[scene.cells(at, along, 1.0, 1.0)].any():
        return None
    return _put(scene, sketch, scene.cells(middle, along, 0.5 * width, scene.half), clear)


def _erased(scene: Scene, sketch: Sketch, rng: np.random.Generator, size: float) -> Sketch | None:
    """All walls of a patch become floor."""
    cells = _patch(scene, rng, size)
    return _taken(scene, sketch, cells, scene.built(sketch, cells), scene.floor)


def _unknown(scene: Scene, sketch: Sketch, rng: np.random.Generator, size: float) -> Sketch | None:
    """Of a patch nothing is known any more."""
    cells = _patch(scene, rng, size)
    return _taken(scene, sketch, cells, cells, np.float32(np.nan))


def _boxes(scene: Scene, sketch: Sketch, rng: np.random.Generator, size: float) -> Sketch | None:
    """A box that is not there, beside the robot's way; as thick all round as the map makes its walls."""
    at = _drawn_from(scene.beside, rng)
    if at is None:
        return None
    half_length, half_width = 0.5 * np.maximum(rng.uniform(*BOX, size=2) * size, BOX[0]) + scene.half
    return _put(scene, sketch, scene.cells(at, _direction(rng), half_length, half_width), CLEAR)


def _moved(scene: Scene, sketch: Sketch, rng: np.random.Generator, size: float) -> Sketch | None:
    """A piece of wall is put forwards or back, with what smears it."""
    at, along = _on_a_wall(scene, rng)
    length = max(rng.uniform(*PIECE) * size, PIECE[0])
    turned = rng.uniform(-0.5, 0.5) + rng.choice([-0.5, 0.5]) * math.pi
    across = np.array(
        [along[0] * math.cos(turned) - along[1] * math.sin(turned),
         along[0] * math.sin(turned) + along[1] * math.cos(turned)]
    )  # fmt: skip
    step = np.round(across * rng.uniform(*SHIFT) / scene.grid.resolution).astype(np.int64)
    cells = scene.cells(at, along, 0.5 * length, 2.0 * scene.half + 0.1)
    source = scene.built(sketch, cells)
    rows, cols = source[0] + step[0], source[1] + step[1]
    height, width = scene.grid.height, scene.grid.width
    kept = (rows >= 0) & (cols >= 0) & (rows < height) & (cols < width)
    target, values = (rows[kept], cols[kept]), sketch.occupancy[source][kept]
    if (scene.from_way[target] <= CLEAR).any():
        return None
    made = _taken(scene, sketch, cells, source, scene.floor)
    if made is not None:
        made.occupancy[target] = np.fmax(made.occupancy[target], values)
    return made


KINDS: Final[Mapping[str, Kind]] = {
    "doors": _doors,
    "shut": _shut,
    "erased": _erased,
    "unknown": _unknown,
    "boxes": _boxes,
    "moved": _moved,
}
"""Every kind of change by its name; docs/changed_maps.md says what each does."""


# --- what they share ----------------------------------------------------------------------------------------------


def _taken(scene: Scene, sketch: Sketch, cells: Cells, told: Cells, value: np.float32) -> Sketch | None:
    """The sketch in which the cells ``told`` have a value, so that the seen wall of ``cells`` is gone; None if none."""
    gone = sketch.gone.copy()
    gone[cells] |= scene.seen[cells]
    if np.array_equal(gone, sketch.gone):
        return None
    occupancy = sketch.occupancy.copy()
    occupancy[told] = value
    return replace(sketch, occupancy=occupancy, gone=gone)


def _put(scene: Scene, sketch: Sketch, cells: Cells, clear: float) -> Sketch | None:
    """The sketch with a wall in these cells, so far as they are known; None where it comes too close to the way."""
    if (scene.from_way[cells] <= clear).any():
        return None
    new = ~np.isnan(sketch.occupancy[cells]) & ~scene.walls[cells]
    cells = cells[0][new], cells[1][new]
    occupancy, put = sketch.occupancy.copy(), sketch.put.copy()
    occupancy[cells] = scene.wall
    put[cells] = True
    return replace(sketch, occupancy=occupancy, put=put)


def _on_a_wall(scene: Scene, rng: np.random.Generator) -> tuple[Array, Array]:
    """A cell of the seen wall, and the direction of the wall there: that of the seen cells within 0.6 m."""
    at = scene.seen_cells[rng.integers(len(scene.seen_cells))].astype(np.float64)
    square = scene.cells(at, np.array([1.0, 0.0]), 0.6, 0.6)
    near = np.stack(square)[:, scene.seen[square]] - at[:, None]
    return at, np.asarray(np.linalg.eigh(near @ near.T)[1][:, 1])


def _patch(scene: Scene, rng: np.random.Generator, size: float) -> Cells:
    at = scene.seen_cells[rng.integers(len(scene.seen_cells))].astype(np.float64)
    half_length, half_width = 0.5 * size * rng.uniform(*PATCH, size=2)
    return scene.cells(at, _direction(rng), half_length, half_width)


def _narrowest(scene: Scene, sketch: Sketch, at: Array) -> tuple[float, Array, Array]:
    """How wide the free space is at a place where it is narrowest, m, the middle of that line, and its direction.

    Infinite where the place is within a wall, or a line has no wall at either end.
    """
    from pipeline.kernels.raycast import cast

    headings = np.arange(0.0, math.pi, math.pi / 18)
    both = np.concatenate([headings, headings + math.pi])
    out = np.empty((1, len(both)), np.float32)
    longest = 2.0 * GAP[1] / scene.grid.resolution
    inside = np.clip(at, 0, np.array(scene.walls.shape) - 1).astype(np.int64)
    if scene.occupied(sketch)[inside[0], inside[1]]:
        return math.inf, at, np.array([1.0, 0.0])
    # From the cell's centre; cell borders are whole numbers, (x, y) is (column, row).
    pose = np.array([[inside[1] + 0.5, inside[0] + 0.5, 0.0]])
    cast(scene.occupied(sketch).astype(np.uint8), pose, both, longest, False, out)
    one, other = out[0, : len(headings)].astype(np.float64), out[0, len(headings) :].astype(np.float64)
    k = int(np.argmin(one + other))
    direction = np.array([math.sin(headings[k]), math.cos(headings[k])])
    width = float(one[k] + other[k])
    middle = inside + 0.5 * (one[k] - other[k]) * direction if math.isfinite(width) else at
    return width * scene.grid.resolution, middle, direction


def _is_floor(scene: Scene, sketch: Sketch, at: Array) -> bool:
    row, col = np.round(at).astype(np.int64).tolist()
    height, width = scene.grid.height, scene.grid.width
    inside = 0 <= row < height and 0 <= col < width
    return inside and bool(sketch.occupancy[row, col] < scene.config.free_threshold)


def _drawn_from(places: NDArray[np.int64], rng: np.random.Generator) -> Array | None:
    return places[rng.integers(len(places))].astype(np.float64) if len(places) else None


def _direction(rng: np.random.Generator) -> Array:
    angle = rng.uniform(0.0, math.pi)
    return np.array([math.cos(angle), math.sin(angle)])
