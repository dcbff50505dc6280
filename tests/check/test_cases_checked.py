"""Every fault of the recordings kept beside the checkout is found and named; on the real ones nothing is broken."""

from __future__ import annotations

from pathlib import Path

import pytest

from converters import read_map
from pipeline.check.looking import look
from pipeline.config import Config

QUICK = Config(max_particles=4000)
CASES = {
    # file: grade, what the finding says
    "odom_garbage.mcap": ("doubtful", "no robot says that"),
    "sim_reset.mcap": ("doubtful", "run back by 23.5 s"),
    "odom_other_clock.mcap": ("broken", "no scan lies within the odometry's time span"),
    "tf_static_twice.mcap": ("doubtful", "is said 2 times and differently"),
    "two_robots.mcap": ("doubtful", "Several robots are in this recording: robot1, robot2"),
    "two_topics.mcap": ("noted", "and not /scan_front"),
    "odom_pose_zero.mcap": ("doubtful", "/odom never moves"),
    "killed.mcap": ("doubtful", "is cut"),
    "ros1_profile.mcap": ("noted", "ROS 1's"),
    "bag_reindexed": ("noted", "calls the bag's storage ''"),
    "split_second.mcap": ("broken", "no transform from 'base_link' to the laser"),
    "pr2_tilt.mcap": ("noted", "/tilt_scan was not taken"),
    "multi_echo.mcap": ("noted", "several echoes"),
    "cloud_only.mcap": ("broken", "no laser scans"),
    "odom_reset.mcap": ("doubtful", "leapt at 40.0 s"),
    "skew.mcap": ("noted", "one after the other"),
    "tree_inverted_odom.mcap": ("noted", "the wrong way round"),
    "carmen/raw_odom.log": ("doubtful", "No PARAM robot_frontlaser_offset"),
    "carmen/mixed180.log": ("noted", "other beams"),
    "cmu/comments.log": ("noted", "comments"),
    "cmu/backstep.log": ("doubtful", "stamps ran backwards"),
    "cmu/concatenated.log": ("doubtful", "begins anew at line 866"),
    "cmu/one_short.log": ("doubtful", "112 ranges"),
    "cmu/one_nan.log": ("doubtful", "NaN or an infinite number"),
}
SOUND = ("base.mcap", "bag_mcap", "cmu/plain.log", "controls/robot2_alone.mcap", "controls/tf_static_once.mcap")
REAL = (
    "cmu/robotdata4.log.gz",
    "olin_mac/macfirst_floor_take_2",
    "uob_pioneer/trace0.bag",
    "carmen/fr079/fr079.log.gz",
)


@pytest.fixture(scope="session")
def cases(shared_data: Path) -> Path:
    path = shared_data.parent / "cases"
    if not path.is_dir():
        pytest.skip("the cases are not beside the checkout")
    return path


@pytest.mark.parametrize("name", CASES)
def test_its_fault_is_named(name: str, cases: Path) -> None:
    grade, words = CASES[name]
    found = look(cases / name, QUICK).findings
    assert [f for f in found if f.grade == grade and words in f.text], found
    assert all(f.do for f in found)


@pytest.mark.parametrize("name", SOUND)
def test_a_sound_one_is_told_so(name: str, cases: Path) -> None:
    report = look(cases / name, QUICK, grid=read_map(cases / "map/office.yaml"))
    assert [f for f in report.findings if f.grade != "noted"] == []


@pytest.mark.parametrize("name", REAL)
def test_nothing_is_broken_in_real_logs(name: str, shared_data: Path) -> None:
    found = look(shared_data / name, QUICK).findings
    assert not [f for f in found if f.grade == "broken"]
    assert len([f for f in found if f.grade == "doubtful"]) <= 1
