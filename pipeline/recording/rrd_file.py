"""Reads the chunks of an .rrd, also of one that was cut short."""

from __future__ import annotations

import struct
import tempfile
import warnings
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from rerun.chunk import RrdReader

from pipeline.errors import MclError
from pipeline.logs import mcap_file

MAGIC = b"RRF2"
_STREAM_HEADER = 12  # bytes: magic, version, options
_MESSAGE_HEADER = struct.Struct("<QQ")  # kind, length of what follows


@dataclass(frozen=True)
class RrdFile:
    """What could be read: ``chunks`` in the file's order; ``damage`` says in one line what is missing, or is empty."""

    application_id: str
    recording_id: str
    chunks: tuple[Any, ...]
    damage: str = ""


def read_rrd(path: Path) -> RrdFile:
    """All chunks of the first recording in a file, or those before the place where it was cut.

    Raises MclError if the file does not exist, is no .rrd, or holds no recording.
    """
    if not path.is_file():
        raise MclError("no such recording", "name a run's folder, or `latest`", path=path)
    with path.open("rb") as file:
        magic = file.read(len(MAGIC))
    if magic == mcap_file.MAGIC[: len(MAGIC)]:
        raise MclError("this is a log, and a run is wanted", "mcl localize makes a run of it", path=path)
    if magic != MAGIC:
        hint = "expected a run as mcl localize leaves it; logs become one by mcl convert, then mcl localize"
        raise MclError("not a rerun recording", hint, path=path)
    size = path.stat().st_size
    whole = _end_of_last_whole_message(path, size)
    if whole == size:
        return _read(path, path)
    with tempfile.TemporaryDirectory() as folder:  # rerun refuses a file that ends within a message
        copy = Path(folder) / path.name
        with path.open("rb") as file:
            copy.write_bytes(file.read(whole))
        return _read(copy, path, "cut short within a write; all before it is read")


def _read(path: Path, named: Path, damage: str = "") -> RrdFile:
    try:
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            reader = RrdReader(path)
            recordings = reader.recordings()
            chunks = tuple(reader.stream().to_chunks()) if recordings else ()
    except Exception as error:
        raise MclError(f"this recording cannot be read: {error}", path=named) from error
    if not recordings:
        raise MclError("the file holds no recording", "was the run stopped before its first scan?", path=named)
    if not damage and any("footer" in str(warning.message) for warning in caught):
        damage = "no footer: the run was stopped before it could close its recording; all that it wrote is read"
    return RrdFile(recordings[0].application_id, recordings[0].recording_id, chunks, damage)


def _end_of_last_whole_message(path: Path, size: int) -> int:
    place = _STREAM_HEADER
    with path.open("rb") as file:
        while place + _MESSAGE_HEADER.size <= size:
            file.seek(place)
            kind, length = _MESSAGE_HEADER.unpack(file.read(_MESSAGE_HEADER.size))
            end = place + _MESSAGE_HEADER.size + length
            if kind == 0 and end <= size:
                return size  # the footer: what follows belongs to it
            if end > size:
                return place
            place = end
    return place
