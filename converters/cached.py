"""Raw logs and bags that are converted on the way to a command, and kept in the cache by what they hold."""

from __future__ import annotations

import hashlib
import time
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import converters
from converters.text import sha256
from pipeline import logs
from pipeline.errors import MclError
from pipeline.logs import reader
from pipeline.logs.mcap_file import A_RUN, MAGIC, RRD_MAGIC
from pipeline.logs.messages import Log
from pipeline.logs.recorded import Names
from pipeline.maps.occupancy_grid import OccupancyGrid

_SUFFIXES = (".gz", ".bz2", ".log", ".clf", ".bag", ".active", ".db3", ".mcap", ".zstd", ".txt")


@dataclass(frozen=True)
class Converted:
    """A log that was converted: its ``name``, the ``mcap`` that it became, what it was, and its own checksum."""

    name: str
    mcap: Path
    format: str
    sha256: str


@dataclass(frozen=True)
class Read:
    """A log that was read, by way of ``mcap`` if it was converted, from ``format``; both None for an .mcap."""

    log: Log
    mcap: Path | None = None
    format: str | None = None


def read(path: Path, grid: OccupancyGrid | None = None, names: Names | None = None) -> Read:
    """Any log: a raw log, or a bag, is converted first, into the cache. ``grid``: instead of the log's own map.

    Raises MclError for whatever is wrong in it.
    """
    if (into := converted(path, names)) is None:
        return Read(reader.read_log(path, grid, names))
    log = reader.read_log(into.mcap, grid)
    log = replace(log, name=into.name, path=path, sha256=into.sha256, converted=into.mcap)
    return Read(log, into.mcap, into.format)


def read_log(path: Path | str, grid: OccupancyGrid | None = None, names: Names | None = None) -> Log:
    """Any log: an .mcap or a ROS 2 recording as it is; a raw log or a bag is converted first, into the cache.

    ``grid``: the map, instead of the log's own. ``names``: topics and frames to read where a recording leaves a choice,
    and what it lacks. What was left out or taken otherwise is in ``log.remarks``.
    Raises MclError for whatever is wrong in it.
    """
    return read(Path(path), grid, names).log


def converted(path: Path, names: Names | None = None) -> Converted | None:
    """What a raw log or a bag becomes, from the cache or made now; None for an .mcap, which is read as it is.

    Raises MclError for a run, and whatever is wrong in the log.
    """
    if path.is_dir():
        if any(path.glob("*.rrd")):
            raise MclError(*A_RUN, path=path)
    else:
        head = _head(path)
        if head.startswith(RRD_MAGIC):
            raise MclError(*A_RUN, path=path)
        if head.startswith(MAGIC):
            return None
    from pipeline.maps.range_table import cache_dir  # here: numba, behind it, loads slowly

    kind = converters.format_of(path)
    content = _content(path)
    key = hashlib.sha256(f"{content} {names!r} {_version()}".encode()).hexdigest()
    mcap = cache_dir() / "logs" / f"{key[:32]}.mcap"
    if not _whole(mcap):
        with suppress(OSError):
            mcap.parent.mkdir(parents=True, exist_ok=True)
            _make_room(mcap.parent)
        converters.convert([path], mcap, names=names)
    with suppress(OSError):
        mcap.touch()
    return Converted(_name(path), mcap, kind.DESCRIPTION, content)


def _head(path: Path) -> bytes:
    try:
        with path.open("rb") as file:
            return file.read(len(MAGIC))
    except FileNotFoundError as error:
        raise MclError("no such file", path=path) from error
    except OSError as error:
        raise MclError(f"cannot be read: {error.strerror}", path=path) from error


def _whole(mcap: Path) -> bool:
    """Whether a file of the cache is there and has both its ends."""
    try:
        with mcap.open("rb") as file:
            begin = file.read(len(MAGIC))
            file.seek(-len(MAGIC), 2)
            return begin == MAGIC and file.tell() > 0 and file.read() == MAGIC
    except OSError:
        return False


def _make_room(folder: Path) -> None:
    from pipeline.maps.range_table import UNUSED

    for old in folder.glob("*.mcap"):
        if time.time() - old.stat().st_mtime > UNUSED:
            old.unlink()


def _content(path: Path) -> str:
    """The checksum of a file, or of all files in a folder."""
    if path.is_file():
        return sha256(path)
    parts = "\n".join(f"{part.name} {sha256(part)}" for part in sorted(path.iterdir()) if part.is_file())
    return hashlib.sha256(parts.encode()).hexdigest()


@cache
def _version() -> str:
    """Of the code that converts: what another one made is made again."""
    digest = hashlib.sha256()
    for package in (converters, logs):
        for source in sorted(Path(package.__path__[0]).glob("*.py")):
            digest.update(source.read_bytes())
    return digest.hexdigest()


def _name(path: Path) -> str:
    name = path.name
    while (suffix := Path(name).suffix) in _SUFFIXES:
        name = name.removesuffix(suffix)
    return name or path.name
