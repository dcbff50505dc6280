"""Text logs as students and old robots leave them: concatenated, jittery, commented, cut, with raw lasers."""

from __future__ import annotations

import bz2
import gzip
import json
from pathlib import Path

import numpy as np
import pytest
from cmu_samples import small_log, write_lines
from drives import moments

from converters import convert, text
from converters.carmen_text import parse_carmen
from converters.cmu import JOIN_GAP, export_raw
from converters.cmu_text import format_lines, read_log_text
from pipeline.errors import MclError
from pipeline.logs.mcap_file import McapFile
from pipeline.logs.messages import Log
from pipeline.logs.reader import read_log
from pipeline.logs.recorded import Names
from pipeline.logs.stretches import GAP

SECOND = 1_000_000_000


def converted(path: Path, tmp_path: Path, **names: object) -> tuple[Log, str]:
    report = convert([path], tmp_path / "out.mcap", names=Names(**names))  # type: ignore[arg-type]
    return read_log(tmp_path / "out.mcap"), " ".join(report.remarks)


# --- the course's logs


def two(tmp_path: Path) -> tuple[Path, Path, Path]:
    """Two logs, and both in one file: cat log1 log2."""
    one = write_lines(tmp_path / "one.log", small_log(120))
    other = write_lines(tmp_path / "other.log", small_log(140, seed=1))
    both = tmp_path / "both.log"
    both.write_bytes(one.read_bytes() + other.read_bytes())
    return one, other, both


def test_two_logs_in_one_file_are_as_if_joined(tmp_path: Path) -> None:
    one, other, both = two(tmp_path)
    log, said = converted(both, tmp_path)
    assert "the clock begins anew at line 121" in said
    convert([one, other], tmp_path / "joined.mcap", join=True)
    joined = read_log(tmp_path / "joined.mcap")
    shift = np.where(np.arange(130) < 60, 0, GAP - JOIN_GAP)  # nobody asked for this one: it is to be seen as a gap
    np.testing.assert_array_equal(log.stamps, joined.stamps + shift)
    np.testing.assert_array_equal(log.odometry, joined.odometry)
    np.testing.assert_array_equal(log.ranges, joined.ranges)
    assert log.stretches is not None
    assert np.bincount(log.stretches).tolist() == [60, 70]
    (at,), (after,) = (json.loads(each.metadata["mcl:source"]["kidnapped_at"]) for each in (log, joined))
    assert at == pytest.approx(after + 9.0)


def test_two_logs_in_one_file_come_back_as_one_file(tmp_path: Path) -> None:
    _, _, both = two(tmp_path)
    converted(both, tmp_path)
    (written,) = export_raw(tmp_path / "out.mcap", tmp_path / "again.log")
    assert written.read_text().split() == both.read_text().split()


def test_stamps_that_run_back_a_little_give_way(tmp_path: Path) -> None:
    lines = format_lines(small_log(120))
    lines[50], lines[51] = lines[51], lines[50]
    (tmp_path / "a.log").write_text("\n".join(lines) + "\n")
    log = read_log_text(tmp_path / "a.log")
    assert (np.diff(log.stamps) >= 0).all()
    assert np.abs(log.stamps - np.sort(small_log(120).stamps)).max() <= SECOND // 10
    assert log.restarts == ()
    assert "stamps ran backwards" in log.remarks[0]
    converted(tmp_path / "a.log", tmp_path)
    (written,) = export_raw(tmp_path / "out.mcap", tmp_path / "again.log")
    assert written.read_text().split() == (tmp_path / "a.log").read_text().split()


def test_comments_are_skipped(tmp_path: Path) -> None:
    lines = format_lines(small_log(20))
    (tmp_path / "a.log").write_text(
        "# my log\n" + "\n".join(lines[:10]) + "\n\n# pause\n" + "\n".join(lines[10:]) + "\n"
    )
    log = read_log_text(tmp_path / "a.log")
    assert (len(log), log.remarks, log.lines[0], log.lines[10]) == (20, (), 2, 14)


