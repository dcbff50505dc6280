"""Raw text inputs, plain or gzipped: what they are is decided by their content, not by their names.

What all text logs have in common: lines that are left out while they are few, and stamps that must not run backwards.
"""

from __future__ import annotations

import bz2
import gzip
import hashlib
import io
import zlib
from collections.abc import Sequence
from contextlib import suppress
from pathlib import Path
from types import ModuleType
from typing import IO

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import MclError
from pipeline.outputs import replacing

GZIP_MAGIC, BZIP2_MAGIC = b"\x1f\x8b", b"BZh"
_BLOCK = 1 << 16
MOST = 1_000_000_000
"""Bytes that a packed file may hold: a small one can be made to fill any memory."""
MIN_STEP = 100_000  # ns between stamps that had to be repaired
FEW = 0.01
"""Share of a log's lines that may be left out, for they say nothing that can be used."""


def read_bytes(path: Path) -> bytes:
    """The whole content, unpacked if it is gzip; MclError if it is missing, empty, cut or only claims to be gzip."""
    try:
        data = Path(path).read_bytes()
    except FileNotFoundError as error:
        raise MclError("no such file", path=path) from error
    except OSError as error:
        raise MclError(f"cannot be read: {error.strerror}", path=path) from error
    if data.startswith(GZIP_MAGIC):
        try:
            data = _unpacked(gzip, data, path)
        except (EOFError, zlib.error, gzip.BadGzipFile) as error:
            raise MclError("this gzip file is cut or damaged", path=path) from error
    elif Path(path).suffix == ".gz" and data:
        raise MclError("named .gz but this is not gzip", "unpacked already? then rename it", path=path)
    if not data.strip():
        raise MclError("this file is empty", path=path)
    return data


def read_head(path: Path, size: int) -> bytes:
    """The first bytes of a file, unpacked if it is gzip; MclError as for ``read_bytes``."""
    try:
        with Path(path).open("rb") as file:
            head = file.read(size)
            if head.startswith(GZIP_MAGIC):
                file.seek(0)
                with gzip.open(file) as packed:
                    head = packed.read1(size)
    except (EOFError, zlib.error, gzip.BadGzipFile) as error:
        raise MclError("this gzip file is cut or damaged", path=path) from error
    except FileNotFoundError as error:
        raise MclError("no such file", path=path) from error
    except OSError as error:
        raise MclError(f"cannot be read: {error.strerror}", path=path) from error
    if not head.strip():
        raise MclError("this file is empty", path=path)
    return head


def read_log_bytes(path: Path) -> tuple[bytes, list[str]]:
    """The content of a log, unpacked if it is gzip or bzip2, and remarks: of a packed file that is cut what is there.

    Raises MclError as ``read_bytes``, and where nothing can be unpacked.
    """
    packed = b""
    with suppress(OSError):  # which read_bytes tells better
        packed = Path(path).read_bytes()
    for magic, kind, decompressor in ((GZIP_MAGIC, "gzip", gzip), (BZIP2_MAGIC, "bzip2", bz2)):
        if packed.startswith(magic):
            remarks = []
            try:
                data = _unpacked(decompressor, packed, path)
            except (EOFError, OSError, zlib.error, ValueError):
                data = _as_far_as_it_goes(decompressor.open(io.BytesIO(packed)))
                remarks.append(f"this {kind} file is cut or damaged: read as far as it goes")
            if not data.strip():
                raise MclError(f"this {kind} file is cut or damaged" if remarks else "this file is empty", path=path)
            return data, remarks
    return read_bytes(path), []


def _unpacked(kind: ModuleType, packed: bytes, path: Path) -> bytes:
    """All of a file that is packed in this ``kind``, unless it unpacks to far more than any log."""
    with kind.open(io.BytesIO(packed)) as file:
        data: bytes = file.read(MOST + 1)
    if len(data) > MOST:
        raise MclError(f"this file unpacks to more than {MOST / 1e9:g} GB, which no log has", path=path)
    return data


def _as_far_as_it_goes(file: IO[bytes]) -> bytes:
    blocks, size = [], 0
    with file, suppress(EOFError, OSError, zlib.error, ValueError):
        while size < MOST and (block := file.read1(_BLOCK)):  # type: ignore[attr-defined]
            blocks.append(block)
            size += len(block)
    return b"".join(blocks)


def write_text(path: Path, text: str) -> None:
    """Writes ASCII text whole or not at all, gzipped if the name ends in .gz (same text, same bytes)."""
    data = text.encode("ascii")
    with replacing(path) as temporary:
        temporary.write_bytes(gzip.compress(data, mtime=0) if Path(path).suffix == ".gz" else data)


def measured(values: Sequence[float], farthest: float) -> bool:
    """Whether all values are finite, and none is farther than ``farthest`` from zero.

    Where neither their sum nor the largest is, no other can be much farther: that is quick to see of a whole scan.
    """
    if abs(sum(values)) <= farthest and (not values or max(values) <= farthest):
        return True
    return all(abs(value) <= farthest for value in values)


def settle(errors: Sequence[MclError], lines: int, last: int | None) -> list[str]:
    """Remarks on the lines that are left out, each by what is wrong with it; ``last``: a line whose end is missing.

    Raises the first of the errors if they are more than a few of the ``lines``.
    """
    cut = [error for error in errors if error.line == last]
    rest = [error for error in errors if error.line != last]
    if len(rest) > FEW * lines or (errors and len(cut) == lines):
        raise errors[0]
    remarks = []
    if rest:
        named = "; ".join(f"line {error.line}: {error.message}" for error in rest[:3])
        more = f"; and {len(rest) - 3:,} more" if len(rest) > 3 else ""
        remarks.append(f"{len(rest):,} of {lines:,} lines left out: {named}{more}")
    if cut:
        remarks.append(f"the last line, {last}, is cut: left out")
    return remarks


def begins_anew(lines: Sequence[int]) -> str:
    """One line that says where a log's clock begins anew."""
    named = ", ".join(map(str, lines[:3])) + (f" and {len(lines) - 3} more" if len(lines) > 3 else "")
    return (
        f"the clock begins anew at line {named}: a new stretch, 10 s after the one before, and nobody saw the way there"
    )


def in_order(stamps: NDArray[np.int64]) -> NDArray[np.int64]:
    """Increasing stamps (n,) in ns for lines in the order of the file, as near to the given ones as can be.

    The order of the lines is the truth where the stamps run backwards: sorted by stamp, a robot's path jumps to and
    fro. So the stamps give way: isotonic regression (the increasing sequence with the least sum of squared changes),
    whose ties are then spread by 0.1 ms. Stamps that increase already come back as they are.
    """
    if len(stamps) < 2 or (np.diff(stamps) > 0).all():
        return stamps
    from scipy.optimize import isotonic_regression

    result = np.rint(isotonic_regression((stamps - stamps[0]).astype(np.float64)).x).astype(np.int64)
    for i in range(1, len(result)):
        result[i] = max(result[i], result[i - 1] + MIN_STEP)
    return result + stamps[0]


def sha256(path: Path) -> str:
    """Checksum of the file as it lies on disk."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
