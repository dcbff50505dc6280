"""How fast: whole commands as a user runs them, and the kernels beside plain NumPy, measured in one go."""

from __future__ import annotations

import os
import platform
import subprocess
import sys
import tempfile
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.config import load_config
from pipeline.errors import MclError
from pipeline.filter.initialization import initial_particles
from pipeline.filter.sensor import Reading, Sensor
from pipeline.kernels.random import stream_key
from pipeline.kernels.threads import use_threads
from pipeline.logs.messages import Log, Scan

POSES = 200_000
"""Random poses of the scoring rows."""
NUMPY_POSES = 10_000
"""NumPy's share of them: it needs as many times the memory for its look-ups."""


@dataclass(frozen=True)
class Row:
    """One figure: the median of ``runs`` measurements between ``least`` and ``most``, in ``unit``."""

    name: str
    value: float
    unit: str
    least: float
    most: float
    runs: int


@dataclass(frozen=True)
class Benchmark:
    """All rows, and the machine that they were measured on."""

    machine: str
    cores: int
    log: str
    rows: tuple[Row, ...]

    def to_dict(self) -> dict[str, Any]:
        """As JSON-like data."""
        return asdict(self)


def bench(log: Log, repeats: int = 5) -> Benchmark:
    """Measure everything over one log that has a map; each row is the median of so many repeats, after a first one."""
    rows = [*_scoring(log, repeats), *_commands(log.path, repeats)]
    return Benchmark(f"{platform.processor() or platform.machine()}, Python {platform.python_version()}",
                     len(os.sched_getaffinity(0)), log.name, tuple(rows))  # fmt: skip


def _commands(log: Path, repeats: int) -> list[Row]:
    """Whole processes, start-up and recording included."""
    mcl = [sys.executable, "-m", "pipeline.cli"]
    rows = [_row("mcl --help", "s", repeats, lambda: _run([*mcl, "--help"]))]
    for particles, beams in ((500, 36), (2000, 60)):
        with tempfile.TemporaryDirectory() as folder:
            runs = iter(range(10**6))

            def localize(particles: int = particles, beams: int = beams) -> float:
                out = f"{folder}/{next(runs)}"  # noqa: B023  (called within the loop)
                typed = ["localize", str(log), "--particles", str(particles), "--set", f"max_beams={beams}", "-o", out]
                return _run([*mcl, *typed])

            rows.append(_row(f"mcl localize, {particles} particles x {beams} beams", "s", repeats, localize))
    return rows


def _run(command: Sequence[str]) -> float:
    start = time.perf_counter()
    subprocess.run(command, check=True, capture_output=True)
    return time.perf_counter() - start


def _scoring(log: Log, repeats: int) -> list[Row]:
    """The sensor model alone, with all beams of the log's first scan, at random poses in free cells."""
    if log.grid is None:
        raise MclError("the log has no map", "convert it with --map", path=log.path)
    config = load_config(max_beams=log.laser.beams)
    sensor = Sensor(log.grid, log.laser, config)
    scan: Scan = next(log.scans())
    reading = sensor.read(scan)
    beams = len(reading.ranges)
    start = config.model_copy(update={"init": "free_space", "max_particles": POSES})
    poses = initial_particles(log.grid, start, int(stream_key(0, 0, 0)))
    ordered = np.ascontiguousarray(poses[:, np.lexsort((poses[2], poses[0] // 0.1, poses[1] // 0.1))])
    per_beam = 1e9 / (POSES * beams)
    rows = []
    for threads in (1, len(os.sched_getaffinity(0))):
        with use_threads(threads):
            for name, chosen in (("random poses", poses), ("sorted by cell", ordered)):
                score = _timed(lambda chosen=chosen: _score(sensor, reading, chosen))  # type: ignore[misc]
                label = f"scoring, {name}, {beams} beams, threads {threads}"
                rows.append(_row(label, "ns per particle and beam", repeats, score, per_beam))
    table = np.random.default_rng(0).integers(0, 256, (100_000, 360 + beams), np.uint8)
    numpy_row = _row(
        f"the same look-ups and sums by NumPy, random poses, {beams} beams",
        "ns per particle and beam", repeats, _timed(lambda: _numpy_score(poses[:, :NUMPY_POSES], reading, table)),
        1e9 / (NUMPY_POSES * beams),
    )  # fmt: skip
    search = _timed(lambda: sensor.search(reading, 1000, stream_key(0, 0, 0)))
    return [*rows, numpy_row, _row("search of the whole building, 24 beams", "s", repeats, search)]


def _score(sensor: Sensor, reading: Reading, poses: NDArray[np.float32]) -> None:
    sensor.score(poses, reading, np.empty(poses.shape[1], np.float32))


def _numpy_score(poses: NDArray[np.float32], reading: Reading, table: NDArray[np.uint8]) -> NDArray[np.float32]:
    """Two look-ups and a sum per beam as ``np.take`` does them, in a table (rows, headings + beams) of codes."""
    beams = len(reading.ranges)
    row = (np.abs(poses[0] * 7919 + poses[1] * 104729).astype(np.int64)) % len(table)
    heading = (np.abs(poses[2]) * 57).astype(np.int64) % 360
    codes = np.take(table.reshape(-1), (row * table.shape[1] + heading)[:, None] + np.arange(beams))
    likelihood = np.take(reading.rows.reshape(-1), codes + 256 * np.arange(beams))
    total: NDArray[np.float32] = likelihood.sum(axis=1)
    return total


def _timed(work: Callable[[], object]) -> Callable[[], float]:
    def measure() -> float:
        start = time.perf_counter()
        work()
        return time.perf_counter() - start

    return measure


def _row(name: str, unit: str, repeats: int, measure: Callable[[], float], scale: float = 1.0) -> Row:
    measure()  # compiles, fills caches
    values = [scale * measure() for _ in range(repeats)]
    return Row(name, median(values), unit, min(values), max(values), repeats)
