from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from pipeline.errors import MclError
from pipeline.geometry import wrap_angle
from pipeline.logs.messages import Trajectory
from pipeline.logs.stamps import format_stamp, parse_stamp
from pipeline.logs.tum import read_tum, write_tum

stamps = st.integers(0, 2**62)


@given(stamps)
def test_stamps_come_back_exactly(stamp: int) -> None:
    assert parse_stamp(format_stamp(stamp)) == stamp
    assert parse_stamp(format_stamp(stamp, 6)) == stamp
    assert parse_stamp(format_stamp(-stamp)) == -stamp


@pytest.mark.parametrize(
    ("text", "stamp"),
    [
        ("0", 0),
        ("5.", 5_000_000_000),
        ("0.1", 100_000_000),
        ("1e-3", 1_000_000),
        ("+1.5", 1_500_000_000),
        ("2.0000000016", 2_000_000_002),
        ("1603211168.591553334", 1_603_211_168_591_553_334),
    ],
)
def test_stamps_in_text(text: str, stamp: int) -> None:
    assert parse_stamp(text) == stamp


@pytest.mark.parametrize("text", ["", "a", "1.2.3", "nan", "inf", "1,5", "0x10", "1e99999999", "-1e999999999999"])
def test_what_is_no_stamp(text: str) -> None:
    with pytest.raises(ValueError, match="not a number of seconds"):
        parse_stamp(text)


def test_six_decimals_where_they_suffice() -> None:
    assert format_stamp(134_998_162_000, 6) == "134.998162"
    assert format_stamp(134_998_162_001, 6) == "134.998162001"


@given(
    st.lists(st.integers(1, 2**40), min_size=1, max_size=20),
    st.lists(st.tuples(*[st.floats(-1e4, 1e4)] * 3), min_size=20, max_size=20),
)
def test_trajectories_come_back(
    tmp_path_factory: pytest.TempPathFactory, steps: list[int], rows: list[tuple[float, float, float]]
) -> None:
    path = tmp_path_factory.mktemp("tum") / "a.tum"
    poses = np.array(rows[: len(steps)])
    write_tum(path, Trajectory(np.cumsum(steps), poses))
    again = read_tum(path)
    np.testing.assert_array_equal(again.stamps, np.cumsum(steps))
    np.testing.assert_allclose(again.poses[:, :2], poses[:, :2], atol=1e-9)
    np.testing.assert_allclose(wrap_angle(again.poses[:, 2] - poses[:, 2]), 0.0, atol=1e-8)
    assert again.frame == "map"


def test_comments_and_blank_lines(tmp_path: Path) -> None:
    path = tmp_path / "a.tum"
    path.write_text("# stamp x y z qx qy qz qw\n\n1.000000001 1 2 0 0 0 0 2 # unnormalised\n2 1 2 5 0 0 1 0\n")
    truth = read_tum(path)
    assert truth.stamps.tolist() == [1_000_000_001, 2_000_000_000]
    np.testing.assert_allclose(truth.poses, [[1, 2, 0], [1, 2, np.pi]])


@pytest.mark.parametrize(
    ("line", "said"),
    [
        ("2 1 2 3", "expected 8 numbers"),
        ("2 1 2 0 0 0 zero 1", "not a number"),
        ("two 1 2 0 0 0 0 1", "not a number"),
        ("2 nan 2 0 0 0 0 1", "NaN"),
        ("2 1 2 0 0 0 0 0", "length zero"),
        ("1 1 2 0 0 0 0 1", "do not increase"),
    ],
)
def test_bad_lines_are_named(tmp_path: Path, line: str, said: str) -> None:
    path = tmp_path / "a.tum"
    path.write_text(f"# comment\n1 0 0 0 0 0 0 1\n{line}\n")
    with pytest.raises(MclError, match=said) as caught:
        read_tum(path)
    assert caught.value.line == 3


def test_files_that_are_no_trajectory(tmp_path: Path) -> None:
    with pytest.raises(MclError, match="no such file"):
        read_tum(tmp_path / "missing.tum")
    (tmp_path / "empty.tum").write_text("# nothing\n")
    with pytest.raises(MclError, match="no poses"):
        read_tum(tmp_path / "empty.tum")
    (tmp_path / "binary.tum").write_bytes(b"\xff\xfe\x00")
    with pytest.raises(MclError, match=r"not a text file .*TUM lines"):
        read_tum(tmp_path / "binary.tum")