@pytest.mark.parametrize(
    "wrong", ["L 1 2 3", "O 1 nan 3 4", "O 1e256 2 3 4", "what is this", "O 1 2 3 -4", "O 1 2 1e9 4"]
)
def test_a_bad_line_is_left_out_and_told_and_many_are_refused(tmp_path: Path, wrong: str) -> None:
    path = write_lines(tmp_path / "a.log", small_log(400), {100: wrong})
    log = read_log_text(path)
    assert len(log) == 399
    assert log.remarks[0].startswith("1 of 400 lines left out: line 100: ")
    path = write_lines(tmp_path / "b.log", small_log(400), dict.fromkeys(range(100, 105), wrong))
    with pytest.raises(MclError) as caught:
        read_log_text(path)
    assert caught.value.line == 100


def test_a_stamp_from_nowhere(tmp_path: Path) -> None:
    stray = format_lines(small_log(400))[99].rsplit(" ", 1)[0] + " 1700000000.0"
    log = read_log_text(write_lines(tmp_path / "a.log", small_log(400), {100: stray}))
    assert (len(log), log.restarts) == (399, ())
    assert "their stamps are far from those around: line 100" in log.remarks[0]


# --- CARMEN


def carmen(
    kind: str = "FLASER",
    params: tuple[str, ...] = (),
    beams: int = 180,
    fewer: tuple[int, ...] = (),
    odometry: bool = True,
) -> list[str]:
    """The drive through the office, one line of odometry before every scan."""
    lines = [f"PARAM {param} host 0.0" for param in params]
    for i, moment in enumerate(moments()):
        x, y, yaw = moment.pose
        seconds = moment.stamp / SECOND
        tail = f"{seconds:.6f} host {seconds:.6f}"
        if odometry:
            lines.append(f"ODOM {x:.6f} {y:.6f} {yaw:.6f} 0 0 0 {tail}")
        ranges = np.minimum([*moment.ranges, 1.0], 81.91)[: beams - (i in fewer)]
        readings = " ".join(f"{r:.2f}" for r in ranges)
        if kind == "FLASER":
            pose = f"{x + 0.25 * np.cos(yaw):.6f} {y + 0.25 * np.sin(yaw):.6f} {yaw:.6f} {x:.6f} {y:.6f} {yaw:.6f}"
            lines.append(f"FLASER {len(ranges)} {readings} {pose} {tail}")
        elif kind.startswith("RAW"):
            lines.append(f"{kind} 0 -1.570796 3.124139 0.017453 81.90 0.01 0 {len(ranges)} {readings} 0 {tail}")
        else:
            lines.append(f"{kind} {len(ranges)} {readings} {tail}")
    return lines


def write(path: Path, lines: list[str]) -> Path:
    path.write_text("\n".join(lines) + "\n")
    return path


@pytest.mark.parametrize("kind", ["RAWLASER1", "RAWLASER2", "RAWLASER4", "LASER3", "LASER5"])
def test_raw_scans_are_where_the_odometry_has_the_robot(tmp_path: Path, kind: str) -> None:
    log, said = converted(write(tmp_path / "a.log", carmen(kind)), tmp_path, laser_pose=(0.25, 0.0, 0.0))
    beside, _ = converted(write(tmp_path / "b.log", carmen()), tmp_path)
    assert said == ""
    assert log.laser.pose == beside.laser.pose == (0.25, 0.0, 0.0)
    np.testing.assert_allclose(log.odometry, beside.odometry, atol=1e-9)
    np.testing.assert_array_equal(log.ranges, beside.ranges)


@pytest.mark.parametrize(
    ("kind", "params", "pose"),
    [
        ("RAWLASER1", ("robot_frontlaser_offset 0.3",), (0.3, 0.0, 0.0)),
        ("RAWLASER1", ("robot_frontlaser_offset 0.3", "robot_frontlaser_side_offset -0.1"), (0.3, -0.1, 0.0)),
        ("RAWLASER1", ("robot_frontlaser_offset 0.3", "robot_frontlaser_angular_offset 0.5"), (0.3, 0.0, 0.5)),
        ("RAWLASER2", ("robot_rearlaser_offset -0.3",), (-0.3, 0.0, np.pi)),
        ("RAWLASER1", (), (0.0, 0.0, 0.0)),
        ("RAWLASER1", ("robot_frontlaser_offset nan",), (0.0, 0.0, 0.0)),
    ],
)
def test_the_mount_of_a_raw_laser_is_what_params_say(
    tmp_path: Path, kind: str, params: tuple[str, ...], pose: tuple[float, float, float]
) -> None:
    log, said = converted(write(tmp_path / "a.log", carmen(kind, params)), tmp_path)
    assert log.laser.pose == pytest.approx(pose)
    assert ("--laser-pose says where it is" in said) == (pose == (0.0, 0.0, 0.0))


