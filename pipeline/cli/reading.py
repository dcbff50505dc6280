"""How commands read logs: the options that say what is in a recording, declared once, and the log that they open."""

from __future__ import annotations

import inspect
import math
import time
from collections.abc import Callable
from dataclasses import dataclass
from enum import StrEnum
from functools import wraps
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, get_type_hints

import typer

from pipeline import console
from pipeline.printable import one_line, seconds

if TYPE_CHECKING:
    from pipeline.logs.messages import Log
    from pipeline.logs.recorded import Names

LogArgument = Annotated[Path, typer.Argument(metavar="LOG", help="A log, as `mcl convert` takes or writes it.")]
LogArguments = Annotated[list[Path], typer.Argument(metavar="LOG", help="Logs, as `mcl convert` takes or writes them.")]


class Stamps(StrEnum):
    """Which time of a message counts."""

    header = "header"
    log = "log"


_OPTIONS: dict[str, Any] = {
    "scan_topic": Annotated[
        str | None,
        typer.Option(
            metavar="TOPIC", help="The laser's topic, where a recording has several; FRONT,REAR takes both together."
        ),
    ],
    "odom_topic": Annotated[
        str | None, typer.Option(metavar="TOPIC", help="The odometry's topic; /tf takes it from the transforms.")
    ],
    "base_frame": Annotated[
        str | None, typer.Option(metavar="FRAME", help="The robot's centre, if not the frame that the odometry moves.")
    ],
    "odom_frame": Annotated[
        str | None, typer.Option(metavar="FRAME", help="The odometry's frame, if the transforms name it otherwise.")
    ],
    "laser_frame": Annotated[
        str | None, typer.Option(metavar="FRAME", help="The laser's frame, if the scans name none, another or several.")
    ],
    "laser_pose": Annotated[
        str | None,
        typer.Option(metavar="X,Y,YAW", help="The laser on the robot (m, rad), where no transform says it."),
    ],
    "tf": Annotated[
        Path | None,
        typer.Option(metavar="FILE.yaml", help="Static transforms, as `ros2 topic echo /tf_static` prints them."),
    ],
    "stamps": Annotated[
        Stamps | None,
        typer.Option(help="With log, messages count from when they were written down, whatever clock stamped them."),
    ],
    "reader": Annotated[
        Path | None,
        typer.Option(metavar="FILE.py", help="A module of yours that reads a format which this program does not know."),
    ],
}


@dataclass(frozen=True)
class Reading:
    """What was said of a recording on the command line."""

    scan_topic: str | None = None
    odom_topic: str | None = None
    base_frame: str | None = None
    odom_frame: str | None = None
    laser_frame: str | None = None
    laser_pose: str | None = None
    tf: Path | None = None
    stamps: Stamps | None = None
    reader: Path | None = None

    @property
    def names(self) -> Names:
        """The same for whoever reads."""
        from pipeline.logs.recorded import Names
        from pipeline.logs.transforms_file import read_transforms

        frames = (self.scan_topic, self.odom_topic, self.base_frame, self.odom_frame, self.laser_frame)
        pose = parse_pose(self.laser_pose)
        given = () if self.tf is None else read_transforms(self.tf)
        stamps = None if self.stamps is None else self.stamps.value
        return Names(*frames, laser_pose=pose, stamps=stamps, transforms=given)


def reads_logs(command: Callable[..., None]) -> Callable[..., None]:
    """A command with the options of reading in the place of its argument ``reading``."""
    hints = get_type_hints(command, include_extras=True)
    parameters = []
    for parameter in inspect.signature(command).parameters.values():
        if parameter.name == "reading":
            kind = inspect.Parameter.POSITIONAL_OR_KEYWORD
            options = _OPTIONS.items()
            parameters += [inspect.Parameter(name, kind, default=None, annotation=option) for name, option in options]
        else:
            parameters.append(parameter.replace(annotation=hints[parameter.name]))

    @wraps(command)
    def read(**given: Any) -> None:
        reading = Reading(**{name: given.pop(name) for name in _OPTIONS})
        if reading.reader is not None:
            import converters
            from pipeline.parts.sinks import reader_in

            converters.register(reader_in(reading.reader))
        command(reading=reading, **given)

    read.__annotations__ = {parameter.name: parameter.annotation for parameter in parameters}
    read.__signature__ = inspect.Signature(parameters)  # type: ignore[attr-defined]
    return read


def parse_pose(text: str | None) -> tuple[float, float, float] | None:
    """A pose as it is typed: X,Y,YAW."""
    if text is None:
        return None
    try:
        pose = [float(number) for number in text.split(",")]
    except ValueError:
        pose = []
    if len(pose) != 3 or not all(map(math.isfinite, pose)):
        raise typer.BadParameter(f"{text!r} is not X,Y,YAW in metres and radians, like 4.5,12,1.57")
    return pose[0], pose[1], pose[2]


def open_log(path: Path, map_path: Path | None, reading: Reading = Reading()) -> Log:
    """The log, with the map of another file if one is given; what a user should know of how it was read is noted.

    A raw log, or a bag, is converted first, into the cache.
    """
    from converters import read_map
    from converters.cached import read

    began = time.perf_counter()
    grid = None if map_path is None else read_map(map_path)
    for remark in () if grid is None else grid.remarks:
        console.note(one_line(f"note: {map_path}: {remark}"))
    opened = read(path, grid, reading.names)
    if opened.mcap is not None:
        console.note(f"note: {path}: read as a {opened.format}, by way of {opened.mcap}")
    for remark in opened.log.remarks:
        console.note(one_line(f"note: {path}: {remark}"))
    log, took = opened.log, seconds(time.perf_counter() - began)
    world = "no map" if log.grid is None else f"a map of {log.grid.width:,} x {log.grid.height:,} cells"
    console.detail(f"{path}: {len(log):,} scans in {seconds(log.duration)}, {world}; read in {took}")
    return log
