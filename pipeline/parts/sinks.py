"""Sinks and readers of a user's own: where results go, and where logs come from."""

from __future__ import annotations

from importlib.metadata import entry_points
from pathlib import Path
from types import ModuleType, TracebackType
from typing import Any, Final, Self

from pipeline.errors import MclError
from pipeline.parts.loading import check_name, load, module_of, told
from pipeline.parts.own import Own
from pipeline.parts.roles import Method, Role

SINK: Final = Role("sink", (Method("log", ("step",)),), {}, made_of=("grid", "laser", "config"))
READERS: Final = "mcl_replay.reader"
READER_HAS: Final = ("FORMAT", "DESCRIPTION", "sniff", "convert")


class OwnSink:
    """A function of a step, or an object with a method ``log``; and ``close``, which is called when the run is over.

    ``name`` as that of any part. Raises MclError if there is none, or it fails.
    """

    def __init__(self, name: str, **offered: Any) -> None:
        try:
            known = check_name(SINK, name)
        except ValueError as error:
            raise MclError(f"--sink {name}: {error}") from error
        part = load(SINK, known)
        self._own = Own(part, part.settled({}), **offered)

    def log(self, step: Any) -> None:
        """Take note of a step."""
        self._own(step)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, kind: type[BaseException] | None, error: BaseException | None, at: TracebackType | None) -> None:
        if (close := self._own.other("close")) is not None:
            close()


def reader_in(path: Path) -> ModuleType:
    """A module that reads a raw format, as those in ``converters`` do. Raises MclError if it is none."""
    module: ModuleType = module_of(path)
    if missing := _missing(module):
        raise MclError(f"it has no {missing}", "a reader is like converters/cmu.py", path=path)
    return module


def installed_readers() -> list[ModuleType]:
    """The readers that installed packages offer. Raises MclError for one that cannot be loaded, or is none."""
    found = []
    for point in entry_points(group=READERS):
        try:
            module = point.load()
        except Exception as error:
            raise MclError(f"the reader {point.name} of an installed package fails: {told(error)}") from error
        if missing := _missing(module):
            raise MclError(f"the reader {point.name} has no {missing}", f"see the package of {point.value}")
        found.append(module)
    return found


def _missing(module: ModuleType) -> str:
    return " and no ".join(name for name in READER_HAS if not hasattr(module, name))
