"""How many beams end before what is mapped, and how many far behind it."""

from __future__ import annotations

import numpy as np
import pytest

from pipeline.filter.sensor import contradicting_shares, explained_share
from pipeline.filter.step import Beams


def shares(measured: list[float], expected: list[float]) -> tuple[float, float]:
    ranges = [np.array(v, np.float32) for v in (measured, expected)]
    return contradicting_shares(Beams(np.zeros(3), np.zeros(len(measured)), *ranges))


WALL = [4.0] * 10


def test_what_is_as_mapped_contradicts_nothing() -> None:
    assert shares([4.0, 4.2, 3.8, 4.25, 3.75] * 2, WALL) == (0.0, 0.0)


def test_something_in_the_way() -> None:
    assert shares([4.0] * 7 + [1.0, 3.6, 0.2], WALL) == (0.3, 0.0)


def test_a_wall_that_is_gone() -> None:
    assert shares([4.0] * 7 + [9.0, 4.7, 6.0], WALL) == (0.0, 0.3)
    assert shares([4.0] * 7 + [4.5, 4.5, 4.5], WALL) == (0.0, 0.0)  # not far behind it


@pytest.mark.parametrize("at", [0, 4, 9])
def test_a_single_beam_may_have_passed_by_an_edge(at: int) -> None:
    measured = list(WALL)
    measured[at] = 9.0
    assert shares(measured, WALL) == (0.0, 0.0)
    measured[at - 1 if at else 1] = 9.0
    assert shares(measured, WALL) == (0.0, 0.2)


def test_the_first_and_the_last_beam_are_no_neighbours() -> None:
    assert shares([9.0] + [4.0] * 8 + [9.0], WALL) == (0.0, 0.0)


def test_only_beams_with_a_return_and_something_mapped_are_counted() -> None:
    """Not those without return, invalid ones, nor those that ended on land that the map does not know."""
    nan, inf = np.nan, np.inf
    assert shares([inf, nan, 4.0, 1.0, 9.0, 9.0], [4.0, 4.0, nan, 4.0, 4.0, 4.0]) == pytest.approx((1 / 3, 2 / 3))
    assert shares([inf, nan, 4.0], [4.0, 4.0, nan]) == (0.0, 0.0)
    # A neighbour that is not counted vouches for nobody.
    assert shares([9.0, inf, 9.0, 4.0], [4.0] * 4) == (0.0, 0.0)


def test_beams_before_what_is_mapped_nowhere_are_short_and_never_behind() -> None:
    """The map has nothing in that direction within the laser's range, and yet something came back."""
    assert shares([5.0, 5.0], [np.inf, np.inf]) == (1.0, 0.0)


def test_no_beam_is_explained_and_contradicts_at_once() -> None:
    rng = np.random.default_rng(0)
    measured, expected = rng.uniform(0.0, 9.0, (2, 500)).astype(np.float32)
    beams = Beams(np.zeros(3), np.zeros(500), measured, expected)
    short, through = contradicting_shares(beams)
    assert min(short, through) > 0.2
    assert short + through + explained_share(beams) <= 1.0
