"""What robots really record, kept beside the checkout: each is localized, or one line names the fault."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from commands import Command

from pipeline.geometry import wrap_angle
from pipeline.logs.tum import read_tum
from pipeline.simulate import sample_dir

BASE, CARMEN = "base.tum", "carmen/base.tum"
FOUND = {
    # input and options: truth, share of scans right, what a note says
    "odom_garbage.mcap": (BASE, 0.95, "/odom: 3 of 216 messages left out"),
    "tf_static_twice.mcap": (BASE, 0.95, "the last counts"),
    "two_topics.mcap": (BASE, 0.95, "/scan_front"),
    "odom_pose_zero.mcap": (BASE, 0.95, "/odom never moves: /tf is taken instead"),
    "odom_other_clock.mcap --stamps log": (BASE, 0.95, ""),
    "killed.mcap": (BASE, 0.9, "is cut"),
    "ros1_profile.mcap": (BASE, 0.95, ""),
    "bag_reindexed": (BASE, 0.95, "by way of"),
    "bag_mcap": (BASE, 0.95, "by way of"),
    "split_second.mcap --laser-pose 0.2,0,0": (BASE, 0.95, ""),
    "pr2_tilt.mcap": (BASE, 0.95, "/tilt_scan was not taken"),
    "multi_echo.mcap": (BASE, 0.95, ""),
    "odom_reset.mcap": (BASE, 0.95, "goes on from where it stood"),
    "skew.mcap": (BASE, 0.95, ""),
    "carmen/raw_odom.log": (CARMEN, 0.9, "no PARAM robot_frontlaser_offset"),
    "carmen/mixed180.log": (CARMEN, 0.95, "4 of 216 scans have other beams"),
    "cmu/comments.log": ("", 0.95, ""),
    "cmu/backstep.log": ("", 0.95, "stamps ran backwards"),
    "cmu/one_short.log": ("", 0.95, "1 of 1,731 lines left out"),
    "cmu/one_nan.log": ("", 0.95, "1 of 1,731 lines left out"),
}
MAPS = {
    "subdir": "beside the YAML is taken",
    "elsewhere": "beside the YAML is taken",
    "warehouse": "are kept that say anything",
    "nan_yaw": "taken for 0",
    "tabs": "",
    "layer": "is transparent",
}
REFUSED = {
    "odom_other_clock.mcap": "--stamps log",
    "split_second.mcap": "--laser-pose",
    "cloud_only.mcap": "pointcloud_to_laserscan",
}


@pytest.fixture(scope="session")
def cases(shared_data: Path) -> Path:
    path = shared_data.parent / "cases"
    if not path.is_dir():
        pytest.skip("the cases are not beside the checkout")
    return path


def right(run: Path, truth: Path) -> float:
    """The share of scans within 0.5 m and 10 degrees of the truth."""
    found, known = read_tum(run / "trajectory.tum"), read_tum(truth)
    assert np.isfinite(found.poses).all()
    at = [
        np.interp(found.stamps, known.stamps, column)
        for column in (*known.poses[:, :2].T, np.unwrap(known.poses[:, 2]))
    ]
    apart = found.poses - np.column_stack(at)
    near = np.hypot(apart[:, 0], apart[:, 1]) < 0.5
    return float(np.mean(near & (np.abs(wrap_angle(apart[:, 2])) < np.radians(10.0))))


@pytest.mark.parametrize("typed", FOUND)
def test_it_is_localized(typed: str, cases: Path, typed_here: Command, tmp_path: Path) -> None:
    name, *options = typed.split()
    truth, share, note = FOUND[typed]
    run = tmp_path / "run"
    done = typed_here("localize", cases / name, *options, "--map", cases / "map/office.yaml", "--no-record", "-o", run)
    assert note in done.stderr
    assert right(run, cases / truth if truth else sample_dir() / "office_truth.tum") >= share


@pytest.mark.parametrize("name", MAPS)
def test_on_a_map_of_somebody_elses(name: str, cases: Path, typed_here: Command, tmp_path: Path) -> None:
    run = tmp_path / "run"
    done = typed_here("localize", cases / "base.mcap", "--map", cases / f"map/{name}.yaml", "--no-record", "-o", run)
    assert MAPS[name] in done.stderr
    assert right(run, cases / BASE) >= 0.95


@pytest.mark.parametrize("name", REFUSED)
def test_one_line_says_what_would_help(name: str, cases: Path, typed_here: Command, tmp_path: Path) -> None:
    done = typed_here("localize", cases / name, "--map", cases / "map/office.yaml", "-o", tmp_path / "run", code=1)
    (line,) = done.stderr.splitlines()
    assert REFUSED[name] in line


@pytest.mark.parametrize("robot", ["1", "2"])
def test_one_of_two_robots(robot: str, cases: Path, typed_here: Command, tmp_path: Path) -> None:
    options = ("--map", cases / "map/office.yaml", "--no-record", "-o", tmp_path / "run")
    done = typed_here("localize", cases / "two_robots.mcap", "--scan-topic", f"/robot{robot}/scan", *options)
    assert f"/robot{robot}/odom; odom -> base_link -> laser" in done.stderr
    assert right(tmp_path / "run", cases / BASE) >= 0.95


def test_a_simulation_that_was_reset(cases: Path, typed_here: Command, tmp_path: Path) -> None:
    options = ("--map", cases / "map/office.yaml", "--no-record", "-o", tmp_path / "run")
    done = typed_here("localize", cases / "sim_reset.mcap", *options)
    assert "at message 61: it begins a new stretch" in done.stderr
    stamps = read_tum(tmp_path / "run" / "trajectory.tum").stamps
    assert (len(stamps), int(np.argmax(np.diff(stamps)))) == (160, 59)
