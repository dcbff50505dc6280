"""From a raw log whose odometry is left out to a score, command by command."""

from __future__ import annotations

import json
from pathlib import Path

import numpy as np
import pytest
from commands import Command

from pipeline.logs.tum import read_tum
from pipeline.simulate import sample_dir


@pytest.fixture(scope="module")
def bare(typed_here: Command, tmp_path_factory: pytest.TempPathFactory) -> Path:
    """The embedded office without odometry, with its map and its truth."""
    sample, log = sample_dir(), tmp_path_factory.mktemp("bare") / "bare.mcap"
    known = ("--map", sample / "office.dat.gz", "--ground-truth", sample / "office_truth.tum")
    typed_here("convert", sample / "office.log.gz", *known, "--without-odometry", "-o", log)
    return log


@pytest.mark.parametrize(
    "known", [pytest.param(False, id="unknown start"), pytest.param(True, id="known start", marks=pytest.mark.slow)]
)
def test_the_robot_is_found(typed_here: Command, bare: Path, tmp_path: Path, known: bool) -> None:
    truth, folder = read_tum(sample_dir() / "office_truth.tum"), tmp_path / "run"
    x, y, yaw = truth.poses[0].tolist()
    start = (f"--pose={x},{y},{yaw}",) if known else ()
    told = json.loads(typed_here("localize", bare, *start, "--seed", 1, "--json", "-o", folder).stdout)
    assert told["truth"]["success"]
    assert {path.name for path in folder.iterdir()} >= {"run.rrd", "trajectory.tum", "config.yaml", "run.json"}
    for name in ("trajectory.tum", "trajectory_hindsight.tum"):
        found = read_tum(folder / name)
        assert np.hypot(*(found.poses[-1] - truth.poses[-1])[:2]) < 0.5


def test_it_is_scored(typed_here: Command, bare: Path) -> None:
    told = json.loads(typed_here("evaluate", bare, "--runs", 1, "--jobs", 1, "--json").stdout)["logs"]["bare"]
    assert told["successes"] == told["runs"] == 1
    assert told["position_error"]["median"] < 0.2


def test_nobody_can_believe_wheels_that_are_not_there(typed_here: Command, bare: Path, tmp_path: Path) -> None:
    """The laser is heard instead."""
    told = typed_here("localize", bare, "--set", "odometry=wheels", "--no-record", "--json", "-o", tmp_path / "run")
    assert json.loads(told.stdout)["truth"]["success"]
