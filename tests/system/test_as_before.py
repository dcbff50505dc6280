"""Runs in which only the wheels are heard stay what they were before the laser was heard, to the byte."""

from __future__ import annotations

import hashlib
from pathlib import Path

import numpy as np
import pytest
from commands import Command

from pipeline.simulate import sample_dir

# The first half of the SHA-256 of trajectory.tum and trajectory_hindsight.tum, as `mcl localize --seed 1` wrote them
# for the embedded office at commit 32efd27, the last that knew no laser odometry: with the defaults of that time, and
# with `--config course`. On x86-64 with AVX-512.
BEFORE = {
    ("--set", "odometry=wheels"): ("fe16f15e99b9458843e812372d610588", "5187f6d4806bd90218371fe7e13342d9"),
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
