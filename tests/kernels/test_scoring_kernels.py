"""Scores read from the table against sums made one look-up at a time."""

from __future__ import annotations

import math

import numpy as np
import pytest
import reference

from pipeline.kernels import scoring

HEADINGS, RESOLUTION, OUTSIDE = 360, 0.1, -77.0


class World:
    """A table of random codes: the scores need to know nothing of geometry."""

    def __init__(self, seed: int, n: int = 600, beams: int = 9) -> None:
        rng = np.random.default_rng(seed)
        self.row_of_cell = np.full((30, 40), -1, np.int32)
        open_cells = rng.choice(1200, 900, replace=False)
        self.row_of_cell.reshape(-1)[open_cells] = np.arange(900)
        self.table = rng.integers(0, 256, (900, HEADINGS)).astype(np.uint8)
        self.offsets = np.sort(rng.choice(180, beams, replace=False)).astype(np.int32)
        self.rows = np.concatenate([self.table, self.table[:, : self.offsets.max()]], axis=1)
        self.log_likelihood = rng.normal(-3, 2, (beams, 256)).astype(np.float32)
        self.laser = (0.25, -0.06, -1.2)
        self.poses = rng.uniform([-0.5, -0.5, -np.pi], [4.5, 3.5, np.pi], (n, 3)).astype(np.float32)

    def place(self) -> tuple:
        laser = [np.float32(v) for v in self.laser]
        return (*laser, np.float32(1 / RESOLUTION), HEADINGS, self.row_of_cell)

    def scores(self, work: int = 0) -> np.ndarray:
        out = np.empty(len(self.poses), np.float32)
        x, y, theta = np.ascontiguousarray(self.poses.T)
        table = self.rows, self.offsets, self.log_likelihood, np.float32(OUTSIDE)
        scoring.score(work, x, y, theta, *self.place(), *table, out)
        return out

    def twin_places(self) -> list[tuple[int, int, float]]:
        return [reference.table_place(p, self.laser, RESOLUTION, HEADINGS, self.row_of_cell) for p in self.poses]


@pytest.mark.parametrize("seed", range(5))
def test_score(seed: int) -> None:
    world = World(seed)
    found = world.scores()
    decided = 0
    for score, (row, heading, undecided) in zip(found, world.twin_places(), strict=True):
        if undecided < 1e-3:  # single precision decides which cell or heading it is
            continue
        decided += 1
        expected = reference.score(row, heading, world.table, world.offsets, world.log_likelihood, OUTSIDE)
        assert score == pytest.approx(expected, abs=1e-3)
    assert decided > 0.98 * len(found)
    assert (found == OUTSIDE).any()
    assert (found != OUTSIDE).any()


def test_score_is_the_same_with_all_threads() -> None:
    world = World(9, n=5001)
    np.testing.assert_array_equal(world.scores(), world.scores(work=10**9))


def test_a_particle_scores_the_same_whatever_its_neighbours_are() -> None:
    """Equal places are scored once, and four at a time: no bit of a score may depend on that."""
    world = World(4, n=3000)
    world.poses[1000:] = world.poses[np.random.default_rng(0).integers(0, 1000, 2000)]
    together = world.scores()
    everyone = world.poses
    for n in (1, 2, 3, 5, 17, 600):
        world.poses = everyone[:n]
        np.testing.assert_array_equal(world.scores(), together[:n])


def test_single_precision_is_enough() -> None:
    """180 beams summed in float32 against float64: apart by less than 1e-3 nats, of some 700."""
    rng = np.random.default_rng(2)
    world = World(2, n=2000, beams=180)
    world.log_likelihood = rng.uniform(-9, 1, (180, 256)).astype(np.float32)
    found = world.scores()
    apart = [
        abs(found[i] - reference.score(row, h, world.table, world.offsets, world.log_likelihood, 0.0))
        for i, (row, h, undecided) in enumerate(world.twin_places())
        if row >= 0 and undecided > 1e-3
    ]
    assert len(apart) > 800
    assert max(apart) < 1e-3


def look_up(world: World, poses) -> np.ndarray:
    codes = np.zeros((len(poses), len(world.offsets)), np.uint8)
    columns = np.ascontiguousarray(np.array(poses, np.float32).T)
    place = (np.float32(0), np.float32(0), np.float32(0), np.float32(1 / RESOLUTION))
    scoring.look_up(*columns, *place, HEADINGS, world.row_of_cell, world.table, world.offsets, codes)
    return codes


def test_headings_go_round() -> None:
    """Headings that are whole turns apart look into the same place, at both ends of the circle too."""
    world = World(3, n=1)
    spot = np.argwhere(world.row_of_cell >= 0)[50][::-1] * RESOLUTION + RESOLUTION / 2
    degrees = np.array([-180.0, -179.6, -0.4, 0.0, 0.4, 179.4, 179.6])
    found = look_up(world, [(*spot, math.radians(d)) for d in degrees])
    row = world.row_of_cell[int(spot[1] / RESOLUTION), int(spot[0] / RESOLUTION)]
    headings = np.floor(degrees + 0.5).astype(int) % HEADINGS
    np.testing.assert_array_equal(found, world.table[row, headings[:, None] + world.offsets])


@pytest.mark.parametrize("pose", [(math.nan, 1.0, 0.0), (math.inf, 1.0, 0.0), (1e30, -1e30, 0.0), (-0.01, 1.0, 0.0)])
def test_poses_that_are_nowhere_are_outside(pose) -> None:
    assert not look_up(World(3), [pose]).any()


def test_score_codes() -> None:
    rng = np.random.default_rng(1)
    codes = rng.integers(0, 256, (400, 7)).astype(np.uint8)
    codes[::10] = 0  # a laser within an obstacle sees nothing but zeros
    codes[5, :6] = 0  # a laser close to one does not
    log_likelihood = rng.normal(-3, 2, (7, 256)).astype(np.float32)
    expected = log_likelihood[np.arange(7), codes].astype(float).sum(axis=1)
    expected[::10] = OUTSIDE
    for work in (0, 10**9):
        out = np.empty(400, np.float32)
        scoring.score_codes(work, codes, log_likelihood, np.float32(OUTSIDE), out)
        np.testing.assert_allclose(out, expected, atol=1e-4)
