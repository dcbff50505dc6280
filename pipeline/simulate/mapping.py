"""The map that somebody has made of the building: smeared walls, floor as sure as it was seen often, else unknown."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray
from scipy.ndimage import binary_dilation

from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.simulate.building import Building, Mapping, Room
from pipeline.simulate.sensors import true_ranges
from pipeline.simulate.world import Stroke, World

Array = NDArray[np.float64]

SURVEY_SPACING = 1.0  # metres between the places where the one who made the map looked around
SURVEY_RAYS = 360
SIGHT_STEP = 0.05  # metres between the points of a ray that mark cells as seen
WALL_DEPTH = 2  # cells behind the floor of which the map knows
NOTED = 0.05  # occupancy from which on a wall is drawn
DOUBT = 0.22  # occupancy of floor that was hardly seen
LOOKS = 12.0  # so many looks take two thirds of the doubt away


def draw_map(building: Building, world: World, rng: np.random.Generator) -> OccupancyGrid:
    """The grid of a building of which ``world`` is the state when it was made; origin (0, 0), NaN = never seen.

    A cell near a wall is occupied with exp(-d^2 / 2 smear^2), d its centre's distance from the wall in metres.
    Values are multiples of 0.01.
    """
    looks = _survey(building, world, rng)
    floor = (DOUBT * np.exp(-looks / LOOKS) + 0.01) * rng.uniform(0.5, 1.0, looks.shape)
    walls = _walls(building.map, world, looks.shape)
    occupancy = np.clip(np.maximum(floor, walls), 0.0, 1.0)
    beside_floor = binary_dilation(looks > 0, structure=np.ones((3, 3), dtype=np.bool_), iterations=WALL_DEPTH)
    known = (looks > 0) | (beside_floor & (walls > NOTED))
    cells = np.where(known, np.round(occupancy, 2), np.nan)
    return OccupancyGrid(cells.astype(np.float32), building.map.resolution)


def _shape(grid: Mapping) -> tuple[int, int]:
    return round(grid.size[1] / grid.resolution), round(grid.size[0] / grid.resolution)


def _walls(grid: Mapping, world: World, shape: tuple[int, int]) -> Array:
    """Occupancy (height, width) that the walls alone give each cell."""
    y, x = (np.indices(shape) + 0.5) * grid.resolution
    occupancy = np.zeros(shape)
    for stroke in world.strokes:
        away = np.maximum(_distance(x, y, stroke) - stroke.half_thickness, 0.0)
        occupancy = np.maximum(occupancy, stroke.seen * np.exp(-0.5 * (away / grid.smear) ** 2))
    for cx, cy, radius in world.discs:
        away = np.abs(np.hypot(x - cx, y - cy) - radius)
        occupancy = np.maximum(occupancy, np.exp(-0.5 * (away / grid.smear) ** 2))
    return occupancy


def _distance(x: Array, y: Array, stroke: Stroke) -> Array:
    """Distance of points from a stroke's centre line."""
    ax, ay = stroke.start
    ex, ey = stroke.end[0] - ax, stroke.end[1] - ay
    along = np.clip(((x - ax) * ex + (y - ay) * ey) / (ex * ex + ey * ey), 0.0, 1.0)
    return np.asarray(np.hypot(x - ax - along * ex, y - ay - along * ey))


def _survey(building: Building, world: World, rng: np.random.Generator) -> Array:
    """How often each cell (height, width) was looked at from the surveyed rooms and along the robot's way."""
    grid = building.map
    height, width = _shape(grid)
    angles = np.linspace(0.0, 2 * np.pi, SURVEY_RAYS, endpoint=False)
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    steps = np.arange(0.0, grid.view, SIGHT_STEP)
    looks = np.zeros((height, width))
    for place in _places(building):
        seen = rng.random((SURVEY_RAYS, len(world.panes))) < world.seen
        ranges = true_ranges(world, np.empty((0, 3)), place, angles, seen)
        points = place + directions[:, None, :] * steps[None, :, None]
        cells = np.floor(points[steps[None, :] < ranges[:, None]] / grid.resolution).astype(np.int64)
        inside = (cells >= 0).all(axis=1) & (cells[:, 0] < width) & (cells[:, 1] < height)
        looked_at = np.zeros((height, width), dtype=np.bool_)
        looked_at[cells[inside, 1], cells[inside, 0]] = True
        looks += looked_at
    return looks


def _places(building: Building) -> Array:
    """Where the one who made the map looked around: a lattice in every surveyed room, the start, the waypoints."""
    waypoints = [building.robot.start, *(leg.to for leg in building.robot.legs if leg.to is not None)]
    lattices = [_lattice(room) for room in building.rooms if room.surveyed]
    places = np.concatenate([*lattices, np.array(waypoints)])
    mapped = [piece for piece in building.furniture if piece.mapped]
    return places[[not any(piece.covers(x, y) for piece in mapped) for x, y in places.tolist()]]


def _lattice(room: Room) -> Array:
    x0, y0, x1, y1 = room.box
    return np.stack(np.meshgrid(_middles(x0, x1), _middles(y0, y1)), axis=-1).reshape(-1, 2)


def _middles(low: float, high: float) -> Array:
    """The middles of equal parts, about SURVEY_SPACING long."""
    parts = max(round((high - low) / SURVEY_SPACING), 1)
    return low + (np.arange(parts) + 0.5) * (high - low) / parts
