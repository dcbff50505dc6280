from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest
from cmu_samples import logs, small_log, write_lines
from hypothesis import given

from converters.cmu_text import CmuLog, format_lines, parse_log_text, read_log_text, write_log_text
from pipeline.errors import MclError


def assert_equal(a: CmuLog, b: CmuLog) -> None:
    for name in ("lines", "is_scan", "stamps", "poses", "laser_poses", "ranges"):
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name), err_msg=name)


@given(logs())
def test_text_gives_the_numbers_back(log: CmuLog) -> None:
    text = "".join(f"{line}\n" for line in format_lines(log))
    assert_equal(parse_log_text(text.encode(), Path("a.log")), log)


@pytest.mark.parametrize("name", ["a.log", "a.log.gz"])
def test_files_plain_and_gzipped(tmp_path: Path, name: str) -> None:
    write_log_text(tmp_path / name, small_log())
    assert_equal(read_log_text(tmp_path / name), small_log())


def test_gzip_is_known_by_its_content(tmp_path: Path) -> None:
    path = write_lines(tmp_path / "a.log", small_log())
    path.write_bytes(gzip.compress(path.read_bytes()))
    assert len(read_log_text(path)) == 12


def test_stamps_are_exact(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    write_lines(
        path, small_log(2), {1: "O 1 2 3 134.998162", 2: format_lines(small_log(2))[1].rsplit(" ", 1)[0] + " 1e3"}
    )
    assert read_log_text(path).stamps.tolist() == [134_998_162_000, 1_000_000_000_000]


def test_blank_lines_count_as_lines_but_hold_nothing(tmp_path: Path) -> None:
    path = tmp_path / "a.log"
    path.write_text("\n" + "\r\n".join(format_lines(small_log(2))) + "\r\n\n")
    assert read_log_text(path).lines.tolist() == [2, 3]


O_LINE, L_LINE = format_lines(small_log(2))
BAD_LINES = {
    "a line cut in the middle": (L_LINE[:400], "this one has"),
    "179 ranges": (" ".join(L_LINE.split()[:7] + L_LINE.split()[8:]), "this one has 186 (179 ranges)"),
    "181 ranges": (L_LINE.replace(" 8191 ", " 8191 8191 ", 1), "this one has 188 (181 ranges)"),
    "letters for a pose": ("O 1.0 two 3.0 4.0", "'two' is not a number"),
    "letters for a range": (L_LINE.replace(" 8191 ", " 81g1 ", 1), "'81g1' is not a number"),
    "letters for a stamp": ("O 1.0 2.0 3.0 later", "'later' is not a number"),
    "NaN": ("O 1.0 nan 3.0 4.0", "NaN or an infinite number"),
    "infinity": ("O 1.0 inf 3.0 4.0", "NaN or an infinite number"),
    "a stamp of NaN": ("O 1.0 2.0 3.0 nan", "'nan' is not a number"),
    "a negative stamp": ("O 1.0 2.0 3.0 -4.0", "out of bounds"),
    "an endless stamp": ("O 1.0 2.0 3.0 4e12", "out of bounds"),
    "an unknown line type": ("P 1.0 2.0 3.0 4.0", "unknown line type 'P', expected O or L"),
    "a line of the map": ("global_map[0]: 800 800", "this is a beesoft map"),
    "an O line too long": ("O 1.0 2.0 3.0 4.0 5.0", "an O line has 4 numbers"),
    "more than a robot measures": ("O 1e256 2.0 3.0 0.4", "a number that no robot measures"),
}


@pytest.mark.parametrize("case", BAD_LINES)
def test_bad_lines_are_named(tmp_path: Path, case: str) -> None:
    text, said = BAD_LINES[case]
    path = write_lines(tmp_path / "bad.log", small_log(), {5: text})
    with pytest.raises(MclError) as caught:
        read_log_text(path)
    assert caught.value.line == 5
    assert str(caught.value).startswith(f"{path}:5: ")
    assert said in str(caught.value)
    assert "\n" not in str(caught.value)


def test_equal_stamps_are_not_backwards(tmp_path: Path) -> None:
    path = write_lines(tmp_path / "a.log", small_log(), {5: "O 1.0 2.0 3.0 0.325863"})
    assert read_log_text(path).stamps[4] == read_log_text(path).stamps[3]


def test_a_last_line_cut_in_its_stamp(tmp_path: Path) -> None:
    path = write_lines(tmp_path / "a.log", small_log())
    path.write_text(path.read_text()[:-3])
    log = read_log_text(path)
    assert (len(log), log.remarks) == (11, ("the last line, 12, is cut: left out",))


def test_a_last_line_without_its_newline_is_fine(tmp_path: Path) -> None:
    path = write_lines(tmp_path / "a.log", small_log())
    path.write_text(path.read_text()[:-1])
    assert len(read_log_text(path)) == 12


def test_a_log_without_scans(tmp_path: Path) -> None:
    (tmp_path / "a.log").write_text("O 1.0 2.0 3.0 4.0\n")
    with pytest.raises(MclError, match="no laser scans"):
        read_log_text(tmp_path / "a.log")


def test_a_packed_log_is_read_as_far_as_it_goes(tmp_path: Path) -> None:
    whole = gzip.compress(write_lines(tmp_path / "a.log", small_log(200)).read_bytes())
    (tmp_path / "cut.log.gz").write_bytes(whole[: len(whole) // 2])
    log = read_log_text(tmp_path / "cut.log.gz")
    assert 0 < len(log) < 200
    np.testing.assert_array_equal(log.poses, small_log(200).poses[: len(log)])
    assert log.remarks[0] == "this gzip file is cut or damaged: read as far as it goes"
    assert "is cut: left out" in log.remarks[1]


def test_files_that_are_no_text(tmp_path: Path) -> None:
    whole = gzip.compress(write_lines(tmp_path / "a.log", small_log(200)).read_bytes())
    contents = {
        "cut.log.gz": whole[:20],
        "false.log.gz": b"O 1 2 3 4\n",
        "empty.log": b"",
        "blank.log": b"\n\n",
    }
    said = {"cut.log.gz": "cut or damaged", "false.log.gz": "not gzip", "empty.log": "empty", "blank.log": "empty"}
    for name, content in contents.items():
        (tmp_path / name).write_bytes(content)
        with pytest.raises(MclError, match=said[name]):
            read_log_text(tmp_path / name)
    with pytest.raises(MclError, match="no such file"):
        read_log_text(tmp_path / "missing.log")
    with pytest.raises(MclError, match="cannot be read"):
        read_log_text(tmp_path)


def test_the_real_logs_come_back_byte_for_byte(shared_data: Path, tmp_path: Path) -> None:
    for number in (1, 2, 4):
        source = shared_data / "cmu" / f"robotdata{number}.log.gz"
        write_log_text(tmp_path / "again.log", read_log_text(source))
        assert (tmp_path / "again.log").read_bytes() == gzip.decompress(source.read_bytes())
