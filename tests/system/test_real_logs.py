"""The course's own logs, where they are at hand: a robot that is carried off half-way."""

from __future__ import annotations

import gzip
import json
from pathlib import Path

import pytest
from commands import FEW, Command


def test_a_log_of_wean_hall_from_raw_to_recording(mcl: Command, shared_data: Path, tmp_path: Path) -> None:
    raw = shared_data / "cmu"
    log, run = tmp_path / "carried.mcap", tmp_path / "run"
    done = mcl("convert", raw / "robotdata1.log.gz", "--map", raw / "wean.dat.gz", "--drop", "40:70", "-o", log)
    assert "dropped" in done.stderr
    told = json.loads(mcl("localize", log, *FEW, "-o", run, "--json").stdout)
    assert told["log"]["scans"] < 713
    assert told["truth"] is None
    inspected = json.loads(mcl("inspect", run, "--json").stdout)
    assert inspected["scans"] == told["log"]["scans"]
    assert inspected["damage"] is None


def test_a_log_of_wean_hall_comes_back_number_by_number(mcl: Command, shared_data: Path, tmp_path: Path) -> None:
    raw = shared_data / "cmu"
    mcl("convert", raw / "robotdata4.log.gz", "--map", raw / "wean.dat.gz", "-o", tmp_path / "log4.mcap")
    log, grid = mcl("export", tmp_path / "log4.mcap", "--raw", tmp_path / "raw").stdout.splitlines()
    numbers = [line.split() for line in Path(log).read_text().splitlines()]
    theirs = [line.split() for line in gzip.decompress((raw / "robotdata4.log.gz").read_bytes()).decode().splitlines()]
    assert [row[0] for row in numbers] == [row[0] for row in theirs]
    assert all(list(map(float, a[1:])) == list(map(float, b[1:])) for a, b in zip(numbers, theirs, strict=True))
    assert Path(grid).read_bytes().split() == gzip.decompress((raw / "wean.dat.gz").read_bytes()).split()


@pytest.mark.slow
def test_a_robot_that_was_carried_off_is_found_again(mcl: Command, shared_data: Path, tmp_path: Path) -> None:
    """Thirty seconds of log 2 are missing; the corridor looks the same every six metres."""
    raw, log = shared_data / "cmu", tmp_path / "carried.mcap"
    mcl("convert", raw / "robotdata2.log.gz", "--map", raw / "wean.dat.gz", "--drop", "30:60", "-o", log)
    reference = raw / "reference" / "robotdata2.tum"
    told = json.loads(mcl("evaluate", log, "--reference", reference, "--runs", 1, "--jobs", 1, "--json").stdout)
    (found,) = told["logs"].values()
    assert found["successes"] == 1
    (recovery,) = found["recoveries"]
    assert recovery["recovered"] == 1
    assert recovery["time"]["median"] < 15.0
    assert found["position_error"]["median"] < 0.2
