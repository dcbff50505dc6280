"""What moves between the cells of a lattice, against dictionaries."""

from __future__ import annotations

import numpy as np
import pytest
import reference

from pipeline.kernels import lattice

HEIGHT, WIDTH = 7, 5


def some_lists(rng: np.random.Generator, lists: int):
    """For each list some cells with weights: as dictionaries, and as the kernel has them."""
    each = []
    for _ in range(lists):
        cells = rng.choice(HEIGHT * WIDTH, rng.integers(0, 12), replace=False)
        each.append({divmod(int(c), WIDTH): float(rng.random()) for c in cells})
    start = np.cumsum([0, *map(len, each)])
    row, col = (np.array([at[k] for cells in each for at in cells], np.int32) for k in (0, 1))
    return each, (start, row, col, np.array([w for cells in each for w in cells.values()]))


def some_moves(rng: np.random.Generator, headings: int, lists: int, n: int):
    target = np.sort(rng.integers(0, headings, n))
    source, down, right = rng.integers(0, lists, n), rng.integers(-3, 4, n), rng.integers(-9, 10, n)
    return target, source, down, right, rng.random(n)


@pytest.mark.parametrize("seed", range(20))
def test_spread(seed: int) -> None:
    rng = np.random.default_rng(seed)
    headings, lists = 4, 4 + 2 * (seed % 2)
    each, cells = some_lists(rng, lists)
    target, *moves = some_moves(rng, headings, lists, 30)
    expected = reference.spread(each, zip(target, *moves, strict=True), HEIGHT, WIDTH)
    plane, first = np.zeros((HEIGHT, WIDTH)), np.searchsorted(target, np.arange(headings + 1))
    room = headings * HEIGHT * WIDTH
    start, weight = np.empty(headings + 1, np.int64), np.empty(room)
    row, col = np.empty(room, np.int32), np.empty(room, np.int32)
    n = lattice.spread(*cells, first, *moves, plane, start, row, col, weight)
    heading = np.repeat(np.arange(headings), np.diff(start))
    found = dict(zip(zip(heading, row[:n], col[:n], strict=True), weight[:n], strict=True))
    assert n == start[-1] == len(found) == len(expected)
    assert found == pytest.approx(expected)
    assert not plane.any()
    # One place too few is noticed, and the plane is left as it was found.
    assert lattice.spread(*cells, first, *moves, plane, start, row[: n - 1], col, weight) == -1
    assert not plane.any()


def test_sum_of_products() -> None:
    rng = np.random.default_rng(3)
    all_of_it, every = some_lists(rng, 6)
    some = [{at: rng.random() for at in cells if rng.random() < 0.6} for cells in all_of_it]
    start = np.cumsum([0, *map(len, some)])
    row, col = (np.array([at[k] for cells in some for at in cells], np.int32) for k in (0, 1))
    weight = np.array([w for cells in some for w in cells.values()])
    expected = sum(w * factor[at] for cells, factor in zip(some, all_of_it, strict=True) for at, w in cells.items())
    plane = np.zeros((HEIGHT, WIDTH))
    assert lattice.sum_of_products(start, row, col, weight, *every, plane) == pytest.approx(expected)
    assert not plane.any()
