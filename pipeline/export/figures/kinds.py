"""Which figures there are, and one of them as a file."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import TYPE_CHECKING

from pipeline.errors import MclError
from pipeline.export.figures.belief import belief, headings, undecided
from pipeline.export.figures.errors import error
from pipeline.export.figures.paper import Paper
from pipeline.export.figures.sensor import sensor
from pipeline.export.figures.ways import compare, path
from pipeline.export.run import Run

if TYPE_CHECKING:
    from matplotlib.figure import Figure

OF_A_RUN: Mapping[str, Callable[[Run, Paper], Figure]] = {"path": path, "error": error, "sensor": sensor}
OF_AN_INSTANT: Mapping[str, Callable[[Run, int, Paper], Figure]] = {"belief": belief, "headings": headings}
OF_RUNS: Mapping[str, Callable[[Sequence[Run], Paper], Figure]] = {"compare": compare}
FIGURES = (*OF_A_RUN, *OF_AN_INSTANT, *OF_RUNS)
"""By what ``--figure`` calls them."""


def draw(kind: str, runs: Sequence[Run], at: float | None, paper: Paper) -> Figure:
    """The figure of that kind, within ``paper.styled()``; ``at``: the instant, s since the first scan, if it is of one.

    Raises MclError for a time outside of the recording and for runs that cannot be compared.
    """
    if kind in OF_RUNS:
        return OF_RUNS[kind](runs, paper)
    (run,) = runs
    if kind in OF_AN_INSTANT:
        return OF_AN_INSTANT[kind](run, undecided(run) if at is None else run.at(at).row, paper)
    return OF_A_RUN[kind](run, paper)


def write_figure(kind: str, runs: Sequence[Run], at: float | None, paper: Paper, output: Path) -> None:
    """Draw it into a PDF, an SVG, a PNG or a JPEG. Raises MclError as ``draw``."""
    if kind not in FIGURES:
        raise MclError(f"there is no figure {kind!r}", f"name one of {', '.join(FIGURES)}")
    with paper.styled():
        paper.save(draw(kind, runs, at, paper), output, f"{runs[0].name}: {kind}")
