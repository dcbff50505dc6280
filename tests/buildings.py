"""Small made-up buildings for tests, each with one thing that is hard for whoever localizes or counts metres.

Every function returns a Building whose sections can be changed: ``hallway(laser={"beams": 360}, people=[])``. Mappings
are merged key by key, anything else is replaced. ``silent`` is a laser without noise, ``exact`` a perfect odometry.
``described`` reads the three buildings of ``data/buildings``.
"""

from __future__ import annotations

from pathlib import Path
from typing import Any

from pipeline.simulate import Building, load_building

DATA = Path(__file__).parents[1] / "data" / "buildings"
DESCRIBED = ("warehouse", "apartment", "hall")

silent: dict[str, Any] = {"sigma": 0.0, "random": 0.0, "missing": 0.0}
exact: dict[str, Any] = {"alpha1": 0.0, "alpha2": 0.0, "alpha3": 0.0, "alpha4": 0.0}

_OFFICE: dict[str, Any] = {
    "map": {"size": [14, 10], "resolution": 0.05},
    "rooms": [
        {"name": "corridor", "box": [1, 4, 13, 6]},
        {"name": "west", "box": [1, 6, 5, 9]},
        {"name": "middle", "box": [5, 6, 9, 9]},
        {"name": "east", "box": [9, 6, 13, 9]},
        {"name": "lab", "box": [1, 1, 8, 4]},
        {"name": "kitchen", "box": [8, 1, 13, 4]},
    ],
    "doors": [
        {"start": [2.5, 6], "end": [3.5, 6], "open_deg": 90},
        {"start": [6.5, 6], "end": [7.5, 6], "open_deg": 90},
        {"start": [10.5, 6], "end": [11.5, 6], "open_deg": 20},
        {"start": [3.5, 4], "end": [4.5, 4], "open_deg": -90},
    ],
    "passages": [{"start": [9.5, 4], "end": [11, 4]}],
    "furniture": [
        {"at": [1.4, 8], "size": [0.6, 1.4], "mapped": True},
        {"at": [7.6, 8.5], "size": [1.6, 0.7], "mapped": True},
        {"at": [5, 2.2], "size": [2.0, 0.8], "mapped": True},
        {"at": [12.5, 2], "radius": 0.3},
    ],
}
_PEOPLE: list[dict[str, Any]] = [
    {"path": [[2, 4.6], [12, 4.7]], "speed": 1.3},
    {"path": [[12, 5.6], [6, 5.5]], "speed": 0.9},
    {"path": [[6.6, 7.6], [5.6, 6.8]], "speed": 0.7},
    {"path": [[9, 2], [11, 3.2]], "speed": 1.0},
]


def hallway(**changes: Any) -> Building:
    """Forty metres of two bare walls, 2 m apart: the ends are out of range, so no scan says how far the robot went."""
    return _made(
        {
            "name": "hallway",
            "map": {"size": [42, 6], "resolution": 0.05},
            "walls": [[[1, 2], [41, 2]], [[1, 4], [41, 4]]],
            "robot": {
                "start": [12, 3],
                "legs": [{"pause": 1}, {"to": [26, 3]}, {"pause": 1}, {"to": [22, 3], "backwards": True}],
                "speed": 1.0,
            },
            "laser": {"max_range": 8},
        },
        changes,
    )


def room(**changes: Any) -> Building:
    """A room of 8 m by 6 m with a corner that differs from the others, and a drive round a square in it."""
    return _made(
        {
            "name": "room",
            "map": {"size": [10, 8], "resolution": 0.05},
            "rooms": [{"name": "room", "box": [1, 1, 9, 7]}],
            "furniture": [
                {"at": [1.7, 1.5], "size": [1.4, 1.0], "mapped": True},
                {"at": [8.4, 4.6], "radius": 0.3, "mapped": True},
            ],
            "robot": {
                "start": [3, 2.6],
                "legs": [{"to": [7, 2.6]}, {"to": [7, 5.4]}, {"to": [3, 5.4]}, {"to": [3, 3]}, {"pause": 0.5}],
                "speed": 0.7,
            },
        },
        changes,
    )


