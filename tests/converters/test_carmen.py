"""CARMEN logs: lines written by hand, and where they are here, three buildings that robots really drove through."""

from __future__ import annotations

import bz2
import gzip
import json
import math
from pathlib import Path

import numpy as np
import pytest

from converters import convert
from converters.carmen import PARAMS
from converters.carmen_text import in_order, is_carmen_text, parse_carmen, read_carmen
from pipeline.errors import MclError
from pipeline.geometry import compose
from pipeline.logs import schema
from pipeline.logs.reader import read_log

SECOND = 1_000_000_000
NOWHERE = Path("log.clf")


def numbers(values) -> str:
    return " ".join(f"{v:g}" for v in values)


def flaser(stamp: str, robot=(0.0, 0.0, 0.0), ranges=(1.0, 2.0, 3.0, 4.0), laser=None, kind="FLASER") -> str:
    laser = compose(robot, (0.2, 0.0, 0.0)).tolist() if laser is None else laser
    return f"{kind} {len(ranges)} {numbers(ranges)} {' '.join(map(repr, [*laser, *robot]))} {stamp} host 0.5"


def odom(stamp: str, robot=(0.0, 0.0, 0.0)) -> str:
    return f"ODOM {numbers(robot)} 0.1 0 0 {stamp} host 0.5"


def robotlaser(stamp: str, ranges=(1.0, 2.0), remissions=(), max_range=8.0) -> str:
    head = f"ROBOTLASER1 0 -1.5 3.0 3.0 {max_range} 0.01 0 {len(ranges)} {numbers(ranges)} {len(remissions)}"
    return f"{head} {numbers(remissions)} 1.2 0 0 1 0 0 0.3 0.1 0.5 0.5 1e6 {stamp} host 0.5"


def parse(*lines: str):
    return parse_carmen(("\n".join(lines) + "\n").encode(), NOWHERE)


def write(path: Path, *lines: str) -> Path:
    path.write_text("\n".join(lines) + "\n")
    return path


# --- lines


def test_flaser_lines_carry_ranges_both_poses_and_an_exact_stamp():
    log = parse(
        "# CARMEN Logfile",
        odom("976052857.337000"),
        "",
        flaser("976052857.337284", robot=(1.0, 2.0, 0.5), ranges=(1.5, 2.5)),
        "SYNC first 1.0 host 1.0",
    )
    assert log.kind == "FLASER"
    assert log.lines.tolist() == [4]
    assert log.stamps.tolist() == [976052857_337284000]
    np.testing.assert_array_equal(log.ranges, [[1.5, 2.5]])
    np.testing.assert_array_equal(log.robot_poses, [[1.0, 2.0, 0.5]])
    np.testing.assert_allclose(log.laser_poses[0], compose((1.0, 2.0, 0.5), (0.2, 0.0, 0.0)))
    assert log.counts == {"ODOM": 1, "FLASER": 1, "SYNC": 1}


@pytest.mark.parametrize(
    ("n", "first", "step", "last"),
    [
        (180, -90, 1.0, 89.0),
        (181, -90, 1.0, 90.0),
        (360, -90, 0.5, 89.5),
        (361, -90, 0.5, 90.0),
        (400, -50, 0.25, 49.75),
        (401, -50, 0.25, 50.0),
        (91, -90, 2.0, 90.0),
        (10, -90, 20.0, 90.0),
    ],
)
def test_the_count_of_an_flaser_line_says_its_angles(n, first, step, last):
    """The counts of a SICK laser as CARMEN's reader guesses them; any other count spans half a turn."""
    beams = parse(flaser("1", ranges=[1.0] * n)).beams
    assert math.degrees(beams.angle_min) == pytest.approx(first)
    assert math.degrees(beams.angle_increment) == pytest.approx(step)
    assert math.degrees(beams.angle_min + (n - 1) * beams.angle_increment) == pytest.approx(last)


