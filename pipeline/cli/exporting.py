"""The command that makes something else of a run, or of a log the raw files that it was made from."""

from __future__ import annotations

from collections.abc import Sequence
from enum import StrEnum
from pathlib import Path
from typing import Annotated, Literal

import typer

from pipeline import console
from pipeline.cli.lines import note_damage
from pipeline.cli.parameters import ForceOption, named_runs
from pipeline.errors import MclError
from pipeline.outputs import check_folder


class Theme(StrEnum):
    """Colours of pictures."""

    print = "print"
    dark = "dark"


class Camera(StrEnum):
    """What the large view of a movie shows."""

    whole = "whole"
    follow = "follow"


class Figure(StrEnum):
    """What a picture shows."""

    path = "path"
    belief = "belief"
    error = "error"
    sensor = "sensor"
    headings = "headings"
    compare = "compare"
    moments = "moments"


def export(
    sources: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN|LOG.mcap",
            callback=named_runs,
            help="A run's folder, its run.rrd or `latest`; several for a comparison or a .yaml; with --raw a log.",
        ),
    ],
    outputs: Annotated[
        list[Path] | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="A .pdf, .svg, .png, .jpg, .gif, .webp, .mp4, .webm, .tum, .csv or .parquet, or a map's .yaml. May be "
            "given several times.",
        ),
    ] = None,
    figure: Annotated[
        Figure | None,
        typer.Option(
            help="What a picture shows. Else a .pdf or .svg is the path, with --at the belief, of several runs their "
            "comparison; a .png is moments, with close-up, curves and legend."
        ),
    ] = None,
    at: Annotated[
        list[float] | None,
        typer.Option(metavar="SECONDS", help="The instant of belief, headings or moments; several make a sheet."),
    ] = None,
    size: Annotated[
        str | None,
        typer.Option(
            metavar="SIZE",
            help="Of a figure: column (84 mm, unless you say otherwise), page (174 mm), or like 84x60mm. "
            "Of moments and movies: pixels, like 1280x720.",
        ),
    ] = None,
    dpi: Annotated[
        int | None, typer.Option(min=50, max=1200, help="Pixels an inch of a figure as .png; 300 unless you say so.")
    ] = None,
    theme: Annotated[Theme, typer.Option(help="Colours of pictures and movies.")] = Theme.print,
    particles: Annotated[bool, typer.Option("--particles", help="In a table: the particles, not the scans.")] = False,
    speed: Annotated[
        str,
        typer.Option(
            metavar="FACTOR", help="How much quicker than it was a movie shows the run; auto: slowly where it matters."
        ),
    ] = "8",
    fps: Annotated[
        int | None,
        typer.Option(min=1, max=50, help="Pictures per second of a movie; 20 in an .mp4 or .webm, else 10."),
    ] = None,
    camera: Annotated[
        Camera, typer.Option(help="What the large view of a movie shows: the whole map, or what is near the robot.")
    ] = Camera.whole,
    raw: Annotated[
        Path | None, typer.Option("--raw", metavar="DIR", help="Write the raw log and map that a log was made from.")
    ] = None,
    force: ForceOption = False,
) -> None:
    """Make a figure, a picture, a movie or a table of a run.

    `mcl export RUN -o figure.pdf` is a figure for a paper. A .png shows the start, when the robot was located or lost,
    and the end. With --raw, the log and the map that `mcl convert` made an .mcap from are given back, every number as
    it was. A .yaml is the renewed map, as nav2's map_server reads it: what the runs have seen of the building, over
    the map that they had.
    """
    if (raw is None) == (not outputs):
        raise typer.BadParameter("give --output FILE for a run, or --raw DIR for a log")
    source = sources[0]
    if raw is not None:
        if len(sources) > 1:
            raise typer.BadParameter("give one log with --raw")
        _raw(source, raw, force)
        return
    from pipeline.export.files import Wishes, check
    from pipeline.export.files import export as write
    from pipeline.export.run import read_run

    wishes = Wishes(
        at=at or (),
        particles=particles,
        size=_size(size),
        speed=_speed(speed),
        fps=fps,
        figure=None if figure is None else figure.value,
        dpi=dpi,
        theme=theme.value,
        camera=camera.value,
    )
    maps = [output for output in outputs or () if output.suffix.lower() == ".yaml"]
    others = [output for output in outputs or () if output not in maps]
    for output in others:
        check(output, wishes, runs=len(sources), force=force)
    if maps:
        _maps(sources, maps, force)
    if not others:
        return
    runs = [read_run(path) for path in sources]
    note_damage(runs)
    for output in others:
        write(runs, output, wishes, force=force, progress=console.progress)
        console.result(str(output))


def _size(text: str | None) -> str | None:
    from pipeline.export.sizes import size_of

    if text is not None:
        try:
            size_of(text)
        except MclError as error:
            raise typer.BadParameter(str(error)) from error
    return text


def _speed(text: str) -> float | Literal["auto"]:
    if text == "auto":
        return "auto"
    try:
        factor = float(text)
    except ValueError:
        factor = 0.0
    if not 0.01 <= factor < float("inf"):
        raise typer.BadParameter(f"--speed is auto or a number of 0.01 or more, not {text!r}")
    return factor


def _maps(runs: Sequence[Path], outputs: Sequence[Path], force: bool) -> None:
    from pipeline.maps.map_server import save_map
    from pipeline.outputs import check_output, told
    from pipeline.world.seen import seen_in

    for output in outputs:
        check_output(output, force)
        check_output(output.with_suffix(".pgm"), force)
    seen = seen_in(runs)
    assert seen is not None, "one run is asked for"
    for output in outputs:
        with told(output):
            save_map(seen.renewed(), output)
        console.result(str(output))


def _raw(log: Path, folder: Path, force: bool) -> None:
    from converters.cmu import export_raw
    from pipeline.logs import schema
    from pipeline.logs.mcap_file import McapFile

    with McapFile(log) as file:
        has_map = file.metadata().get(schema.MAP_SOURCE, {}).get("format") == "beesoft"
    names = (f"{log.stem}.log", f"{log.stem}.dat")
    check_folder(folder, names, force)
    for path in export_raw(log, folder / names[0], folder / names[1] if has_map else None):
        console.result(str(path))
