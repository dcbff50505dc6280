"""Beams' ends looked up in a field against look-ups made one at a time."""

from __future__ import annotations

import math

import numpy as np
import pytest
import reference

from pipeline.kernels import BLOCK, field

RESOLUTION = 0.1
INV = np.float32(1 / RESOLUTION)


class World:
    """A field of random codes; poses and ends on and off it."""

    def __init__(self, seed: int, n: int = 500, beams: int = 8) -> None:
        rng = np.random.default_rng(seed)
        self.codes = rng.integers(0, 9, (30, 40)).astype(np.uint16)
        self.values = rng.normal(-3, 2, 10).astype(np.float32)
        self.poses = rng.uniform([-0.5, -0.5, -np.pi], [4.5, 3.5, np.pi], (n, 3)).astype(np.float32)
        self.ranges, self.angles = rng.uniform(0, 2, beams), rng.uniform(-2, 2, beams)
        ends = self.ranges * np.array([np.cos(self.angles), np.sin(self.angles)]) / RESOLUTION
        self.ends = ends.astype(np.float32)

    def arguments(self) -> tuple:
        return (*np.ascontiguousarray(self.poses.T), *self.ends, INV, self.codes)

    def scores(self, work: int = 0) -> np.ndarray:
        out = np.empty(len(self.poses), np.float32)
        field.score_field(work, *self.arguments(), self.values, out)
        return out

    def counts(self, near: int, work: int = 0) -> np.ndarray:
        counts = np.full((-(-len(self.poses) // BLOCK), len(self.ranges)), -1, np.int64)
        field.count_near(work, *self.arguments(), near, counts)
        return counts.sum(axis=0)

    def twin(self) -> tuple[np.ndarray, np.ndarray]:
        """(n, k) codes by the twin, 9 off the map; and (n,) whether single precision cannot change them."""
        codes, decided = [], []
        for pose in self.poses:
            ends = reference.beam_ends(pose, (0.0, 0.0, 0.0), self.angles, self.ranges)
            codes.append(reference.end_distances(ends, self.codes, RESOLUTION, 9.0))
            cells = np.array(ends) / RESOLUTION
            decided.append(np.abs(cells - np.round(cells)).min() > 1e-4)
        return np.array(codes).astype(int), np.array(decided)


@pytest.mark.parametrize("seed", range(5))
def test_scores(seed: int) -> None:
    world = World(seed)
    codes, decided = world.twin()
    expected = world.values[codes].astype(float).sum(axis=1)
    assert decided.mean() > 0.95
    assert (codes == 9).any()
    np.testing.assert_allclose(world.scores()[decided], expected[decided], atol=1e-4)


@pytest.mark.parametrize("seed", range(3))
def test_counts(seed: int) -> None:
    world = World(seed)
    codes, decided = world.twin()
    for near in (0, 4, 9):
        undecided = np.count_nonzero(~decided)
        assert np.abs(world.counts(near) - (codes < near).sum(axis=0)).max() <= undecided


def test_an_end_off_the_map_is_never_near() -> None:
    world = World(1)
    world.poses[:, 0] += 100.0
    assert world.counts(10).tolist() == [0] * 8
    np.testing.assert_allclose(world.scores(), 8 * world.values[9], rtol=1e-5)


def test_all_threads_give_the_same() -> None:
    world = World(9, n=3 * BLOCK + 17)
    np.testing.assert_array_equal(world.scores(), world.scores(work=10**9))
    np.testing.assert_array_equal(world.counts(4), world.counts(4, work=10**9))


@pytest.mark.parametrize("pose", [(math.nan, 1.0, 0.0), (1.0, math.inf, 0.0), (1e30, -1e30, 0.0)])
def test_poses_that_are_nowhere(pose) -> None:
    world = World(3)
    world.poses[:] = pose
    np.testing.assert_allclose(world.scores(), 8 * world.values[9], rtol=1e-5)


def test_no_beams_say_nothing() -> None:
    world = World(3)
    world.ends = np.empty((2, 0), np.float32)
    assert not world.scores().any()