CARMENS_OWN = {
    # As the header that CARMEN's logger writes describes its lines, each followed by
    # ipc_timestamp ipc_hostname logger_timestamp.
    "PARAM": "param_name param_value",
    "ODOM": "x y theta tv rv accel",
    "TRUEPOS": "true_x true_y true_theta odom_x odom_y odom_theta",
    "FLASER": "num_readings [range_readings] x y theta odom_x odom_y odom_theta",
    "RLASER": "num_readings [range_readings] x y theta odom_x odom_y odom_theta",
    "ROBOTLASER1": "laser_type start_angle field_of_view angular_resolution maximum_range accuracy remission_mode "
    "num_readings [range_readings] num_remissions [remission values] laser_pose_x laser_pose_y laser_pose_theta "
    "robot_pose_x robot_pose_y robot_pose_theta laser_tv laser_rv forward_safety_dist side_safty_dist turn_axis",
}


@pytest.mark.parametrize("kind", ["FLASER", "RLASER", "ROBOTLASER1"])
def test_lines_as_carmens_own_header_describes_them(kind):
    """Every value is found where the description has it."""
    values = {
        "num_readings": "3", "[range_readings]": "1.5 2.5 3.5", "num_remissions": "2", "[remission values]": "7 8",
        "param_name": "robot_frontlaser_offset", "param_value": "0.1", "laser_type": "99", "start_angle": "-1.5",
        "field_of_view": "3", "angular_resolution": "1.5", "maximum_range": "60", "accuracy": "0.02",
        "remission_mode": "0", "x": "1.1", "y": "2", "theta": "0.5", "odom_x": "1", "odom_y": "2", "odom_theta": "0.5",
        "laser_pose_x": "1.1", "laser_pose_y": "2", "laser_pose_theta": "0.5", "robot_pose_x": "1",
        "robot_pose_y": "2", "robot_pose_theta": "0.5", "true_x": "5", "true_y": "6", "true_theta": "0.7",
    }  # fmt: skip

    def line(name: str, stamp: str) -> str:
        words = CARMENS_OWN[name].replace("remission values", "remission_values").split()
        named = {key.replace(" ", "_"): value for key, value in values.items()}
        return " ".join([name, *(named.get(word, "0.25") for word in words), stamp, "host", "9.5"])

    log = parse(line("PARAM", "0"), line("ODOM", "1"), line("TRUEPOS", "2"), line(kind, "3.25"))
    assert log.kind == kind
    assert log.counts == {"PARAM": 1, "ODOM": 1, "TRUEPOS": 1, kind: 1}
    assert log.params == {"robot_frontlaser_offset": "0.1"}
    assert log.stamps.tolist() == [3.25 * SECOND]
    assert log.ranges.tolist() == [[1.5, 2.5, 3.5]]
    assert log.laser_poses.tolist() == [[1.1, 2.0, 0.5]]
    assert log.robot_poses.tolist() == [[1.0, 2.0, 0.5]]
    assert (log.truth_stamps.tolist(), log.truth_poses.tolist()) == ([2 * SECOND], [[5.0, 6.0, 0.7]])
    if kind == "ROBOTLASER1":
        assert (log.beams.angle_min, log.beams.angle_increment, log.beams.max_range) == (-1.5, 1.5, 60.0)


def test_robotlaser_says_its_own_angles_and_longest_range_and_is_preferred():
    log = parse(flaser("1"), robotlaser("1.5", ranges=(1.0, 2.0), remissions=(0.1, 0.2)), robotlaser("2"))
    assert log.kind == "ROBOTLASER1"
    assert (log.beams.count, log.beams.angle_min, log.beams.angle_increment, log.beams.max_range) == (2, -1.5, 3.0, 8.0)
    np.testing.assert_array_equal(log.robot_poses[0], [1.0, 0.0, 0.0])
    np.testing.assert_array_equal(log.laser_poses[0], [1.2, 0.0, 0.0])
    assert log.stamps.tolist() == [1.5 * SECOND, 2 * SECOND]


