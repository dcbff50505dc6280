"""Maps of either kind, told apart by their content: beesoft, or a map_server YAML with its image.

Any map that can be read, one in a recording as well, can be written as a map_server YAML.
"""

from __future__ import annotations

import tempfile
from collections.abc import Sequence
from pathlib import Path

from converters.bag_file import is_bag, open_recording
from converters.beesoft import is_beesoft, parse_beesoft
from converters.carmen_text import is_carmen_text
from converters.cmu_text import is_log_text
from converters.text import read_bytes, read_head
from pipeline.errors import MclError
from pipeline.logs import schema
from pipeline.logs.choice import find
from pipeline.logs.decode import decode_grid
from pipeline.logs.mcap_file import MAGIC, McapFile
from pipeline.logs.reader import own_map
from pipeline.logs.recorded import describe
from pipeline.maps.map_server import load_map, save_map
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.outputs import told

HEAD = 4096  # bytes (unpacked) by which a file is known


def read_map(path: Path | str) -> OccupancyGrid:
    """The map in a beesoft file (plain or gzipped) or described by a map_server YAML.

    Raises MclError for a log, an image, and whatever is wrong in the file.
    """
    path = Path(path)
    data = map_bytes(path)
    head = data[:HEAD]
    if is_beesoft(head):
        return parse_beesoft(data, path).grid
    if _is_log(path, head):
        raise MclError("this is a log, not a map", "give it as the log", path=path)
    if b"\0" in head or head[:2] in (b"P5", b"P2"):
        raise MclError("not a map file", "give the .yaml beside the image, or a beesoft map", path=path)
    return load_map(path)


def map_bytes(path: Path) -> bytes:
    """The content of a map's file, unpacked. Raises MclError as `read_bytes`, and for a folder."""
    if path.is_dir():
        raise MclError("this is a folder, not a map", "give the .yaml in it, or a beesoft map", path=path)
    return read_bytes(path)


def convert_map(source: Path, output: Path, mode: str = "trinary") -> tuple[OccupancyGrid, Sequence[Path]]:
    """Writes a map, or the map in a recording, as a map_server YAML ``output`` with an image beside it.

    Both appear when they are complete. Gives back the grid and the paths; see ``save_map`` for ``mode``.
    """
    grid = _find_map(Path(source))
    output = Path(output)
    with told(output):
        output.parent.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryDirectory(prefix=f".{output.stem}.", dir=output.parent) as folder:
            written = save_map(grid, Path(folder) / output.name, mode)
            return grid, [file.replace(output.parent / file.name) for file in written]


def _find_map(source: Path) -> OccupancyGrid:
    head = b"" if source.is_dir() else read_head(source, HEAD)
    if head.startswith(MAGIC):
        with McapFile(source) as recorded:
            grid, topics = own_map(recorded), recorded.topics
    elif is_bag(source, head):
        with open_recording(source) as bag:
            topic, topics = find(bag, schema.GRID_TYPE), bag.topics
            grid = None if topic is None else decode_grid(bag.messages([topic])[topic])
    elif _is_log(source, head):
        raise MclError("this is a log, and a .yaml is for maps", "name the output .mcap", path=source)
    else:
        return read_map(source)
    if grid is None:
        raise MclError(f"no map ({schema.GRID_TYPE}) in this file: {describe(topics)}", path=source)
    return grid


def _is_log(path: Path, head: bytes) -> bool:
    return is_log_text(head) or is_carmen_text(path, head)