def office(**changes: Any) -> Building:
    """Six rooms off a corridor through which people walk while the robot does, with a stop and a way back."""
    return _made(
        _OFFICE
        | {
            "name": "office",
            "people": _PEOPLE,
            "robot": {
                "start": [7, 7.4],
                "heading_deg": -90,
                "legs": [
                    {"pause": 1},
                    {"to": [7, 5.3]},
                    {"to": [4.2, 5.0]},
                    {"to": [2.2, 5.2]},
                    {"pause": 1.5},
                    {"to": [3.6, 5.2], "backwards": True, "speed": 0.4},
                    {"turn_deg": -150},
                    {"to": [10.2, 5.2]},
                    {"to": [10.2, 2.6]},
                    {"pause": 0.5},
                ],
            },
        },
        changes,
    )


def hard_braking(**changes: Any) -> Building:
    """In the office's corridor, without people: from 2 m/s to a stand within half a metre, again and again."""
    return _made(
        _OFFICE
        | {
            "name": "braking",
            "robot": {
                "start": [2, 5],
                "legs": [
                    {"to": [6, 5]},
                    {"pause": 0.6},
                    {"to": [11.5, 5]},
                    {"pause": 0.6},
                    {"to": [7, 5], "backwards": True},
                    {"pause": 0.6},
                    {"to": [10, 5]},
                    {"pause": 0.6},
                ],
                "speed": 2.0,
                "acceleration": 8.0,
            },
        },
        changes,
    )


def turning(**changes: Any) -> Building:
    """Nothing but turns on the spot, to both sides, at up to 120 degrees a second."""
    turns = [90, -360, 45, 540, -200]
    legs = [order for turn in turns for order in ({"turn_deg": turn}, {"pause": 0.5})]
    robot = {"start": [6, 5], "heading_deg": 20, "legs": legs, "turn_rate_deg": 120}
    return _made(_OFFICE | {"name": "turning", "robot": robot}, changes)


def standing(**changes: Any) -> Building:
    """Twenty seconds on the spot in the corridor while people walk past and around."""
    robot = {"start": [8, 5.1], "heading_deg": 10, "legs": [{"pause": 20}]}
    return _made(_OFFICE | {"name": "standing", "people": _PEOPLE, "robot": robot}, changes)


def turned_laser(**changes: Any) -> Building:
    """The room, seen by a laser mounted on the robot's left, turned by 90 degrees, that looks all around."""
    laser = {"pose": [0.05, 0.15, 90], "beams": 360, "field_of_view_deg": 360}
    return _made(room(name="turned").model_dump(), {"laser": laser}, changes)


def upside_down(**changes: Any) -> Building:
    """The room, seen by a laser that hangs upside down, turned by 20 degrees, and measures beam by beam."""
    laser = {
        "pose": [0.2, -0.05, 20],
        "upside_down": True,
        "beams": 271,
        "field_of_view_deg": 270,
        "rate": 10,
        "time_increment": 0.0002,
    }
    return _made(room(name="hanging").model_dump(), {"laser": laser}, changes)


def spinning(**changes: Any) -> Building:
    """The office with people, seen by a laser that takes its whole period of 0.2 s for a turn, and a gyroscope."""
    laser = {"beams": 360, "field_of_view_deg": 360, "rate": 5, "time_increment": 0.00055, "pose": [0, 0, 0]}
    parts = {"laser": laser, "imu": {"rate": 100, "noise": 0.003, "bias": 0.0}}
    return _made(office(name="spinning").model_dump(exclude_none=True), parts, changes)


def dropouts(**changes: Any) -> Building:
    """The room, in which every tenth reading comes without return and every tenth is no number."""
    return _made(room(name="dropouts").model_dump(), {"laser": {"missing": 0.1, "invalid": 0.1}}, changes)


def described(name: str) -> Building:
    """One of DESCRIBED, as its YAML has it."""
    return load_building(DATA / f"{name}.yaml")


def _made(*parts: dict[str, Any]) -> Building:
    description: dict[str, Any] = {}
    for part in parts:
        for key, value in part.items():
            before = description.get(key)
            merges = isinstance(value, dict) and isinstance(before, dict)
            description[key] = before | value if merges and before is not None else value
    return Building.model_validate(description)