def test_params_and_truepos():
    log = parse(
        "PARAM robot_frontlaser_offset 0.25 nohost 0",
        "PARAM robot_name two words 1.0 host 1.0",
        "TRUEPOS 5 6 0.7 1 2 0.3 3.5 host 0.5",
        flaser("4"),
    )
    assert log.params == {"robot_frontlaser_offset": "0.25", "robot_name": "two"}
    assert log.truth_stamps.tolist() == [3.5 * SECOND]
    np.testing.assert_array_equal(log.truth_poses, [[5, 6, 0.7]])


@pytest.mark.parametrize(
    ("line", "message"),
    [
        (flaser("2")[:-10], "FLASER: expected 15 words, found 1"),
        ("FLASER", "FLASER: the line is cut"),
        ("FLASER many 1 2", "'many' is no number of readings"),
        (flaser("2").replace("3", "x3", 1), "'x3' is not a finite number"),
        (flaser("2").replace("3", "nan", 1), "'nan' is not a finite number"),
        (flaser("-2"), "the stamp -2.000000000 is out of bounds"),
        (flaser("soon"), "'soon' is not a number of seconds"),
        ("ODOM 1 2 3", "ODOM: expected 10 words, found 4"),
        ("TRUEPOS 1 2 3 4 5 inf 6 host 7", "'inf' is not a finite number"),
        ("PARAM alone", "PARAM: the line is cut"),
        (robotlaser("2").replace(" 0 -1.5", " 0", 1), "is no number of readings"),
    ],
)
def test_a_bad_line_is_told_in_one_line_with_its_place(line, message):
    with pytest.raises(MclError, match=r"log\.clf:3: ") as caught:
        parse("# CARMEN Logfile", flaser("1"), line)
    assert message in str(caught.value)
    assert "\n" not in str(caught.value)


def test_a_log_without_scans_says_what_it_has_instead():
    with pytest.raises(MclError, match=r"no laser scans .* but 2 ODOM"):
        parse(odom("1"), odom("2"))


# --- stamps


def test_stamps_that_increase_stay_as_they_are():
    stamps = np.array([5, 6, 7 * SECOND], dtype=np.int64)
    assert in_order(stamps) is stamps
    assert len(in_order(np.zeros(0, dtype=np.int64))) == 0


def test_stamps_that_run_backwards_give_way_and_the_order_of_the_lines_stays():
    start = 976_052_857 * SECOND
    stamps = start + np.array([0, 3, 1, 2, 9], dtype=np.int64) * SECOND
    repaired = in_order(stamps)
    np.testing.assert_array_equal(
        repaired - start, [0, 2 * SECOND, 2 * SECOND + 100_000, 2 * SECOND + 200_000, 9 * SECOND]
    )


def test_scans_keep_the_order_of_the_file():
    log = parse(flaser("1", (0, 0, 0)), flaser("3", (1, 0, 0)), flaser("2", (2, 0, 0)), flaser("4", (3, 0, 0)))
    assert log.robot_poses[:, 0].tolist() == [0, 1, 2, 3]
    assert (np.diff(log.stamps) > 0).all()
    assert log.repaired == 2


# --- files


