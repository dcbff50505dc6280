"""Thousands of messages of one shape, seen as the rows of one numpy array instead of one by one.

With the same frame names and the same number of beams every CDR message of a type has the same bytes in
the same places: its fields are the columns of a structured array. ``unpack`` checks that this holds
and says None where it does not; rosbags then decodes message by message.
"""

from __future__ import annotations

import struct
from collections.abc import Callable, Mapping, Sequence
from typing import Any, Final

import numpy as np
from numpy.typing import NDArray

Fields = tuple[tuple[str, str], ...]
Rows = NDArray[Any]

STRING, FLOATS, BYTES = "string", "<f4[]", "i1[]"

_HEADER: Final[Fields] = (("sec", "<i4"), ("nanosec", "<u4"), ("frame_id", STRING))
_POSE: Final[Fields] = (("position", "3<f8"), ("orientation", "4<f8"))

POSE_STAMPED: Final[Fields] = (*_HEADER, *_POSE)
POSE_WITH_COVARIANCE: Final[Fields] = (*_HEADER, *_POSE, ("covariance", "36<f8"))
ODOMETRY: Final[Fields] = (
    *_HEADER,
    ("child_frame_id", STRING),
    *_POSE,
    ("pose_covariance", "36<f8"),
    ("twist", "6<f8"),
    ("twist_covariance", "36<f8"),
)
LASER_SCAN: Final[Fields] = (
    *_HEADER,
    *((name, "<f4") for name in ("angle_min", "angle_max", "angle_increment", "time_increment", "scan_time")),
    ("range_min", "<f4"),
    ("range_max", "<f4"),
    ("ranges", FLOATS),
    ("intensities", FLOATS),
)
IMU: Final[Fields] = (
    *_HEADER,
    ("orientation", "4<f8"),
    ("orientation_covariance", "9<f8"),
    ("angular_velocity", "3<f8"),
    ("angular_velocity_covariance", "9<f8"),
    ("linear_acceleration", "3<f8"),
    ("linear_acceleration_covariance", "9<f8"),
)
ONE_TRANSFORM: Final[Fields] = (("transforms", "<u4"), *_HEADER, ("child_frame_id", STRING), *_POSE)
OCCUPANCY_GRID: Final[Fields] = (
    *_HEADER,
    ("load_sec", "<i4"),
    ("load_nanosec", "<u4"),
    ("resolution", "<f4"),
    ("width", "<u4"),
    ("height", "<u4"),
    *_POSE,
    ("data", BYTES),
)

_LITTLE_ENDIAN = 0x0100  # the encapsulation header 00 01, read as a little-endian number
_START = 4  # the body begins after that header, and alignment counts from there


def unpack(messages: Sequence[bytes], fields: Fields) -> Rows | None:
    """The messages as rows with one column per field, or None if they are not all of one shape.

    Strings come as bytes without their NUL; a field of variable length that is empty has no column.
    """
    first = messages[0]
    size = len(first)
    if any(len(message) != size for message in messages):
        return None

    def length_of(_: str, offset: int) -> int:
        (length,) = struct.unpack_from("<I", first, offset)
        if length > size:
            raise ValueError("longer than the message")
        return int(length)

    try:
        names, formats, offsets, end = _place(fields, length_of)
    except (struct.error, ValueError):
        return None
    if not 0 <= size - end <= 3:  # some writers pad to four bytes
        return None
    dtype = np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": size})
    rows: Rows = np.frombuffer(b"".join(messages), dtype=dtype)
    if ((rows["encapsulation"] & 0xFFFF) != _LITTLE_ENDIAN).any():
        return None
    fixed = [n for name, kind in fields if kind == STRING for n in (name, _length(name)) if n in names]
    fixed += [_length(name) for name, kind in fields if kind in (FLOATS, BYTES)]
    return rows if all((rows[name] == rows[name][0]).all() for name in fixed) else None


def blank(count: int, fields: Fields, lengths: dict[str, int] | None = None, **strings: str) -> Rows:
    """Rows of zeros to be filled in: the given strings in place, ``lengths`` for the sequences."""
    texts = {name: text.encode() + b"\0" for name, text in strings.items()}
    sizes = {name: len(text) for name, text in texts.items()} | (lengths or {})
    names, formats, offsets, end = _place(fields, lambda name, _: sizes.get(name, 0))
    dtype = np.dtype({"names": names, "formats": formats, "offsets": offsets, "itemsize": end})
    rows: Rows = np.zeros(count, dtype=dtype)
    rows["encapsulation"] = _LITTLE_ENDIAN
    for name, length in sizes.items():
        rows[_length(name)] = length
    for name, text in texts.items():
        rows[name] = text
    return rows


