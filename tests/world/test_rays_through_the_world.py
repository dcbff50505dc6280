"""Ranges through a raster, cast cell by cell when somebody asks: as the table of ranges has them."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import pytest
from made_up import CELL, room_beside_the_unknown

from pipeline.maps.range_table import HEADINGS, build_range_table, opaque_cells, range_codes
from pipeline.world.rays import Rays

WIDTH = 544


@pytest.mark.parametrize("order", [np.ascontiguousarray, np.asfortranarray], ids=["C", "Fortran"])
def test_rows_are_those_of_the_table_in_whatever_order_they_are_asked_for(
    order: Callable[[np.ndarray], np.ndarray],
) -> None:
    """More cells than there is room for at first, some twice: earlier rows stay where and what they were."""
    grid = room_beside_the_unknown()
    table = build_range_table(grid, 0.65, 12.0, WIDTH - HEADINGS)
    rays = Rays(order(opaque_cells(grid, 0.65)), range_codes(grid, 12.0), CELL, WIDTH)
    rng = np.random.default_rng(0)
    row_of_cell = table.row_of_cell.reshape(-1)
    first = rays.rows(table.cells[:3].astype(np.int64))
    for n in (1, 40, 150, 700):
        cells = rng.choice(table.cells, n).astype(np.int64)
        rows = rays.rows(cells)
        np.testing.assert_array_equal(rays.codes[rows], table.wide[row_of_cell[cells]])
        np.testing.assert_array_equal(rays.rows(cells), rows)
    np.testing.assert_array_equal(rays.rows(table.cells[:3].astype(np.int64)), first)
    assert (first > 0).all()


def test_a_laser_off_the_raster_sees_nothing() -> None:
    grid = room_beside_the_unknown()
    rays = Rays(opaque_cells(grid, 0.65), range_codes(grid, 12.0), CELL, WIDTH)
    rows = rays.rows(np.array([-1, 20 * 60 + 10, -1], np.int64))
    assert rows.tolist() == [0, 1, 0]
    assert (rays.codes[0] == 255).all()
    assert (rays.codes[1] < 255).all()
    assert rays.rows(np.full(5, -1, np.int64)).tolist() == [0] * 5
