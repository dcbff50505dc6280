"""Maps of either kind, told apart by their content: beesoft, or a map_server YAML with its image."""

from __future__ import annotations

from pathlib import Path

from converters.beesoft import is_beesoft, parse_beesoft
from converters.cmu_text import is_log_text
from converters.text import read_bytes
from pipeline.errors import MclError
from pipeline.maps.map_server import load_map
from pipeline.maps.occupancy_grid import OccupancyGrid

HEAD = 4096  # bytes (unpacked) by which a file is known


def read_map(path: Path) -> OccupancyGrid:
    """The map in a beesoft file (plain or gzipped) or described by a map_server YAML.

    Raises MclError for a log, an image, and whatever is wrong in the file.
    """
    path = Path(path)
    data = read_bytes(path)
    head = data[:HEAD]
    if is_beesoft(head):
        return parse_beesoft(data, path).grid
    if is_log_text(head):
        raise MclError("this is a log, not a map", "give it as the log", path=path)
    if b"\0" in head or head[:2] in (b"P5", b"P2"):
        raise MclError("not a map file", "give the .yaml beside the image, or a beesoft map", path=path)
    return load_map(path)
