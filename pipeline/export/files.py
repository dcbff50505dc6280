"""Writes whatever a file's suffix asks for; the file appears when it is complete."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

from PIL import Image

from pipeline.errors import MclError
from pipeline.export.figures.kinds import FIGURES, OF_AN_INSTANT, OF_RUNS, write_figure
from pipeline.export.figures.paper import VECTORS, Paper
from pipeline.export.movies import CAMERAS, MOVIES, Film, Progress, check_writable, movie
from pipeline.export.pictures import moment, sheet
from pipeline.export.run import Run, key_moments
from pipeline.export.sizes import Size, size_of
from pipeline.export.tables import TABLES, particles_table, scans_table, write_table
from pipeline.export.theme import theme
from pipeline.logs.tum import write_tum
from pipeline.outputs import check_output, replacing

PICTURES = (".png", ".jpg")
TRAJECTORY = ".tum"
KINDS = (*VECTORS, *PICTURES, *MOVIES, TRAJECTORY, *TABLES)
"""Suffixes that can be asked for."""
MOMENTS = "moments"
"""The figure that is a picture, not one for a paper: map, close-up, curves and legend at some moments."""

PICTURE_SIZE, VIDEO_SIZE, LOOP_SIZE = (1600, 900), (1280, 720), (960, 540)
VIDEO_FPS, LOOP_FPS = 20, 10  # a GIF or WebP of twice the pictures is twice as large
DPI = 300
"""Pixels an inch of a figure that becomes some: what printers ask for."""


@dataclass(frozen=True)
class Wishes:
    """How to export.

    ``figure``: one of FIGURES or ``moments``; if None what the suffix and the rest suggest. ``at``: seconds since
    the first scan, of ``moments`` a picture each, of several a sheet; ``particles``: the table of these; ``size``: as
    ``size_of`` has it, the usual one if None; ``dpi``: of a figure in pixels; ``theme``: one of THEMES. Of a
    movie ``speed``: how much quicker than it was, or "auto"; ``fps``: pictures per second; ``camera``: one of CAMERAS.
    """

    at: Sequence[float] = ()
    particles: bool = False
    size: str | tuple[int, int] | None = None
    speed: float | Literal["auto"] = 8.0
    fps: int | None = None
    figure: str | None = None
    dpi: int | None = None
    theme: str = "print"
    camera: str = "whole"


def check(output: Path, wishes: Wishes, *, runs: int = 1, force: bool = False) -> None:
    """Raises MclError for what would be known only after a while: a wrong suffix, a file that exists already."""
    kind = output.suffix.lower()
    if kind not in KINDS:
        raise MclError(f"the suffix says what to write: one of {', '.join(KINDS)}", path=output)
    if wishes.at and kind not in (*VECTORS, *PICTURES):
        raise MclError("--at asks for a picture, this is none", "name a .png or a .pdf", path=output)
    if wishes.figure and kind not in (*VECTORS, *PICTURES):
        raise MclError("--figure asks for a picture, this is none", "name a .pdf, a .svg or a .png", path=output)
    if wishes.particles and kind not in TABLES:
        raise MclError("--particles asks for a table, this is none", "name a .csv or a .parquet", path=output)
    theme(wishes.theme)
    if wishes.camera not in CAMERAS:
        raise MclError(f"there is no camera {wishes.camera!r}", f"name one of {', '.join(CAMERAS)}")
    figure = _figure(kind, wishes, runs)
    if runs > 1 and figure not in OF_RUNS:
        raise MclError("this is made of one run", "--figure compare is of several", path=output)
    if figure is not None:
        _check_figure(figure, output, wishes)
    elif wishes.dpi is not None:
        raise MclError("--dpi is for a figure", "with --size in pixels a picture is as large as it says", path=output)
    elif wishes.size is not None and size_of(wishes.size).unit != "px":
        raise MclError("its size is in pixels", "like --size 1280x720; or name a figure, --figure path", path=output)
    check_output(output, force)
    check_writable(output)


def export(
    run: Run | Sequence[Run],
    output: Path | str,
    wishes: Wishes | None = None,
    *,
    force: bool = False,
    progress: Progress | None = None,
) -> None:
    """Write a picture, a movie or a table of the run, or a figure that compares several, as ``output``'s suffix says.

    Raises MclError as `check`.
    """
    output, wishes = Path(output), wishes or Wishes()
    runs = [run] if isinstance(run, Run) else list(run)
    check(output, wishes, runs=len(runs), force=force)
    kind = output.suffix.lower()
    figure = _figure(kind, wishes, len(runs))
    with replacing(output) as partial:
        if figure is not None:
            paper = Paper(_paper_size(wishes), theme(wishes.theme), wishes.dpi or DPI, exact=kind == ".pdf")
            write_figure(figure, runs, next(iter(wishes.at), None), paper, partial)
        elif kind in PICTURES:
            _picture(runs[0], partial, wishes)
        elif kind in MOVIES:
            loop = kind in (".gif", ".webp")
            width, height = _pixels(wishes) or (LOOP_SIZE if loop else VIDEO_SIZE)
            fps = wishes.fps or (LOOP_FPS if loop else VIDEO_FPS)
            film = Film(width, height, wishes.speed, fps, wishes.camera, theme(wishes.theme))
            movie(runs[0], partial, film, progress)
        elif kind == TRAJECTORY:
            write_tum(partial, runs[0].told.trajectory)
        else:
            write_table(particles_table(runs[0]) if wishes.particles else scans_table(runs[0]), partial)


def _figure(kind: str, wishes: Wishes, runs: int) -> str | None:
    """The figure for a paper that is asked for; None of a table, a movie, or a picture of moments."""
    if kind not in (*VECTORS, *PICTURES):
        return None
    if wishes.figure is not None:
        return None if wishes.figure == MOMENTS and kind in PICTURES else wishes.figure
    if runs > 1:
        return "compare"
    if kind in PICTURES:
        return None
    return "belief" if wishes.at else "path"


def _check_figure(figure: str, output: Path, wishes: Wishes) -> None:
    if figure == MOMENTS:
        raise MclError("moments are a picture of pixels", "name a .png, or another figure", path=output)
    if figure not in FIGURES:
        raise MclError(f"there is no figure {figure!r}", f"name one of {', '.join((*FIGURES, MOMENTS))}", path=output)
    if wishes.at and figure not in OF_AN_INSTANT:
        raise MclError(f"the figure {figure!r} is of the whole run", "leave --at out", path=output)
    if len(wishes.at) > 1:
        raise MclError(f"the figure {figure!r} is of one instant", "give --at once", path=output)
    if wishes.dpi is not None and output.suffix.lower() in VECTORS:
        raise MclError("--dpi asks for pixels, this has none", "leave it out, or name a .png", path=output)
    _paper_size(wishes)


def _paper_size(wishes: Wishes) -> Size:
    return size_of("column" if wishes.size is None else wishes.size)


def _pixels(wishes: Wishes) -> tuple[int, int] | None:
    if wishes.size is None:
        return None
    size = size_of(wishes.size)
    assert size.height is not None, "pixels are asked for by both sides"
    return int(size.width), int(size.height)


def _picture(run: Run, path: Path, wishes: Wishes) -> None:
    colours, (width, height) = theme(wishes.theme), _pixels(wishes) or PICTURE_SIZE
    moments = [run.at(time) for time in wishes.at]
    if len(moments) == 1:
        picture = moment(run, moments[0], width, height, colours)
    else:
        picture = sheet(run, moments or key_moments(run), width, colours)
    Image.fromarray(picture).save(path, quality=90)
