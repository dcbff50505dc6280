"""How costs grow: over particles, beams, and the size of the map."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence

import numpy as np

from pipeline.bench.measure import Growth, measured, seconds
from pipeline.bench.scoring import Bench
from pipeline.logs.messages import Log
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.maps.range_table import build_range_table, throwaway_tables

PARTICLES = (500, 2_000, 10_000, 50_000, 200_000, 1_000_000)
BEAMS = (36, 60, 90, 180)
METRES = (80, 160, 320)
COARSEST = 0.2
"""Cells of the maps of different sizes: finer ones would not fit the largest table."""
POSES = 100_000


def growth(log: Log, repeats: int) -> list[Growth]:
    """Curves of scoring at random poses with all threads, of full updates, and of the table."""
    every = log.laser.beams
    updates, scores = [], []
    for particles in PARTICLES:
        b = Bench(log, particles, every)
        updates.append(_median(b.updates(repeats)) * 1e9 / particles)
        scores.append(_score(b, repeats))
    over_beams = [beams for beams in BEAMS if beams <= every] or [every]
    by_beams = [_score(Bench(log, POSES, beams), repeats) for beams in over_beams]
    built, by_size = [], []
    with throwaway_tables():
        for metres in METRES:
            assert log.grid is not None
            larger = dataclasses.replace(log, grid=_tiled(log.grid, metres))
            assert larger.grid is not None
            of_map = (larger.grid, larger.grid.wall_threshold(None), log.laser.longest(None), every)
            build_range_table(*of_map)
            built.append(seconds(lambda of_map=of_map: build_range_table(*of_map)))  # type: ignore[misc]
            by_size.append(_score(Bench(larger, POSES, every), repeats))
    each = "ns a particle-beam"
    return [
        _curve(f"full update, {every} beams", "particles", PARTICLES, updates, "ns a particle"),
        _curve(f"scoring, {every} beams", "particles", PARTICLES, scores, each),
        _curve(f"scoring, {POSES:,} particles", "beams", over_beams, by_beams, each),
        _curve(f"scoring, {POSES:,} particles, {every} beams", "map, m", METRES, by_size, each),
        _curve("table of ranges, cells of 0.2 m: build", "map, m", METRES, built, "s"),
    ]


def _curve(name: str, over: str, points: Sequence[float], values: Sequence[float], unit: str) -> Growth:
    return Growth(name, over, tuple(points), tuple(values), unit)


def _score(b: Bench, repeats: int) -> float:
    out = np.empty(b.poses.shape[1], np.float32)
    (taken,) = measured(repeats, [lambda: b.score(b.poses, out)])
    return _median(taken) * 1e9 / (out.size * b.beams)


def _median(values: Sequence[float]) -> float:
    return float(np.median(values))


def _tiled(grid: OccupancyGrid, metres: float) -> OccupancyGrid:
    """The map over and over, of so many metres a side, in cells of COARSEST or the map's own if these are larger."""
    by = max(1, round(COARSEST / grid.resolution))
    height, width = grid.height // by * by, grid.width // by * by
    blocks = grid.occupancy[:height, :width].reshape(height // by, by, width // by, by)
    unknown = np.isnan(blocks)
    cells = np.where(unknown, 0.0, blocks).max(axis=(1, 3)).astype(np.float32)
    cells[unknown.all(axis=(1, 3))] = np.nan
    size = round(metres / (grid.resolution * by))
    tiled = np.tile(cells, (-(-size // cells.shape[0]), -(-size // cells.shape[1])))[:size, :size]
    return OccupancyGrid(np.ascontiguousarray(tiled), grid.resolution * by)
