"""Pre-computed true ranges: eight bits for every open cell and heading, built once per map and kept on disk."""

from __future__ import annotations

import hashlib
import os
import tempfile
import time
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from typing import Any
from unittest.mock import patch

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import MclError
from pipeline.kernels import raycast, table
from pipeline.kernels.nearest import nearest
from pipeline.maps.occupancy_grid import OccupancyGrid

HIT_CODES = 224
"""Codes 0..223: an obstacle stops the ray. Fine where the sensor model is sharp, near, and coarser far away."""
UNKNOWN_CODES = 31
"""Codes 224..254: the ray leaves what the map knows; beyond that anything may be. 255: nothing within max_range."""
LOG_OFFSET = 2.0
"""Metres at which the logarithmic scale of the codes bends: 3 cm a step at the laser, 2 % of the range far away."""
HEADINGS = 360
MAX_TABLE_BYTES = 1 << 30
_FORMAT = b"mcl range table 2\n"
_HEADER = 192
"""Bytes before the table: format, key, checksum. Whole words, so that the table can be read by the word."""
UNUSED = 60 * 86_400
"""Seconds after which a table that nobody has asked for makes room: it is large, and soon built again."""


@dataclass(frozen=True)
class RangeCodes:
    """The scale of the eight-bit codes for rays up to ``max_range`` metres."""

    max_range: float

    @property
    def scale(self) -> float:
        """1 / log(1 + max_range / LOG_OFFSET)."""
        return 1.0 / float(np.log1p(self.max_range / LOG_OFFSET))

    @cached_property
    def ranges(self) -> NDArray[np.float64]:
        """(256,) true range in metres that each code stands for; inf for 255."""
        hit = np.expm1(np.arange(HIT_CODES) / (HIT_CODES - 1) / self.scale) * LOG_OFFSET
        unknown = np.expm1(np.arange(UNKNOWN_CODES) / (UNKNOWN_CODES - 1) / self.scale) * LOG_OFFSET
        return np.concatenate([hit, unknown, [np.inf]])

    @cached_property
    def steps(self) -> tuple[NDArray[np.float64], NDArray[np.float64]]:
        """Shortest and longest true range in metres, (256,) each, that are rounded to a code; inf for 255."""
        borders = []
        for codes in (HIT_CODES, UNKNOWN_CODES):
            share = np.clip((np.arange(codes + 1) - 0.5) / (codes - 1), 0.0, 1.0)
            borders.append(np.expm1(share / self.scale) * LOG_OFFSET)
        none = np.array([np.inf])
        return np.concatenate([*(b[:-1] for b in borders), none]), np.concatenate([*(b[1:] for b in borders), none])

    @property
    def ends_unknown(self) -> NDArray[np.bool_]:
        """(256,) codes of rays that leave what the map knows."""
        codes = np.arange(256)
        return (codes >= HIT_CODES) & (codes < HIT_CODES + UNKNOWN_CODES)


@dataclass(frozen=True)
class RangeTable:
    """True ranges from the centre of every open cell.

    ``wide`` (n, HEADINGS or more) uint8 codes, heading h at h * 360 / HEADINGS degrees in the grid frame, as many of
    the first ones repeated at the end as a laser spans, so that no index needs a modulo;
    ``cells`` (n,) int32 flat index of each row's cell; ``row_of_cell`` (height, width) int32, -1 = no laser there.
    """

    codes: RangeCodes
    cells: NDArray[np.int32]
    row_of_cell: NDArray[np.int32]
    wide: NDArray[np.uint8]

    @property
    def rows(self) -> NDArray[np.uint8]:
        """(n, HEADINGS) uint8: each heading once."""
        return self.wide[:, :HEADINGS]

    def rows_through_walls(self, reach: float) -> NDArray[np.int32]:
        """``row_of_cell`` with the row of the nearest open cell in every cell whose centre lies up to ``reach`` cells
        inside a wall.

        A map whose walls are smeared closes its own doors: a robot that drives through one must not fall off the map.
        """
        if reach < 0.5:
            return self.row_of_cell
        squared, at = np.empty_like(self.row_of_cell), np.empty_like(self.row_of_cell)
        # The open cell's border is half a cell nearer than its centre; and 1.5 cells in metres may come back as less.
        farthest = reach + 0.5 + 1e-6
        nearest(self.row_of_cell >= 0, int(farthest), squared, at)
        filled = self.row_of_cell.reshape(-1)[at]
        return np.where(squared <= farthest**2, filled, np.int32(-1)).astype(np.int32)

    def padded(self, span: int) -> NDArray[np.uint8]:
        """The rows with at least their first ``span`` headings repeated at the end; a copy only if they are not yet."""
        if self.wide.shape[1] >= HEADINGS + span:
            return self.wide
        return np.ascontiguousarray(np.concatenate([self.rows, self.rows[:, :span]], axis=1))


