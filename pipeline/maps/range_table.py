"""Pre-computed true ranges: eight bits for every open cell and heading, built once per map and kept on disk."""

from __future__ import annotations

import hashlib
import os
import tempfile
from contextlib import suppress
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import MclError
from pipeline.kernels import raycast
from pipeline.maps.occupancy_grid import OccupancyGrid

HIT_CODES = 224
"""Codes 0..223: an obstacle stops the ray. Fine where the sensor model is sharp, near, and coarser far away."""
UNKNOWN_CODES = 31
"""Codes 224..254: the ray leaves what the map knows; beyond that anything may be. 255: nothing within max_range."""
LOG_OFFSET = 2.0
"""Metres at which the logarithmic scale of the codes bends: 3 cm a step at the laser, 2 % of the range far away."""
HEADINGS = 360
MAX_TABLE_BYTES = 1 << 30
_FORMAT = b"mcl range table 1\n"


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

    ``rows`` (n, HEADINGS) uint8 codes, heading h at h * 360 / HEADINGS degrees in the grid frame;
    ``cells`` (n,) int32 flat index of each row's cell; ``row_of_cell`` (height, width) int32, -1 = no laser there.
    """

    codes: RangeCodes
    cells: NDArray[np.int32]
    row_of_cell: NDArray[np.int32]
    rows: NDArray[np.uint8]

    def rows_through_walls(self, reach: float) -> NDArray[np.int32]:
        """``row_of_cell`` with the row of the nearest open cell in every cell whose centre lies up to ``reach`` cells
        inside a wall.

        A map whose walls are smeared closes its own doors: a robot that drives through one must not fall off the map.
        """
        if reach < 0.5:
            return self.row_of_cell
        from scipy import ndimage

        distance, nearest = ndimage.distance_transform_edt(self.row_of_cell < 0, return_indices=True)
        filled = self.row_of_cell[tuple(nearest)]
        # The open cell's border is half a cell nearer than its centre; and 1.5 cells in metres may come back as less.
        return np.where(distance - 0.5 <= reach + 1e-6, filled, np.int32(-1)).astype(np.int32)

    def padded(self, span: int) -> NDArray[np.uint8]:
        """``rows`` with their first ``span`` headings repeated at the end, so that no index needs a modulo."""
        return np.ascontiguousarray(np.concatenate([self.rows, self.rows[:, :span]], axis=1))


def opaque_cells(grid: OccupancyGrid, threshold: float) -> NDArray[np.uint8]:
    """(height, width) uint8: 0 lets rays pass, 1 is occupied, 2 unknown (a ray ends there, for want of knowledge)."""
    opaque = np.where(grid.known, grid.occupied(threshold), raycast.UNKNOWN)
    return np.ascontiguousarray(opaque.astype(np.uint8))


def range_codes(grid: OccupancyGrid, laser_max_range: float) -> RangeCodes:
    """The scale of codes for a map and a laser: no ray is longer than the map's diagonal."""
    return RangeCodes(min(laser_max_range, float(np.hypot(grid.height, grid.width)) * grid.resolution))


def build_range_table(grid: OccupancyGrid, threshold: float, laser_max_range: float) -> RangeTable:
    """Cast every ray with the DDA kernel; the map's unknown cells stop rays and hold no laser.

    Raises MclError if the map has no open cell, or so many that the table would not fit in a gigabyte.
    """
    opaque = opaque_cells(grid, threshold)
    codes = range_codes(grid, laser_max_range)
    cells, row_of_cell = _open_cells(opaque)
    rows = np.empty((len(cells), HEADINGS), np.uint8)
    in_cells = codes.max_range / grid.resolution, codes.scale, LOG_OFFSET / grid.resolution
    raycast.build_table(rows.size, opaque, cells, HEADINGS, *in_cells, HIT_CODES, UNKNOWN_CODES, rows)
    return RangeTable(codes, cells, row_of_cell, rows)


def load_range_table(grid: OccupancyGrid, threshold: float, laser_max_range: float) -> RangeTable:
    """The table from the cache, or built and put there. A damaged or foreign file is rebuilt, never trusted."""
    codes = range_codes(grid, laser_max_range)
    identity = f"{grid.sha256} {threshold!r} {codes.max_range!r} {HEADINGS} {HIT_CODES} {UNKNOWN_CODES} {LOG_OFFSET!r}"
    key = hashlib.sha256(identity.encode()).hexdigest()
    path = cache_dir() / f"{key[:32]}.ranges"
    cells, row_of_cell = _open_cells(opaque_cells(grid, threshold))
    rows = _read(path, key, len(cells))
    if rows is not None:
        return RangeTable(codes, cells, row_of_cell, rows)
    table = build_range_table(grid, threshold, laser_max_range)
    _write(path, key, table.rows)
    return table


def cache_dir() -> Path:
    """Where tables are kept: $MCL_CACHE_DIR, or the user's cache folder."""
    if configured := os.environ.get("MCL_CACHE_DIR"):
        return Path(configured)
    return Path(os.environ.get("XDG_CACHE_HOME") or Path.home() / ".cache") / "mcl-replay"


def _open_cells(opaque: NDArray[np.uint8]) -> tuple[NDArray[np.int32], NDArray[np.int32]]:
    cells = np.flatnonzero(opaque == 0).astype(np.int32)
    if len(cells) == 0:
        raise MclError("the map has no cell in which a robot could stand", "check occupied_threshold and the map")
    if len(cells) * HEADINGS > MAX_TABLE_BYTES:
        raise MclError(
            f"the table of ranges would need {len(cells) * HEADINGS / 1e9:.1f} GB for {len(cells):,} open cells",
            "use --set ray_caster=dda, or a map with larger cells",
        )
    row_of_cell = np.full(opaque.shape, -1, np.int32)
    row_of_cell.reshape(-1)[cells] = np.arange(len(cells), dtype=np.int32)
    return cells, row_of_cell


def _read(path: Path, key: str, n: int) -> NDArray[np.uint8] | None:
    """Rows from a cache file, mapped read-only for processes to share; None if it is not exactly what we wrote."""
    header = len(_FORMAT) + 128
    try:
        if path.stat().st_size != header + n * HEADINGS:
            return None
        with path.open("rb") as file:
            head = file.read(header)
        rows = np.memmap(path, np.uint8, "r", offset=header, shape=(n, HEADINGS))
    except OSError:
        return None
    # blake2b runs at about a gigabyte a second: cheap beside the wrong map.
    checksum = hashlib.blake2b(rows.data, digest_size=32).hexdigest()
    return rows if head == _FORMAT + key.encode() + checksum.encode() else None


def _write(path: Path, key: str, rows: NDArray[np.uint8]) -> None:
    checksum = hashlib.blake2b(rows.data, digest_size=32).hexdigest()
    temporary: Path | None = None
    try:
        path.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.NamedTemporaryFile(dir=path.parent, delete=False) as file:
            temporary = Path(file.name)
            file.write(_FORMAT + key.encode() + checksum.encode())
            file.write(rows.tobytes())
        temporary.replace(path)
    except OSError:
        pass  # a cache that cannot be written costs time, nothing else
    finally:
        if temporary is not None:
            with suppress(OSError):
                temporary.unlink(missing_ok=True)  # whatever went wrong, Ctrl-C as well: it may hold a gigabyte
