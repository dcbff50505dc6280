"""Maps that are wrong on purpose: so much of the wall that a drive sees is changed, while scans and truth stay exact.

Buildings change after they were mapped: doors are opened and shut, walls move, furniture comes and goes. Here the map
is changed instead of the building, which for a filter is the same, and keeps every scan and the truth as they were.
Every change is drawn from a seed, one piece after the other, until the share that was asked for is reached; what
counts is wall on which beams end when they are cast from the true way (``seen_walls``), in cells.
"""

from __future__ import annotations

import math
from dataclasses import dataclass, replace
from typing import Final

import numpy as np

from pipeline.config import Config
from pipeline.errors import MclError
from pipeline.evaluate.changes import KINDS, Kind
from pipeline.evaluate.metrics import Array
from pipeline.evaluate.scene import Scene, Sketch
from pipeline.evaluate.seen_walls import drive
from pipeline.logs.messages import Laser
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.spelling import meant_or_known

MIXED: Final = "mixed"
UNCHANGED: Final = "unchanged"
OVER: Final = 0.01
"""Share by which a piece may go beyond what was asked."""
SHORT: Final = 0.005
"""Share that may be missing when no further piece is drawn."""
PATIENCE: Final = 80
"""Pieces in a row that find no place before the drawing gives up."""


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
        raise MclError(f"no kind of change {kind!r}", meant_or_known(kind, (MIXED, *KINDS)))
    try:
        asked = [float(share) for share in shares.split(",")]
    except ValueError:
        asked = [math.nan]
    if not all(0.0 <= share <= 1.0 for share in asked):
        raise MclError(f"{text!r} asks for shares that are not between 0 and 1", "write 0.2 for 20 %, or boxes:0.1,0.2")
    return tuple(Change(kind, share) if share else Change(UNCHANGED, 0.0) for share in asked)


@dataclass(frozen=True)
class Perturbed:
    """A map that is wrong, and the share of the seen wall that really was ``changed``."""

    grid: OccupancyGrid
    changed: float


def perturb(grid: OccupancyGrid, truth: Array, laser: Laser, config: Config, change: Change, seed: int) -> Perturbed:
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
