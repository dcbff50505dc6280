"""Logs that are converted without the odometry that they have, and what a bag's IMU and beam times become."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from cmu_samples import small_log, write_lines
from typer.testing import CliRunner

from converters import convert
from converters.cmu import export_raw
from converters.report import ConversionReport
from pipeline.cli import app
from pipeline.errors import MclError
from pipeline.logs import schema
from pipeline.logs.mcap_file import McapFile
from pipeline.logs.messages import Log
from pipeline.logs.reader import read_log
from pipeline.simulate import sample_dir
from recordings import UPRIGHT, UPSIDE_DOWN, Recording, ordinary, yaw

SECOND = 1_000_000_000
CARMEN = "\n".join(f"FLASER 4 1 2 3 {4 + i} {0.2 + 0.1 * i} 0 0 {0.1 * i} 0 0 {100 + i}.5 host 0.5" for i in range(20))
ODOMETRY_TOPICS = {schema.ODOMETRY, schema.TF, schema.LASER_POSE, schema.VIEW_PATH}


def both(source: Path, tmp_path: Path, **options: object) -> tuple[Log, Log, ConversionReport]:
    """The log with its odometry and without it, and the report of the latter; nothing in the file tells of it."""
    convert([source], tmp_path / "with.mcap", **options)  # type: ignore[arg-type]
    report = convert([source], tmp_path / "bare.mcap", without_odometry=True, **options)  # type: ignore[arg-type]
    with McapFile(tmp_path / "bare.mcap") as file:
        assert not ODOMETRY_TOPICS & set(file.topics)
    return read_log(tmp_path / "with.mcap"), read_log(tmp_path / "bare.mcap"), report


def same_scans(bare: Log, whole: Log) -> None:
    np.testing.assert_array_equal(bare.stamps, whole.stamps)
    np.testing.assert_array_equal(bare.ranges, whole.ranges)
    assert bare.laser == whole.laser
    assert (bare.wheels, whole.wheels, bare.odometry.any(), bare.sweeps) == (False, True, False, None)


def test_a_course_log(tmp_path: Path) -> None:
    sample = sample_dir()
    options = {"map_path": sample / "office.dat.gz", "ground_truth": sample / "office_truth.tum"}
    whole, bare, report = both(sample / "office.log.gz", tmp_path, **options)
    same_scans(bare, whole)
    assert (report.odometry, report.scans) == (0, len(whole))
    assert bare.grid is not None
    assert whole.grid is not None
    assert bare.grid.sha256 == whole.grid.sha256
    assert bare.ground_truth is not None
    assert whole.ground_truth is not None
    np.testing.assert_array_equal(bare.ground_truth.poses, whole.ground_truth.poses)


@pytest.mark.parametrize("drop", [(), [(1.0, 2.0)], [(0.0, 0.5), (3.0, 3.2)]])
def test_what_is_dropped_from_a_course_log_is_a_kidnapping_all_the_same(tmp_path: Path, drop: object) -> None:
    whole, bare, _ = both(write_lines(tmp_path / "a.log", small_log(40)), tmp_path, drop=drop)
    same_scans(bare, whole)
    for key in ("kidnapped_at", "dropped_lines"):
        assert bare.metadata[schema.SOURCE].get(key) == whole.metadata[schema.SOURCE].get(key)


def test_joined_course_logs(tmp_path: Path) -> None:
    sources = [write_lines(tmp_path / f"{i}.log", small_log(10, seed=i)) for i in range(2)]
    for name, without in (("with", False), ("bare", True)):
        convert(sources, tmp_path / f"{name}.mcap", join=True, without_odometry=without)
    bare = read_log(tmp_path / "bare.mcap")
    same_scans(bare, read_log(tmp_path / "with.mcap"))
    assert len(json.loads(bare.metadata[schema.SOURCE]["kidnapped_at"])) == 1


def test_there_is_no_raw_log_to_give_back(tmp_path: Path) -> None:
    convert([write_lines(tmp_path / "a.log", small_log())], tmp_path / "a.mcap", without_odometry=True)
    with pytest.raises(MclError, match=r"a\.mcap: made without odometry: there is no raw log to give back"):
        export_raw(tmp_path / "a.mcap", tmp_path / "b.log")
    done = CliRunner().invoke(app, ["export", str(tmp_path / "a.mcap"), "--raw", str(tmp_path / "raw")])
    assert done.exit_code == 1
    assert done.stderr.count("\n") == 1


def test_a_carmen_log(tmp_path: Path) -> None:
    (tmp_path / "a.clf").write_text(CARMEN + "\n")
    whole, bare, report = both(tmp_path / "a.clf", tmp_path, drop=[(5.0, 8.0)])
    same_scans(bare, whole)
    assert (report.odometry, len(bare)) == (0, 16)
    assert bare.metadata[schema.SOURCE]["kidnapped_at"] == whole.metadata[schema.SOURCE]["kidnapped_at"]


def test_a_bag(tmp_path: Path) -> None:
    source = ordinary().write(tmp_path / "theirs.mcap")
    whole, bare, report = both(source, tmp_path)
    same_scans(bare, whole)
    assert (report.odometry, report.lines, report.dropped) == (0, 31, 0)
    assert whole.laser.time_increment == 0.001
    assert whole.sweeps is not None
    np.testing.assert_allclose(whole.sweeps, read_log(source).sweeps, atol=1e-12)


def test_a_bag_that_never_had_odometry(tmp_path: Path) -> None:
    recording = ordinary()
    recording.entries = [entry for entry in recording.entries if "Odometry" not in entry[1]]
    source = recording.write(tmp_path / "theirs.mcap")
    report = convert([source], tmp_path / "a.mcap", drop=[(0.35, 0.65)])
    log = read_log(tmp_path / "a.mcap")
    assert (log.wheels, report.odometry, report.scans, report.dropped) == (False, 0, 7, 3)
    np.testing.assert_allclose(log.laser.pose, read_log(source).laser.pose, atol=1e-12)
    assert json.loads(log.metadata[schema.SOURCE]["kidnapped_at"]) == [pytest.approx(0.7)]


@pytest.mark.parametrize("mount", [UPRIGHT, UPSIDE_DOWN, yaw(1.0)])
@pytest.mark.parametrize("without", [False, True])
def test_a_bags_gyroscope_and_beam_times_travel_along(tmp_path: Path, mount, without: bool) -> None:
    recording = Recording()
    recording.transforms(("base", "laser", (0.2, 0.0, 0.3), UPSIDE_DOWN), ("base", "imu_link", (0.0, 0.0, 0.1), mount))
    for i in range(301):
        recording.odometry(i * SECOND // 100, 0.004 * i, 0.0, 0.01 * i, frames=("odom", "base"))
        recording.imu(i * SECOND // 100, (0.1, 0.2, 0.9 + 0.1 * np.sin(i)))
    for i in range(14):
        recording.scan(i * SECOND // 5, [1.0] * 101, frame="laser")
    source = recording.write(tmp_path / "theirs.mcap")
    theirs = read_log(source)
    convert([source], tmp_path / "ours.mcap", without_odometry=without)
    ours = read_log(tmp_path / "ours.mcap")
    assert ours.laser.time_increment == theirs.laser.time_increment == -0.001
    np.testing.assert_allclose(ours.turns, theirs.turns, atol=1e-12)  # type: ignore[arg-type]
    if not without:
        np.testing.assert_allclose(ours.sweeps, theirs.sweeps, atol=1e-12)  # type: ignore[arg-type]


def test_the_gyroscopes_rates_are_dropped_with_the_scans(tmp_path: Path) -> None:
    recording = Recording()
    for i in range(501):
        recording.odometry(i * SECOND // 100, 0.0, 0.0, 0.01 * i, frames=("odom", "laser"))
        recording.imu(i * SECOND // 100, (0.0, 0.0, 1.0), frame="laser")
    for i in range(25):
        recording.scan(i * SECOND // 5, [1.0] * 101, frame="laser")
    convert([recording.write(tmp_path / "theirs.mcap")], tmp_path / "ours.mcap", drop=[(2.0, 3.0)])
    log = read_log(tmp_path / "ours.mcap")
    assert log.turns is not None
    assert log.times[np.isnan(log.turns)].tolist() == [pytest.approx(3.2)]


def test_on_the_command_line(tmp_path: Path) -> None:
    source = ordinary().write(tmp_path / "theirs.mcap")
    words = ["convert", str(source), "-o", str(tmp_path / "a.mcap"), "--without-odometry"]
    done = CliRunner().invoke(app, words)
    assert done.exit_code == 0
    assert "odometry  none\n" in done.stderr
    assert not read_log(tmp_path / "a.mcap").wheels
    refused = CliRunner().invoke(app, ["convert", str(source), "-o", str(tmp_path / "a.yaml"), "--without-odometry"])
    assert refused.exit_code == 2
