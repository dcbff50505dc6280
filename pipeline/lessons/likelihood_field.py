"""Lesson 6.3: the likelihood field of a range finder."""

from __future__ import annotations

import math

import numpy as np

from pipeline.lessons.exam import Array, Case, Exact, Returned
from pipeline.lessons.lesson import Lesson, Mistake

RESOLUTION, ROWS, COLUMNS = 0.1, 100, 135
"""Of the map in the cases: m, cells."""


def likelihood_field_range_finder_model(
    ranges: Array,
    angles: Array,
    pose: Array,
    laser: Array,
    distances: Array,
    resolution: float,
    z_hit: float,
    z_rand: float,
    sigma_hit: float,
    max_range: float,
) -> Array:
    """Likelihood of each beam by how far from any obstacle it ends (Probabilistic Robotics, Table 6.3).

    ranges: (k,) float64, measured ranges, m; max_range or more means that nothing came back.
    angles: (k,) float64, the direction of each beam, rad, counter-clockwise from the laser's x axis.
    pose: (3,) float64, the robot, x (m), y (m), yaw (rad) in the grid's frame, whose origin is the lower left
        corner of the map. laser: (3,) float64, the laser on the robot, x (m), y (m), yaw (rad).
    distances: (rows, columns) float64, for each cell the distance to the nearest obstacle, m. Row i is the cells
        with y from i * resolution to (i + 1) * resolution, column j those with x likewise.
    resolution: the edge of a cell, m. No beam ends outside of the map.
    z_hit, z_rand: the weights of the two parts. sigma_hit: standard deviation of a hit, m.
    Returns (k,): for each beam z_hit times the normal density of the distance of the cell in which it ends, plus
        z_rand / max_range, per metre; 1 for a beam from which nothing came back.
    """
    x, y, yaw = pose
    heading = yaw + laser[2] + angles
    end_x = x + laser[0] * np.cos(yaw) - laser[1] * np.sin(yaw) + ranges * np.cos(heading)
    end_y = y + laser[0] * np.sin(yaw) + laser[1] * np.cos(yaw) + ranges * np.sin(heading)
    back = ranges < max_range
    row = np.floor(end_y[back] / resolution).astype(int)
    column = np.floor(end_x[back] / resolution).astype(int)
    distance = distances[row, column]
    normal = np.exp(-0.5 * (distance / sigma_hit) ** 2) / (math.sqrt(2.0 * math.pi) * sigma_hit)
    p = np.ones(len(ranges))
    p[back] = z_hit * normal + z_rand / max_range
    return p


def _field() -> Array:
    """Distances to a few obstacles, with nothing that is the same to the left and to the right, or above and below."""
    x = (np.arange(COLUMNS) + 0.5) * RESOLUTION
    y = (np.arange(ROWS) + 0.5) * RESOLUTION
    stones = np.array([(3.0, 3.2), (5.7, 6.9), (8.1, 4.2), (10.8, 7.1), (9.4, 2.4), (1.1, 8.3), (12.4, 0.9)])
    return np.sqrt((x[None, :, None] - stones[:, 0]) ** 2 + (y[:, None, None] - stones[:, 1]) ** 2).min(axis=-1)


def _case(
    group: str, seed: int, pose: tuple[float, float, float], laser: tuple[float, float, float], max_range: float
) -> Case:
    """Beams that end on the map, each well within a cell: the last bit of a sum must not decide which one it is."""
    rng = np.random.default_rng([6, 3, seed])
    x, y, yaw = pose
    at_x = x + laser[0] * math.cos(yaw) - laser[1] * math.sin(yaw)
    at_y = y + laser[0] * math.sin(yaw) + laser[1] * math.cos(yaw)
    angles, ranges = rng.uniform(-2.0, 2.0, 400), rng.uniform(0.2, min(4.0, max_range - 0.1), 400)
    end = np.stack([at_x + ranges * np.cos(yaw + laser[2] + angles), at_y + ranges * np.sin(yaw + laser[2] + angles)])
    inside = (end > 0.3).all(axis=0) & (end[0] < COLUMNS * RESOLUTION - 0.3) & (end[1] < ROWS * RESOLUTION - 0.3)
    chosen = np.flatnonzero(inside & (np.abs(end / RESOLUTION % 1.0 - 0.5) < 0.3).all(axis=0))[:10]
    angles, ranges = angles[chosen], ranges[chosen]
    ranges[3] = max_range
    rows = tuple(
        f"p of beam {k}, {math.degrees(a):.0f} degrees, {r:.2f} m"
        for k, (a, r) in enumerate(zip(angles, ranges, strict=True))
    )
    arguments = (ranges, angles, np.array(pose), np.array(laser), _field(), RESOLUTION, 0.7, 0.3, 0.4, max_range)
    return Case(group, arguments, rows)


