"""How commands lay out what they say: one fact a line, values in a column."""

from __future__ import annotations

import shlex
import shutil
import sys
from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline import console
from pipeline.printable import one_line

if TYPE_CHECKING:
    from pipeline.export.run import Run


def facts(title: str, rows: Sequence[tuple[str, str]]) -> str:
    """A title, and below it names and values, aligned."""
    width = max(len(name) for name, _ in rows)
    return "\n".join([one_line(title), *(f"  {name:<{width}}  {one_line(value)}" for name, value in rows)])


def columns(title: str, rows: Sequence[Sequence[str]], heading: Sequence[str] = ()) -> str:
    """A title, and below it texts in columns as wide as their longest; numbers (and units) to the right, words left."""
    right = [all(cell[:1] in "-0123456789" for cell in column) for column in zip(*rows, strict=True)]
    rows = [[one_line(cell) for cell in row] for row in rows]
    shown = [heading, *rows] if heading else rows
    widths = [max(map(len, column)) for column in zip(*shown, strict=True)]
    lines = [
        "  ".join(f"{cell:>{w}}" if r else f"{cell:<{w}}" for cell, w, r in zip(row, widths, right, strict=True))
        for row in shown
    ]
    return "\n".join([one_line(title), *(f"  {line}".rstrip() for line in lines)])


def percent(share: float) -> str:
    """A share of one, in percent."""
    return f"{100 * share:.0f} %"


def look_at(recording: Path) -> str:
    """The line that opens a recording, to be pasted into a shell."""
    return f"look at it:  {shlex.join([_viewer(), str(recording)])}"


def note_damage(runs: Iterable[Run]) -> None:
    """A line for every recording that is not whole."""
    for run in runs:
        if run.told.damage:
            console.note(f"note: {run.told.path}: {run.told.damage}")


def _viewer() -> str:
    """How to call rerun's viewer from here: it is installed beside this Python, which need not be on the PATH."""
    beside = Path(sys.executable).with_name("rerun")
    if shutil.which("rerun") or not beside.exists():
        return "rerun"
    here = Path.cwd()
    return str(beside.relative_to(here) if beside.is_relative_to(here) else beside)