def opaque_cells(grid: OccupancyGrid, threshold: float) -> NDArray[np.uint8]:
    """(height, width) uint8: 0 lets rays pass, 1 is occupied, 2 unknown (a ray ends there, for want of knowledge)."""
    opaque = np.where(grid.known, grid.occupied(threshold), raycast.UNKNOWN)
    return np.ascontiguousarray(opaque.astype(np.uint8))


def range_codes(grid: OccupancyGrid, laser_max_range: float) -> RangeCodes:
    """The scale of codes for a map and a laser: no ray is longer than the map's diagonal."""
    return RangeCodes(min(laser_max_range, float(np.hypot(grid.height, grid.width)) * grid.resolution))


def build_range_table(grid: OccupancyGrid, threshold: float, laser_max_range: float, span: int = 0) -> RangeTable:
    """Cast every ray; the map's unknown cells stop rays and hold no laser. The first ``span`` headings are repeated.

    Raises MclError if the map has no open cell, or so many that the table would not fit in a gigabyte.
    """
    opaque = opaque_cells(grid, threshold)
    codes = range_codes(grid, laser_max_range)
    cells, row_of_cell = _open_cells(opaque, _width(span))
    wide = np.empty((len(cells), _width(span)), np.uint8)
    RangeCaster(opaque, codes, grid.resolution).cast(cells, wide)
    wide.flags.writeable = False  # as what is read from the cache
    return RangeTable(codes, cells, row_of_cell, wide)


class RangeCaster:
    """Casts rays in every heading from the centres of cells of a raster, ``opaque`` (height, width) uint8: 0 lets rays
    pass, 1 is occupied, 2 unknown; off it all is."""

    def __init__(self, opaque: NDArray[np.uint8], codes: RangeCodes, resolution: float) -> None:
        # One cell off the map on every side, so that no ray has to ask where the map ends.
        self._walled, self._width = np.pad(np.ascontiguousarray(opaque), 1), opaque.shape[1]
        self._clear = np.empty_like(self._walled)
        table.clearance(self._walled, self._clear)
        # From which range on each code counts, and which code that is at every small step.
        longest = codes.max_range / resolution
        borders = np.full((2, HIT_CODES + 1), np.inf)
        borders[0, :HIT_CODES] = codes.steps[0][:HIT_CODES] / resolution
        borders[1, :UNKNOWN_CODES] = codes.steps[0][HIT_CODES:-1] / resolution
        steps = np.arange(int(longest * table.STEPS) + 1) / table.STEPS
        code_at = np.stack([np.searchsorted(b, steps, side="right") - 1 for b in borders]).astype(np.uint8)
        self._scale = (HEADINGS, longest, borders, code_at)

    def cast(self, cells: NDArray[np.integer[Any]], out: NDArray[np.uint8]) -> None:
        """Codes from the centres of ``cells`` (n,) flat, in every heading -> ``out`` (n, HEADINGS or more)."""
        row, col = np.divmod(cells.astype(np.int64), self._width)
        start = (row + 1) * self._walled.shape[1] + col + 1
        table.build_table(50 * out.size, self._walled, self._clear, start, *self._scale, out)


