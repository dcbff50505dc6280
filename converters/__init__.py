"""Raw logs and maps in, one .mcap out: one module per format, and the content decides which."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from types import ModuleType

from converters.report import ConversionReport
from converters.text import read_bytes
from pipeline.errors import MclError
from pipeline.maps.occupancy_grid import OccupancyGrid

__all__ = ["ConversionReport", "convert", "read_map"]

HEAD = 4096  # bytes (unpacked) that a format may look at to know its own


def formats() -> list[ModuleType]:
    """The modules that read raw logs, in the order in which they are asked.

    Each has FORMAT (its name), DESCRIPTION, ``sniff(path, head) -> bool`` and ``convert`` as below.
    """
    from converters import cmu

    return [cmu]


def convert(
    sources: Sequence[Path],
    output: Path,
    *,
    map_path: Path | None = None,
    drop: Sequence[tuple[float, float]] = (),
    ground_truth: Path | None = None,
    join: bool = False,
) -> ConversionReport:
    """Converts one raw log (or several, one after the other, with ``join``) and its map into ``output``.

    ``drop``: intervals in seconds since the first line of the log. What is stamped within (ends included) is left
    out, and the odometry goes on from where it stood: somebody carried the robot and its wheels did not
    turn. That is a kidnapping; merely deleting lines is not, for the odometry after the gap would tell
    the filter how far the robot went. ``join`` treats the joint between two logs the same way, 1 s apart: the
    robot was switched off, carried, and switched on. ``ground_truth``: a TUM file of base_link in the map, its
    stamps those of the output. Raises MclError for input of no known format and for whatever is wrong in it.
    """
    sources = [Path(source) for source in sources]
    if not sources:
        raise MclError("no log to convert")
    if len(sources) > 1 and not join:
        raise MclError(f"{len(sources)} logs given, one expected", "--join puts them one after the other")
    kinds = [_format_of(source) for source in sources]
    for source, kind in zip(sources, kinds, strict=True):
        if kind is not kinds[0]:
            raise MclError(f"a {kind.DESCRIPTION} cannot be joined to a {kinds[0].DESCRIPTION}", path=source)
    report: ConversionReport = kinds[0].convert(
        sources, Path(output), map_path=map_path, drop=drop, ground_truth=ground_truth
    )
    return report


def read_map(path: Path) -> OccupancyGrid:
    """The map in a file of either kind: a beesoft map (plain or gzipped) or a map_server YAML with its image."""
    from converters.beesoft import is_beesoft, parse_beesoft
    from converters.cmu_text import is_log_text
    from pipeline.maps.map_server import load_map

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


def _format_of(path: Path) -> ModuleType:
    from converters.beesoft import is_beesoft

    head = b"" if path.is_dir() else read_bytes(path)[:HEAD]
    if is_beesoft(head):
        raise MclError("this is a beesoft map, not a log", "give it with --map", path=path)
    for kind in formats():
        if kind.sniff(path, head):
            return kind
    known = ", ".join(kind.DESCRIPTION for kind in formats())
    begin = head.split(b"\n", 1)[0][:40].decode("ascii", errors="replace")
    raise MclError(f"a log of no known format, beginning {begin!r}", f"known: {known}", path=path)
