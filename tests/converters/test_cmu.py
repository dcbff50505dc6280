from __future__ import annotations

import gzip
import json
from pathlib import Path

import numpy as np
import pytest
from cmu_samples import logs, numbers, small_log, write_lines
from hypothesis import given, settings
from hypothesis import strategies as st

from converters import convert
from converters.beesoft import write_beesoft
from converters.cmu import JOIN_GAP, export_raw
from converters.cmu_text import CmuLog, write_log_text
from pipeline.errors import MclError
from pipeline.geometry import between
from pipeline.logs import schema
from pipeline.logs.decode import decode_odometry, decode_scans
from pipeline.logs.mcap_file import McapFile
from pipeline.logs.messages import Log, Trajectory
from pipeline.logs.reader import read_log
from pipeline.logs.tum import write_tum
from pipeline.logs.writer import write_log
from pipeline.maps.map_server import save_map
from pipeline.maps.occupancy_grid import OccupancyGrid

GRID = OccupancyGrid(np.array([[np.nan, 0.25], [1.0, 0.003]], dtype=np.float32), 0.1)


def converted(tmp_path: Path, log: CmuLog, **options: object) -> Log:
    convert([write_lines(tmp_path / "a.log", log)], tmp_path / "a.mcap", **options)  # type: ignore[arg-type]
    return read_log(tmp_path / "a.mcap")


def exported(mcap: Path) -> list[tuple[str, list[float]]]:
    export_raw(mcap, mcap.with_suffix(".log"))
    return numbers(mcap.with_suffix(".log").read_text())


def test_a_log_in_metres(tmp_path: Path) -> None:
    raw = small_log()
    log = converted(tmp_path, raw)
    np.testing.assert_array_equal(log.stamps, raw.stamps[raw.is_scan])
    np.testing.assert_allclose(log.odometry[:, :2], raw.poses[raw.is_scan, :2] / 100, atol=1e-12)
    np.testing.assert_allclose(between(log.odometry, raw.poses[raw.is_scan] / [100, 100, 1]), 0, atol=1e-12)
    assert np.isinf(log.ranges[:, 7]).all()
    measured = np.arange(180) != 7
    np.testing.assert_allclose(log.ranges[:, measured], raw.ranges[:, measured] / 100, rtol=1e-6)
    assert log.laser.pose == (0.25, 0.0, 0.0)
    np.testing.assert_allclose(log.laser.angles, np.radians(np.arange(180) - 90), atol=1e-5)
    assert log.grid is None
    assert log.metadata[schema.SOURCE]["scan_lines"] == "6"


@pytest.mark.parametrize("code", [8183.0, 8187.0, 8189.0, 8191.0])
def test_codes_of_no_return_keep_their_value_and_read_as_infinite(tmp_path: Path, code: float) -> None:
    raw = small_log()
    raw.ranges[0, 3] = code
    assert converted(tmp_path, raw).ranges[0, 3] == np.inf
    assert exported(tmp_path / "a.mcap")[1][1][6 + 3] == code


@settings(max_examples=30, deadline=None)
@given(logs(), st.floats(0, 1), st.floats(0, 1))
def test_every_number_comes_back(
    tmp_path_factory: pytest.TempPathFactory, log: CmuLog, start: float, length: float
) -> None:
    """With an interval dropped too: what is left comes back in the source's own odometry frame."""
    tmp_path = tmp_path_factory.mktemp("log")
    source = write_lines(tmp_path / "a.log", log)
    since = (log.stamps - log.stamps[0]) / 1e9
    convert([source], tmp_path / "whole.mcap")
    assert exported(tmp_path / "whole.mcap") == numbers(source.read_text())
    interval = (start * since[-1], (start + length) * since[-1])
    kept = (log.stamps - log.stamps[0] < round(interval[0] * 1e9)) | (
        log.stamps - log.stamps[0] > round(interval[1] * 1e9)
    )
    if (kept & log.is_scan).any():
        convert([source], tmp_path / "gap.mcap", drop=[interval])
        assert exported(tmp_path / "gap.mcap") == [
            line for line, keep in zip(numbers(source.read_text()), kept, strict=True) if keep
        ]


