"""The command that learns the sensor model and the odometry's noise from logs."""

from __future__ import annotations

import shutil
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline import console
from pipeline.cli.lines import columns
from pipeline.cli.parameters import (
    ConfigOption,
    ForceOption,
    JsonOption,
    MapOption,
    ParticlesOption,
    SetOption,
    effective_config,
)
from pipeline.cli.reading import LogArguments, Reading, open_log, reads_logs
from pipeline.errors import MclError
from pipeline.outputs import check_output, check_suffix, replacing

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pipeline.nav2 import Given
    from pipeline.tune import Reason, Tuning

PICTURES = (".png", ".pdf", ".svg")


@reads_logs
def tune(
    logs: LogArguments,
    reading: Reading,
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="FILE.yaml",
            help="Write what was learned; stdout if not given. Into a file that is nav2's, or whose name says nav2, "
            "AMCL's parameters are written, and nothing else in it changes.",
        ),
    ] = None,
    nav2_file: Annotated[
        Path | None,
        typer.Option(
            "--nav2",
            metavar="NAV2_PARAMS.yaml",
            help="Take this file of nav2's, and write it to the output with AMCL's parameters as they were learned.",
        ),
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="OUT.png", help="Draw what was measured, and what was learned over it.")
    ] = None,
    record: Annotated[Path | None, typer.Option(metavar="OUT.rrd", help="The same as a recording.")] = None,
    explain: Annotated[
        bool, typer.Option("--explain", help="Say for each value from which numbers in the logs it comes.")
    ] = False,
    rounds: Annotated[
        int, typer.Option(min=1, max=2, help="2: localize once more with what was learned, and learn again.")
    ] = 1,
    map_path: MapOption = None,
    config: ConfigOption = None,
    settings: SetOption = None,
    particles: ParticlesOption = None,
    seed: Annotated[int, typer.Option(min=0, max=2**63 - 1, help="Of all random numbers.")] = 0,
    as_json: JsonOption = False,
    force: ForceOption = False,
) -> None:
    """Learn the parameters of a robot and its building from logs."""
    base = _base(output, nav2_file)
    for path in (output, plot, record):
        if path is not None:
            check_output(path, force or (base is not None and path == base.path))
    if record is not None:
        check_suffix(record, ".rrd", "the name of a recording ends in .rrd")
    if plot is not None and plot.suffix.lower() not in PICTURES:
        raise MclError(f"a plot is one of {', '.join(PICTURES)}, told apart by its suffix", path=plot)
    from pipeline import tune as tuning

    effective = effective_config(config, settings, particles)
    opened = [open_log(log, map_path, reading) for log in logs]
    learned = tuning.tune(opened, effective, seed=seed, rounds=rounds, progress=console.progress)
    if base is None:
        text, table, reasons = tuning.preset(learned), tuning.table(learned), learned.reasons
    else:
        text, table, reasons = base.written(learned), base.table(learned), learned.amcl.reasons
    console.note(columns(f"{learned.scans:,} scans, {learned.beams:,} beams", table, tuning.COLUMNS))
    for remark in learned.remarks:
        console.note(f"not learned: {remark}")
    if plot is not None:
        with replacing(plot) as partial:
            tuning.plot(learned, partial)
    if record is not None:
        with replacing(record) as partial:
            _record(learned, tuning.preset(learned), partial)
    if output is not None:
        # A user's own file stays where a link leads to, and whose it is to read.
        place = output.resolve() if base is not None and base.text is not None else output
        with replacing(place) as partial:
            partial.write_bytes(text.encode())
            if place.exists():
                shutil.copymode(place, partial)
    if as_json:
        console.emit_json(learned.to_dict())
        return
    if explain:
        # Before a file on stdout they are its comments.
        console.result("\n".join(_lines(reasons, "# " if output is None else "")))
    if output is None:
        console.result(text.rstrip())
    for written in (plot, record, output):
        if written is not None:
            (console.note if output is None else console.result)(str(written))


def _lines(reasons: Sequence[Reason], head: str) -> list[str]:
    from pipeline.tune import number

    width = max(len(reason.name) for reason in reasons)
    return [f"{head}{reason.name:<{width}}  {number(reason.value)}: {reason.text}" for reason in reasons]


@dataclass(frozen=True)
class _Base:
    """The file of nav2's that the parameters are written into: its ``text``, None if there is none yet."""

    path: Path
    text: str | None
    given: Given

    def written(self, learned: Tuning) -> str:
        from pipeline import nav2
        from pipeline import tune as tuning

        values = learned.amcl.values
        if self.text is None:
            return nav2.fresh(values, tuning.origin(learned))
        return nav2.written(self.text, values, self.path)

    def table(self, learned: Tuning) -> list[tuple[str, str, str]]:
        from pipeline.tune import number

        return [(name, number(self.given.get(name)), number(value)) for name, value in learned.amcl.values.items()]


def _base(output: Path | None, nav2_file: Path | None) -> _Base | None:
    """What nav2's parameters are written into; None if a preset is wanted.

    Raises MclError, before anything is learned, for a file into which they cannot be written.
    """
    from pipeline import nav2

    path = nav2_file or output
    if path is None:
        return None
    text = None
    if nav2_file is not None or path.is_file():
        try:
            text = path.read_bytes().decode("utf-8")
        except OSError as error:
            raise MclError(f"cannot be read: {error.strerror or error}", path=path) from error
        except UnicodeDecodeError as error:
            raise MclError("not a text file", "expected parameters of nav2", path=path) from error
        if "ros__parameters" not in text:
            if nav2_file is not None:
                raise MclError("no parameters of ROS 2 in this file", "expected one with ros__parameters", path=path)
            return None
        nav2.written(text, {}, path)
    elif "nav2" not in path.name.lower():
        return None
    given = nav2.Given(path, {}) if text is None else nav2.given_of_layout(nav2.layout_of(text, path))
    return _Base(path, text, given)


def _record(learned: Tuning, text: str, path: Path) -> None:
    from pipeline import tune as tuning
    from pipeline.recording.fit import write_fit

    found = tuning.residuals(learned.readings, learned.before, learned.after)
    both = tuning.plane(learned.readings, learned.after)
    densities = (found.measured, found.before, found.after)
    name = "-".join(log.name for log in learned.logs)
    write_fit(path, name, found.at, densities, (both.measured, both.fitted), text)
