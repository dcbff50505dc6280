"""What scans have shown of the world, as a run leaves it: counts of a raster, to be kept, merged, and begun with."""

from __future__ import annotations

import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import MclError
from pipeline.geometry import Pose
from pipeline.maps.occupancy_grid import OccupancyGrid

MEMORY = "memory.npz"
"""Name of the file in a run's folder."""
FREE, WALL, UNKNOWN = 0, 1, 2
SEEN_HITS, SEEN_WALL = 2.0, 0.4
"""Scans that must have ended in a cell, and their least share among all that came to it, so that it is a wall."""
SEEN_PASSES, SEEN_FREE = 3.0, 0.1
"""Scans that must have passed a cell, and the most of them that may have ended there, so that it is free."""
SAME = 0.3
"""m: a wall that is so close to a mapped one is that: maps are drawn no better, nor is the place known better."""

_DAMAGED = (OSError, EOFError, KeyError, TypeError, ValueError, RuntimeError, zipfile.BadZipFile, zlib.error)
"""What numpy and zipfile raise for files that are something else, or cut, or damaged."""


@dataclass(frozen=True)
class Seen:
    """Of every cell how many scans ended in it, ``hits``, and passed it, ``passes`` (height, width) float32.

    ``mapped`` (height, width) uint8: FREE, WALL or UNKNOWN, as the map has it, which is ``margin`` cells smaller on
    every side; ``resolution`` m; ``origin``: of the map's corner, as in ``OccupancyGrid``; ``map_sha256``: which map.
    """

    mapped: NDArray[np.uint8]
    hits: NDArray[np.float32]
    passes: NDArray[np.float32]
    margin: int
    resolution: float
    origin: Pose
    map_sha256: str

    @property
    def walls(self) -> NDArray[np.bool_]:
        """Cells in which there is a wall, as far as was seen."""
        return (self.hits >= SEEN_HITS) & (self.hits > SEEN_WALL * (self.hits + self.passes))

    @property
    def free(self) -> NDArray[np.bool_]:
        """Cells in which there is none."""
        return (self.passes >= SEEN_PASSES) & (self.hits < SEEN_FREE * (self.hits + self.passes))

    @property
    def kinds(self) -> NDArray[np.uint8]:
        """(height, width) FREE, WALL or UNKNOWN: as was seen, and as the map has it where nothing was."""
        kinds = self.mapped.copy()
        kinds[self.free] = FREE
        kinds[self.walls] = WALL
        return kinds

    def changed(self) -> NDArray[np.uint8]:
        """(height, width): 0 as mapped, 1 a wall that the map lacks, 2 a wall that is gone, 3 floor that was unknown.

        Walls that are no farther than SAME from where they were are where they were.
        """
        # Imported here: most runs never come so far.
        from scipy.ndimage import distance_transform_edt

        near, walls, free = SAME / self.resolution, self.walls, self.free
        out = np.zeros(self.mapped.shape, np.uint8)
        out[free & (self.mapped == UNKNOWN)] = 3
        if walls.any():
            mapped_wall = self.mapped == WALL
            far = distance_transform_edt(~mapped_wall) > near if mapped_wall.any() else np.True_
            out[walls & far] = 1
        touched = self.hits >= SEEN_HITS
        far = distance_transform_edt(~touched) > near if touched.any() else np.True_
        out[free & (self.mapped == WALL) & far] = 2
        return out

    def renewed(self) -> OccupancyGrid:
        """The map as it is now: what was seen over what was mapped, cut to what is known."""
        occupancy = np.where(self.kinds == UNKNOWN, np.nan, self.kinds == WALL).astype(np.float32)
        rows, columns = np.nonzero(self.kinds != UNKNOWN)
        top, left = (int(k.min()) for k in (rows, columns)) if len(rows) else (self.margin, self.margin)
        bottom, right = (int(k.max()) + 1 for k in (rows, columns)) if len(rows) else (top + 1, left + 1)
        x, y, yaw = self.origin
        shift = np.array([left - self.margin, top - self.margin]) * self.resolution
        cos, sin = np.cos(yaw), np.sin(yaw)
        corner = (x + cos * shift[0] - sin * shift[1], y + sin * shift[0] + cos * shift[1], yaw)
        return OccupancyGrid(np.ascontiguousarray(occupancy[top:bottom, left:right]), self.resolution, corner)

    def merged(self, other: Seen) -> Seen:
        """Both together. Raises MclError if they are of two maps."""
        if self.map_sha256 != other.map_sha256 or self.mapped.shape != other.mapped.shape:
            raise MclError("these runs were made on different maps", "merge runs on one map")
        return Seen(
            self.mapped, self.hits + other.hits, self.passes + other.passes, self.margin, self.resolution, self.origin,
            self.map_sha256,
        )  # fmt: skip

    def write(self, path: Path) -> None:
        """Save as a compressed .npz."""
        np.savez_compressed(
            path, mapped=self.mapped, hits=self.hits.astype(np.float16), passes=self.passes.astype(np.float16),
            margin=self.margin, resolution=self.resolution, origin=np.array(self.origin), map_sha256=self.map_sha256,
        )  # fmt: skip


def seen_in(runs: Sequence[Path]) -> Seen | None:
    """What these runs, given by their folders or recordings, have shown of the world together; None of no run.

    Raises MclError if one has no memory, or they were made on different maps.
    """
    seen: Seen | None = None
    for run in runs:
        found = read_seen(run / MEMORY if run.is_dir() else run.with_name(MEMORY))
        seen = found if seen is None else seen.merged(found)
    return seen


def read_seen(path: Path) -> Seen:
    """Read what a run has left. Raises MclError if the file is missing, or no such file."""
    try:
        with np.load(path, allow_pickle=False) as file:
            x, y, yaw = file["origin"].tolist()
            found = Seen(
                file["mapped"], file["hits"].astype(np.float32), file["passes"].astype(np.float32), int(file["margin"]),
                float(file["resolution"]), (x, y, yaw), str(file["map_sha256"]),
            )  # fmt: skip
    except FileNotFoundError:
        raise MclError(
            "this run remembers nothing of the world", "it needs a run that kept its memory", path=path
        ) from None
    except _DAMAGED as error:
        raise MclError("this file is no memory of a run", "name the folder of a run", path=path) from error
    if not (found.mapped.shape == found.hits.shape == found.passes.shape) or found.mapped.ndim != 2:
        raise MclError("this file is no memory of a run", "name the folder of a run", path=path)
    return found