def test_numbers_that_the_messages_would_round_travel_verbatim(tmp_path: Path) -> None:
    odd = "O 1.23456789012 2e5 123.456789 0.42500000049999"
    source = write_lines(tmp_path / "a.log", small_log(), {5: odd})
    convert([source], tmp_path / "a.mcap")
    assert exported(tmp_path / "a.mcap") == numbers(source.read_text())


def test_a_map_comes_back_in_full_and_rounded(tmp_path: Path) -> None:
    write_beesoft(tmp_path / "m.dat.gz", GRID)
    log = converted(tmp_path, small_log(), map_path=tmp_path / "m.dat.gz")
    assert log.grid is not None
    np.testing.assert_array_equal(log.grid.occupancy, GRID.occupancy)
    export_raw(tmp_path / "a.mcap", tmp_path / "b.log", tmp_path / "b.dat")
    assert (tmp_path / "b.dat").read_bytes() == gzip.decompress((tmp_path / "m.dat.gz").read_bytes())


def test_a_map_with_more_digits_than_float32_travels_verbatim(tmp_path: Path) -> None:
    write_beesoft(tmp_path / "m.dat", GRID)
    text = (tmp_path / "m.dat").read_text().replace("0.750", "0.7500000001234")
    (tmp_path / "m.dat").write_text(text)
    converted(tmp_path, small_log(), map_path=tmp_path / "m.dat")
    export_raw(tmp_path / "a.mcap", tmp_path / "b.log", tmp_path / "b.dat")
    assert (tmp_path / "b.dat").read_text() == text


def test_a_map_server_map_travels_too(tmp_path: Path) -> None:
    trinary = OccupancyGrid(np.array([[np.nan, 0.0], [1.0, 0.0]], np.float32), 0.05, (1.0, -2.0, 0.5))
    save_map(trinary, tmp_path / "m.yaml")
    log = converted(tmp_path, small_log(), map_path=tmp_path / "m.yaml")
    assert log.grid is not None
    assert log.grid.sha256 == trinary.sha256
    with pytest.raises(MclError, match="no beesoft map"):
        export_raw(tmp_path / "a.mcap", tmp_path / "b.log", tmp_path / "b.dat")


def test_the_metadata_tell_where_it_came_from(tmp_path: Path) -> None:
    source = converted(tmp_path, small_log()).metadata[schema.SOURCE]
    assert source["format"] == "cmu"
    assert json.loads(source["files"]) == ["a.log"]
    assert json.loads(source["laser_pose"]) == [0.25, 0.0, 0.0]
    assert len(json.loads(source["sha256"])[0]) == 64
    assert (source["lines"], source["odometry_lines"], source["scan_lines"], source["dropped_lines"]) == (
        "12",
        "6",
        "6",
        "0",
    )


def test_a_log_that_does_not_say_where_the_laser_is(tmp_path: Path) -> None:
    raw = small_log()
    raw.laser_poses[:] = 0.0
    log = converted(tmp_path, raw)
    assert log.laser.pose == (0.25, 0.0, 0.0)
    assert "instructions" in log.metadata[schema.SOURCE]["laser_pose_from"]


def test_a_gap_is_a_kidnapping(tmp_path: Path) -> None:
    """Odometry does not notice what happened in the gap, and tells the truth before and after."""
    raw = small_log(40)
    whole = converted(tmp_path, raw)
    log = converted(tmp_path, raw, drop=[(1.0, 2.0)])
    keep = (raw.stamps - raw.stamps[0] < 1_000_000_000) | (raw.stamps - raw.stamps[0] > 2_000_000_000)
    np.testing.assert_array_equal(log.stamps, raw.stamps[raw.is_scan & keep])
    before = int((raw.stamps[raw.is_scan] - raw.stamps[0] < 1_000_000_000).sum())
    np.testing.assert_array_equal(log.odometry[:before], whole.odometry[:before])
    after = whole.odometry[-(len(log) - before) :]
    np.testing.assert_allclose(
        between(log.odometry[before:-1], log.odometry[before + 1 :]), between(after[:-1], after[1:]), atol=1e-9
    )
    # The first line after the gap stands where the last before it stood: here an O line and an L line.
    with McapFile(tmp_path / "a.mcap") as file:
        poses = decode_odometry(file.messages([schema.ODOMETRY])[schema.ODOMETRY])
    last = int(np.searchsorted(poses.stamps, raw.stamps[0] + 1_000_000_000)) - 1
    np.testing.assert_allclose(poses.planar[last + 1], poses.planar[last], atol=1e-9)
    assert log.metadata[schema.SOURCE]["dropped_lines"] == "11"
    assert json.loads(log.metadata[schema.SOURCE]["dropped_intervals_s"]) == [[1.0, 2.0]]
    after_gap = (raw.stamps[keep][last + 1] - log.stamps[0]) / 1e9
    assert json.loads(log.metadata[schema.SOURCE]["kidnapped_at"]) == [pytest.approx(after_gap)]


