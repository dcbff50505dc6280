"""Files to be written: what would go wrong is known before the work, and they appear when they are complete."""

from __future__ import annotations

import os
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from pipeline.errors import MclError


def check_output(path: Path, force: bool) -> None:
    """Raises MclError if something is there that must not be replaced, or nothing can be written there."""
    refuse_existing(path, force)
    if not path.parent.is_dir():
        raise MclError("the folder to write to does not exist", path=path.parent)
    with told(path), tempfile.TemporaryFile(dir=path.parent):
        pass


def check_folder(folder: Path, names: Sequence[str], force: bool) -> None:
    """Raises MclError if files of these names cannot be written into the folder, which need not be there yet."""
    if folder.exists() and not folder.is_dir():
        raise MclError("this is a file, not a folder to write to", path=folder)
    for name in names:
        refuse_existing(folder / name, force)
    there = next(place for place in (folder, *folder.absolute().parents) if place.exists())
    with told(folder), tempfile.TemporaryFile(dir=there):
        pass


def refuse_existing(path: Path, force: bool) -> None:
    """Raises MclError if something is there that must not be replaced."""
    if path.is_dir():
        raise MclError("this is a folder, not a file to write", path=path)
    if path.exists() and not force:
        raise MclError("this file exists already", "--force replaces it", path=path)


def check_suffix(path: Path, suffix: str, expected: str) -> None:
    """Raises MclError, saying what was expected, unless the name tells what will be in the file."""
    if path.suffix.lower() != suffix:
        raise MclError(expected, path=path)


@contextmanager
def replacing(path: Path) -> Iterator[Path]:
    """A name beside ``path`` to write to: it takes that one's place when it is complete, and goes if it is not."""
    path = Path(path)
    partial = path.with_name(f".{path.stem}.{os.getpid()}.part{path.suffix}")  # the suffix may decide the format
    try:
        with told(path):
            path.parent.mkdir(parents=True, exist_ok=True)
            yield partial
            partial.replace(path)
    finally:
        with suppress(OSError):
            partial.unlink(missing_ok=True)


@contextmanager
def told(path: Path) -> Iterator[None]:
    """Whatever hinders the writing is told of ``path``: nobody knows a temporary file by its name."""
    try:
        yield
    except OSError as error:
        raise MclError(f"cannot be written: {error.strerror or error}", path=path) from error
