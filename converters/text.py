"""Raw text inputs, plain or gzipped: what they are is decided by their content, not by their names."""

from __future__ import annotations

import gzip
import hashlib
import zlib
from pathlib import Path

from pipeline.errors import MclError
from pipeline.outputs import replacing

GZIP_MAGIC = b"\x1f\x8b"


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
            data = gzip.decompress(data)
        except (EOFError, zlib.error, gzip.BadGzipFile) as error:
            raise MclError("this gzip file is cut or damaged", path=path) from error
    elif Path(path).suffix == ".gz" and data:
        raise MclError("named .gz but this is not gzip", "unpacked already? then rename it", path=path)
    if not data.strip():
        raise MclError("this file is empty", path=path)
    return data


def write_text(path: Path, text: str) -> None:
    """Writes ASCII text whole or not at all, gzipped if the name ends in .gz (same text, same bytes)."""
    data = text.encode("ascii")
    with replacing(path) as temporary:
        temporary.write_bytes(gzip.compress(data, mtime=0) if Path(path).suffix == ".gz" else data)


def sha256(path: Path) -> str:
    """Checksum of the file as it lies on disk."""
    with Path(path).open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()
