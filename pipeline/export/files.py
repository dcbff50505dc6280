"""Writes whatever a file's suffix asks for; the file appears when it is complete."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

from PIL import Image

from pipeline.errors import MclError
from pipeline.export.movies import MOVIES, Progress, check_writable, movie
from pipeline.export.pictures import moment, sheet
from pipeline.export.run import Run, key_moments
from pipeline.export.tables import TABLES, particles_table, scans_table, write_table
from pipeline.logs.tum import write_tum
from pipeline.outputs import check_output, replacing

PICTURES = (".png", ".jpg")
TRAJECTORY = ".tum"
KINDS = (*PICTURES, *MOVIES, TRAJECTORY, *TABLES)
"""Suffixes that can be asked for."""

PICTURE_SIZE, VIDEO_SIZE, LOOP_SIZE = (1600, 900), (1280, 720), (960, 540)
VIDEO_FPS, LOOP_FPS = 20, 10  # a GIF or WebP of twice the pictures is twice as large
SMALLEST, LARGEST = 240, 7680
"""Pixels along a side."""


@dataclass(frozen=True)
class Wishes:
    """How to export: ``at``: seconds since the first scan, one picture each, of several a sheet; ``particles``: the
    table of these; ``size``: pixels, and ``fps``: pictures per second of movies, the usual ones if None."""

    at: Sequence[float] = ()
    particles: bool = False
    size: tuple[int, int] | None = None
    speed: float = 8.0
    fps: int | None = None


def check(output: Path, wishes: Wishes, *, force: bool = False) -> None:
    """Raises MclError for what would be known only after a while: a wrong suffix, a file that exists already."""
    kind = output.suffix.lower()
    if kind not in KINDS:
        raise MclError(f"the suffix says what to write: one of {', '.join(KINDS)}", path=output)
    if wishes.at and kind not in PICTURES:
        raise MclError("--at asks for a picture, this is none", "name a .png", path=output)
    if wishes.particles and kind not in TABLES:
        raise MclError("--particles asks for a table, this is none", "name a .csv or a .parquet", path=output)
    if wishes.size and not all(SMALLEST <= side <= LARGEST for side in wishes.size):
        raise MclError(f"a picture has {SMALLEST} to {LARGEST} pixels along a side")
    check_output(output, force)
    check_writable(output)


def export(
    run: Run, output: Path | str, wishes: Wishes | None = None, *, force: bool = False, progress: Progress | None = None
) -> None:
    """Write a picture, a movie or a table of the run, as the suffix of ``output`` says. Raises MclError as `check`."""
    output, wishes = Path(output), wishes or Wishes()
    check(output, wishes, force=force)
    with replacing(output) as partial:
        kind = output.suffix.lower()
        if kind in PICTURES:
            moments = [run.at(time) for time in wishes.at]
            if len(moments) == 1:
                picture = moment(run, moments[0], *(wishes.size or PICTURE_SIZE))
            else:
                picture = sheet(run, moments or key_moments(run), (wishes.size or PICTURE_SIZE)[0])
            Image.fromarray(picture).save(partial, quality=90)
        elif kind in MOVIES:
            size, fps = (VIDEO_SIZE, VIDEO_FPS) if kind == ".mp4" else (LOOP_SIZE, LOOP_FPS)
            movie(run, partial, wishes.size or size, wishes.speed, wishes.fps or fps, progress)
        elif kind == TRAJECTORY:
            write_tum(partial, run.told.trajectory)
        else:
            write_table(particles_table(run) if wishes.particles else scans_table(run), partial)