def test_a_gap_at_the_start_moves_nothing(tmp_path: Path) -> None:
    raw = small_log(20)
    whole, log = converted(tmp_path, raw), converted(tmp_path, raw, drop=[(0.0, 0.5)])
    np.testing.assert_array_equal(log.odometry, whole.odometry[-len(log) :])


def test_an_interval_without_lines_changes_nothing(tmp_path: Path) -> None:
    raw = small_log(20)
    np.testing.assert_array_equal(
        converted(tmp_path, raw, drop=[(0.51, 0.59)]).odometry, converted(tmp_path, raw).odometry
    )


@pytest.mark.parametrize("interval", [(2.0, 1.0), (float("nan"), 1.0), (0.0, float("inf"))])
def test_intervals_must_be_intervals(tmp_path: Path, interval: tuple[float, float]) -> None:
    with pytest.raises(MclError, match="begin <= end"):
        converted(tmp_path, small_log(), drop=[interval])


def test_dropping_everything(tmp_path: Path) -> None:
    with pytest.raises(MclError, match="nothing is left"):
        converted(tmp_path, small_log(), drop=[(0.0, 100.0)])


def test_joined_logs_go_on_and_come_apart_again(tmp_path: Path) -> None:
    raws = [small_log(10), small_log(8, start=0, seed=1), small_log(6, seed=2)]
    sources = [write_lines(tmp_path / f"{i}.log", raw) for i, raw in enumerate(raws)]
    report = convert(sources, tmp_path / "all.mcap", join=True)
    assert (report.lines, report.scans, report.odometry) == (24, 12, 24)
    log = read_log(tmp_path / "all.mcap")
    assert log.stamps[5] - raws[0].stamps[-1] == JOIN_GAP + raws[1].stamps[1] - raws[1].stamps[0]
    first = between(raws[1].poses[0] / [100, 100, 1], raws[1].poses[1] / [100, 100, 1])
    np.testing.assert_allclose(between(log.odometry[4], log.odometry[5]), first, atol=1e-9)
    written = export_raw(tmp_path / "all.mcap", tmp_path / "out.log")
    assert [path.name for path in written] == ["out.log", "out-2.log", "out-3.log"]
    for path, source in zip(written, sources, strict=True):
        assert numbers(path.read_text()) == numbers(source.read_text())


def test_ground_truth_travels_in_the_map_frame(tmp_path: Path) -> None:
    truth = Trajectory(np.array([25_863_001, 125_863_000]), np.array([[1.0, 2.0, 3.0], [1.5, 2.5, -3.1]]))
    write_tum(tmp_path / "truth.tum", truth)
    log = converted(tmp_path, small_log(), ground_truth=tmp_path / "truth.tum")
    assert log.ground_truth is not None
    assert log.ground_truth.frame == "map"
    np.testing.assert_array_equal(log.ground_truth.stamps, truth.stamps)
    np.testing.assert_allclose(log.ground_truth.poses, truth.poses, atol=1e-8)


def test_the_same_input_gives_the_same_bytes(tmp_path: Path) -> None:
    write_beesoft(tmp_path / "m.dat", GRID)
    converted(tmp_path, small_log(), map_path=tmp_path / "m.dat")
    first = (tmp_path / "a.mcap").read_bytes()
    converted(tmp_path, small_log(), map_path=tmp_path / "m.dat")
    assert (tmp_path / "a.mcap").read_bytes() == first


