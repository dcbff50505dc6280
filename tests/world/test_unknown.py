"""Off the map: what a pose is worth on land that the map does not know, and how one may come there."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
from made_up import BEYOND, DOOR, FAR_WALL, IN_THE_ROOM, ROUND, room_beside_the_unknown

from pipeline.config import Config
from pipeline.filter.sensor import Sensor
from pipeline.logs.messages import Log
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.world.agnostic import Agnostic
from pipeline.world.expected_ranges import ExpectedRanges
from pipeline.world.unknown import PRICE, WRONG, OffMap, Unknown
from pipeline.world.world import MARGIN, World

CONFIG = Config(max_beams=360, occupied_threshold=0.65, init="free_space", recovery="none", laser_max_range=12.0)
AHEAD, BACK, LEFT = 180, 0, 270
"""Beams that look along x, back, and along y."""


class Land:
    """A map with everything that ``Unknown`` looks at."""

    def __init__(self, grid: OccupancyGrid, half_thickness: float = 0.0) -> None:
        self.expected = ExpectedRanges(grid, ROUND, np.arange(360), CONFIG, 12.0, half_thickness)
        self.world = World(grid, 0.65, self.expected.codes, self.expected.rows.shape[1])
        self.agnostic = Agnostic(12.0)
        self.unknown = Unknown(self.world, self.expected, self.agnostic)

    def find(self, *poses: tuple[float, float, float]) -> OffMap | None:
        return self.unknown.find(columns(*poses))


def columns(*poses: tuple[float, float, float]) -> np.ndarray:
    return np.ascontiguousarray(np.array(poses, np.float32).T)


@pytest.fixture(scope="module")
def land() -> Land:
    return Land(room_beside_the_unknown())


def test_off_the_map_is_where_nothing_is_known_and_beyond_its_edge(land: Land) -> None:
    off = land.find(IN_THE_ROOM, BEYOND, (3.05, 0.5, 0.0), (-4.0, 2.0, 1.0), (2.0 * MARGIN, -3.0 * MARGIN, 0.0))
    assert off is not None
    assert off.which.tolist() == [1, 3, 4]  # not in the room, nor in its wall
    assert (off.cells[:2] >= 0).all()
    assert off.cells[2] == -1
    assert land.find(IN_THE_ROOM) is None


def test_within_a_wall_as_thick_as_its_drawing_one_is_on_the_map() -> None:
    """Just behind the room's wall the land is unknown, and yet a laser there sees the room: maps smear walls."""
    just_behind = (DOOR + 0.08, 0.5, 0.0)
    assert Land(room_beside_the_unknown()).find(just_behind) is not None
    assert Land(room_beside_the_unknown(), half_thickness=0.25).find(just_behind) is None


def test_through_the_unknown_mapped_walls_are_seen(land: Land) -> None:
    off = land.find(BEYOND)
    assert off is not None
    walls, known = land.unknown.ranges(off)
    # The middle of the cell, and half a step of the codes.
    assert walls[0, AHEAD] == pytest.approx(FAR_WALL - 4.05, abs=0.07)
    assert known[0, AHEAD] == walls[0, AHEAD]
    # Back through the door: the floor is known from there on, the wall is at the room's other end.
    assert known[0, BACK] == pytest.approx(4.05 - 3.1, abs=0.07)
    assert walls[0, BACK] == pytest.approx(4.05 - 0.1, abs=0.12)
    assert np.isinf([walls[0, LEFT], known[0, LEFT]]).all()


def likelihood_near(codes: np.ndarray, ranges: np.ndarray, width: float = 0.2) -> np.ndarray:
    """(k, 256): 3 per metre where a true range is as measured, and next to nothing elsewhere."""
    with np.errstate(invalid="ignore"):  # of no return and nothing there
        apart = np.abs(codes[None, :] - ranges[:, None])
    return np.where(apart < width, 3.0, 1e-7).astype(np.float32)


def test_a_beam_that_ends_in_the_unknown_is_worth_what_it_is_on_average(land: Land) -> None:
    off = land.find(BEYOND)
    assert off is not None
    ranges = np.full(360, 0.6, np.float32)  # before anything that is known
    ranges[LEFT] = np.inf
    agnostic = land.agnostic.density(ranges)
    likelihood = likelihood_near(land.expected.codes.ranges, ranges)
    found = land.unknown.beams(off, ranges, agnostic, likelihood)[0]
    np.testing.assert_allclose(found[[AHEAD, BACK]], np.log(agnostic[[AHEAD, BACK]]), atol=1e-4)
    # Nothing came back, and nothing is there: as probable as it is for this laser.
    assert found[LEFT] == pytest.approx(math.log(agnostic[LEFT]), abs=1e-4)


