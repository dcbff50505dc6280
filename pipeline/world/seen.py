"""What scans have shown of the world, as a run leaves it: counts of a raster, to be kept, merged, and begun with."""

from __future__ import annotations

import math
import zipfile
import zlib
from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import MclError
from pipeline.geometry import Pose
from pipeline.maps.occupancy_grid import OccupancyGrid

MEMORY = "memory.npz"
"""Name of the file in a run's folder."""
FREE, WALL, UNKNOWN = 0, 1, 2
NEW, GONE, FLOOR = 1, 2, 3
"""How a cell has changed: a wall that the map lacks, a wall that is gone, floor of which the map knows nothing."""
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
    every side; ``resolution`` m; ``origin``: of the map's corner, as in ``OccupancyGrid``; ``map_sha256``: which map;
    ``logs``: checksums of the logs whose scans are counted, so that none is counted twice;
    ``within``: rows and columns that hold all that was seen, if somebody knows.
    """

    mapped: NDArray[np.uint8]
    hits: NDArray[np.float32]
    passes: NDArray[np.float32]
    margin: int
    resolution: float
    origin: Pose
    map_sha256: str
    logs: tuple[str, ...] = ()
    within: tuple[slice, slice] | None = None

    def __repr__(self) -> str:
        changed, logs = np.count_nonzero(self.changed), len(self.logs)
        return f"Seen({logs} {'log' if logs == 1 else 'logs'}: {changed:,} cells are not as mapped)"

    @cached_property
    def box(self) -> tuple[slice, slice]:
        """Rows and columns of the part in which anything was seen, and SAME around it; empty if nothing was."""
        if self.within is not None:
            return self.within
        touched = self.hits + self.passes > 0.0
        sides = []
        for axis in (1, 0):
            there = np.flatnonzero(touched.any(axis=axis))
            near = math.ceil(SAME / self.resolution) + 1
            first, last = (max(int(there[0]) - near, 0), int(there[-1]) + near + 1) if len(there) else (0, 0)
            sides.append(slice(first, last))
        return sides[0], sides[1]

    @cached_property
    def kinds(self) -> NDArray[np.uint8]:
        """(height, width) FREE, WALL or UNKNOWN: as mapped, but for what has changed.

        A mapped wall is gone only if nothing was hit near it: beams that pass a thin wall's end or graze it would erase
        walls that stand (docs/world.md).
        """
        kinds = self.mapped.copy()
        part, changed = kinds[self.box], self.changed[self.box]
        walls, _ = self._shown
        part[(changed == GONE) | (changed == FLOOR)] = FREE
        part[(changed == NEW) | (walls & (part == UNKNOWN))] = WALL
        return kinds

    @cached_property
    def changed(self) -> NDArray[np.uint8]:
        """(height, width): 0 as mapped, NEW, a wall that the map lacks, GONE, a wall, or FLOOR that was unknown.

        Walls that are no farther than SAME from where they were are where they were.
        """
        # Imported here: most runs never come so far.
        from scipy.ndimage import distance_transform_edt

        out = np.zeros(self.mapped.shape, np.uint8)
        (walls, free), mapped, near = self._shown, self.mapped[self.box], SAME / self.resolution
        part = out[self.box]
        if not part.size:
            return out

        def far_from(cells: NDArray[np.bool_]) -> NDArray[np.bool_]:
            return distance_transform_edt(~cells) > near if cells.any() else np.ones(cells.shape, np.bool_)

        part[free & (mapped == UNKNOWN)] = FLOOR
        part[walls & far_from(mapped == WALL)] = NEW
        part[free & (mapped == WALL) & far_from(self.hits[self.box] >= SEEN_HITS)] = GONE
        return out

    @cached_property
    def _shown(self) -> tuple[NDArray[np.bool_], NDArray[np.bool_]]:
        """Within the box the cells in which there is a wall, as far as was seen, and those in which there is none."""
        hits, passes = self.hits[self.box], self.passes[self.box]
        total = hits + passes
        return (hits >= SEEN_HITS) & (hits > SEEN_WALL * total), (passes >= SEEN_PASSES) & (hits < SEEN_FREE * total)

    def renewed(self) -> OccupancyGrid:
        """The map as it is now: what was seen over what was mapped, cut to what is known."""
        kinds = self.kinds
        occupancy = np.where(kinds == UNKNOWN, np.nan, kinds == WALL).astype(np.float32)
        rows, columns = np.nonzero(kinds != UNKNOWN)
        top, left = (int(k.min()) for k in (rows, columns)) if len(rows) else (self.margin, self.margin)
        bottom, right = (int(k.max()) + 1 for k in (rows, columns)) if len(rows) else (top + 1, left + 1)
        x, y, yaw = self.origin
        shift = np.array([left - self.margin, top - self.margin]) * self.resolution
        cos, sin = np.cos(yaw), np.sin(yaw)
        corner = (x + cos * shift[0] - sin * shift[1], y + sin * shift[0] + cos * shift[1], yaw)
        return OccupancyGrid(np.ascontiguousarray(occupancy[top:bottom, left:right]), self.resolution, corner)

    def merged(self, other: Seen) -> Seen:
        """Both together. Raises MclError if they are of two maps, or of the same log: its scans would count twice."""
        if self.map_sha256 != other.map_sha256 or self.mapped.shape != other.mapped.shape:
            raise MclError("these runs were made on different maps", "give runs that were made on one map")
        if set(self.logs) & set(other.logs):
            raise MclError(
                "two of these runs have seen the same log, whose scans would count twice", "give one run of each log"
            )
        hits, passes = self.hits + other.hits, self.passes + other.passes
        return Seen(
            self.mapped, hits, passes, self.margin, self.resolution, self.origin, self.map_sha256,
            (*self.logs, *other.logs),
        )  # fmt: skip

    def write(self, path: Path) -> None:
        """Save as a compressed .npz."""
        np.savez_compressed(
            path, mapped=self.mapped, hits=self.hits.astype(np.float16), passes=self.passes.astype(np.float16),
            margin=self.margin, resolution=self.resolution, origin=np.array(self.origin), map_sha256=self.map_sha256,
            logs=np.array(self.logs, dtype=np.str_),
        )  # fmt: skip


def seen_in(runs: Sequence[Path]) -> Seen | None:
    """What these runs, given by their folders or recordings, have shown of the world together; None of no run.

    Raises MclError if one has no memory, or they were made on different maps.
    """
    seen: Seen | None = None
    for run in runs:
        if not run.exists():
            raise MclError("no such folder", "name the folder of a run", path=run)
        if not run.is_dir() and run.suffix not in (".rrd", ".npz"):
            raise MclError("this is no run", "name the folder of a run", path=run)
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
                tuple(map(str, file["logs"].tolist())),
            )  # fmt: skip
    except FileNotFoundError:
        raise MclError(
            "there is no memory of a run here", "runs of earlier versions left none: run the log again", path=path
        ) from None
    except _DAMAGED as error:
        raise MclError("this file is no memory of a run", "name the folder of a run", path=path) from error
    if not (found.mapped.shape == found.hits.shape == found.passes.shape) or found.mapped.ndim != 2:
        raise MclError("this file is no memory of a run", "name the folder of a run", path=path)
    return found
