"""A log as a recording: what is in it, and what becomes of it on the command line."""

from dataclasses import replace

import numpy as np
import pyarrow as pa
import pytest
from synthetic import drive
from typer.testing import CliRunner

from converters import convert
from pipeline.cli import app
from pipeline.geometry import between, compose
from pipeline.recording.columns import DISPLAY_STEP
from pipeline.recording.documents import log_explanation
from pipeline.recording.raw_log import write_raw_log
from pipeline.recording.rrd_file import read_rrd
from pipeline.recording.truth import truth_at_scans
from pipeline.simulate import sample_dir


@pytest.fixture
def recorded(tmp_path):
    """The entities of a log's recording, and its columns: a list per scan."""

    def write(log, name="log.rrd"):
        path = tmp_path / name
        write_raw_log(path, log)
        chunks = read_rrd(path).chunks

        def column(entity, component):
            batches = [c.to_record_batch() for c in chunks if c.entity_path == entity and not c.is_static]
            return pa.Table.from_batches([b for b in batches if component in b.schema.names])[component].to_pylist()

        return {chunk.entity_path for chunk in chunks}, column

    return write


def test_every_scan_is_drawn_where_the_odometry_has_it_and_where_it_was(recorded):
    log = drive(120)
    ranges = log.ranges.copy()
    ranges[7, :100], ranges[7, 100:] = np.nan, np.inf
    log = replace(log, ranges=ranges)
    _, column = recorded(log)
    x, y, _ = log.laser.pose
    ends = np.column_stack([np.cos(log.laser.angles), np.sin(log.laser.angles)]) * ranges[3][:, None] + [x, y]
    for robot, poses in (("/odometry/robot", log.odometry), ("/world/truth", log.ground_truth.poses)):
        places = np.array(column(robot, "Transform3D:translation"))[:, 0, :2]
        assert np.allclose(places, poses[:, :2], atol=DISPLAY_STEP)
        drawn = column(f"{robot}/scan", "Points3D:positions")
        assert [len(points) for points in drawn] == [180 * (i != 7) for i in range(120)]
        assert np.allclose(np.array(drawn[3])[:, :2], ends, atol=DISPLAY_STEP)


def test_a_path_by_the_wheels_goes_on_where_they_were_restarted(recorded):
    log = drive(120)
    odometry = log.odometry.copy()
    odometry[60:] = between(odometry[60], odometry[60:])
    _, column = recorded(replace(log, odometry=odometry))
    places = np.array(column("/odometry/robot", "Transform3D:translation"))[:, 0, :2]
    assert np.allclose(places[:60], log.odometry[:60, :2], atol=DISPLAY_STEP)
    standing = between(log.odometry[60], log.odometry[60:])
    assert np.allclose(places[60:], compose(log.odometry[59], standing)[:, :2], atol=DISPLAY_STEP)


def test_what_a_log_lacks_is_left_out(recorded):
    entities, _ = recorded(replace(drive(5, truth=False), grid=None))
    assert "/odometry/robot/scan" in entities
    assert not any(entity.startswith("/world") for entity in entities)


def test_without_odometry_the_robot_stands_still_and_has_no_path(recorded):
    log = drive(12)
    log = replace(log, odometry=np.zeros((12, 3)), wheels=False)
    entities, column = recorded(log)
    assert {"/odometry/robot/scan", "/world/map", "/world/truth/scan", "/world/truth_path"} <= entities
    assert "/odometry/path" not in entities
    assert not np.array(column("/odometry/robot", "Transform3D:translation"))[:, 0, :2].any()
    assert [len(points) for points in column("/odometry/robot/scan", "Points3D:positions")] == [180] * 12


def test_without_odometry_the_true_path_leaps_where_no_robot_drives(recorded):
    log = drive(12)
    truth = log.ground_truth.poses.copy()
    truth[:, :2] = np.column_stack([0.4 * np.arange(12), np.zeros(12)])  # 2 m/s
    truth[6:, 0] += 4.0
    log = replace(log, odometry=np.zeros((12, 3)), wheels=False, ground_truth=replace(log.ground_truth, poses=truth))
    assert truth_at_scans(log)[2].tolist() == [False, *[True] * 5, False, *[True] * 5]


def test_what_is_drawn_is_explained(recorded):
    entities, _ = recorded(drive(5))
    assert "/about/explanation" in entities
    assert "blue dots" in log_explanation(grid=False, truth=False)
    assert "truth" in log_explanation(grid=True, truth=True)
    assert "truth" not in log_explanation(grid=True, truth=False)
    assert "walls" not in log_explanation(grid=False, truth=False)
    assert "path" not in log_explanation(grid=True, truth=False, wheels=False)
    assert "blue dots" in log_explanation(grid=False, truth=False, wheels=False)


def test_a_log_is_viewed_alone(office, tmp_path, listening):
    _, address = listening
    viewed = CliRunner().invoke(app, ["view", str(office.path), "--connect", address])
    assert viewed.exit_code == 0
    both = CliRunner().invoke(app, ["view", str(office.path), str(office.path), "--connect", address])
    assert both.exit_code == 1
    assert "a log is viewed alone" in both.stderr


def test_a_log_without_odometry_is_viewed(tmp_path, monkeypatch):
    sample, path, shown = sample_dir(), tmp_path / "office.mcap", []
    convert([sample / "office.log.gz"], path, map_path=sample / "office.dat.gz", without_odometry=True)
    monkeypatch.setattr("pipeline.recording.viewer.show", lambda file: shown.append(read_rrd(file)))
    assert CliRunner().invoke(app, ["view", str(path)]).exit_code == 0
    entities = {chunk.entity_path for chunk in shown.pop().chunks}
    assert {"/odometry/robot/scan", "/world/map"} <= entities
    assert "/odometry/path" not in entities


def test_a_log_without_a_map_can_be_given_one(tmp_path, monkeypatch):
    """A run has its own."""
    sample, path, shown = sample_dir(), tmp_path / "office.mcap", []
    convert([sample / "office.log.gz"], path)
    monkeypatch.setattr("pipeline.recording.viewer.show", lambda file: shown.append(read_rrd(file)))
    for words, drawn in (((), False), (("--map", str(sample / "office.dat.gz")), True)):
        assert CliRunner().invoke(app, ["view", str(path), *words]).exit_code == 0
        assert any(chunk.entity_path == "/world/map" for chunk in shown.pop().chunks) == drawn
    (tmp_path / "run").mkdir()
    (tmp_path / "run" / "run.rrd").touch()
    refused = CliRunner().invoke(app, ["view", str(tmp_path / "run"), "--map", str(sample / "office.dat.gz")])
    assert refused.exit_code == 2


def test_the_way_by_the_laser_is_beside_that_by_the_wheels(recorded):
    log = drive(40)
    found, column = recorded(log)
    assert "/odometry/laser_robot" in found
    places = np.array(column("/odometry/laser_robot", "Transform3D:translation"))[:, 0, :2]
    assert np.allclose(places[0], log.odometry[0, :2], atol=DISPLAY_STEP)
    still, _ = recorded(replace(log, wheels=False), "still.rrd")
    assert not any(entity.startswith("/odometry/laser") for entity in still)
