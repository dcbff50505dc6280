"""The description of a made-up building: what stands where, what the map knows of it, and how the robot drives through.

A description is a YAML file. Lengths in metres, all points in the map frame (the lower left corner of the map is the
origin), angles in degrees in keys that end in ``_deg``, times in seconds.
"""

from __future__ import annotations

import math
import typing
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Annotated, Any

import numpy as np
from numpy.typing import NDArray
from pydantic import BaseModel, ConfigDict, Field, ValidationError, model_validator

from pipeline.errors import MclError
from pipeline.geometry import Pose
from pipeline.spelling import did_you_mean
from pipeline.wrong_values import expectation
from pipeline.yaml_errors import yaml_told

Point = tuple[float, float]
NonNegative = Annotated[float, Field(ge=0.0)]
Positive = Annotated[float, Field(gt=0.0)]
Fraction = Annotated[float, Field(ge=0.0, le=1.0)]


class Part(BaseModel):
    """Anything in a description: unknown keys are errors, values never change."""

    model_config = ConfigDict(extra="forbid", frozen=True, allow_inf_nan=False)


class Room(Part):
    """A rectangle of walls: ``box`` is x_min, y_min, x_max, y_max. Corridors are rooms too; neighbours share walls."""

    name: str
    box: tuple[float, float, float, float]
    surveyed: bool = Field(default=True, description="Whoever made the map has been in here.")

    @model_validator(mode="after")
    def _not_inside_out(self) -> Room:
        if self.box[0] >= self.box[2] or self.box[1] >= self.box[3]:
            raise ValueError("box must be [x_min, y_min, x_max, y_max] with x_min < x_max and y_min < y_max")
        return self


class Opening(Part):
    """A gap in the wall from ``start`` to ``end``."""

    start: Point
    end: Point

    @model_validator(mode="after")
    def _has_length(self) -> Opening:
        if self.start == self.end:
            raise ValueError("start and end must be two points")
        return self


class Door(Opening):
    """A gap with a leaf, hinged at ``start``: 0 degrees is shut, positive swings counter-clockwise, 10 is ajar."""

    open_deg: float = Field(default=90.0, ge=-180.0, le=180.0)
    mapped_open_deg: float | None = Field(
        default=None, ge=-180.0, le=180.0, description="Where it stood when the map was made, if not so."
    )


class Glass(Opening):
    """A pane instead of wall: a beam returns from it with probability ``seen`` and goes through it otherwise."""

    seen: Fraction = 0.5


class Furniture(Part):
    """A box of ``size`` (along x, along y, before the turn) or a disc of ``radius``, centred on ``at``."""

    at: Point
    size: tuple[Positive, Positive] | None = None
    radius: Positive | None = None
    turn_deg: float = 0.0
    mapped: bool = Field(default=False, description="Whether it stood there when the map was made.")

    @model_validator(mode="after")
    def _one_shape(self) -> Furniture:
        if (self.size is None) == (self.radius is None):
            raise ValueError("give either size: [x, y] or radius")
        return self

    def covers(self, x: float, y: float) -> bool:
        """Whether the point lies inside."""
        dx, dy, turn = x - self.at[0], y - self.at[1], math.radians(self.turn_deg)
        if self.radius is not None:
            return math.hypot(dx, dy) < self.radius
        assert self.size is not None
        along, across = math.cos(turn) * dx + math.sin(turn) * dy, math.cos(turn) * dy - math.sin(turn) * dx
        return abs(along) < self.size[0] / 2 and abs(across) < self.size[1] / 2


class Person(Part):
    """Someone who walks to and fro along ``path`` from time ``start`` on: a disc that stops beams."""

    path: Annotated[Sequence[Point], Field(min_length=2)]
    speed: NonNegative = 1.2
    start: NonNegative = 0.0
    radius: Positive = 0.22

    @model_validator(mode="after")
    def _goes_somewhere(self) -> Person:
        if all(p == self.path[0] for p in self.path):
            raise ValueError("path must hold two different points")
        return self


class Leg(Part):
    """One order to the robot: drive ``to`` a point, ``turn_deg`` on the spot, or ``pause``."""

    to: Point | None = None
    turn_deg: float | None = None
    pause: Positive | None = None
    speed: Positive | None = Field(default=None, description="m/s, if not the robot's own.")
    backwards: bool = False

    @model_validator(mode="after")
    def _one_order(self) -> Leg:
        if sum(order is not None for order in (self.to, self.turn_deg, self.pause)) != 1:
            raise ValueError("a leg is one of to: [x, y], turn_deg, pause")
        return self


