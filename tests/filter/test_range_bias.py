"""The bias of the ranges: given, or begun at half the walls' thickness and learned."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.config import Config
from pipeline.filter.range_bias import RangeBias
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.maps.walls import wall_half_thickness


def residuals(bias: RangeBias, true_bias: float, rng) -> tuple[np.ndarray, np.ndarray]:
    """A scan at the right pose: noise, people before the wall, open doors, missing and invalid returns."""
    expected = rng.uniform(1, 9, 60).astype(np.float32)
    measured = expected + rng.normal(true_bias, 0.05, 60).astype(np.float32)
    measured[:6] *= np.float32(0.5)
    measured[6:8] += np.float32(4.0)
    measured[8], measured[9], expected[10] = np.inf, np.nan, np.inf
    return measured - np.float32(bias.value), expected


@pytest.mark.parametrize("true_bias", [-0.1, 0.0, 0.12, 0.25])
def test_learns_the_bias(true_bias: float) -> None:
    rng = np.random.default_rng(0)
    bias = RangeBias(Config(), 0.05)
    assert bias.value == 0.05
    for _ in range(300):
        bias.learn(*residuals(bias, true_bias, rng))
    assert bias.value == pytest.approx(true_bias, abs=0.015)


def test_a_given_bias_stays() -> None:
    bias = RangeBias(Config(range_bias=0.1), 0.3)
    for _ in range(50):
        bias.learn(*residuals(bias, 0.3, np.random.default_rng(0)))
    assert bias.value == 0.1


def test_nothing_to_learn_from() -> None:
    bias = RangeBias(Config(), 0.07)
    nothing = np.full(5, np.nan, np.float32)
    bias.learn(nothing, nothing)
    bias.learn(np.full(5, np.inf, np.float32), np.full(5, 3.0, np.float32))
    assert bias.value == 0.07


@pytest.mark.parametrize("cells", [1, 2, 3, 4, 5, 6])
def test_half_the_thickness_of_a_wall(cells: int) -> None:
    occupancy = np.zeros((60, 60), np.float32)
    occupancy[20 : 20 + cells] = 1.0
    for walls in (occupancy, occupancy.T):
        assert wall_half_thickness(OccupancyGrid(walls, 0.1), 0.9) == pytest.approx(0.1 * cells / 2)


def test_a_wall_askew_is_about_as_thick() -> None:
    """At any angle to the cells; a strip of 0.4 m, in cells of 0.1 m whose centres lie within it."""
    x, y = np.meshgrid(*[0.1 * (np.arange(100) + 0.5) - 5.0] * 2)
    for angle in np.radians([20, 45, 70, 110]):
        occupancy = (np.abs(x * np.cos(angle) + y * np.sin(angle)) < 0.2).astype(np.float32)
        assert wall_half_thickness(OccupancyGrid(occupancy, 0.1), 0.9) == pytest.approx(0.2, abs=0.04)


def test_a_map_without_walls_has_no_bias() -> None:
    assert wall_half_thickness(OccupancyGrid(np.zeros((9, 9), np.float32), 0.1), 0.9) == 0.0
