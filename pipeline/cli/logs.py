"""Commands that make logs: convert, simulate."""

from __future__ import annotations

from contextlib import suppress
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from pipeline import console
from pipeline.cli.lines import facts, percent
from pipeline.cli.parameters import (
    FaultOption,
    ForceOption,
    asked_faults,
)
from pipeline.cli.reading import Reading, reads_logs
from pipeline.errors import MclError
from pipeline.outputs import check_folder, check_suffix, refuse_existing
from pipeline.printable import one_line

YAML = (".yaml", ".yml")


def _interval(text: str) -> tuple[float, float]:
    begin, colon, end = text.partition(":")
    try:
        interval = float(begin), float(end)
    except ValueError:
        interval = None
    if not colon or interval is None:
        raise typer.BadParameter(f"{text!r} is not BEGIN:END in seconds, like 40:70")
    return interval


class LogFormat(StrEnum):
    """How a simulated log is written; the names are those of ``pipeline.simulate.Format``."""

    cmu = "cmu"
    mcap = "mcap"


class MapMode(StrEnum):
    """How map_server reads an image."""

    trinary = "trinary"
    scale = "scale"
    raw = "raw"


@reads_logs
def convert(
    logs: Annotated[
        list[Path], typer.Argument(metavar="LOG", help="A raw log or a ROS bag; several logs with --join; or a map.")
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="OUT.mcap", help="The file to write; of a map a .yaml.")
    ],
    reading: Reading,
    map_path: Annotated[
        Path | None,
        typer.Option("--map", metavar="MAP", help="Its map, to travel with it: beesoft, or a map_server YAML."),
    ] = None,
    drop: Annotated[
        list[str] | None,
        typer.Option(metavar="BEGIN:END", help="Leave out these seconds: somebody carried the robot. Repeatable."),
    ] = None,
    faults: FaultOption = None,
    seed: Annotated[int, typer.Option(min=0, help="Of what --fault leaves to chance.")] = 0,
    join: Annotated[bool, typer.Option("--join", help="Put several logs one after the other.")] = False,
    ground_truth: Annotated[
        Path | None,
        typer.Option(
            metavar="TRUTH.tum|TOPIC", help="Where the robot really was (base_link in map): TUM, or a bag's topic."
        ),
    ] = None,
    without_odometry: Annotated[
        bool,
        typer.Option("--without-odometry", help="Leave out the wheels: the laser alone then tells the motion."),
    ] = False,
    mode: Annotated[
        MapMode, typer.Option(help="How a map becomes a YAML: trinary by the thresholds, or keeping every per cent.")
    ] = MapMode.trinary,
    force: ForceOption = False,
) -> None:
    """Turn a raw log or a ROS bag and its map into one .mcap.

    With a name that ends in .yaml as the output, a map (or a recording's) becomes a map_server YAML with its image.
    """
    if output.suffix.lower() in YAML:
        if len(logs) != 1 or map_path or drop or join or ground_truth or without_odometry or faults:
            raise typer.BadParameter("to write a map, give one map (or a recording that has one) and nothing else")
        _convert_map(logs[0], output, mode, force)
        return
    intervals = [_interval(text) for text in drop or ()]
    disturbances = asked_faults(faults)
    check_suffix(output, ".mcap", "the name of a log ends in .mcap, that of a map in .yaml")
    refuse_existing(output, force)
    for source in (*logs, map_path, ground_truth):
        if source is not None and source.exists() and output.exists() and source.samefile(output):
            raise MclError("the output is one of the inputs", "give it another name", path=output)
    from converters import convert as convert_logs
    from converters import read_map

    report = convert_logs(
        logs,
        output,
        map_path=map_path,
        drop=intervals,
        ground_truth=ground_truth,
        join=join,
        names=reading.names,
        without_odometry=without_odometry,
        faults=disturbances,
        seed=seed,
    )
    rows = [
        ("format", report.format),
        (report.unit, f"{report.lines:,}"),
        ("scans", f"{report.scans:,}"),
        ("odometry", f"{report.odometry:,}" if report.odometry else "none"),
        ("dropped", f"{report.dropped:,} {report.unit}"),
        *(("fault", text) for text in report.faults),
        ("duration", f"{report.duration:.1f} s"),
        ("size", f"{report.size / 1e6:.2f} MB"),
    ]
    console.note(facts(", ".join(log.name for log in logs), rows))
    for remark in report.remarks:
        console.note(one_line(f"note: {remark}"))
    if map_path is not None:
        for remark in read_map(map_path).remarks:
            console.note(one_line(f"note: {map_path}: {remark}"))
    if ground_truth is not None:
        _doubt_truth(report.output)
    console.result(str(report.output))


