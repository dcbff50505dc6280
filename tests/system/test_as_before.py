"""Runs in which only the wheels are heard, and those of the course's values, stay what they were, to the byte."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest
from commands import Command

from pipeline.simulate import sample_dir

# The first half of the SHA-256 of trajectory.tum and trajectory_hindsight.tum, as `mcl localize --seed 1` writes them
# for the embedded office since doubt is told against chance, and places may be off the map: with the wheels alone, and
# with `--config course`. On x86-64 with AVX-512.
BEFORE = {
    ("--set", "odometry=wheels"): ("dc26323fad366b168a73ffc5bd0542dd", "414fa332e9e93cc96a7c1f5d15ec11b9"),
    ("--config", "course"): ("108412c7f6ccef12420de73e887b9ac8", "6818fcbee7f2004309a6f84ae33132f2"),
}
ARITHMETIC = "6ba7837f3e73aa6c5137d0fa74d9f4a0"
"""Of the elementary functions of the machine that wrote them: others may round the last bit another way."""


def short_hash(data: bytes) -> str:
    return hashlib.sha256(data).hexdigest()[:32]


def arithmetic() -> str:
    x = np.linspace(0.01, 3.0, 5000)
    functions = (np.exp, np.log, np.log1p, np.sin, np.cos, np.sqrt)
    told = [function(x.astype(kind)) for function in functions for kind in (np.float32, np.float64)]
    told += [np.arctan2(x, x[::-1]), np.hypot(x, x[::-1])]
    return short_hash(b"".join(values.tobytes() for values in told))


@pytest.fixture(scope="module")
def sample(mcl: Command, tmp_path_factory: pytest.TempPathFactory) -> Path:
    if arithmetic() != ARITHMETIC:
        pytest.skip("this machine rounds another way than the one whose bytes are known")
    log = tmp_path_factory.mktemp("before") / "office.mcap"
    mcl("convert", sample_dir() / "office.log.gz", "--map", sample_dir() / "office.dat.gz", "-o", log)
    return log


@pytest.mark.parametrize("options", BEFORE, ids=["wheels", "course"])
def test_to_the_byte(mcl: Command, sample: Path, tmp_path: Path, options: tuple[str, ...]) -> None:
    folder = tmp_path / "run"
    mcl("localize", sample, *options, "--seed", 1, "--no-record", "-o", folder)
    files = (folder / "trajectory.tum", folder / "trajectory_hindsight.tum")
    assert tuple(short_hash(file.read_bytes()) for file in files) == BEFORE[options]
