"""The course's own logs, where they are at hand: a robot that is carried off half-way."""

from __future__ import annotations

import gzip
import json
from pathlib import Path

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