def test_a_converted_log_reads_back(tmp_path):
    lines = [
        "PARAM robot_frontlaser_offset 0.2 nohost 0",
        odom("10.0"),
        flaser("10.5", (1.0, 0.0, 0.1), (1.0, 2.0, 0.0, 81.91)),
        "TRUEPOS 5 6 0.7 1 2 0.3 10.5 host 0.5",
        flaser("11.25", (1.5, 0.2, 0.3), (1.1, 2.1, 3.1, 81.83)),
    ]
    report = convert([write(tmp_path / "a.log", *lines)], tmp_path / "a.mcap")
    assert (report.format, report.scans, report.odometry, report.lines) == ("carmen", 2, 2, 5)
    log = read_log(tmp_path / "a.mcap")
    assert log.stamps.tolist() == [10_500_000_000, 11_250_000_000]
    assert log.laser.pose == (0.2, 0.0, 0.0)
    assert log.laser.range_max == pytest.approx(81.82)
    np.testing.assert_allclose(log.odometry, [[1.0, 0.0, 0.1], [1.5, 0.2, 0.3]], atol=1e-12)
    np.testing.assert_array_equal(log.ranges, np.array([[1, 2, np.nan, np.inf], [1.1, 2.1, 3.1, np.inf]], np.float32))
    assert log.ground_truth is not None
    np.testing.assert_allclose(log.ground_truth.poses, [[5, 6, 0.7]])
    assert log.metadata[PARAMS] == {"robot_frontlaser_offset": "0.2"}
    source = log.metadata[schema.SOURCE]
    assert json.loads(source["lines_by_type"]) == {"PARAM": 1, "ODOM": 1, "FLASER": 2, "TRUEPOS": 1}
    assert source["stamps_repaired"] == "0"


@pytest.mark.parametrize("pack", [gzip.compress, bz2.compress])
def test_packed_logs_are_known_by_their_content(tmp_path, pack):
    path = tmp_path / ("a.log.gz" if pack is gzip.compress else "a.clf")
    path.write_bytes(pack(f"# CARMEN Logfile\n{flaser('1')}\n{flaser('2')}\n".encode()))
    assert convert([path], tmp_path / "a.mcap").scans == 2


def test_a_cut_bzip2_file_is_one_line(tmp_path):
    path = tmp_path / "a.clf.bz2"
    path.write_bytes(bz2.compress(flaser("1").encode())[:-19])
    with pytest.raises(MclError, match="cut or damaged"):
        read_carmen(path)
    assert not is_carmen_text(path, path.read_bytes())


def test_other_text_is_no_carmen_log(tmp_path):
    for text in (b"O 1 2 3 4\n", b"robot_specifications->resolution 10\n", b"FLASERS\n", b""):
        assert not is_carmen_text(tmp_path, text)


def test_dropping_scans_is_a_kidnapping(tmp_path):
    lines = [flaser(f"{10 + k}", (float(k), 0.0, 0.5 * (k > 2))) for k in range(6)]
    report = convert([write(tmp_path / "a.log", *lines)], tmp_path / "a.mcap", drop=[(1.5, 3.5)])
    assert (report.scans, report.dropped) == (4, 2)
    log = read_log(tmp_path / "a.mcap")
    np.testing.assert_allclose(log.odometry[:3], [[0, 0, 0], [1, 0, 0], [1, 0, 0]], atol=1e-9)
    np.testing.assert_allclose(log.odometry[3], compose((1, 0, 0), (math.cos(0.5), -math.sin(0.5), 0)), atol=1e-9)
    assert json.loads(log.metadata[schema.SOURCE]["kidnapped_at"]) == [4.0]


def test_dropping_the_beginning_is_a_later_start(tmp_path):
    lines = [flaser(f"{10 + k}", (float(k), 0.0, 0.0)) for k in range(4)]
    convert([write(tmp_path / "a.log", *lines)], tmp_path / "a.mcap", drop=[(0, 1)])
    log = read_log(tmp_path / "a.mcap")
    assert log.odometry[:, 0].tolist() == [2, 3]
    assert "kidnapped_at" not in log.metadata[schema.SOURCE]


@pytest.mark.parametrize("drop", [(0.0, 99.0), (2.0, 1.0), (0.0, math.nan)])
def test_what_cannot_be_dropped_is_an_error(tmp_path, drop):
    with pytest.raises(MclError, match=r"nothing is left|begin <= end"):
        convert([write(tmp_path / "a.log", flaser("1"), flaser("2"))], tmp_path / "a.mcap", drop=[drop])