def load_range_table(grid: OccupancyGrid, threshold: float, laser_max_range: float, span: int = 0) -> RangeTable:
    """The table from the cache, or built and put there. A damaged or foreign file is rebuilt, never trusted."""
    codes, width = range_codes(grid, laser_max_range), _width(span)
    identity = (
        f"{grid.sha256} {threshold!r} {codes.max_range!r} {HEADINGS} {width} {HIT_CODES} {UNKNOWN_CODES} {LOG_OFFSET!r}"
    )
    key = hashlib.sha256(identity.encode()).hexdigest()
    path = cache_dir() / f"{key[:32]}.ranges"
    cells, row_of_cell = _open_cells(opaque_cells(grid, threshold), width)
    if (wide := _read(path, key, (len(cells), width))) is None:
        built = build_range_table(grid, threshold, laser_max_range, span)
        _write(path, key, built.wide)
        # Read back, so that it lies in memory once for all who use it.
        if (wide := _read(path, key, (len(cells), width))) is None:
            return built
    with suppress(OSError):
        path.touch()
    return RangeTable(codes, cells, row_of_cell, wide)


def cache_dir() -> Path:
    """Where tables are kept: $MCL_CACHE_DIR, or the user's cache folder."""
    if configured := os.environ.get("MCL_CACHE_DIR"):
        return Path(configured)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "mcl-replay"


@contextmanager
def throwaway_tables() -> Iterator[None]:
    """Tables that are made meanwhile go into a folder that is removed at the end: nobody will ask for them again."""
    with patch.dict(os.environ), tempfile.TemporaryDirectory(prefix="mcl-table-") as folder:
        os.environ["MCL_CACHE_DIR"] = folder
        yield


def _width(span: int) -> int:
    """Bytes of a row: all headings and so many again, up to whole words."""
    return -(-(HEADINGS + span) // 8) * 8


def _open_cells(opaque: NDArray[np.uint8], width: int) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    cells = np.flatnonzero(opaque == 0).astype(np.int32)
    if len(cells) == 0:
        raise MclError("the map has no cell in which a robot could stand", "check occupied_threshold and the map")
    if len(cells) * width > MAX_TABLE_BYTES:
        raise MclError(
            f"the table of ranges would need {len(cells) * width / 1e9:.1f} GB for {len(cells):,} open cells",
            "use --set ray_caster=dda, or a map with larger cells",
        )
    row_of_cell = np.full(opaque.shape, -1, np.int32)
    row_of_cell.reshape(-1)[cells] = np.arange(len(cells), dtype=np.int32)
    return cells, row_of_cell


def _read(path: Path, key: str, shape: tuple[int, int]) -> NDArray[np.uint8] | None:
    """Rows from a cache file, mapped read-only for processes to share; None if it is not exactly what we wrote."""
    try:
        if path.stat().st_size != _HEADER + shape[0] * shape[1]:
            return None
        with path.open("rb") as file:
            head = file.read(_HEADER)
        rows = np.asarray(np.memmap(path, np.uint8, "r", offset=_HEADER, shape=shape))
    except OSError:
        return None
    return rows if head == _header(key, rows) else None


def _header(key: str, rows: NDArray[np.uint8]) -> bytes:
    """Format, key, and a checksum that runs as fast as memory: a table is asked for damage at every start."""
    words = np.frombuffer(rows.data, np.uint64)
    sums = np.empty(-(-len(words) // table.WORDS), np.uint64)
    table.mix(len(words), words, sums)
    checksum = hashlib.blake2b(sums.tobytes(), digest_size=32).hexdigest()
    return (_FORMAT + key.encode() + checksum.encode()).ljust(_HEADER)


def _make_room(folder: Path) -> None:
    for old in folder.glob("*.ranges"):
        if time.time() - old.stat().st_mtime > UNUSED:
            old.unlink()


def _write(path: Path, key: str, rows: NDArray[np.uint8]) -> None:
    temporary: Path | None = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as file:
            temporary = Path(file.name)
            file.write(_header(key, rows))
            file.write(rows.data)
        temporary.replace(path)
        _make_room(path.parent)
    except OSError:
        pass  # a cache that cannot be written costs time, nothing else
    finally:
        if temporary is not None:
            with suppress(OSError):
                temporary.unlink(missing_ok=True)  # whatever went wrong, Ctrl-C as well: it may hold a gigabyte
