"""The command that makes something else of a run, or of a log the raw files that it was made from."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path
from typing import Annotated

import typer

from pipeline import console
from pipeline.cli.lines import note_damage
from pipeline.cli.parameters import ForceOption, named_runs
from pipeline.outputs import check_folder


def export(
    sources: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN|LOG.mcap",
            callback=named_runs,
            help="A run's folder, its run.rrd or `latest`; several for a .yaml; with --raw a log.",
        ),
    ],
    outputs: Annotated[
        list[Path] | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE",
            help="A .png, .gif, .webp, .mp4, .tum, .csv or .parquet, or a map's .yaml; repeatable.",
        ),
    ] = None,
    at: Annotated[
        list[float] | None,
        typer.Option(metavar="SECONDS", help="The picture of this moment; of several, a sheet; else of key moments."),
    ] = None,
    particles: Annotated[bool, typer.Option("--particles", help="In a table: the particles, not the scans.")] = False,
    speed: Annotated[float, typer.Option(min=0.01, help="How much quicker than it was a movie shows the run.")] = 8.0,
    fps: Annotated[
        int | None, typer.Option(min=1, max=50, help="Pictures per second of a movie; 20 in an .mp4, else 10.")
    ] = None,
    size: Annotated[str | None, typer.Option(metavar="WxH", help="Pixels, like 1280x720.")] = None,
    raw: Annotated[
        Path | None, typer.Option("--raw", metavar="DIR", help="Write the raw log and map that a log was made from.")
    ] = None,
    force: ForceOption = False,
) -> None:
    """Make a picture, a movie or a table of a run.

    Without --at, a .png shows the start, when the robot was located or lost, and the end. With --raw, the log and the
    map that `mcl convert` made an .mcap from are given back, every number as it was. A .yaml is the renewed map, as
    nav2's map_server reads it: what the runs have seen of the building, over the map that they had.
    """
    if (raw is None) == (not outputs):
        raise typer.BadParameter("give --output FILE for a run, or --raw DIR for a log")
    maps = [output for output in outputs or () if output.suffix.lower() == ".yaml"]
    if len(sources) > 1 and (raw is not None or len(maps) < len(outputs or ())):
        raise typer.BadParameter("give one run; only a .yaml, the renewed map, can be made of several runs together")
    source = sources[0]
    if maps:
        _maps(sources, maps, force)
        outputs = [output for output in outputs or () if output not in maps]
        if not outputs:
            return
    if raw is not None:
        _raw(source, raw, force)
        return
    pixels = _size(size)
    from pipeline.export.files import Wishes, check
    from pipeline.export.files import export as write
    from pipeline.export.run import read_run

    wishes = Wishes(at or (), particles, pixels, speed, fps)
    for output in outputs or ():
        check(output, wishes, force=force)
    run = read_run(source)
    note_damage([run])
    for output in outputs or ():
        write(run, output, wishes, force=force, progress=console.progress)
        console.result(str(output))


def _size(text: str | None) -> tuple[int, int] | None:
    if text is None:
        return None
    width, _, height = text.lower().partition("x")
    if not (width.isdecimal() and height.isdecimal()):
        raise typer.BadParameter(f"{text!r} is not WIDTHxHEIGHT in pixels, like 1280x720")
    return int(width), int(height)


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
