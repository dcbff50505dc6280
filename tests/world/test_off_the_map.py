"""A drive to where the map ends, whole: the robot is kept there, and what it saw becomes part of the map."""

from __future__ import annotations

import dataclasses
from typing import Any

import buildings
import numpy as np
import pytest

from pipeline.config import Config
from pipeline.judgement.verdict import TRUSTED
from pipeline.localization import RunResult, localize
from pipeline.simulate import Simulated, simulate_log

KNOWN = (8.3, 6.2)
"""m: what is to the right of and below this is not on the map: the kitchen, and half of the corridor."""


@pytest.fixture(scope="module")
def drive() -> Simulated:
    there = [{"to": [7, 5.3]}, {"to": [4.2, 5.0]}, {"to": [10.2, 5.2]}, {"to": [10.2, 2.6]}, {"turn_deg": 150}]
    back = [{"to": [10.2, 5.0]}, {"to": [2.2, 5.2]}, {"turn_deg": 180}, {"to": [6.0, 5.2]}]
    robot = {"start": [7, 7.4], "heading_deg": -90, "legs": there + back}
    return simulate_log(buildings.office(people=[], robot=robot), 3)


@pytest.fixture(scope="module")
def unknown(drive: Simulated) -> np.ndarray:
    """Scans that were taken there, but for those at its border."""
    x, y, _ = drive.ground_truth.poses.T
    return (x > KNOWN[0] + 0.3) & (y < KNOWN[1])


def localized(drive: Simulated, grid: Any = None, **changes: Any) -> tuple[RunResult, np.ndarray]:
    """The run, and how far off it was at every scan, m."""
    if grid is None:
        occupancy = drive.grid.occupancy.copy()
        column, row = (int(v / drive.grid.resolution) for v in KNOWN)
        occupancy[:row, column:] = np.nan
        grid = dataclasses.replace(drive.grid, occupancy=occupancy)
    truth = drive.ground_truth.poses
    start = tuple(truth[0].tolist())
    config = Config(max_particles=500, min_particles=500, init="pose", initial_pose=start, **changes)
    result = localize(dataclasses.replace(drive.log, grid=grid), config, seed=1)
    return result, np.hypot(*(result.poses - truth)[:, :2].T)


@pytest.fixture(scope="module")
def kept(drive: Simulated) -> tuple[RunResult, np.ndarray]:
    return localized(drive)


def test_where_the_map_ends_the_robot_is_kept(
    drive: Simulated, unknown: np.ndarray, kept: tuple[RunResult, np.ndarray]
) -> None:
    assert unknown.sum() > 60
    result, off = kept
    assert off.max() < 0.3
    # And it is said that it is off the map, and nowhere else that it were.
    kinds = np.array(result.verdicts)
    assert (kinds[unknown] == "off the map").mean() > 0.3
    known = drive.ground_truth.poses[:, 0] < KNOWN[0] - 0.3
    assert not (kinds[known] == "off the map").any()
    assert np.isin(kinds[known], TRUSTED).mean() > 0.9


def test_without_land_off_the_map_it_is_lost_there(drive: Simulated, unknown: np.ndarray) -> None:
    _, off = localized(drive, without=("off_map",))
    assert off[: int(np.argmax(unknown))].max() < 0.3
    assert off[unknown].max() > 3.0


def test_what_was_seen_there_becomes_floor_and_walls(
    drive: Simulated, unknown: np.ndarray, kept: tuple[RunResult, np.ndarray]
) -> None:
    """The renewed map has the way that the robot took, and the kitchen's walls where they are."""
    seen = kept[0].seen
    assert seen is not None
    renewed = seen.renewed()
    way = renewed.to_grid(drive.ground_truth.poses[unknown])
    column, row = np.floor(way[:, :2].T / renewed.resolution).astype(int)
    assert (renewed.occupancy[row, column] == 0.0).mean() > 0.9
    rows, cols = np.nonzero(seen.changed == 1)
    assert len(rows) > 50
    at = drive.grid.to_map(
        np.stack([cols + 0.5 - seen.margin, rows + 0.5 - seen.margin, 0 * cols], axis=1) * seen.resolution
    )
    true_rows, true_cols = np.nonzero(drive.grid.occupied(0.65))
    walls = (np.stack([true_cols, true_rows], axis=1) + 0.5) * drive.grid.resolution
    nearest = np.array([np.hypot(*(walls - place[:2]).T).min() for place in at])
    assert np.mean(nearest < 0.2) > 0.8  # the rest is furniture that no map has


def test_on_the_renewed_map_the_same_drive_needs_no_land_off_it(
    drive: Simulated, kept: tuple[RunResult, np.ndarray]
) -> None:
    assert kept[0].seen is not None
    _, off = localized(drive, kept[0].seen.renewed(), without=("off_map",))
    assert off.max() < 0.5
