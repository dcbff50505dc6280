"""The only place that knows stdout and stderr: people read stderr, programs read stdout.

Progress and tables go to stderr; ``--json`` and final paths go to stdout. Colours follow NO_COLOR and whether
somebody is looking. What a terminal might obey is written out, for names are other people's. rich is imported when the
first thing is shown, so that ``--help`` stays quick.
"""

from __future__ import annotations

import json
import sys
import time
from collections.abc import Iterable, Iterator, Sequence
from typing import Any, TypeVar

from pipeline.printable import one_line, printable

T = TypeVar("T")

EVERY = 5.0
"""Seconds between two lines of progress, at least."""
QUIET, NORMAL, VERBOSE = 0, 1, 2
_volume = NORMAL


def set_volume(volume: int) -> None:
    """How much is said from now on: ``QUIET`` errors and results, ``NORMAL`` notes too, ``VERBOSE`` details too."""
    global _volume
    _volume = volume


def is_quiet() -> bool:
    """Whether nothing but errors and results is wanted: no progress either."""
    return _volume == QUIET


def note(text: str) -> None:
    """A line for people, on stderr."""
    if not is_quiet():
        print(printable(text), file=sys.stderr, flush=True)


def detail(text: str) -> None:
    """A line on stderr for those who asked for more with --verbose."""
    if _volume >= VERBOSE:
        note(text)


def error(text: str) -> None:
    """The one line that bad input gets, on stderr."""
    prefix = "error:"
    if _colour():
        prefix = f"\x1b[1;31m{prefix}\x1b[0m"
    print(prefix, one_line(text), file=sys.stderr, flush=True)


def result(text: str) -> None:
    """A line for programs (and the last one for people), on stdout."""
    print(printable(text), flush=True)


def emit_json(value: Any) -> None:
    """A JSON document on stdout; NaN and infinities become null."""
    print(json.dumps(_finite(value), indent=2, default=str), flush=True)


def table(title: str, columns: Sequence[str], rows: Iterable[Sequence[str]], *, stdout: bool = False) -> None:
    """A table for people: the first column left, the others right. On stderr unless it is the command's answer."""
    from rich.console import Console
    from rich.table import Table
    from rich.text import Text

    # As texts, in which nothing is markup: names are other people's.
    sheet = Table(title=Text(printable(title), style="table.title"), title_justify="left")
    for i, column in enumerate(columns):
        sheet.add_column(column, justify="left" if i == 0 else "right", overflow="fold")
    for row in rows:
        sheet.add_row(*(Text(one_line(cell)) for cell in row))
    stream = sys.stdout if stdout else sys.stderr
    width = None if stream.isatty() else 120
    Console(file=stream, width=width, highlight=False).print(sheet)


def progress(items: Iterable[T], total: int, label: str) -> Iterator[T]:
    """Passes the items on and shows how far they are: a bar where somebody looks at stderr, else a line now and then.

    Lines come EVERY seconds at most, for a log of a build or a notebook; what is done sooner says nothing.
    """
    if is_quiet():
        yield from items
        return
    if not sys.stderr.isatty():
        yield from _in_lines(items, total, label)
        return
    from rich.console import Console
    from rich.progress import BarColumn, Progress, TextColumn, TimeRemainingColumn

    columns = (TextColumn("{task.description}"), BarColumn(), TextColumn("{task.completed}/{task.total}"))
    with Progress(*columns, TimeRemainingColumn(), console=Console(file=sys.stderr), transient=True) as bar:
        yield from bar.track(items, total=total, description=label)


def _in_lines(items: Iterable[T], total: int, label: str) -> Iterator[T]:
    begun = said = time.monotonic()
    for done, item in enumerate(items):
        now = time.monotonic()
        if now - said >= EVERY:
            said = now
            # The first ones say little of the rest: while they are worked on, kernels are compiled.
            left = f", about {(now - begun) * (total - done) / done:.0f} s left" if 10 * done > total else ""
            note(f"{label}: {done:,} of {total:,}{left}")
        yield item


def _colour() -> bool:
    import os

    return sys.stderr.isatty() and not os.environ.get("NO_COLOR") and os.environ.get("TERM") != "dumb"


def _finite(value: Any) -> Any:
    if isinstance(value, float) and (value != value or value in (float("inf"), float("-inf"))):
        return None
    if isinstance(value, dict):
        return {k: _finite(v) for k, v in value.items()}
    if isinstance(value, list | tuple):
        return [_finite(v) for v in value]
    if hasattr(value, "tolist"):
        return _finite(value.tolist())
    return value
