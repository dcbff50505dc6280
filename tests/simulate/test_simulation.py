"""Whole simulations: what is written, that a seed decides it, and that the embedded sample is what its seed gives."""

from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest

from converters.beesoft import read_beesoft
from converters.cmu_text import CmuLog, read_log_text
from pipeline.geometry import between, compose, wrap_angle
from pipeline.logs.messages import Trajectory
from pipeline.logs.tum import read_tum
from pipeline.simulate import SAMPLE_SEED, Building, SimulationReport, load_building, sample_dir, simulate
from pipeline.simulate.drive import drive
from pipeline.simulate.sensors import true_ranges
from pipeline.simulate.world import build_world, people_at

HUT = {
    "name": "hut",
    "map": {"size": [8, 6]},
    "rooms": [{"name": "hall", "box": [1, 1, 7, 5]}],
    "doors": [{"start": [3, 1], "end": [4, 1]}],
    "people": [{"path": [[2, 4], [6, 4]]}],
    "robot": {"start": [2, 2], "legs": [{"to": [5, 2]}, {"turn_deg": 90}, {"to": [4, 2.5], "backwards": True}]},
    "odometry": {"start": [1.0, 2.0, 3.0]},
}


@pytest.fixture(scope="module")
def hut(tmp_path_factory: pytest.TempPathFactory) -> SimulationReport:
    return simulate(Building.model_validate(HUT), tmp_path_factory.mktemp("hut"), seed=4)


def text(path: Path) -> bytes:
    return gzip.decompress(path.read_bytes()) if path.suffix == ".gz" else path.read_bytes()


def test_the_log_looks_like_a_real_one(hut: SimulationReport) -> None:
    lines = text(hut.log).decode().splitlines()
    kinds = {line[0]: line.split() for line in lines}
    assert len(kinds["O"]) == 5
    assert len(kinds["L"]) == 188
    assert all(number.partition(".")[2].isdigit() and len(number.partition(".")[2]) == 6 for number in kinds["O"][1:])
    assert all(number.isdigit() for number in kinds["L"][7:187])
    assert "-0.000000" not in text(hut.log).decode().split()
    log = read_log_text(hut.log)
    assert log.poses[0] == pytest.approx([100.0, 200.0, 3.0])
    assert log.stamps[0] == 0
    assert not log.is_scan[0]
    assert not log.is_scan[-1]
    assert np.abs(log.poses[:, 2]).max() <= np.pi
    assert log.is_scan.sum() == hut.scans
    assert set(log.ranges[log.ranges > 5000].ravel().tolist()) == {8191.0}  # through the door
    rates = 1e9 / np.diff(log.stamps[log.is_scan]).mean(), 1e9 / np.diff(log.stamps[~log.is_scan]).mean()
    assert rates == pytest.approx((5.0, 15.0), rel=0.05)


def test_the_laser_is_a_quarter_of_a_metre_ahead(hut: SimulationReport) -> None:
    log = read_log_text(hut.log)
    offset = between(log.poses[log.is_scan] / [100, 100, 1], log.laser_poses / [100, 100, 1])
    assert offset == pytest.approx(np.tile([0.25, 0.0, 0.0], (len(offset), 1)), abs=1e-6)


def test_odometry_at_a_scan_lies_between_its_neighbours(hut: SimulationReport) -> None:
    log = read_log_text(hut.log)
    odometry, scans = ~log.is_scan, log.is_scan
    for column in range(2):
        expected = np.interp(log.stamps[scans], log.stamps[odometry], log.poses[odometry, column])
        assert log.poses[scans, column] == pytest.approx(expected, abs=1e-4)


def test_the_truth_has_the_stamps_of_the_scans(hut: SimulationReport) -> None:
    truth, log = read_tum(hut.ground_truth), read_log_text(hut.log)
    assert truth.stamps.tolist() == log.stamps[log.is_scan].tolist()
    assert truth.poses[0] == pytest.approx([2.0, 2.0, 0.0], abs=1e-3)
    assert hut.distance == pytest.approx(4.1, abs=0.3)
    assert hut.duration == pytest.approx(log.stamps[-1] / 1e9, abs=0.3)


