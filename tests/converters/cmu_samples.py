"""Small logs and maps in the course's formats, and strategies that make many of them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from converters.cmu_text import BEAMS, CmuLog, format_lines
from pipeline.geometry import compose


def small_log(lines: int = 12, *, start: int = 25_863_000, seed: int = 0) -> CmuLog:
    """Odometry and scans taking turns every 100 ms, the laser 25 cm ahead, whole ranges with some codes."""
    rng = np.random.default_rng(seed)
    is_scan = np.arange(lines) % 2 == 1
    poses = np.cumsum(rng.normal(scale=[20.0, 20.0, 0.2], size=(lines, 3)), axis=0).round(6)
    lasers = compose(poses[is_scan], (25.0, 0.0, 0.0))
    lasers[:, 2] = poses[is_scan, 2]
    ranges = rng.integers(5, 3000, size=(int(is_scan.sum()), BEAMS)).astype(float)
    ranges[:, 7] = 8191.0
    stamps = start + 100_000_000 * np.arange(lines)
    return CmuLog(np.arange(lines) + 1, is_scan, stamps, poses, lasers.round(6), ranges)


def write_lines(path: Path, log: CmuLog, replace: dict[int, str] | None = None) -> Path:
    """The log as text, with some lines (1-based) replaced."""
    lines = format_lines(log)
    for number, text in (replace or {}).items():
        lines[number - 1] = text
    path.write_text("".join(f"{line}\n" for line in lines))
    return path


def numbers(text: str) -> list[tuple[str, list[float]]]:
    """Every line as its type and its numbers."""
    return [(line.split()[0], [float(v) for v in line.split()[1:]]) for line in text.splitlines() if line.strip()]


def decimals(limit: float, places: int) -> st.SearchStrategy[float]:
    """Numbers with so many decimals."""
    scale = 10**places
    return st.integers(int(-limit * scale), int(limit * scale)).map(lambda n: n / scale)


@st.composite
def logs(draw: st.DrawFn) -> CmuLog:
    """Logs of any shape: long turns, odd ranges, equal stamps, more decimals than the format has."""
    kinds = draw(st.lists(st.booleans(), min_size=1, max_size=8).filter(any))
    n, m = len(kinds), sum(kinds)
    centimetres = decimals(1e5, 6)
    turns = st.one_of(decimals(3.2, 6), decimals(50.0, 6))

    def poses(count: int) -> np.ndarray:
        rows = draw(st.lists(st.tuples(centimetres, centimetres, turns), min_size=count, max_size=count))
        return np.array(rows, dtype=np.float64).reshape(count, 3)

    ranges = st.one_of(st.integers(0, 8191).map(float), decimals(8191.0, 3).map(abs))
    steps = draw(st.lists(st.integers(0, 10**7), min_size=n, max_size=n))
    return CmuLog(
        np.arange(n) + 1,
        np.array(kinds),
        np.cumsum(steps) * 1000,
        poses(n),
        poses(m),
        draw(hnp.arrays(np.float64, (m, BEAMS), elements=ranges, fill=ranges)),
    )
