"""Buildings as geometry: doors cut walls, leaves swing, people walk to and fro."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
import pytest

from pipeline.errors import MclError
from pipeline.simulate import Building
from pipeline.simulate.building import Person
from pipeline.simulate.sensors import true_ranges
from pipeline.simulate.world import build_world, people_at

NOBODY = np.empty((0, 3))


def hall(**parts: Any) -> Building:
    """A room of 8 m by 4 m with walls of 0.2 m, whose middle is (5, 3)."""
    return Building.model_validate(
        {
            "name": "hall",
            "map": {"size": [10, 6]},
            "wall_thickness": 0.2,
            "rooms": [{"name": "hall", "box": [1, 1, 9, 5]}],
            "robot": {"start": [5, 3], "legs": [{"pause": 1}]},
            **parts,
        }
    )


def look(building: Building, degrees: float, *, mapped: bool = False, see_glass: bool = True) -> float:
    """Range from the middle of the hall."""
    world = build_world(building, mapped=mapped)
    seen = np.full((1, len(world.panes)), see_glass)
    return float(true_ranges(world, NOBODY, np.array([5.0, 3.0]), np.deg2rad([degrees]), seen)[0])


def test_walls_have_faces_half_a_thickness_before_their_line() -> None:
    assert look(hall(), 0) == pytest.approx(3.9)
    assert look(hall(), 90) == pytest.approx(1.9)
    assert look(hall(), math.degrees(math.atan2(1.9, 3.9))) == pytest.approx(math.hypot(3.9, 1.9))


def test_a_shut_door_stops_a_ray_and_an_open_one_does_not() -> None:
    door = {"start": [4.5, 5], "end": [5.5, 5]}
    assert look(hall(doors=[door | {"open_deg": 0}]), 90) == pytest.approx(1.98)
    assert look(hall(doors=[door | {"open_deg": 90}]), 90) == math.inf


def test_an_ajar_door_lets_rays_through_beside_its_leaf() -> None:
    ajar = hall(doors=[{"start": [4.5, 5], "end": [5.5, 5], "open_deg": 30}])
    assert look(ajar, 90) == pytest.approx(2.0 + 0.5 * math.tan(math.radians(30)), abs=0.03)
    assert look(ajar, 79) == math.inf


def test_the_map_may_know_a_door_otherwise_than_it_stands() -> None:
    building = hall(doors=[{"start": [4.5, 5], "end": [5.5, 5], "open_deg": 90, "mapped_open_deg": 0}])
    assert look(building, 90, mapped=True) == pytest.approx(1.98)
    assert look(building, 90, mapped=False) == math.inf


def test_furniture_is_in_the_world_and_in_the_map_only_if_it_says_so() -> None:
    for mapped in (False, True):
        building = hall(furniture=[{"at": [7, 3], "size": [1, 1], "turn_deg": 45, "mapped": mapped}])
        assert look(building, 0) == pytest.approx(2 - math.sqrt(0.5))
        assert look(building, 0, mapped=True) == pytest.approx(2 - math.sqrt(0.5) if mapped else 3.9)
    assert look(hall(furniture=[{"at": [7, 3], "radius": 0.4}]), 0) == pytest.approx(1.6)


def test_glass_is_seen_or_seen_through() -> None:
    building = hall(glass=[{"start": [9, 2], "end": [9, 4], "seen": 0.5}])
    assert look(building, 0) == pytest.approx(4.0)
    assert look(building, 0, see_glass=False) == math.inf
    assert look(building, 40, see_glass=False) < math.inf  # beside the pane there is wall


@pytest.mark.parametrize("kind", ["doors", "passages", "glass"])
def test_an_opening_without_a_wall_is_an_error(kind: str) -> None:
    with pytest.raises(MclError, match="lies on no wall"):
        build_world(hall(**{kind: [{"start": [4, 3], "end": [5, 3]}]}), mapped=False)


def test_openings_cut_shared_walls_and_walls_at_any_angle() -> None:
    building = hall(
        walls=[[[7, 1], [9, 5]]],
        passages=[{"start": [7.6, 2.2], "end": [8.4, 3.8]}],
    )
    assert look(building, 0) == pytest.approx(3.9)
    shared = hall(
        rooms=[{"name": "left", "box": [1, 1, 7, 5]}, {"name": "right", "box": [7, 2, 9, 4]}],
        passages=[{"start": [7, 2.5], "end": [7, 3.5]}],
    )
    assert look(shared, 0) == pytest.approx(3.9)


def test_people_walk_to_and_fro() -> None:
    person = Person(path=[(0.0, 0.0), (3.0, 0.0), (3.0, 1.0)], speed=1.0, start=2.0, radius=0.3)
    where = {0: (0, 0), 2: (0, 0), 4: (2, 0), 5.5: (3, 0.5), 6: (3, 1), 7: (3, 0), 9: (1, 0), 10: (0, 0), 12: (2, 0)}
    for time, place in where.items():
        assert people_at([person], time) == pytest.approx(np.array([[*place, 0.3]]))


def test_a_person_shortens_beams() -> None:
    world = build_world(hall(), mapped=False)
    ranges = true_ranges(
        world, np.array([[6.0, 3.0, 0.25]]), np.array([5.0, 3.0]), np.array([0.0, np.pi]), np.empty((2, 0))
    )
    assert ranges == pytest.approx([0.75, 3.9])