def test_a_beam_that_meets_a_mapped_wall_through_the_unknown_speaks_for_it(land: Land) -> None:
    """It has to come through, and then it is as probable as anywhere on the map; what ends behind it is not."""
    off = land.find(BEYOND)
    assert off is not None
    to_wall = FAR_WALL - 4.05
    ranges = np.full(360, 0.6, np.float32)
    ranges[AHEAD], ranges[BACK] = to_wall + 0.05, 3.95
    agnostic = land.agnostic.density(ranges)
    likelihood = likelihood_near(land.expected.codes.ranges, ranges)
    found = land.unknown.beams(off, ranges, agnostic, likelihood)[0]
    through = land.agnostic.survival(np.array([to_wall, 0.95]))
    np.testing.assert_allclose(
        found[[AHEAD, BACK]], np.log((1.0 - WRONG) * through * 3.0 + WRONG * agnostic[[AHEAD, BACK]]), atol=0.02
    )
    assert found[AHEAD] > math.log(agnostic[AHEAD]) + 1.0
    ranges[AHEAD] = to_wall + 1.0  # as if there were no wall
    behind = land.unknown.beams(off, ranges, agnostic, likelihood_near(land.expected.codes.ranges, ranges))[0]
    assert behind[AHEAD] == pytest.approx(math.log(WRONG * agnostic[AHEAD]), abs=1e-3)


def test_who_came_from_where(land: Land) -> None:
    """Through the door, from beyond, through the wall, and from off the map back onto it."""
    before = columns((2.8, 2.0, 0.0), BEYOND, (2.8, 0.7, 0.0), BEYOND)
    poses = columns((3.4, 2.0, 0.0), (4.3, 2.2, 0.0), (3.4, 0.7, 0.0), IN_THE_ROOM)
    off = land.unknown.find(poses)
    assert off is not None
    entered, walled = land.unknown.entered(off, before, poses)
    assert off.which.tolist() == [0, 1, 2]
    assert entered.tolist() == [True, False, True]
    assert walled.tolist() == [False, False, True]


# --- as the filter has it --------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def sensor() -> Sensor:
    return Sensor(room_beside_the_unknown(), ROUND, CONFIG)


def scores(sensor: Sensor, before: list, poses: list, ranges: np.ndarray | None = None) -> tuple[np.ndarray, object]:
    ranges = np.full(360, 1.0, np.float32) if ranges is None else ranges
    reading, out = sensor.read(ranges), np.empty(len(poses), np.float32)
    sensor.score(columns(*poses), reading, out, columns(*before) if before else None)
    return out, reading


def test_entering_costs_its_price_once(sensor: Sensor) -> None:
    before = [(2.8, 2.0, 0.0), (3.3, 2.0, 0.0), (4.0, 2.0, 0.0)]
    out, reading = scores(sensor, before, [(3.4, 2.0, 0.0)] * 3)
    assert out[0] == pytest.approx(out[1] - PRICE / reading.temper, rel=1e-5)  # type: ignore[attr-defined]
    assert out[1] == out[2]


def test_nobody_comes_through_a_wall(sensor: Sensor) -> None:
    """Neither from known floor, nor from what is unknown on its other side."""
    before = [(2.8, 0.7, 0.0), (5.2, 2.0, 0.0), (4.8, 2.0, 0.0)]
    out, reading = scores(sensor, before, [(3.4, 0.7, 0.0), (5.8, 2.0, 0.0), (5.2, 2.0, 0.0)])
    outside = np.float32(reading.outside)  # type: ignore[attr-defined]
    assert out[:2].tolist() == [outside, outside]
    assert out[2] > outside


def test_without_a_way_there_nobody_is_off_the_map(sensor: Sensor) -> None:
    """A search of the building, for one, asks about places and not about ways."""
    out, reading = scores(sensor, [], [BEYOND, IN_THE_ROOM])
    assert out[0] == np.float32(reading.outside)  # type: ignore[attr-defined]
    assert out[1] > out[0]


def test_on_the_map_nothing_changes(sensor: Sensor) -> None:
    without = Sensor(room_beside_the_unknown(), ROUND, CONFIG.model_copy(update={"without": ("off_map",)}))
    poses = [(0.5 + 0.04 * k, 0.4 + 0.06 * k, 0.1 * k) for k in range(50)]
    np.testing.assert_array_equal(scores(sensor, poses, poses)[0], scores(without, poses, poses)[0])
    assert without.world is None


def test_a_scan_without_a_reading_moves_nobody_off_the_map(sensor: Sensor) -> None:
    out, _ = scores(sensor, [BEYOND, IN_THE_ROOM], [BEYOND, IN_THE_ROOM], np.full(360, np.nan, np.float32))
    assert np.isfinite(out).all()


def test_a_map_in_fortran_order_is_the_same_map(office: Log) -> None:
    """Readers of other people's maps turn and mirror them: that must change no score."""
    from pipeline.localization import localize

    assert office.grid is not None
    turned = dataclasses.replace(office.grid, occupancy=np.asfortranarray(office.grid.occupancy))
    short = office.part(slice(40))
    config = Config(max_particles=300, min_particles=300)
    here, there = (localize(dataclasses.replace(short, grid=grid), config) for grid in (office.grid, turned))
    np.testing.assert_array_equal(here.poses, there.poses)
    assert here.seen is not None
    assert there.seen is not None
    np.testing.assert_array_equal(here.seen.hits, there.seen.hits)