LESSON = Lesson(
    name="6.3",
    title="The likelihood field of a range finder",
    source="Probabilistic Robotics, Section 6.4 and Table 6.3",
    task=(
        "Where does a beam end, if the robot stands at this pose, and how far is that from anything that the map "
        "has? The nearer, the likelier. The distances are looked up in a table with a number for each cell of the "
        "map, so the work is to find the cell: from the robot to the laser on it, from there along the beam, and "
        "from metres to rows and columns."
    ),
    reference=likelihood_field_range_finder_model,
    exam=Exact(
        likelihood_field_range_finder_model,
        [Returned("p", "per metre")],
        [
            _case("the laser at the robot's centre, the robot looks along x", 0, (6.0, 5.0, 0.0), (0.0, 0.0, 0.0), 8.0),
            _case("the robot looks elsewhere", 1, (7.2, 4.6, 2.1), (0.0, 0.0, 0.0), 8.0),
            _case("the laser is ahead of the robot's centre, to the left", 2, (6.4, 5.1, -0.8), (0.5, 0.25, 0.0), 8.0),
            _case("the laser is turned", 3, (6.7, 4.9, 0.6), (0.3, 0.0, 1.1), 8.0),
            _case("a laser that does not see far", 4, (6.2, 5.2, -2.5), (0.2, 0.1, 0.0), 3.0),
        ],
    ),
    mistakes=(
        Mistake(
            "rows and columns are exchanged",
            {"distances[row, column]": "distances[column % len(distances), row % distances.shape[1]]"},
        ),
        Mistake(
            "sine and cosine are exchanged",
            {
                "ranges * np.cos(heading)": "ranges * np.sin(heading)",
                "ranges * np.sin(heading)": "ranges * np.cos(heading)",
            },
        ),
        Mistake("the robot's yaw is not added to the beam's angle", {"yaw + laser[2] + angles": "laser[2] + angles"}),
        Mistake("the beam's angle is subtracted", {"yaw + laser[2] + angles": "yaw + laser[2] - angles"}),
        Mistake("the yaw of the laser on the robot is left out", {"yaw + laser[2] + angles": "yaw + angles"}),
        Mistake(
            "where the laser is on the robot is left out",
            {
                " + laser[0] * np.cos(yaw) - laser[1] * np.sin(yaw)": "",
                " + laser[0] * np.sin(yaw) + laser[1] * np.cos(yaw)": "",
            },
        ),
        Mistake(
            "where the laser is on the robot is not turned with the robot",
            {
                "laser[0] * np.cos(yaw) - laser[1] * np.sin(yaw)": "laser[0]",
                "laser[0] * np.sin(yaw) + laser[1] * np.cos(yaw)": "laser[1]",
            },
        ),
        Mistake(
            "the laser's offset is turned the wrong way",
            {
                "- laser[1] * np.sin(yaw)": "+ laser[1] * np.sin(yaw)",
                "laser[0] * np.sin(yaw) + laser[1]": "-laser[0] * np.sin(yaw) + laser[1]",
            },
        ),
        Mistake(
            "angles are taken for degrees",
            {"np.cos(heading)": "np.cos(np.deg2rad(heading))", "np.sin(heading)": "np.sin(np.deg2rad(heading))"},
        ),
        Mistake(
            "metres are rounded to the nearest cell border, not down to the cell",
            {
                "np.floor(end_y[back] / resolution)": "np.round(end_y[back] / resolution)",
                "np.floor(end_x[back] / resolution)": "np.round(end_x[back] / resolution)",
            },
        ),
        Mistake(
            "rows and columns are one too high: cells count from 0",
            {
                "np.floor(end_y[back] / resolution)": "np.ceil(end_y[back] / resolution)",
                "np.floor(end_x[back] / resolution)": "np.ceil(end_x[back] / resolution)",
            },
        ),
        Mistake(
            "metres are taken for cells, without the resolution",
            {"end_y[back] / resolution": "end_y[back]", "end_x[back] / resolution": "end_x[back]"},
        ),
        Mistake("rows are counted from the top", {"distances[row, column]": "distances[-1 - row, column]"}),
        Mistake(
            "sigma_hit is taken for a variance",
            {
                "(distance / sigma_hit) ** 2": "distance**2 / sigma_hit",
                "(math.sqrt(2.0 * math.pi) * sigma_hit)": "math.sqrt(2.0 * math.pi * sigma_hit)",
            },
        ),
        Mistake("the distance is not squared", {"(distance / sigma_hit) ** 2": "(distance / sigma_hit)"}),
        Mistake("the factor one half is missing in the exponent", {"-0.5 * (distance": "-1.0 * (distance"}),
        Mistake(
            "the normal density lacks its factor 1 / (sqrt(2 pi) sigma_hit)",
            {" / (math.sqrt(2.0 * math.pi) * sigma_hit)": ""},
        ),
        Mistake("z_rand is not divided by max_range", {"z_rand / max_range": "z_rand"}),
        Mistake("z_rand is left out", {" + z_rand / max_range": ""}),
        Mistake(
            "beams from which nothing came back are judged like all others",
            {"back = ranges < max_range": "back = ranges < np.inf"},
        ),
        Mistake(
            "beams from which nothing came back have no likelihood, where they should be left out of the product",
            {"np.ones(len(ranges))": "np.zeros(len(ranges))"},
        ),
        Mistake("the logarithm of the likelihood is returned", {"    return p": "    return np.log(p)"}),
        Mistake(
            "the beam's angle is subtracted in the end's x only",
            {"ranges * np.cos(heading)": "ranges * np.cos(yaw + laser[2] - angles)"},
        ),
        Mistake(
            "the beam's angle is subtracted in the end's y only",
            {"ranges * np.sin(heading)": "ranges * np.sin(yaw + laser[2] - angles)"},
        ),
        Mistake("the beam is laid out backwards in x", {"+ ranges * np.cos(heading)": "- ranges * np.cos(heading)"}),
        Mistake("the beam is laid out backwards in y", {"+ ranges * np.sin(heading)": "- ranges * np.sin(heading)"}),
        Mistake(
            "the end's x has the sine of the heading, where it should have the cosine",
            {"ranges * np.cos(heading)": "ranges * np.sin(heading)"},
        ),
        Mistake(
            "the end's y has the cosine of the heading, where it should have the sine",
            {"ranges * np.sin(heading)": "ranges * np.cos(heading)"},
        ),
        Mistake(
            "the laser's offset to the left has the wrong sign in x",
            {"- laser[1] * np.sin(yaw)": "+ laser[1] * np.sin(yaw)"},
        ),
        Mistake(
            "the laser's offset to the left has the wrong sign in y",
            {"+ laser[1] * np.cos(yaw)": "- laser[1] * np.cos(yaw)"},
        ),
        Mistake(
            "the laser's offset ahead has the wrong sign in x", {"+ laser[0] * np.cos(yaw)": "- laser[0] * np.cos(yaw)"}
        ),
        Mistake(
            "the laser's offset ahead has the wrong sign in y", {"+ laser[0] * np.sin(yaw)": "- laser[0] * np.sin(yaw)"}
        ),
        Mistake("the laser's own yaw is subtracted", {"yaw + laser[2] + angles": "yaw - laser[2] + angles"}),
        Mistake("the exponent has the wrong sign", {"-0.5 * (distance": "0.5 * (distance"}),
        Mistake("the square root of two pi is not taken", {"math.sqrt(2.0 * math.pi)": "2.0 * math.pi"}),
        Mistake("z_rand is subtracted", {"+ z_rand / max_range": "- z_rand / max_range"}),
    ),
)
