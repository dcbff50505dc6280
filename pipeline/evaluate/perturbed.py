"""Maps that are wrong on purpose: so much of the wall that a drive sees is changed, while scans and truth stay exact.

Buildings change after they were mapped: doors are opened and shut, walls move, furniture comes and goes. Here the map
is changed instead of the building, which for a filter is the same, and keeps every scan and the truth as they were.
Every change is drawn from a seed, one piece after the other, until the share that was asked for is reached; what
counts is wall on which beams end when they are cast from the true way (``seen_walls``), in cells.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import Final

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import distance_transform_edt

from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.evaluate.metrics import Array
from pipeline.evaluate.seen_walls import Drive, Mask, drive
from pipeline.logs.messages import Laser
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.maps.walls import wall_half_thickness

MIXED: Final = "mixed"
UNCHANGED: Final = "unchanged"
CLEAR: Final = 0.3
"""m around the robot's way that nothing but a door of ``shut`` is put into."""
SMEAR: Final = 0.3
"""m from a wall up to which what is not floor belongs to it: beesoft maps draw walls half a metre thick."""
NEAR: Final = 4.0
"""m from the robot's way to boxes and doors, at most."""
DOOR: Final = (0.7, 1.2)
"""m: how wide a door is that is open on the map."""
GAP: Final = (0.6, 1.6)
"""m: how wide a gap is that a door on the map may shut; of a corridor that the robot drives through, twice that."""
PATCH: Final = (2.0, 5.0)
BOX: Final = (0.5, 1.5)
PIECE: Final = (1.0, 4.0)
SHIFT: Final = (0.3, 1.5)
OVER: Final = 0.01
"""Share by which a piece may go beyond what was asked."""
SHORT: Final = 0.005
"""Share that may be missing when no further piece is drawn."""
PATIENCE: Final = 80
"""Pieces in a row that find no place before the drawing gives up."""

Cells = tuple[NDArray[np.int64], NDArray[np.int64]]


@dataclass(frozen=True)
class Change:
    """What is asked for: ``share`` of the seen wall, changed in the way that ``kind`` names."""

    kind: str
    share: float

    @property
    def text(self) -> str:
        """As ``parse_changes`` reads it."""
        return UNCHANGED if self.kind == UNCHANGED else f"{self.kind}:{self.share:g}"


def parse_changes(text: str) -> tuple[Change, ...]:
    """What a text KIND:SHARE[,SHARE...] asks for; without a kind all of them are mixed. MclError for any other text."""
    kind, sep, shares = text.strip().rpartition(":")
    kind = kind if sep else MIXED
    if kind not in (MIXED, *KINDS):
        raise MclError(f"no kind of change {kind!r}", f"there are {', '.join((MIXED, *KINDS))}")
    try:
        asked = [float(share) for share in shares.split(",")]
    except ValueError:
        asked = [math.nan]
    if not all(0.0 <= share <= 1.0 for share in asked):
        raise MclError(f"{text!r} is not KIND:SHARE[,SHARE...] with shares of the seen wall from 0 to 1, as boxes:0.1")
    return tuple(Change(kind, share) if share else Change(UNCHANGED, 0.0) for share in asked)


@dataclass(frozen=True)
class Perturbed:
    """A map that is wrong, and the share of the seen wall that really was ``changed``."""

    grid: OccupancyGrid
    changed: float


def perturb(
    grid: OccupancyGrid, truth: Array, laser: Laser, config: Config, change: Change, seed: int
) -> Perturbed:  # fmt: skip
    """Change the map for a robot that is at ``truth`` (n, 3), m, m, rad in the map frame, NaN where unknown.

    The share that was changed is within 0.01 of what was asked, or as much as found a place. The same arguments give
    the same map. Raises MclError if no beam ends on a wall.
    """
    if change.kind == UNCHANGED:
        return Perturbed(grid, 0.0)
    scene = Scene(grid, drive(truth, laser, grid, laser.longest(config.laser_max_range)), config)
    if not scene.seen.any():
        raise MclError("no beam from the reference ends on a wall of this map", "do map and reference fit together?")
    sketch = Sketch(grid.occupancy, np.zeros_like(scene.seen), np.zeros_like(scene.seen))
    kinds = list(KINDS) if change.kind == MIXED else [change.kind]
    for k, kind in enumerate(kinds, start=1):
        rng = np.random.default_rng([seed, list(KINDS).index(kind)])
        sketch = _drawn(scene, sketch, KINDS[kind], change.share * k / len(kinds), rng)
    return Perturbed(replace(grid, occupancy=sketch.occupancy), scene.changed(sketch))


@dataclass(frozen=True)
class Sketch:
    """A map in the making: ``occupancy`` (height, width) float32; ``gone``: seen wall that was taken away or moved;
    ``put``: wall that was not there before. Both of the same shape."""

    occupancy: NDArray[np.float32]
    gone: Mask
    put: Mask