def test_raw_scans_without_odometry(tmp_path: Path) -> None:
    log, said = converted(write(tmp_path / "a.log", carmen("RAWLASER1", odometry=False)), tmp_path)
    assert (len(log), log.wheels) == (60, False)
    assert "no ODOM lines: the laser alone tells the motion" in said


def test_scans_of_two_sizes_come_onto_the_same_angles(tmp_path: Path) -> None:
    log, said = converted(write(tmp_path / "a.log", carmen(beams=181, fewer=(3, 50))), tmp_path)
    whole, _ = converted(write(tmp_path / "b.log", carmen(beams=181)), tmp_path)
    assert "2 of 60 scans have other beams than the rest" in said
    assert log.laser.beams == 181
    assert np.isnan(log.ranges[[3, 50], 180]).all()
    log.ranges[[3, 50], 180] = whole.ranges[[3, 50], 180]
    np.testing.assert_array_equal(log.ranges, whole.ranges)


@pytest.mark.parametrize("kind", ["FLASER", "RAWLASER1"])
def test_a_carmen_log_whose_clock_begins_anew(tmp_path: Path, kind: str) -> None:
    once = carmen(kind)
    log, said = converted(write(tmp_path / "a.log", [*once, *once]), tmp_path)
    single, _ = converted(write(tmp_path / "b.log", once), tmp_path)
    assert "the clock begins anew at line 122" in said
    assert log.stretches is not None
    assert np.bincount(log.stretches).tolist() == [60, 60]
    for part in (slice(0, 60), slice(60, 120)):
        np.testing.assert_array_equal(np.diff(log.stamps[part]), np.diff(single.stamps))
        np.testing.assert_array_equal(log.ranges[part], single.ranges)
    np.testing.assert_allclose(log.odometry[60], log.odometry[59], atol=1e-9)
    with McapFile(tmp_path / "out.mcap") as file:
        segments = [json.loads(text) for text in file.metadata()["mcl:segments"].values()]
    assert [segment["stamp_shift"] > 0 for segment in segments] in ([False, True], [False])


def test_a_bad_line_among_many(tmp_path: Path) -> None:
    lines = carmen()
    lines[61] = lines[61][:200]
    log = parse_carmen(("\n".join(lines) + "\n").encode(), tmp_path)
    assert len(log) == 59
    assert log.remarks[0].startswith("1 of 120 lines left out: line 62: FLASER: ")


def test_a_log_that_was_cut_in_its_last_line(tmp_path: Path) -> None:
    text = "\n".join(carmen())
    log = parse_carmen(text[:-300].encode(), tmp_path)
    assert len(log) == 59
    assert log.remarks == ("the last line, 120, is cut: left out",)


def test_a_packed_log_that_was_cut(tmp_path: Path) -> None:
    lines = carmen()
    packed = bz2.compress(("\n".join(lines * 20) + "\n").encode(), 1)
    (tmp_path / "a.clf.bz2").write_bytes(packed[: len(packed) * 3 // 4])
    log, said = converted(tmp_path / "a.clf.bz2", tmp_path)
    assert 60 < len(log) < 1200
    assert "this bzip2 file is cut or damaged: read as far as it goes" in said


def test_a_small_file_that_unpacks_to_more_than_any_log_is_refused(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(text, "MOST", 10_000)
    for name, pack in (("a.log.gz", gzip.compress), ("a.log.bz2", bz2.compress)):
        (tmp_path / name).write_bytes(pack(b"O 0 0 0 0.0\n" * 1000))
        with pytest.raises(MclError, match="unpacks to more than"):
            text.read_log_bytes(tmp_path / name)
    with pytest.raises(MclError, match="unpacks to more than"):
        text.read_bytes(tmp_path / "a.log.gz")
