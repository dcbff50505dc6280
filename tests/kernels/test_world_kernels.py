"""What poses see in the world as the log has shown it, and what scans show of it, each against its slow twin."""

from __future__ import annotations

import math

import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.kernels import world

HEADINGS, RESOLUTION, MARGIN = 360, 0.1, 7
FREE, WALL = 0, 1
LASER = (0.25, -0.06, -1.2)
seeds = st.integers(0, 2**32 - 1)


# --- find ------------------------------------------------------------------------------------------------------------


def find(poses, wanted) -> list[tuple[int, int, int]]:
    """(index, cell, heading) of the poses that the kernel finds."""
    n = len(poses)
    which, cells, turns = np.empty(n, np.int64), np.empty(n, np.int64), np.empty(n, np.int32)
    columns = np.ascontiguousarray(np.asarray(poses, np.float32).T)
    laser = [np.float32(v) for v in LASER]
    inverse = np.float32(1 / RESOLUTION)
    m = world.find(*columns, *laser, inverse, HEADINGS, MARGIN, wanted, which, cells, turns)
    return list(zip(which[:m].tolist(), cells[:m].tolist(), turns[:m].tolist(), strict=True))


@given(seeds)
@settings(max_examples=15, deadline=None)
def test_find_finds_the_lasers_in_wanted_cells_and_those_off_the_raster(seed: int) -> None:
    rng = np.random.default_rng(seed)
    wanted = rng.random((30, 40)) < 0.4
    poses = rng.uniform([-1.2, -1.2, -9.0], [3.8, 2.8, 9.0], (300, 3)).astype(np.float32)
    found = {i: (cell, turn) for i, cell, turn in find(poses, wanted)}
    decided = 0
    for i, pose in enumerate(poses):
        cell, turn, undecided = reference.place_in_world(pose, LASER, RESOLUTION, HEADINGS, MARGIN, wanted)
        if undecided < 1e-3:  # single precision decides which cell or heading it is
            continue
        decided += 1
        assert found.get(i) == (None if cell is None else (cell, turn))
    assert decided > 0.95 * len(poses)
    cells = [cell for cell, _ in found.values()]
    assert min(cells) == -1
    assert max(cells) > 0
    assert len(found) < len(poses)


def test_find_takes_a_mask_without_memory_of_its_own() -> None:
    """Asked for every pose, the filter gives one value for all cells, broadcast."""
    poses = np.random.default_rng(1).uniform([-2, -2, -3], [5, 4, 3], (200, 3))
    everywhere = np.ones((30, 40), np.bool_)
    assert find(poses, np.broadcast_to(np.True_, (30, 40))) == find(poses, everywhere)
    assert [i for i, _, _ in find(poses, everywhere)] == list(range(200))


# --- walled ----------------------------------------------------------------------------------------------------------


def walled(starts, ends, kinds) -> np.ndarray:
    """Of ways (n, 2) from cells of the map to others; every second one is asked about."""
    which = np.arange(0, len(starts), 2)
    out = np.empty(len(which), np.bool_)
    columns = [np.ascontiguousarray(np.asarray(v, np.float32)) for v in (*np.transpose(starts), *np.transpose(ends))]
    world.walled(which, *columns, np.float32(1.0), MARGIN, kinds, WALL, out)
    return out


@given(seeds)
@settings(max_examples=15, deadline=None)
def test_a_way_through_half_a_cell_of_wall_is_walled_and_none_that_meets_no_wall(seed: int) -> None:
    rng = np.random.default_rng(seed)
    kinds = rng.choice(np.array([0, 1, 2], np.uint8), (30, 40), p=[0.8, 0.05, 0.15])
    starts = rng.uniform([-10, -10], [36, 26], (120, 2)).astype(np.float32)
    ends = (starts + rng.normal(0.0, 4.0, starts.shape)).astype(np.float32)
    found = walled(starts, ends, kinds)
    longest = np.array(
        [
            reference.longest_in_wall(a.astype(float), b.astype(float), MARGIN, kinds == WALL)
            for a, b in zip(starts[::2], ends[::2], strict=True)
        ]
    )
    assert not found[longest == 0.0].any()
    assert found[longest > 0.5 + 1e-4].all()