def test_a_laser_that_looks_back(tmp_path):
    behind = (-0.3, 0.0, math.pi)
    lines = [
        flaser(f"{k + 1}", (0.0, 0.0, 0.1 * k), laser=compose((0.0, 0.0, 0.1 * k), behind).tolist(), kind="RLASER")
        for k in range(5)
    ]
    convert([write(tmp_path / "a.log", *lines)], tmp_path / "a.mcap")
    x, y, yaw = read_log(tmp_path / "a.mcap").laser.pose
    assert (x, y, abs(yaw)) == (pytest.approx(-0.3), pytest.approx(0), pytest.approx(math.pi, abs=1e-3))


def test_a_log_of_corrected_poses_needs_a_param_for_the_laser(tmp_path):
    lines = [flaser("1", laser=(0.2, 0, 0)), flaser("2", laser=(0.5, 0, 0))]
    with pytest.raises(MclError, match="the laser moves on the robot, and no PARAM robot_frontlaser_offset"):
        convert([write(tmp_path / "a.log", *lines)], tmp_path / "a.mcap")
    convert([write(tmp_path / "b.log", "PARAM robot_frontlaser_offset 0.15 x 0", *lines)], tmp_path / "b.mcap")
    assert read_log(tmp_path / "b.mcap").laser.pose == pytest.approx((0.15, 0, 0))


def test_a_longest_reading_that_stands_out_means_no_return(tmp_path):
    often = [flaser(f"{k + 1}", ranges=(1.0 + k, 50.0, 50.0)) for k in range(6)]
    convert([write(tmp_path / "a.log", *often)], tmp_path / "a.mcap")
    assert np.isinf(read_log(tmp_path / "a.mcap").ranges[:, 1:]).all()
    seldom = [flaser(f"{k + 1}", ranges=(1.0 + k, 7.0, 6.5)) for k in range(3)]
    convert([write(tmp_path / "b.log", *seldom)], tmp_path / "b.mcap")
    assert read_log(tmp_path / "b.mcap").laser.range_max == 7.0


def test_the_longest_range_of_a_robotlaser_is_no_return(tmp_path):
    convert([write(tmp_path / "a.log", robotlaser("1", (3.0, 8.0)), robotlaser("2"))], tmp_path / "a.mcap")
    log = read_log(tmp_path / "a.mcap")
    assert log.ranges[0].tolist() == [3.0, math.inf]
    assert log.laser.pose == pytest.approx((0.2, 0, 0))


def test_carmen_logs_are_not_joined(tmp_path):
    path = write(tmp_path / "a.log", flaser("1"))
    with pytest.raises(MclError, match="cannot be joined"):
        convert([path, path], tmp_path / "a.mcap", join=True)


# --- real buildings


@pytest.mark.parametrize(
    ("name", "scans", "repaired", "offset"),
    [("aces", 7374, 0, 0.0), ("fr079", 4934, 0, -0.04), ("intel", 13631, 2042, 0.0)],
)
def test_raw_logs_of_real_buildings_agree_with_their_repaired_twins(
    shared_data, tmp_path, name, scans, repaired, offset
):
    """The twin's stamps were made increasing by others' code, and the truth of every scan is stamped alike."""
    folder = shared_data / "carmen" / name
    convert([folder / f"{name}.clf.bz2"], tmp_path / "raw.mcap")
    convert([folder / f"{name}.log.gz"], tmp_path / "twin.mcap", map_path=folder / "map.yaml")
    raw, twin = read_log(tmp_path / "raw.mcap"), read_log(tmp_path / "twin.mcap")
    assert len(raw) == len(twin) == scans
    assert raw.metadata[schema.SOURCE]["stamps_repaired"] == str(repaired)
    assert np.abs(raw.stamps - twin.stamps).max() < 1000  # ns
    np.testing.assert_array_equal(raw.ranges, twin.ranges)
    np.testing.assert_allclose(raw.odometry, twin.odometry, atol=1e-9)
    assert twin.laser.pose == (offset, 0.0, 0.0)
    assert twin.grid is not None
    assert 0.005 < np.isinf(twin.ranges).mean() < 0.03
