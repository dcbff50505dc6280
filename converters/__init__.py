"""Raw logs and maps in, one .mcap out: one module per format, and the content decides which."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from types import ModuleType
from typing import Any

from converters.beesoft import is_beesoft
from converters.map_files import HEAD, convert_map, read_map
from converters.report import ConversionReport
from converters.text import read_head
from pipeline.errors import MclError
from pipeline.logs.faults import Fault
from pipeline.logs.recorded import Names
from pipeline.parts.sinks import installed_readers

__all__ = ["ConversionReport", "convert", "convert_map", "read_map"]


def formats() -> list[ModuleType]:
    """The modules that read raw logs, in the order in which they are asked.

    Each has FORMAT (its name), DESCRIPTION, ``sniff(path, head) -> bool`` and ``convert`` as below.
    """
    from converters import bag, carmen, cmu

    return [*_registered, cmu, carmen, bag, *installed_readers()]


_registered: list[ModuleType] = []


def register(reader: ModuleType) -> None:
    """From now on this module is asked first whether it knows a raw log; it has what ``formats`` says."""
    if reader not in _registered:
        _registered.insert(0, reader)


def convert(
    sources: Sequence[Path],
    output: Path,
    *,
    map_path: Path | None = None,
    drop: Sequence[tuple[float, float]] = (),
    ground_truth: Path | None = None,
    join: bool = False,
    names: Names | None = None,
    without_odometry: bool = False,
    faults: Sequence[Fault] = (),
    seed: int = 0,
) -> ConversionReport:
    """Converts one raw log (or several, one after the other, with ``join``) and its map into ``output``.

    ``drop``: intervals in seconds since the first line of the log. What is stamped within (ends included) is left
    out, and the odometry goes on from where it stood: somebody carried the robot and its wheels did not
    turn. That is a kidnapping; merely deleting lines is not, for the odometry after the gap would tell
    the filter how far the robot went. ``join`` treats the joint between two logs the same way, 1 s apart: the
    robot was switched off, carried, and switched on. ``ground_truth``: a TUM file of base_link in the map, its
    stamps those of the output, or a topic of a bag. ``names``: topics and frames of a bag, and what a log lacks.
    ``without_odometry``: leave out what the wheels said, as if nobody had recorded it; the scans keep their stamps, the
    laser its place on the robot. ``faults``: to be made in it, where they do not say by ``seed``. Raises MclError for
    input of no known format and for whatever is wrong in it.
    """
    sources = [Path(source) for source in sources]
    if not sources:
        raise MclError("no log to convert")
    if len(sources) > 1 and not join:
        raise MclError(f"{len(sources)} logs given, one expected", "--join puts them one after the other")
    kinds = [format_of(source) for source in sources]
    for source, kind in zip(sources, kinds, strict=True):
        if kind is not kinds[0]:
            raise MclError(f"a {kind.DESCRIPTION} cannot be joined to a {kinds[0].DESCRIPTION}", path=source)
    options: dict[str, Any] = {"map_path": map_path, "drop": drop, "ground_truth": ground_truth}
    options |= {"without_odometry": without_odometry, "names": names, "faults": faults, "seed": seed}
    if kinds[0].FORMAT != "rosbag" and names is not None and replace(names, laser_pose=None) != Names():
        raise MclError(f"a {kinds[0].DESCRIPTION} has no topics, frames and clocks to choose", path=sources[0])
    report: ConversionReport = kinds[0].convert(sources, Path(output), **options)
    return report


def format_of(path: Path) -> ModuleType:
    """The module that reads a raw log. Raises MclError if there is none, for a map, and for what `convert` wrote."""
    head = b"" if path.is_dir() else read_head(path, HEAD)
    if is_beesoft(head):
        raise MclError("this is a beesoft map, not a log", "give it with --map", path=path)
    for kind in formats():
        if kind.sniff(path, head):
            return kind
    if head.startswith(b"\x89MCAP"):
        raise MclError(
            "mcl convert made this file", "mcl localize reads it as it is, with --map if it has none", path=path
        )
    known = ", ".join(kind.DESCRIPTION for kind in formats())
    if path.is_dir():
        raise MclError("this folder is no bag: it has no metadata.yaml", f"known: {known}", path=path)
    begin = head.split(b"\n", 1)[0][:40].decode("ascii", errors="replace")
    raise MclError(f"a log of no known format, beginning {begin!r}", f"known: {known}, MCAP", path=path)