def _doubt_truth(path: Path) -> None:
    """What would be known only when runs are scored, or never."""
    from pipeline.logs.plausibility import doubt_truth
    from pipeline.logs.reader import read_log

    with suppress(MclError):  # a log that cannot be read back has other troubles, which `localize` tells
        if doubt := doubt_truth(read_log(path)):
            console.note(f"warning: {doubt}")


def simulate(
    building: Annotated[
        Path,
        typer.Argument(
            metavar="BUILDING.yaml", help="This file describes the building, the robot, its sensors and its orders."
        ),
    ],
    output: Annotated[
        Path, typer.Option("--output", "-o", metavar="DIR", help="The files are written to this folder.")
    ],
    seed: Annotated[
        int, typer.Option(min=0, help="All noise follows from the seed: another one gives another log.")
    ] = 0,
    log_format: Annotated[
        LogFormat | None,
        typer.Option(
            "--format",
            help="With cmu a raw log and a beesoft map are written, with mcap one .mcap and a map for ROS. "
            "Without this option the format is cmu, or mcap if a raw log cannot hold what the robot measures.",
        ),
    ] = None,
    faults: FaultOption = None,
    force: ForceOption = False,
) -> None:
    """Drive through a made-up building: a log, a map and the truth.

    The description says what laser the robot has, and whether it has a gyroscope.
    """
    from pipeline.simulate import Format, chosen_format, load_building, output_names
    from pipeline.simulate import simulate as simulate_drive

    description, disturbances = load_building(building), asked_faults(faults)
    try:
        kind = chosen_format(description, None if log_format is None else Format(log_format.value), disturbances)
    except MclError as error:
        raise MclError(error.message, error.hint, path=building) from error
    names = output_names(description, kind)
    for name in names:
        if (output / name).exists() and building.samefile(output / name):
            raise MclError("the output is the input", "give another folder", path=output / name)
    check_folder(output, names, force)
    report = simulate_drive(description, output, seed, kind, disturbances)
    rows = [
        ("seed", str(report.seed)),
        ("format", report.format.value),
        ("scans", f"{report.scans:,}"),
        *(("fault", text) for text in report.faults),
        ("duration", f"{report.duration:.1f} s"),
        ("distance", f"{report.distance:.1f} m"),
        ("odometry alone ends off by", f"{report.odometry_error:.2f} m"),
    ]
    console.note(facts(description.name, rows))
    for name in names:
        console.result(str(output / name))


def _convert_map(source: Path, output: Path, mode: MapMode, force: bool) -> None:
    from converters import convert_map

    image = output.with_suffix(".png" if mode is MapMode.scale else ".pgm")
    for path in (output, image):
        refuse_existing(path, force)
        if source.exists() and path.exists() and source.samefile(path):
            raise MclError("the output is the input", "give it another name", path=path)
    grid, written = convert_map(source, output, mode.value)
    occupied, free, known = (grid.occupancy > 0.65).mean(), (grid.occupancy < 0.196).mean(), grid.known.mean()
    rows = [
        ("cells", f"{grid.width:,} x {grid.height:,} of {grid.resolution:g} m"),
        ("occupied", percent(occupied)),
        ("free", percent(free)),
        ("between", percent(known - occupied - free)),
        ("unknown", percent(1.0 - known)),
    ]
    console.note(facts(source.name, rows))
    for remark in grid.remarks:
        console.note(one_line(f"note: {remark}"))
    graded = float(((grid.occupancy > 0.01) & (grid.occupancy < 0.99)).sum() / max(grid.known.sum(), 1))
    if mode is MapMode.trinary and graded > 0.01:
        console.note(f"note: {percent(graded)} of what is known is neither sure nor free; --mode raw keeps such shades")
    for path in written:
        console.result(str(path))