def test_what_was_there_survives_a_failure(tmp_path: Path) -> None:
    output = tmp_path / "a.mcap"
    output.write_bytes(b"precious")
    with pytest.raises(MclError):
        converted(tmp_path, small_log(), map_path=tmp_path / "missing.dat")
    assert output.read_bytes() == b"precious"
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.log", "a.mcap"]


def test_an_output_that_cannot_be_written(tmp_path: Path) -> None:
    (tmp_path / "taken").mkdir()
    (tmp_path / "file").write_text("")
    for output in (tmp_path / "taken", tmp_path / "file" / "a.mcap"):
        with pytest.raises(MclError, match="cannot be written"):
            convert([write_lines(tmp_path / "a.log", small_log())], output)
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a.log", "file", "taken"]


def test_inputs_of_the_wrong_kind(tmp_path: Path) -> None:
    write_beesoft(tmp_path / "m.dat", GRID)
    log = write_lines(tmp_path / "a.log", small_log())
    (tmp_path / "prose.txt").write_text("once upon a time")
    (tmp_path / "empty.log").write_text("")
    output = tmp_path / "a.mcap"
    with pytest.raises(MclError, match=r"beesoft map, not a log \(give it with --map\)"):
        convert([tmp_path / "m.dat"], output)
    with pytest.raises(MclError, match="this is a log, not a map"):
        convert([log], output, map_path=log)
    with pytest.raises(MclError, match="no known format, beginning 'once upon a time'"):
        convert([tmp_path / "prose.txt"], output)
    with pytest.raises(MclError, match="empty"):
        convert([tmp_path / "empty.log"], output)
    with pytest.raises(MclError, match="no such file"):
        convert([tmp_path / "missing.log"], output)
    with pytest.raises(MclError, match="--join"):
        convert([log, log], output)
    with pytest.raises(MclError, match="no log"):
        convert([], output)
    assert not output.exists()


def test_only_what_came_from_text_goes_back_to_text(tmp_path: Path) -> None:
    with McapFile(converted(tmp_path, small_log()).path) as file:
        messages = file.messages([schema.SCAN, schema.ODOMETRY])
    scans, odometry = decode_scans(messages[schema.SCAN]), decode_odometry(messages[schema.ODOMETRY])
    write_log(tmp_path / "other.mcap", scans, odometry, (0.0, 0.0, 0.0))
    with pytest.raises(MclError, match="not made from a CMU"):
        export_raw(tmp_path / "other.mcap", tmp_path / "b.log")


@pytest.mark.parametrize("number", [1, 2, 4])
def test_the_real_logs_come_back_byte_for_byte(shared_data: Path, tmp_path: Path, number: int) -> None:
    source, drawn = shared_data / "cmu" / f"robotdata{number}.log.gz", shared_data / "cmu" / "wean.dat.gz"
    report = convert([source], tmp_path / "a.mcap", map_path=drawn)
    assert (report.lines, report.scans) == {1: (2218, 713), 2: (5377, 2251), 4: (1423, 600)}[number]
    export_raw(tmp_path / "a.mcap", tmp_path / "a.log", tmp_path / "a.dat")
    assert (tmp_path / "a.log").read_bytes() == gzip.decompress(source.read_bytes())
    assert (tmp_path / "a.dat").read_bytes() == gzip.decompress(drawn.read_bytes())


def test_a_real_log_with_a_gap_comes_back(shared_data: Path, tmp_path: Path) -> None:
    source = shared_data / "cmu" / "robotdata2.log.gz"
    convert([source], tmp_path / "a.mcap", drop=[(50.0, 90.0), (120.0, 140.0)])
    whole = numbers(gzip.decompress(source.read_bytes()).decode())
    start = whole[0][1][-1]
    expected = [(k, v) for k, v in whole if not (50 <= v[-1] - start <= 90 or 120 <= v[-1] - start <= 140)]
    assert exported(tmp_path / "a.mcap") == expected


def test_the_simulator_writes_what_converts(tmp_path: Path) -> None:
    write_log_text(tmp_path / "sim.log.gz", small_log())
    assert convert([tmp_path / "sim.log.gz"], tmp_path / "sim.mcap").scans == 6