class Robot(Part):
    """Where the robot starts, what it is told to do, and what its wheels can do."""

    start: Point
    heading_deg: float = 0.0
    legs: Annotated[Sequence[Leg], Field(min_length=1)]
    speed: Positive = 0.8
    acceleration: Positive = 0.8
    turn_rate_deg: Positive = 70.0
    radius: Positive = 0.25


class Laser(Part):
    """A planar range finder and its noise; by default that of the raw format: 180 beams, 0.25 m ahead of the centre.

    Beam k looks ``angle_min + k * angle_increment`` (rad) from the laser's x axis, counter-clockwise as the laser sees
    it, and is measured ``k * time_increment`` (s) after the stamp of its scan.
    """

    beams: Annotated[int, Field(ge=2, le=20_000)] = 180
    field_of_view_deg: Annotated[float, Field(gt=0.0, le=360.0)] | None = Field(
        default=None,
        description="From first to last beam, or 360: a whole turn. Else beams part the 180 degrees from -90 on.",
    )
    pose: tuple[float, float, float] = Field(
        default=(0.25, 0.0, 0.0), description="On the robot: x, y (m), yaw (degrees)."
    )
    upside_down: bool = Field(default=False, description="Mounted so, beams turn clockwise as seen from above.")
    rate: Annotated[float, Field(gt=0.0, le=200.0)] = Field(default=5.0, description="Scans per second.")
    time_increment: NonNegative = Field(default=0.0, description="Seconds from beam to beam; 0 is all at once.")
    max_range: Annotated[float, Field(gt=0.0, lt=81.9)] = Field(
        default=50.0, description="Nothing returns from farther off."
    )
    sigma: NonNegative = Field(default=0.015, description="Standard deviation of a range.")
    random: Fraction = Field(default=0.002, description="Share of readings that mean nothing.")
    missing: Fraction = Field(default=0.003, description="Share of readings without return: infinity.")
    invalid: Fraction = Field(default=0.0, description="Share of readings that are no numbers: NaN.")

    @model_validator(mode="after")
    def _has_time(self) -> Laser:
        if self.duration * self.rate > 1.0:
            raise ValueError(
                f"the beams of a scan take {self.duration:.3g} s, longer than from scan to scan ({1 / self.rate:.3g} s)"
            )
        return self

    @property
    def angle_min(self) -> float:
        """Direction of the first beam in the laser's own frame, rad."""
        return math.radians(-90.0 if self.field_of_view_deg is None else -self.field_of_view_deg / 2)

    @property
    def angle_increment(self) -> float:
        """From beam to beam in the laser's own frame, rad."""
        return math.radians(self._step_deg)

    @property
    def duration(self) -> float:
        """Seconds from the first beam of a scan to its last."""
        return self.time_increment * (self.beams - 1)

    @property
    def mount(self) -> Pose:
        """The laser in base_link as seen from above: m, m, rad."""
        return self.pose[0], self.pose[1], math.radians(self.pose[2])

    @property
    def bearings(self) -> NDArray[np.float64]:
        """Directions (beams,) of the beams as they are measured, rad from the laser's x axis, as seen from above."""
        first = -90.0 if self.field_of_view_deg is None else -self.field_of_view_deg / 2
        angles = np.deg2rad(np.arange(self.beams) * self._step_deg + first)
        return -angles if self.upside_down else angles

    @property
    def _step_deg(self) -> float:
        if self.field_of_view_deg is None:
            return 180.0 / self.beams
        whole = self.field_of_view_deg == 360.0  # then the last beam must not look where the first does
        return self.field_of_view_deg / (self.beams if whole else self.beams - 1)


class Imu(Part):
    """A gyroscope at the robot's centre: what it says of the turn rate is off by noise and by a bias."""

    rate: Annotated[float, Field(gt=0.0, le=1000.0)] = Field(default=100.0, description="Readings per second.")
    noise: NonNegative = Field(default=0.005, description="Standard deviation of a reading, rad/s.")
    bias: float = Field(default=0.0, description="What it reads when nothing turns, rad/s.")


class Odometry(Part):
    """Noise of Probabilistic Robotics' Table 5.6, per reading, and errors that always go the same way."""

    rate: Positive = Field(default=15.0, description="Readings per second.")
    start: tuple[float, float, float] = Field(
        default=(0.0, 0.0, 0.0), description="First reading: x, y (m), yaw (rad)."
    )
    alpha1: NonNegative = Field(default=0.02, description="Variance of rotation from rotation, rad^2/rad^2.")
    alpha2: NonNegative = Field(default=0.01, description="Variance of rotation from translation, rad^2/m^2.")
    alpha3: NonNegative = Field(default=0.02, description="Variance of translation from translation, m^2/m^2.")
    alpha4: NonNegative = Field(default=0.001, description="Variance of translation from rotation, m^2/rad^2.")
    scale: Positive = Field(default=1.0, description="Metres reported per metre driven.")
    drift_deg: float = Field(default=0.0, description="Turn reported, but not made, per metre driven.")


