"""A share of `make faults`: commands that are killed, stopped, starved of disk, run twice at once; and a cut cache."""

from __future__ import annotations

import random
import signal
from pathlib import Path

import breakdowns
import pytest
from breakdowns import Broken, Desk

BY_NAME = {command.name: command for command in breakdowns.COMMANDS}


@pytest.fixture(scope="module")
def desk(tmp_path_factory: pytest.TempPathFactory) -> Desk:
    return Desk(tmp_path_factory.mktemp("breakdowns"))


@pytest.mark.parametrize(
    ("name", "share", "sent"),
    [
        ("convert", 0.9, signal.SIGKILL),
        ("localize", 0.7, signal.SIGINT),
        pytest.param("share", 0.8, signal.SIGTERM, marks=pytest.mark.slow),
    ],
)
def test_a_command_that_is_stopped_leaves_nothing_half_done(
    name: str, share: float, sent: signal.Signals, desk: Desk
) -> None:
    usual = desk.sound(BY_NAME[name].words).seconds
    desk.clear()
    assert breakdowns.stopped(desk, BY_NAME[name], sent, share * usual) == []


@pytest.mark.parametrize("limit", [3_000, 1_200_000])
@pytest.mark.parametrize("name", ["convert", "localize", "share", "export raw"])
def test_a_full_disk_is_told_in_one_line(name: str, limit: int, desk: Desk) -> None:
    assert breakdowns.on_a_full_disk(desk, BY_NAME[name], limit) == []


@pytest.mark.parametrize("name", ["convert", "localize", "share"])
def test_a_read_only_folder_is_told_and_two_at_once_do_no_harm(name: str, desk: Desk) -> None:
    assert breakdowns.read_only(desk, BY_NAME[name]) == []
    assert breakdowns.two_at_once(desk, BY_NAME[name]) == []


@pytest.mark.slow
def test_a_cache_that_is_cut_is_made_again(desk: Desk) -> None:
    assert breakdowns.cut_cache(desk, random.Random(0)) == []


def test_whatever_must_not_be_is_seen(desk: Desk) -> None:
    command = Broken("x", ("x",), ("new.mcap", "new.html"))
    (desk.home / "new.mcap").write_bytes(b"\x89MCAP0\r\nhalf")
    (desk.home / ".new.part").write_bytes(b"")
    kept = (desk.home / "office.log.gz").read_bytes()
    (desk.home / "office.log.gz").write_bytes(b"gone")
    wrong = " ".join(desk.wrong(command, breakdowns.Ended(1, "Traceback (most recent call last)", 1.0)))
    (desk.home / "office.log.gz").write_bytes(kept)
    desk.clear()
    desk.before = desk.listing()
    for words in (
        "is half a file",
        "left behind: ['.new.part']",
        "is not what it was",
        "Traceback",
        "no line of error",
    ):
        assert words in wrong
    assert Path(desk.home / "office.mcap").exists()
