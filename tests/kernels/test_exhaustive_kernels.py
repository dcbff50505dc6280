"""Every cell and heading scored at once, against one look-up at a time."""

from __future__ import annotations

import math

import numpy as np
import pytest
import reference
from hypothesis import example, given, settings
from hypothesis import strategies as st
from numba import njit

from pipeline.kernels import exhaustive
from pipeline.kernels.random import stream_key

HEADINGS, TEMPER = 36, 0.3


@njit
def exponentiate(total, largest, temper):
    return exhaustive.exponentiate(total, largest, temper)


class World:
    """A table of random codes over a small map; the laser sits ahead of the robot's centre, askew."""

    def __init__(self, seed: int) -> None:
        rng = np.random.default_rng(seed)
        self.allowed = rng.random((9, 11)) < (0.6, 0.6, 0.98)[seed]
        self.cells = np.sort(rng.choice(99, 60, replace=False)).astype(np.int32)
        self.table = rng.integers(0, 256, (60, HEADINGS)).astype(np.uint8)
        self.offsets = np.sort(rng.choice(30, 5, replace=False)).astype(np.int32)
        self.rows = np.concatenate([self.table, self.table[:, : self.offsets.max()]], axis=1)
        self.log_likelihood = rng.normal(-3, 2, (5, 256)).astype(np.float32)
        self.laser = 2.3, -0.4, 0.2
        yaw = 2 * np.pi * np.arange(HEADINGS) / HEADINGS - self.laser[2]
        dx = -np.cos(yaw) * self.laser[0] + np.sin(yaw) * self.laser[1]
        dy = -np.sin(yaw) * self.laser[0] - np.cos(yaw) * self.laser[1]
        self.place = np.floor(0.5 + dx).astype(np.int64), np.floor(0.5 + dy).astype(np.int64), self.allowed
        self.open_around = np.array([self.standing(row).all() for row in range(60)])
        scan = self.cells, self.open_around, self.rows, self.offsets, self.log_likelihood
        self.arguments = (*scan, np.float32(TEMPER), *self.place)

    def standing(self, row: int) -> np.ndarray:
        """By the twin: (headings,) in which the robot can stand."""
        cell = int(self.cells[row])
        return np.array([reference.standing(cell, h, self.laser, HEADINGS, self.allowed) for h in range(HEADINGS)])

    def scores(self, row: int) -> np.ndarray:
        """By the twin: (headings,), -inf where no robot can stand."""
        table = self.table, self.offsets, self.log_likelihood
        scores = np.array([reference.score(row, h, *table, 0.0) for h in range(HEADINGS)])
        return np.where(self.standing(row), scores, -math.inf)


@pytest.mark.parametrize("seed", range(3))
def test_cell_masses(seed: int) -> None:
    world = World(seed)
    results = []
    for work in (0, 10**9):
        best, log_mass = np.empty(60, np.float32), np.empty(60, np.float32)
        exhaustive.cell_masses(work, np.arange(60), *world.arguments, best, log_mass)
        results.append((best, log_mass))
        for row in range(60):
            scores = world.scores(row)
            assert best[row] == pytest.approx(scores.max(), abs=1e-4)
            expected = np.logaddexp.reduce(TEMPER * scores) if scores.max() > -math.inf else -math.inf
            assert log_mass[row] == pytest.approx(expected, abs=1e-4)
    for one, all_threads in zip(*results, strict=True):
        np.testing.assert_array_equal(one, all_threads)


def test_the_quick_exponential_is_good_enough() -> None:
    nats = np.concatenate([-np.linspace(0, 70, 50_001), [-np.inf, -1e6]]).astype(np.float32)
    quick = nats + np.float32(40.0)
    mass = exponentiate(quick, np.float32(40.0), np.float32(0.7))
    exact = np.exp(0.7 * nats.astype(float))
    np.testing.assert_allclose(quick, exact, atol=5e-6)
    assert (quick[-2:] == 0.0).all()
    assert mass == pytest.approx(exact.sum(), rel=1e-5)


@pytest.mark.parametrize("work", [0, 10**9])
def test_count_standing(work: int) -> None:
    world, out = World(0), np.empty(60, np.int32)
    exhaustive.count_standing(work, world.cells, *world.place, out)
    assert out.tolist() == [world.standing(row).sum() for row in range(60)]
    assert World(2).open_around.any()


