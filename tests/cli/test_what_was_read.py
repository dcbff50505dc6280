"""What a run says of the log that it read: one line for everything that was missing, chosen or left out."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from typer.testing import CliRunner

from converters import convert
from pipeline.cli import app
from recordings import UPRIGHT, Recording

SECOND = 1_000_000_000
FEW = ("--particles", "50", "--pose", "2,2,0", "--no-record")


def recording(*, mount: bool = True, time_increment: float = 0.0, imu: str = "") -> Recording:
    """Five scans of a room, and a map of it."""
    result = Recording()
    if mount:
        result.transforms(("base", "laser", (0.2, 0.0, 0.3), UPRIGHT))
    cells = np.zeros((40, 40), np.int8)
    cells[[0, -1]] = cells[:, [0, -1]] = 100
    result.grid(cells, 0.1, 0.0, 0.0, 0.0)
    for i in range(5):
        result.scan(i * SECOND // 5, [2.0] * 61, step=0.1, frame="laser", time_increment=time_increment)
        if imu:
            result.imu(i * SECOND // 5, (0.0, 0.0, 0.1), frame=imu)
    return result


def said(path: Path, tmp_path: Path) -> str:
    done = CliRunner().invoke(app, ["localize", str(path), *FEW, "-o", str(tmp_path / "run")])
    assert done.exit_code == 0, done.output
    return done.stderr


@pytest.mark.parametrize("converted", [False, True])
def test_that_there_is_no_odometry_is_one_line(tmp_path: Path, converted: bool) -> None:
    path = recording().write(tmp_path / "a.mcap")
    if converted:
        convert([path], tmp_path / "b.mcap")
        path = tmp_path / "b.mcap"
    (line,) = [line for line in said(path, tmp_path).splitlines() if "odometry" in line]
    assert " ".join(line.split()) == "odometry none: only the scans tell how the robot moved"


@pytest.mark.parametrize("converted", [False, True])
def test_a_laser_that_nothing_places_is_told_in_the_same_line(tmp_path: Path, converted: bool) -> None:
    path = recording(mount=False).write(tmp_path / "a.mcap")
    if converted:
        convert([path], tmp_path / "b.mcap")
        path = tmp_path / "b.mcap"
    (line,) = [line for line in said(path, tmp_path).splitlines() if "odometry" in line]
    assert line.endswith("the laser is taken to be at its centre: no transform says where it is")


def test_what_is_read_and_what_is_not_used(tmp_path: Path) -> None:
    told = said(recording(time_increment=0.5, imu="nowhere").write(tmp_path / "a.mcap"), tmp_path)
    assert "read from             /base/scan_front, /imu/data; base -> laser\n" in told
    assert "beam times            not used: 61 beams 0.5 s apart do not fit into 0.2 s from scan to scan\n" in told
    assert "gyroscope             not used: no transform from 'base' to 'nowhere'\n" in told