@dataclass(frozen=True)
class Scene:
    """The map as it was, and the drive that sees it."""

    grid: OccupancyGrid
    drive: Drive
    config: Config

    @cached_property
    def walls(self) -> Mask:
        """Cells that stop a beam."""
        return self.grid.occupied(self.config.occupied_threshold)

    @cached_property
    def seen(self) -> Mask:
        """Those of them on which beams end."""
        return self.drive.seen(self.walls)

    @cached_property
    def seen_cells(self) -> NDArray[np.int64]:
        """(n, 2) rows and columns of the seen wall."""
        return np.argwhere(self.seen)

    @cached_property
    def from_way(self) -> Array:
        """Metres of every cell from where the robot's centre was."""
        off = np.ones(self.walls.shape, np.bool_)
        way = np.floor(self.drive.way).astype(np.int64)
        cols, rows = way[:, 0], way[:, 1]
        inside = (rows >= 0) & (cols >= 0) & (rows < self.grid.height) & (cols < self.grid.width)
        off[rows[inside], cols[inside]] = False
        return np.asarray(distance_transform_edt(off)) * self.grid.resolution

    @cached_property
    def beside(self) -> NDArray[np.int64]:
        """(n, 2) rows and columns of the floor near the robot's way, but not in it."""
        floor = self.grid.free(self.config.free_threshold)
        return np.argwhere(floor & (self.from_way > CLEAR) & (self.from_way <= NEAR))

    @cached_property
    def by_walls(self) -> Mask:
        """Cells that are wall, or within SMEAR of it."""
        return np.asarray(distance_transform_edt(~self.walls)) * self.grid.resolution <= SMEAR

    @cached_property
    def half(self) -> float:
        """Half of what the map makes a wall thick, m; at least three quarters of a cell, which leaves no gaps."""
        return max(wall_half_thickness(self.grid, self.config.occupied_threshold), 0.75 * self.grid.resolution)

    @cached_property
    def floor(self) -> np.float32:
        """What the map says of floor."""
        floor = self.grid.occupancy[self.grid.free(self.config.free_threshold)]
        return np.float32(np.median(floor) if len(floor) else 0.0)

    @cached_property
    def wall(self) -> np.float32:
        """What the map says of walls."""
        return np.float32(np.median(self.grid.occupancy[self.walls]))

    def changed(self, sketch: Sketch) -> float:
        """The share of the seen wall that is gone, and the new wall that is seen, as a share of the same."""
        seen = int(np.sum(self.drive.seen(self.occupied(sketch)) & sketch.put)) if sketch.put.any() else 0
        return (int(np.sum(sketch.gone)) + seen) / len(self.seen_cells)

    def occupied(self, sketch: Sketch) -> Mask:
        """Cells of the sketch that stop a beam."""
        return sketch.occupancy >= np.float32(self.config.occupied_threshold)

    def cells(self, middle: Array, direction: Array, half_length: float, half_width: float) -> Cells:
        """Rows and columns of the cells in a rectangle: ``middle`` in cells (row, column), the rest in metres."""
        length, width = half_length / self.grid.resolution, half_width / self.grid.resolution
        reach = math.hypot(length, width) + 1.0
        low = np.maximum(np.floor(middle - reach), 0).astype(np.int64)
        high = np.minimum(np.ceil(middle + reach), np.array(self.walls.shape) - 1).astype(np.int64)
        rows, cols = np.mgrid[low[0] : high[0] + 1, low[1] : high[1] + 1]
        along = (rows - middle[0]) * direction[0] + (cols - middle[1]) * direction[1]
        across = (cols - middle[1]) * direction[0] - (rows - middle[0]) * direction[1]
        inside = (np.abs(along) <= length) & (np.abs(across) <= width)
        return rows[inside], cols[inside]

    def built(self, sketch: Sketch, cells: Cells) -> Cells:
        """Those of the cells that are wall, or what smears it: anything but floor, known, and close to wall."""
        something = sketch.occupancy[cells] >= np.float32(self.config.free_threshold)
        something &= self.by_walls[cells] | sketch.put[cells] | self.occupied(sketch)[cells]
        return cells[0][something], cells[1][something]


Kind = Callable[[Scene, Sketch, np.random.Generator, float], Sketch | None]
"""Draws a piece of change, of its usual size or a smaller one (by a factor); None if it found no place."""


def _drawn(scene: Scene, sketch: Sketch, kind: Kind, target: float, rng: np.random.Generator) -> Sketch:
    """The sketch with pieces of one kind, until ``target`` is changed or nothing finds a place any more."""
    now, misses, size = scene.changed(sketch), 0, 1.0
    while now < target - SHORT and misses < PATIENCE:
        tried = kind(scene, sketch, rng, size)
        then = now if tried is None else scene.changed(tried)
        if tried is None or then <= now or then > target + OVER:
            misses += 1
            size = max(0.8 * size, 0.2) if then > target + OVER else size
            continue
        sketch, now, misses = tried, then, 0
    return sketch


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
