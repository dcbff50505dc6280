"""What a benchmark is made of: rows of figures, and curves of how costs grow."""

from __future__ import annotations

import os
import platform
import time
from collections.abc import Callable, Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from statistics import median
from typing import Any


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
class Growth:
    """How a cost, in ``unit``, grows with ``over``: ``values`` at ``points``."""

    name: str
    over: str
    points: tuple[float, ...]
    values: tuple[float, ...]
    unit: str


@dataclass(frozen=True)
class Benchmark:
    """All rows and curves, and the machine that they were measured on."""

    machine: str
    cores: int
    log: str
    repeats: int
    rows: tuple[Row, ...]
    growth: tuple[Growth, ...]

    def to_dict(self) -> dict[str, Any]:
        """As JSON-like data."""
        return asdict(self)


def machine() -> tuple[str, int]:
    """The processor's name with Python's version, and how many cores this process may use."""
    name = platform.processor() or platform.machine()
    try:
        lines = Path("/proc/cpuinfo").read_text(encoding="utf-8").splitlines()
        name = next(line.split(":", 1)[1].strip() for line in lines if line.startswith("model name"))
    except (OSError, StopIteration):
        pass
    return f"{name}, Python {platform.python_version()}", cores()


def cores() -> int:
    """Cores that this process may use."""
    return len(os.sched_getaffinity(0)) if hasattr(os, "sched_getaffinity") else os.cpu_count() or 1


def seconds(work: Callable[[], object]) -> float:
    """How long it takes."""
    start = time.perf_counter()
    work()
    return time.perf_counter() - start


def row(name: str, unit: str, values: Sequence[float]) -> Row:
    """The figures of several measurements."""
    return Row(name, median(values), unit, min(values), max(values), len(values))


def measured(repeats: int, works: Sequence[Callable[[], object]]) -> list[list[float]]:
    """Seconds of each of ``works``, as many times: all of them in turn, so that whatever else the machine does touches
    them alike and their ratios hold. The first round, which compiles and fills caches, does not count."""
    rounds = [[seconds(work) for work in works] for _ in range(1 + repeats)][1:]
    return [list(values) for values in zip(*rounds, strict=True)]


def ratios(slow: Sequence[float], quick: Sequence[float]) -> list[float]:
    """How many times as long the one took as the other, round by round."""
    return [a / b for a, b in zip(slow, quick, strict=True)]