class Mapping(Part):
    """The grid that somebody else has made of the building."""

    size: tuple[Positive, Positive]
    resolution: Positive = 0.1
    smear: Positive = Field(default=0.06, description="Standard deviation of a wall's place in the map.")
    view: Positive = Field(default=8.0, description="How far the one who made the map looked.")


class Building(Part):
    """A building, the map of it, and a drive through it."""

    name: Annotated[str, Field(pattern=r"^[A-Za-z0-9][A-Za-z0-9_-]*$")]
    map: Mapping
    wall_thickness: Positive = 0.12
    rooms: Sequence[Room] = ()
    walls: Sequence[Annotated[Sequence[Point], Field(min_length=2)]] = Field(default=(), description="Polylines.")
    doors: Sequence[Door] = ()
    passages: Sequence[Opening] = ()
    glass: Sequence[Glass] = ()
    furniture: Sequence[Furniture] = ()
    people: Sequence[Person] = ()
    robot: Robot
    laser: Laser = Laser()
    odometry: Odometry = Odometry()
    imu: Imu | None = None

    @model_validator(mode="after")
    def _stands_on_the_map(self) -> Building:
        if not self.rooms and not self.walls:
            raise ValueError("a building needs rooms or walls")
        for x, y in self._points():
            if not (0.0 <= x <= self.map.size[0] and 0.0 <= y <= self.map.size[1]):
                raise ValueError(f"({x:g}, {y:g}) lies outside the map, which is {self.map.size} m from (0, 0)")
        return self

    def _points(self) -> Iterator[Point]:
        for room in self.rooms:
            yield room.box[:2]
            yield room.box[2:]
        for wall in self.walls:
            yield from wall
        yield self.robot.start
        yield from (leg.to for leg in self.robot.legs if leg.to is not None)


def load_building(path: Path) -> Building:
    """The building that a YAML file describes.

    Raises MclError with file and line: not YAML, an unknown key (naming the nearest one), a value out of bounds.
    """
    from ruamel.yaml import YAML

    try:
        text = path.read_text(encoding="utf-8")
    except (OSError, UnicodeDecodeError) as error:
        reason = getattr(error, "strerror", None) or "not a text file"
        raise MclError(f"cannot read the building: {reason}", path=path) from error
    with yaml_told(path):
        tree = YAML(typ="rt").load(text)
    if not isinstance(tree, dict):
        raise MclError("expected a mapping that describes a building", path=path)
    try:
        return Building.model_validate(tree)
    except ValidationError as error:
        # An unknown key explains the missing one that it was meant to be, so it is told first.
        first = min(error.errors(), key=lambda e: e["type"] != "extra_forbidden")
        raise _explain(dict(first), tree, path) from error


def _explain(error: dict[str, Any], tree: Any, path: Path) -> MclError:
    where = error["loc"]
    line = _line(tree, where)
    if error["type"] == "extra_forbidden":
        hint = did_you_mean(str(where[-1]), _fields(where)) or f"known: {', '.join(_fields(where))}"
        return MclError(f"unknown key {_dotted(where)!r}", hint, path=path, line=line)
    said = expectation(error)
    # A whole mapping in a message hides the message.
    got = "" if isinstance(error["input"], dict | list) else f", got {error['input']!r}"
    return MclError(f"{_dotted(where)}: {said}{got}" if where else said, path=path, line=line)


def _dotted(where: Sequence[int | str]) -> str:
    return "".join(f"[{key}]" if isinstance(key, int) else f".{key}" for key in where).lstrip(".")


def _line(tree: Any, where: Sequence[int | str]) -> int | None:
    """The 1-based line of the deepest part of ``where`` that the file holds."""
    line = None
    for key in where:
        marks = getattr(tree, "lc", None)  # ruamel's mappings and lists know their lines
        if marks is None or key not in (tree if hasattr(tree, "keys") else range(len(tree))):
            break
        line = (marks.key(key) if hasattr(tree, "keys") else marks.item(key))[0] + 1
        tree = tree[key]
    return line


def _fields(where: Sequence[int | str]) -> list[str]:
    """The keys that are known where the last key of ``where`` is not."""
    model: type[BaseModel] = Building
    for key in where[:-1]:
        if isinstance(key, str) and key in model.model_fields:
            model = next(_models_in(model.model_fields[key].annotation), model)
    return list(model.model_fields)


def _models_in(annotation: Any) -> Iterator[type[BaseModel]]:
    if isinstance(annotation, type) and issubclass(annotation, BaseModel):
        yield annotation
    for inner in typing.get_args(annotation):
        yield from _models_in(inner)
