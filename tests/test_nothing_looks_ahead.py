"""What is told at a scan is told by the scans until then: a log that ends there gives the same poses, to the bit."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import buildings
import numpy as np
import pytest

from converters import convert
from pipeline.config import Config
from pipeline.localization import localize
from pipeline.logs.messages import Log
from pipeline.logs.reader import read_log
from pipeline.simulate import simulate_log

FIRST = 300
REAL = {
    "fr079": ("carmen/fr079/fr079.log.gz", "carmen/fr079/map.yaml"),
    "robotdata1": ("cmu/robotdata1.log.gz", "cmu/wean.dat.gz"),
}


def poses(log: Log, odometry: str, hindsight: bool = False) -> np.ndarray:
    few = {"max_particles": 2000, "min_particles": 500}
    return localize(log, Config(**few, odometry=odometry, hindsight=hindsight), seed=3).poses


def assert_nothing_looks_ahead(log: Log, odometry: str, *, cuts: int = 2) -> None:
    whole = poses(log, odometry)
    for cut in np.random.default_rng(len(log)).integers(len(log) // 4, len(log), cuts):
        assert poses(log.part(slice(cut)), odometry).tobytes() == whole[:cut].tobytes()
    assert poses(log.part(slice(cut)), odometry, hindsight=True).tobytes() == whole[:cut].tobytes()


@pytest.mark.parametrize("odometry", ["both", "laser", "wheels"])
def test_among_people(odometry: str) -> None:
    assert_nothing_looks_ahead(simulate_log(buildings.office(), 1).log, odometry)


@pytest.mark.parametrize("odometry", ["both", "laser"])
def test_with_a_laser_that_spins_and_a_gyroscope(odometry: str) -> None:
    log = simulate_log(buildings.spinning(), 1).log
    assert log.sweeps is not None
    assert log.turns is not None
    assert_nothing_looks_ahead(log, odometry, cuts=1)


def test_without_wheels() -> None:
    log = simulate_log(buildings.office(), 2).log
    bare = dataclasses.replace(log, odometry=np.zeros_like(log.odometry), wheels=False)
    assert_nothing_looks_ahead(bare, "both")


@pytest.fixture(scope="module", params=REAL)
def real(request: pytest.FixtureRequest, shared_data: Path, tmp_path_factory: pytest.TempPathFactory) -> Log:
    log, grid = (shared_data / name for name in REAL[request.param])
    path = tmp_path_factory.mktemp("real") / "real.mcap"
    convert([log], path, map_path=grid)
    return read_log(path).part(slice(FIRST))


@pytest.mark.parametrize(
    "odometry", ["both", *(pytest.param(name, marks=pytest.mark.slow) for name in ("laser", "wheels"))]
)
def test_in_real_buildings(real: Log, odometry: str) -> None:
    assert_nothing_looks_ahead(real, odometry, cuts=1)
