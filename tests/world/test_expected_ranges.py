"""True ranges as the filter asks for them: by table, DDA and Bresenham's line, from anywhere on the map."""

from __future__ import annotations

import dataclasses
import math

import numpy as np
import pytest
import reference

from pipeline.config import Config
from pipeline.geometry import compose
from pipeline.logs.messages import Laser, Log
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.maps.range_table import opaque_cells
from pipeline.world.expected_ranges import ExpectedRanges, select_beams

LASER = Laser((0.25, -0.1, 0.3), -math.pi / 2, math.pi / 90, beams=91, range_min=0.0, range_max=30.0)


def expected(grid: OccupancyGrid, caster: str, laser: Laser = LASER, half_thickness: float = 0.0) -> ExpectedRanges:
    config = Config(ray_caster=caster, occupied_threshold=0.65, init="free_space", recovery="none")
    beams = np.arange(laser.beams)
    return ExpectedRanges(grid, laser, beams, config, laser.range_max, half_thickness)


def poses_in(grid: OccupancyGrid, n: int) -> np.ndarray:
    """Anywhere over the free cells, in the grid frame, (n, 3)."""
    rng = np.random.default_rng(0)
    rows, cols = np.nonzero(grid.free(0.25))
    cell = rng.integers(len(rows), size=n)
    at = (np.stack([cols[cell], rows[cell]]) + rng.random((2, n))) * grid.resolution
    return np.column_stack([at.T, rng.uniform(-np.pi, np.pi, n)])


@pytest.mark.parametrize("caster", ["table", "dda", "bresenham"])
def test_every_caster_sees_the_office(office: Log, caster: str) -> None:
    """Against the slow ray in metres. DDA: half a step of the code, 2 % and 3 cm. The others: also a cell and a half,
    and for the table half a degree, unless the ray grazes an obstacle, which a tenth of them do."""
    grid = office.grid
    opaque, ranges = opaque_cells(grid, 0.65), expected(grid, caster)
    close = []
    for pose in poses_in(grid, 25):
        found = ranges.codes.ranges[ranges.codes_at(pose[None])[0][0]]
        x, y, yaw = compose(pose, LASER.pose)
        for angle, distance in zip(LASER.angles[::6], found[::6], strict=True):
            true, kind = reference.ray(opaque, x / 0.1, y / 0.1, yaw + angle, 300.0)
            true *= 0.1
            code = 0.02 * true + 0.03 if kind == 1 else 0.1 * true + 0.15
            cells = 0.0 if caster == "dda" else 0.15
            close.append(distance == true or abs(distance - true) <= code + cells)
    assert np.mean(close) > (0.99 if caster == "dda" else 0.85)


@pytest.mark.parametrize("caster", ["table", "dda", "bresenham"])
def test_the_score_is_the_sum_over_what_the_pose_should_see(office: Log, caster: str) -> None:
    """A likelihood that is high where a code is even: score and expected ranges must read the same codes."""
    ranges = expected(office.grid, caster)
    rng = np.random.default_rng(1)
    log_likelihood = rng.normal(-3, 1, (LASER.beams, 256)).astype(np.float32)
    poses = poses_in(office.grid, 60)
    out = np.empty(60, np.float32)
    ranges.score(np.ascontiguousarray(poses.T.astype(np.float32)), log_likelihood, -999.0, out)
    agree = 0
    for pose, score in zip(poses, out, strict=True):
        codes = ranges.codes_at(pose[None])[0][0]
        if not codes.any():  # a laser within a wall
            agree += score == -999.0
            continue
        agree += abs(float(log_likelihood[np.arange(LASER.beams), codes].astype(float).sum()) - score) < 1e-2
    # Code 224, unknown land at the laser itself, reads the same zero as code 0: the one thing that `at` cannot tell.
    assert agree >= 57


@pytest.mark.parametrize("caster", ["table", "dda", "bresenham"])
def test_poses_off_the_map_and_in_walls_are_outside(office: Log, caster: str) -> None:
    grid = office.grid
    rows, cols = np.nonzero(grid.occupied(0.99))
    laser = dataclasses.replace(LASER, pose=(0.0, 0.0, 0.0))
    in_walls = np.stack([cols[:20] + 0.5, rows[:20] + 0.5]) * grid.resolution
    x, y = np.hstack([in_walls, [[-5.0, 500.0, 3.0], [3.0, 3.0, -0.2]]])
    log_likelihood = np.full((LASER.beams, 256), -1.0, np.float32)
    out = np.empty(len(x), np.float32)
    poses = np.stack([x, y, np.zeros_like(x)]).astype(np.float32)
    expected(grid, caster, laser).score(poses, log_likelihood, -999.0, out)
    assert (out[:20] == -999.0).all()
    if caster == "table":
        assert (out[20:] == -999.0).all()


def test_just_inside_a_smeared_wall_a_robot_still_sees(office: Log) -> None:
    grid = OccupancyGrid(np.zeros((40, 40), np.float32), 0.1)
    grid.occupancy[20:26] = 1.0
    laser = dataclasses.replace(LASER, pose=(0.0, 0.0, 0.0))
    poses = np.array([[2.05] * 6, [2.05, 2.15, 2.25, 2.35, 2.45, 2.55], [0.0] * 6], np.float32)
    log_likelihood = np.full((LASER.beams, 256), -1.0, np.float32)
    out = np.empty(6, np.float32)
    expected(grid, "table", laser, half_thickness=0.2).score(poses, log_likelihood, -999.0, out)
    assert (out == -999.0).tolist() == [False, False, True, True, False, False]
    expected(grid, "table", laser, half_thickness=0.15).score(poses, log_likelihood, -999.0, out)
    assert (out == -999.0).tolist() == [False, False, True, True, False, False]  # the second cell's centre, just so
    expected(grid, "table", laser, half_thickness=0.05).score(poses, log_likelihood, -999.0, out)
    assert (out == -999.0).tolist() == [False, True, True, True, True, False]
    expected(grid, "table", laser, half_thickness=0.0).score(poses, log_likelihood, -999.0, out)
    assert (out == -999.0).all()


@pytest.mark.parametrize("limit", [1, 2, 7, 60, 91, 500])
def test_beams_are_spread_evenly(limit: int) -> None:
    chosen = select_beams(LASER, Config(max_beams=limit))
    assert len(chosen) == min(limit, LASER.beams)
    assert chosen.min() >= 0
    assert chosen.max() < LASER.beams
    np.testing.assert_allclose(chosen.mean(), (LASER.beams - 1) / 2, atol=0.51)
    if len(chosen) > 1:
        assert np.ptp(np.diff(chosen)) <= 1


def test_every_fifth_beam_is_the_course_s_choice() -> None:
    laser = dataclasses.replace(LASER, beams=180)
    assert select_beams(laser, Config(beam_step=5)).tolist() == list(range(0, 180, 5))