def pack(rows: Rows) -> list[bytes]:
    """Every row as the bytes of its message."""
    data, size = rows.tobytes(), rows.dtype.itemsize
    return [data[i : i + size] for i in range(0, len(data), size)]


def set_stamps(rows: Rows, stamps: NDArray[np.int64]) -> None:
    """Fills in the headers' stamps, nanoseconds."""
    rows["sec"], rows["nanosec"] = np.divmod(stamps, 1_000_000_000)


def pack_sequence(stamp: int, frame: str, items: NDArray[np.float64]) -> bytes:
    """A header and a sequence of items that are so many doubles each, (n, doubles): a PoseArray, for one."""
    seconds, nanoseconds = divmod(stamp, 1_000_000_000)
    name = frame.encode() + b"\0"
    head = struct.pack("<IiII", _LITTLE_ENDIAN, seconds, nanoseconds, len(name)) + name
    head = head.ljust(_aligned(len(head), 4), b"\0") + struct.pack("<I", len(items))
    if not len(items):
        return head
    return head.ljust(_aligned(len(head), 8), b"\0") + np.ascontiguousarray(items, "<f8").tobytes()


def pack_diagnostics(stamp: int, level: int, name: str, message: str, values: Mapping[str, str]) -> bytes:
    """A DiagnosticArray with one status."""
    seconds, nanoseconds = divmod(stamp, 1_000_000_000)
    parts = bytearray(struct.pack("<IiI", _LITTLE_ENDIAN, seconds, nanoseconds))

    def text(said: str) -> None:
        data = said.encode() + b"\0"
        parts.extend(b"\0" * (_aligned(len(parts), 4) - len(parts)) + struct.pack("<I", len(data)) + data)

    def count(n: int) -> None:
        parts.extend(b"\0" * (_aligned(len(parts), 4) - len(parts)) + struct.pack("<I", n))

    text("")  # the header's frame
    count(1)
    parts.append(level)
    for said in (name, message, ""):  # the last: which hardware
        text(said)
    count(len(values))
    for key, value in values.items():
        text(key)
        text(value)
    return bytes(parts)


def stamp_of(message: bytes) -> int:
    """The stamp of any message that begins with a header, nanoseconds."""
    seconds, nanoseconds = struct.unpack_from(_byte_order(message) + "iI", message, _START)
    return int(seconds) * 1_000_000_000 + int(nanoseconds)


def frame_of(message: bytes) -> str:
    """The frame of any message that begins with a header."""
    (length,) = struct.unpack_from(_byte_order(message) + "I", message, _START + 8)
    return message[_START + 12 : _START + 12 + length].rstrip(b"\0").decode(errors="replace")


def stamps_of(rows: Rows) -> NDArray[np.int64]:
    """The headers' stamps, nanoseconds."""
    return rows["sec"].astype(np.int64) * 1_000_000_000 + rows["nanosec"]


def _place(
    fields: Fields, length_of: Callable[[str, int], int]
) -> tuple[list[str], list[np.dtype[Any]], list[int], int]:
    """Where every field lies: names, formats, offsets, and where the message ends."""
    names, offsets, end = ["encapsulation"], [0], _START
    formats: list[np.dtype[Any]] = [np.dtype("<u4")]
    for name, kind in fields:
        if kind in (STRING, FLOATS, BYTES):
            end = _aligned(end, 4)
            length = length_of(name, end)
            names.append(_length(name))
            formats.append(np.dtype("<u4"))
            offsets.append(end)
            end += 4
            if length == 0:
                continue
            kind = f"S{length}" if kind == STRING else f"({length},){kind.removesuffix('[]')}"
        dtype: np.dtype[Any] = np.dtype(kind)
        end = _aligned(end, dtype.base.alignment)
        names.append(name)
        formats.append(dtype)
        offsets.append(end)
        end += dtype.itemsize
    return names, formats, offsets, end


def _byte_order(message: bytes) -> str:
    return "<" if message[1] & 1 else ">"


def _aligned(offset: int, size: int) -> int:
    return _START + -(-(offset - _START) // size) * size


def _length(name: str) -> str:
    return f"{name}_length"
