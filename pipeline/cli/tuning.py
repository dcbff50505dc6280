"""The command that learns the sensor model and the odometry's noise from logs."""

from __future__ import annotations

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
    from pipeline.tune import Tuning

PICTURES = (".png", ".pdf", ".svg")


@reads_logs
def tune(
    logs: LogArguments,
    reading: Reading,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="PRESET.yaml", help="Write what was learned; stdout if not given."),
    ] = None,
    plot: Annotated[
        Path | None, typer.Option(metavar="OUT.png", help="Draw what was measured, and what was learned over it.")
    ] = None,
    record: Annotated[Path | None, typer.Option(metavar="OUT.rrd", help="The same as a recording.")] = None,
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
    for path in (output, plot, record):
        if path is not None:
            check_output(path, force)
    if record is not None:
        check_suffix(record, ".rrd", "the name of a recording ends in .rrd")
    if plot is not None and plot.suffix.lower() not in PICTURES:
        raise MclError(f"a plot is one of {', '.join(PICTURES)}, told apart by its suffix", path=plot)
    from pipeline import tune as tuning

    effective = effective_config(config, settings, particles)
    opened = [open_log(log, map_path, reading) for log in logs]
    learned = tuning.tune(opened, effective, seed=seed, rounds=rounds, progress=console.progress)
    text = tuning.preset(learned)
    console.note(columns(f"{learned.scans:,} scans, {learned.beams:,} beams", tuning.table(learned), tuning.COLUMNS))
    for remark in learned.remarks:
        console.note(f"not learned: {remark}")
    if plot is not None:
        with replacing(plot) as partial:
            tuning.plot(learned, partial)
    if record is not None:
        with replacing(record) as partial:
            _record(learned, text, partial)
    if output is not None:
        with replacing(output) as partial:
            partial.write_text(text, encoding="utf-8")
    if as_json:
        console.emit_json(learned.to_dict())
        return
    if output is None:
        console.result(text.rstrip())
    for written in (plot, record, output):
        if written is not None:
            (console.note if output is None else console.result)(str(written))


def _record(learned: Tuning, text: str, path: Path) -> None:
    from pipeline import tune as tuning
    from pipeline.recording.fit import write_fit

    found = tuning.residuals(learned.readings, learned.before, learned.after)
    both = tuning.plane(learned.readings, learned.after)
    densities = (found.measured, found.before, found.after)
    name = "-".join(log.name for log in learned.logs)
    write_fit(path, name, found.at, densities, (both.measured, both.fitted), text)