def test_the_report_tells_how_far_odometry_is_off(hut: SimulationReport) -> None:
    truth, log = read_tum(hut.ground_truth).poses, read_log_text(hut.log)
    odometry = log.poses[log.is_scan] / [100, 100, 1]
    error = compose(truth[0], between(odometry[0], odometry[-1])) - truth[-1]
    assert hut.odometry_error == pytest.approx(np.hypot(error[0], error[1]), abs=1e-5)
    assert hut.odometry_yaw_error == pytest.approx(abs(wrap_angle(error[2])), abs=1e-5)


def test_the_map_is_written_whole(hut: SimulationReport) -> None:
    grid = read_beesoft(hut.map)
    assert grid.occupancy.shape == (60, 80)
    assert grid.resolution == 0.1
    assert grid.occupancy[30, 10] == 1.0  # x = 1.05, y = 3.05: the western wall


def test_a_seed_decides_everything(hut: SimulationReport, tmp_path: Path) -> None:
    same = simulate(Building.model_validate(HUT), tmp_path / "same", seed=4)
    other = simulate(Building.model_validate(HUT), tmp_path / "other", seed=5)
    assert same.log.read_bytes() == hut.log.read_bytes()
    assert same.map.read_bytes() == hut.map.read_bytes()
    assert same.ground_truth.read_bytes() == hut.ground_truth.read_bytes()
    assert text(other.log) != text(hut.log)


def test_the_sample_is_what_its_seed_gives(tmp_path: Path) -> None:
    building = load_building(sample_dir() / "building.yaml")
    made = simulate(building, tmp_path, SAMPLE_SEED)
    for path in (made.log, made.map, made.ground_truth):
        assert text(path) == text(sample_dir() / path.name), f"{path.name} is not what the simulator makes"


@pytest.fixture(scope="module")
def sample() -> tuple[Building, CmuLog, Trajectory]:
    folder = sample_dir()
    return (
        load_building(folder / "building.yaml"),
        read_log_text(folder / "office.log.gz"),
        read_tum(folder / "office_truth.tum"),
    )


def test_the_sample_is_small() -> None:
    assert sum(path.stat().st_size for path in sample_dir().iterdir()) < 600_000


def test_the_samples_robot_touches_nothing(sample: tuple[Building, CmuLog, Trajectory]) -> None:
    building, _, _ = sample
    world, motion = build_world(building, mapped=False), drive(building.robot)
    all_round = np.linspace(0, 2 * np.pi, 36, endpoint=False)
    seen = np.ones((36, len(world.panes)), dtype=np.bool_)
    for time, pose in zip(motion.times[::10], motion.poses[::10], strict=True):
        free = true_ranges(world, people_at(building.people, time), pose[:2], all_round, seen).min()
        assert free > building.robot.radius, f"at {time:.1f} s the robot is {free:.2f} m from something"


def test_the_samples_scans_fit_its_map_at_the_true_poses(sample: tuple[Building, CmuLog, Trajectory]) -> None:
    """Most beams end on a wall of the map, the rest is what the sample is about: people, furniture, doors, glass."""
    _, log, truth = sample
    grid = read_beesoft(sample_dir() / "office.dat.gz")
    y, x = np.nonzero(grid.occupied(0.5))
    walls = (np.column_stack([x, y]) + 0.5) * grid.resolution
    beams = np.arange(0, 180, 10)
    angles = truth.poses[::20, 2, None] + np.deg2rad(beams - 90.0)
    laser = compose(truth.poses[::20], (0.25, 0.0, 0.0))
    ranges = log.ranges[::20][:, beams, None] / 100
    ends = laser[:, None, :2] + ranges * np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    away = np.sqrt(((ends[:, :, None, :] - walls) ** 2).sum(axis=-1).min(axis=-1))
    assert 0.6 < (away < 0.2).mean() < 0.95
