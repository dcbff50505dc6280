from __future__ import annotations

import subprocess
import time
from collections.abc import Callable, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
import pytest
from synthetic import drive, steps
from test_viewer import PATIENCE, free_port

from pipeline.config import Config
from pipeline.filter.step import Step
from pipeline.logs.messages import Log
from pipeline.recording import viewer
from pipeline.recording.rerun_sink import RerunSink
from pipeline.recording.rrd_file import read_rrd


def values(column: Any) -> list[Any]:
    """As Python values; durations as integer nanoseconds."""
    return (column.cast(pa.int64()) if pa.types.is_duration(column.type) else column).to_pylist()


class Recorded:
    """A recording with what went into it."""

    def __init__(self, path: Path, log: Log, config: Config, steps: Sequence[Step]) -> None:
        self.path, self.log, self.config, self.steps = path, log, config, steps
        self.file = read_rrd(path)

    def column(self, entity: str, component: str, *, static: bool = False) -> list[Any]:
        """A component of an entity, one item per row, in the order of the scans."""
        batches = [c.to_record_batch() for c in self.file.chunks if c.entity_path == entity and c.is_static == static]
        tables = [pa.Table.from_batches([b]) for b in batches if component in b.schema.names]
        rows = [
            (scan, value)
            for table in tables
            for scan, value in zip(
                range(len(table)) if static else table["scan"].to_pylist(), values(table[component]), strict=True
            )
        ]
        return [value for _, value in sorted(rows, key=lambda row: row[0])]


@pytest.fixture
def record(tmp_path: Path) -> Callable[..., Recorded]:
    def write(name: str = "run.rrd", *, scans: int = 150, particles: int = 40, **options: Any) -> Recorded:
        log = options.pop("log", None) or drive(scans)
        config = Config(record_particles=options.pop("record_particles", 2000))
        seen = options.pop("seen", None) or list(steps(log, particles))
        path = tmp_path / name
        with RerunSink(path, log=log, config=config, seed=options.pop("seed", 0)) as sink:
            for step in seen:
                sink.log(step)
            if (summary := options.pop("summary", None)) is not None:
                sink.finish(summary)
        return Recorded(path, log, config, seen)

    return write


@pytest.fixture
def listening():
    """The part of a viewer that listens; no screen is needed. Its process, and its address."""
    port = free_port()
    process = subprocess.Popen(
        [viewer.program(), "--serve-grpc", "--bind", "127.0.0.1", "--port", str(port)],
        env=viewer.quiet(), stdout=subprocess.DEVNULL, stderr=subprocess.DEVNULL,
    )  # fmt: skip
    address = f"rerun+http://127.0.0.1:{port}/proxy"
    until = time.monotonic() + PATIENCE
    while not viewer._listens("127.0.0.1", port, 0.2) and time.monotonic() < until:
        time.sleep(0.05)
    yield process, address
    process.kill()
    process.wait()
