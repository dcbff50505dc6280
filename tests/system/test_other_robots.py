"""Other robots and other buildings, as a user meets them: what was read, and whether to trust what came out."""

from __future__ import annotations

import json
import re
from pathlib import Path

import numpy as np
import pytest
from commands import FEW, Command, Journey

from pipeline.maps.map_server import save_map
from pipeline.maps.occupancy_grid import OccupancyGrid

MANY = ("--particles", "6000", "--set", "record_particles=200")


def test_the_map_of_another_building_is_not_trusted(mcl: Command, journey: Journey, tmp_path: Path) -> None:
    cells = np.zeros((200, 200), np.float32)
    cells[::8, ::8] = 1.0  # a hall of columns
    save_map(OccupancyGrid(cells, 0.1), tmp_path / "hall.yaml")
    said = mcl("localize", journey.short, "--map", tmp_path / "hall.yaml", *FEW, "-o", tmp_path / "run").stderr
    found = r"in the second half of the run the robot is found in 0 % of the scans"
    fits = r"the map .*hall\.yaml explains \d+ % of the beams"
    assert re.search(rf"^warning: do not trust this: {found}, and {fits}", said, re.M)
    assert "the parameters" not in said
    figures = json.loads((tmp_path / "run" / "run.json").read_text())["figures"]
    assert figures["explained_late"] < 0.55
    words = ("--map", tmp_path / "hall.yaml", *FEW, "--config", "course", "-o", tmp_path / "again")
    assert re.search(
        r"do not trust .* \(--config course\) another robot's\?$", mcl("localize", journey.short, *words).stderr, re.M
    )


def test_a_map_goes_to_ros_and_comes_back(mcl: Command, journey: Journey, tmp_path: Path) -> None:
    done = mcl("convert", journey.raw / "office.dat.gz", "-o", tmp_path / "office.yaml")
    assert done.stdout.split() == [str(tmp_path / "office.yaml"), str(tmp_path / "office.pgm")]
    assert "unknown" in done.stderr
    mcl("localize", journey.short, "--map", tmp_path / "office.yaml", *FEW, "-o", tmp_path / "run")
    again = mcl("convert", tmp_path / "office.yaml", "-o", tmp_path / "again.yaml")
    assert (tmp_path / "again.pgm").read_bytes() == (tmp_path / "office.pgm").read_bytes()
    assert again.returncode == 0


@pytest.mark.slow
def test_a_pioneer_in_birmingham(mcl: Command, shared_data: Path, tmp_path: Path) -> None:
    """A bag of ROS 1 and its twin of ROS 2, another laser and other topics: found from anywhere in the building."""
    folder, truth = shared_data / "uob_pioneer", shared_data / "uob_pioneer" / "trace0_groundtruth.tum"
    theirs = folder / "trace0_ros2_mcap" / "uob_trace0.mcap"
    said = mcl("localize", theirs, "--map", folder / "map.yaml", *MANY, "-o", tmp_path / "a").stderr
    assert "/base_scan, /odom; odom -> base_link -> laser" in said
    assert "1 of the scans: before the odometry begins or after it ends" in said
    assert "warning" not in said
    ours = tmp_path / "ours.mcap"
    mcl("convert", folder / "trace0.bag", "--map", folder / "map.yaml", "--ground-truth", truth, "-o", ours)
    told = json.loads(mcl("localize", ours, *MANY, "-o", tmp_path / "b", "--json").stdout)
    assert told["truth"]["end_position_error"] < 0.3
    assert (tmp_path / "a" / "trajectory.tum").read_bytes() == (tmp_path / "b" / "trajectory.tum").read_bytes()


def test_a_map_whose_unknown_reads_as_free_is_remarked_upon(mcl: Command, shared_data: Path, tmp_path: Path) -> None:
    folder = shared_data / "olin_mac"
    said = mcl("convert", folder / "mac_1st_floor_9_23.yaml", "-o", tmp_path / "m.yaml").stderr
    assert re.search(r"^note: 66 % of the map is grey 205.* free_thresh 0\.25; with 0\.196 it would", said, re.M)
