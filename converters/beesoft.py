"""Beesoft occupancy maps: a header in centimetres, then one line of probabilities per column of the map.

A file's value is the probability that the cell is FREE and -1 means unknown; the first index of the
file is x, the second y (what the format's own C reader does, whatever the course's notes say).
"""

from __future__ import annotations

import re
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from converters.text import read_bytes, write_text
from pipeline.errors import MclError
from pipeline.maps.occupancy_grid import OccupancyGrid

_SIZE = re.compile(rb"^global_map\[0\]:[ \t]*(\S+)[ \t]+(\S+)[ \t]*\r?$", re.MULTILINE)
_RESOLUTION = re.compile(rb"^robot_specifications->resolution[ \t]+(\S+)", re.MULTILINE)


def is_beesoft(head: bytes) -> bool:
    """Whether the first bytes of a text file look like a beesoft map."""
    return b"robot_specifications->" in head or b"global_map[" in head


def read_beesoft(path: Path) -> OccupancyGrid:
    """The map as occupancy = 1 - value: cell (0, 0) at the map frame's origin, x along the file's lines, y up."""
    return parse_beesoft(read_bytes(path), path).grid


@dataclass(frozen=True)
class BeesoftMap:
    """A map file as written: ``header`` up to and with the ``global_map`` line, ``values`` (nx, ny), cell size in m."""

    header: str
    values: NDArray[np.float64]
    resolution: float

    @property
    def grid(self) -> OccupancyGrid:
        """The map as occupancy = 1 - value."""
        free = self.values.T  # the file's first index is x: one line of the file is one column of the grid
        return OccupancyGrid(np.where(free < 0.0, np.nan, 1.0 - free).astype(np.float32), self.resolution)


def parse_beesoft(data: bytes, path: Path) -> BeesoftMap:
    """The map in bytes that are already unpacked; ``path`` names them in errors.

    Raises MclError with file and line if there is no header, a value is not a number, neither -1 nor
    in [0, 1], or the number of cells is not what the header promises.
    """
    size = _SIZE.search(data)
    if size is None:
        hint = "this is a log" if re.match(rb"\s*[OL]\s", data) else "expected a line 'global_map[0]: <nx> <ny>'"
        raise MclError("not a beesoft map: no global_map header", hint, path=path)
    line = data.count(b"\n", 0, size.start()) + 1
    nx, ny = (_positive_int(text, path, line) for text in size.groups())
    resolution = _resolution_cm(data, size.start(), path) / 100.0
    cells = _cells(data, size.end(), nx * ny, path)
    header = data[: size.end()].decode("ascii", errors="replace").replace("\r", "") + "\n"
    return BeesoftMap(header, cells.reshape(nx, ny), resolution)


def write_beesoft(path: Path, grid: OccupancyGrid) -> None:
    """Writes the grid's cells so that reading them gives the same back (to 1e-16); the origin is not kept."""
    nx, ny, cm = grid.width, grid.height, grid.resolution * 100.0
    header = [
        ("global_mapsize_x", nx * cm),
        ("global_mapsize_y", ny * cm),
        ("resolution", cm),
        ("autoshifted_x", 0.0),
        ("autoshifted_y", 0.0),
    ]
    lines = [f"{f'robot_specifications->{name}':<54} {value:.10g}" for name, value in header]
    write_text(path, format_beesoft("\n".join([*lines, "", f"global_map[0]: {nx} {ny}"]) + "\n", grid))


def format_beesoft(header: str, grid: OccupancyGrid) -> str:
    """The text of a map file with the given header: three decimals where they suffice, else as many as it takes."""
    free = file_values(grid)
    if np.array_equal(free, np.round(free, 3)):
        names = {value: f"{value:.3f}" for value in np.unique(free).tolist()}
    else:
        names = {value: repr(value) for value in np.unique(free).tolist()}
    return header + "".join(" ".join([names[v] for v in row]) + " \n" for row in free.tolist())


def file_values(grid: OccupancyGrid) -> NDArray[np.float64]:
    """What a file says of the cells, (nx, ny): probability of being free, -1 unknown; as short as float32 allows."""
    occupancy = grid.occupancy.T
    exact = 1.0 - occupancy.astype(np.float64)
    free = exact
    for decimals in (3, 6):
        short = np.round(exact, decimals)
        if np.array_equal((1.0 - short).astype(np.float32), occupancy, equal_nan=True):
            free = short
            break
    return np.where(np.isnan(free), -1.0, free)


def _cells(data: bytes, start: int, expected: int, path: Path) -> NDArray[np.float64]:
    tokens = data[start:].split()
    try:
        cells = np.fromiter(map(float, tokens), dtype=np.float64, count=len(tokens))
    except ValueError:
        bad = next(i for i, token in enumerate(tokens) if not _is_number(token))
        raise MclError(f"{_show(tokens[bad])} is not a number", path=path, line=_line_of(data, start, bad)) from None
    valid = (cells == -1.0) | ((cells >= 0.0) & (cells <= 1.0))
    if not valid.all():
        bad = int(np.argmin(valid))
        raise MclError(
            f"{_show(tokens[bad])} is neither -1 (unknown) nor a probability in [0, 1]",
            path=path,
            line=_line_of(data, start, bad),
        )
    if len(cells) != expected:
        raise MclError(
            f"the header promises {expected} cells, the file has {len(cells)}",
            "the file is cut" if len(cells) < expected else "",
            path=path,
            line=data.rstrip().count(b"\n") + 1,
        )
    return cells


def _resolution_cm(data: bytes, end: int, path: Path) -> float:
    match = _RESOLUTION.search(data, 0, end)
    if match is None:
        raise MclError("no line 'robot_specifications->resolution <cm>' in the header", path=path)
    text = match.group(1)
    if not _is_number(text) or not 0.0 < float(text) < float("inf"):
        line = data.count(b"\n", 0, match.start()) + 1
        raise MclError(f"the resolution {_show(text)} is not a positive number of centimetres", path=path, line=line)
    return float(text)


def _positive_int(text: bytes, path: Path, line: int) -> int:
    if not text.isdigit() or int(text) == 0:
        raise MclError(f"the map's size {_show(text)} is not a positive whole number", path=path, line=line)
    return int(text)


def _line_of(data: bytes, start: int, index: int) -> int:
    """Line (1-based) of the index-th token after ``start``."""
    first = data.count(b"\n", 0, start) + 1
    for offset, line in enumerate(data[start:].split(b"\n")):
        index -= len(line.split())
        if index < 0:
            return first + offset
    return first


def _is_number(text: bytes) -> bool:
    try:
        float(text)
    except ValueError:
        return False
    return True


def _show(text: bytes) -> str:
    return repr(text[:40].decode("ascii", errors="replace"))