@given(
    st.lists(st.one_of(st.just(0.0), st.floats(1e-6, 1.0)), min_size=1, max_size=30).filter(lambda w: sum(w) > 0),
    st.floats(0, 1, exclude_max=True),
    st.integers(1, 80),
)
@settings(deadline=None)
@example([0.5, 1.0, 1.0], 1 - 2**-53, 2)
def test_split_draws(values, start: float, n: int) -> None:
    """A systematic draw, counted: as many for each cell as the comb's teeth within it."""
    mass, draws = np.array(values) / np.sum(values), np.empty(len(values), np.int64)
    exhaustive.split_draws(mass, start, n, draws)
    assert draws.sum() == n
    assert (draws[mass == 0.0] == 0).all()
    assert (np.abs(draws - n * mass) <= 1 + 1e-9).all()


@pytest.mark.parametrize("seed", range(3))
def test_draw_headings(seed: int) -> None:
    world = World(seed)
    rng = np.random.default_rng(seed)
    possible = [row for row in range(60) if world.scores(row).max() > -math.inf]
    chosen = np.sort(rng.choice(possible, 12, replace=False)).astype(np.int64)
    draws = rng.integers(1, 60, 12)
    first = np.concatenate([[0], np.cumsum(draws)])
    at_cell, at_heading = np.empty(first[-1], np.int32), np.empty(first[-1], np.int32)
    key = stream_key(seed, 0, 0)
    exhaustive.draw_headings(0, chosen, first, *world.arguments, at_cell, at_heading, key)
    for row, low, high in zip(chosen, first, first[1:], strict=False):
        assert (at_cell[low:high] == world.cells[row]).all()
        share = np.exp(TEMPER * (world.scores(row) - world.scores(row).max()))
        share *= (high - low) / share.sum()
        counts = np.bincount(at_heading[low:high], minlength=HEADINGS)
        assert (np.abs(counts - share) <= 1 + 1e-4).all()
        assert (counts[share == 0.0] == 0).all()  # never where the robot would stand in a wall
    again = np.empty_like(at_cell), np.empty_like(at_heading)
    exhaustive.draw_headings(10**9, chosen, first, *world.arguments, *again, key)
    np.testing.assert_array_equal(at_cell, again[0])
    np.testing.assert_array_equal(at_heading, again[1])


def test_each_heading_is_drawn_as_often_as_it_deserves() -> None:
    """Over many keys, of one draw in a cell and of three."""
    world = World(1)
    row = max(range(60), key=lambda r: np.count_nonzero(np.isfinite(world.scores(r))))
    share = np.exp(TEMPER * (world.scores(row) - world.scores(row).max()))
    share /= share.sum()
    for n in (1, 3):
        first, keys = np.array([0, n]), 4000
        counts = np.zeros(HEADINGS)
        for k in range(keys):
            out = np.empty(n, np.int32), np.empty(n, np.int32)
            exhaustive.draw_headings(0, np.array([row]), first, *world.arguments, *out, stream_key(k, 0, 0))
            counts += np.bincount(out[1], minlength=HEADINGS)
        deviation = np.sqrt(n * keys * share * (1 - share))  # a systematic draw has no more than an independent one
        assert (np.abs(counts - n * keys * share) <= 4.5 * deviation + 1e-9).all()


def test_one_draw_a_cell_is_a_fair_draw() -> None:
    """A corridor: every cell fits a heading and its opposite, 55 to 45. Of one draw in each of a few cells some must
    be the opposite, or one of two places is lost before the second scan."""
    world = World(0)
    table = np.zeros((60, HEADINGS), np.uint8)
    table[:, 9], table[:, 27] = 1, 2
    log_likelihood = np.full((1, 256), -1000.0, np.float32)
    log_likelihood[0, 1:3] = np.log([0.55, 0.45]) / TEMPER
    anywhere = (*world.place[:2], np.ones((9, 11), bool))
    inside = [i for i, cell in enumerate(world.cells) if 3 <= cell % 11 < 8 and 3 <= cell // 11 < 6]
    first = np.arange(len(inside) + 1)
    at_cell, at_heading = np.empty(len(inside), np.int32), np.empty(len(inside), np.int32)
    scan = world.cells, np.ones(60, bool), table, np.zeros(1, np.int32), log_likelihood, np.float32(TEMPER)
    exhaustive.draw_headings(0, np.array(inside, np.int64), first, *scan, *anywhere, at_cell, at_heading)
    assert set(at_heading.tolist()) == {9, 27}
