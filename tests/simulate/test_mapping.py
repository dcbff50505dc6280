"""The simulated map: walls where they are, floor where somebody looked, nothing elsewhere."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.simulate import Building
from pipeline.simulate.mapping import draw_map
from pipeline.simulate.world import build_world


def mapped(**parts: Any) -> OccupancyGrid:
    building = Building.model_validate(
        {
            "name": "two",
            "map": {"size": [10, 6], "smear": 0.05},
            "rooms": [
                {"name": "left", "box": [1.05, 1.05, 5.05, 5.05]},
                {"name": "right", "box": [5.05, 1.05, 9.05, 5.05], "surveyed": False},
            ],
            "robot": {"start": [3, 3], "legs": [{"pause": 1}]},
            **parts,
        }
    )
    return draw_map(building, build_world(building, mapped=True), np.random.default_rng(0))


def at(grid: OccupancyGrid, x: float, y: float) -> float:
    return float(grid.occupancy[int(y / grid.resolution), int(x / grid.resolution)])


def test_walls_floor_and_the_unknown() -> None:
    grid = mapped()
    assert grid.occupancy.shape == (60, 100)
    assert grid.origin == (0.0, 0.0, 0.0)
    assert at(grid, 1.05, 3.0) == 1.0
    assert at(grid, 3.0, 3.0) < 0.25
    assert np.isnan(at(grid, 7.0, 3.0))  # nobody has been there
    assert np.isnan(at(grid, 0.3, 3.0))  # outside


def test_walls_are_smeared_by_a_gaussian_of_the_distance_from_their_face() -> None:
    # The wall's line is the middle of its cell, its face 0.06 m off, the next cell's middle 0.10 m off.
    assert at(mapped(), 1.15, 3.0) == pytest.approx(np.exp(-0.5 * (0.04 / 0.05) ** 2), abs=0.006)


def test_the_floor_is_surer_where_it_was_seen_more_often() -> None:
    passage = [{"start": [5.05, 2.55], "end": [5.05, 3.55]}]
    grid = mapped(passages=passage)
    left, right = grid.occupancy[20:40, 20:40], grid.occupancy[30, 60:85]
    assert np.isfinite(right).all()
    assert np.nanmean(left) < np.nanmean(right) < 0.25


def test_a_door_is_drawn_as_it_stood_for_the_map() -> None:
    door = {"start": [5.05, 2.55], "end": [5.05, 3.55], "open_deg": 90}
    assert at(mapped(doors=[door]), 5.05, 3.15) < 0.25
    assert at(mapped(doors=[door | {"mapped_open_deg": 0}]), 5.05, 3.15) == 1.0


def test_glass_is_as_sure_as_it_is_seen() -> None:
    grid = mapped(glass=[{"start": [1.05, 2], "end": [1.05, 4], "seen": 0.4}])
    assert at(grid, 1.05, 3.0) == pytest.approx(0.4)


def test_only_mapped_furniture_is_drawn() -> None:
    for known in (True, False):
        grid = mapped(
            furniture=[
                {"at": [2.55, 2.55], "size": [0.6, 0.6], "mapped": known},
                {"at": [4.05, 4.05], "radius": 0.3, "mapped": known},
            ]
        )
        assert (at(grid, 2.25, 2.55) > 0.6) is known
        assert (at(grid, 4.35, 4.05) > 0.6) is known
        assert bool(np.isnan(at(grid, 2.55, 2.55))) is known  # nobody looks into a box


def test_values_are_hundredths() -> None:
    occupancy = mapped().occupancy
    known = occupancy[np.isfinite(occupancy)].astype(np.float64)
    assert np.abs(known * 100 - np.round(known * 100)).max() < 1e-4
    assert known.min() >= 0.0
    assert known.max() == 1.0