def test_ways_known_by_hand() -> None:
    kinds = np.zeros((20, 20), np.uint8)
    kinds[:, 12], kinds[4] = WALL, 2  # in cells of the map: the column 5; unknown land is no wall
    kinds[9, 12] = FREE  # a door at row 2
    ways = [
        ((2.5, 6.5), (8.5, 6.5), True),
        ((8.5, 6.5), (2.5, 6.5), True),
        ((2.5, 2.5), (8.5, 2.5), False),  # through the door
        ((2.5, -2.5), (2.5, 8.0), False),  # across unknown land
        ((2.5, 6.5), (2.5, 6.5), False),  # not moved at all
        ((5.5, 6.5), (5.5, 6.5), True),  # the same within the wall
        ((-30.0, 6.5), (-20.0, 6.5), False),  # off the raster
        ((-30.0, 6.5), (30.0, 6.5), True),
    ]
    starts, ends, expected = zip(*[way for way in ways for _ in range(2)], strict=True)
    assert walled(starts, ends, kinds).tolist() == list(expected[::2])


# --- score -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("seed", range(3))
def test_score_is_the_unknown_before_what_is_known_and_the_wall_behind_it(seed: int) -> None:
    rng = np.random.default_rng(seed)
    n, k, rows = 40, 9, 12
    offsets = np.sort(rng.choice(180, k, replace=False)).astype(np.int32)
    walls, known = (rng.integers(0, 256, (rows, HEADINGS + 180)).astype(np.uint8) for _ in range(2))
    likelihood = rng.gamma(0.3, 1.0, (k, 256)).astype(np.float32)
    agnostic = np.where(rng.random((k, 256)) < 0.5, 0.0, rng.random((k, 256))).astype(np.float32)
    survival = np.sort(rng.random(256))[::-1].astype(np.float32)
    survival[200:] = 0.0
    to_wall, to_known = rng.integers(0, rows, n), rng.integers(0, rows, n)
    turns = rng.integers(0, HEADINGS, n).astype(np.int32)
    out = np.empty((n, k), np.float32)
    world.score(to_wall, to_known, turns, offsets, walls, known, likelihood, agnostic, survival, out)
    for i in range(n):
        for beam in range(k):
            at = turns[i] + offsets[beam]
            first, wall = known[to_known[i], at], walls[to_wall[i], at]
            parts = float(agnostic[beam, first]), float(survival[first]), float(likelihood[beam, wall])
            assert out[i, beam] == pytest.approx(reference.through_unknown(*parts), rel=1e-5, abs=1e-5)
    assert out.min() == pytest.approx(math.log(1e-30), rel=1e-6)  # nothing of either


# --- look ------------------------------------------------------------------------------------------------------------


@given(seeds)
@settings(max_examples=10, deadline=None)
def test_look_counts_where_beams_ended_and_passed_once_a_scan(seed: int) -> None:
    rng = np.random.default_rng(seed)
    shape, most, longest = (35, 45), 4.0, 18.0
    hits, passes = np.zeros(shape, np.float32), np.zeros(shape, np.float32)
    passed_at, hit_at = np.zeros(hits.size, np.int32), np.zeros(hits.size, np.int32)
    twin = np.zeros(shape), np.zeros(shape)
    angles = np.linspace(-2.0, 2.0, 50)
    place = rng.uniform([0, 0, -3], [30, 20, 3])
    for stamp in range(1, 9):
        laser = place + rng.normal(0.0, 0.7, 3)
        ranges = rng.uniform(0.0, 25.0, 50).astype(np.float32)
        ranges[rng.random(50) < 0.1] = np.inf
        ranges[rng.random(50) < 0.1] = np.nan
        world.look(
            *laser, angles, ranges, longest, shape[1], MARGIN, stamp, passed_at, hit_at, passes.reshape(-1),
            hits.reshape(-1), np.float32(most),
        )  # fmt: skip
        seen = reference.looked_at(laser, angles, ranges, longest, shape, MARGIN)
        twin = reference.counted(*twin, *seen, most)
        np.testing.assert_allclose(hits, twin[0], atol=1e-4)
        np.testing.assert_allclose(passes, twin[1], atol=1e-4)
    assert (hits + passes).max() <= most + 1e-4
    assert hits.any()
    assert passes.any()
