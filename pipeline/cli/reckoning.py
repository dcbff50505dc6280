"""The command that tells where a robot went without any map, by its laser and its wheels."""

from __future__ import annotations

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline import console
from pipeline.cli.evaluation import ReferenceFrame
from pipeline.cli.lines import columns, facts
from pipeline.cli.parameters import (
    ConfigOption,
    ForceOption,
    JsonOption,
    SetOption,
    effective_config,
)
from pipeline.cli.reading import LogArgument, Reading, open_log, reads_logs
from pipeline.errors import MclError
from pipeline.outputs import check_output, check_suffix, replacing

if TYPE_CHECKING:
    from pipeline.odometry import DeadReckoning, Judged


@reads_logs
def odometry(
    log: LogArgument,
    reading: Reading,
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="OUT.tum", help="Write the path, a pose for every scan.")
    ] = None,
    laser_alone: Annotated[
        bool, typer.Option("--laser-alone", help="Ask the laser only, as if the robot had no wheels.")
    ] = False,
    mcap: Annotated[
        Path | None,
        typer.Option("--output-mcap", metavar="OUT.mcap", help="Write the log with the path in it, as /laser_odom."),
    ] = None,
    reference: Annotated[
        Path | None,
        typer.Option(metavar="TRUTH.tum", help="The truth, to tell the drift by; the log's own if not given."),
    ] = None,
    reference_frame: Annotated[
        ReferenceFrame, typer.Option(help="Whether the reference says where the robot's centre was, or its laser.")
    ] = ReferenceFrame.base,
    relations: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Hand-checked relations between scans, of the Freiburg SLAM benchmark."),
    ] = None,
    config: ConfigOption = None,
    settings: SetOption = None,
    as_json: JsonOption = False,
    force: ForceOption = False,
) -> None:
    """Tell where the robot went, without a map.

    The laser compares every scan with the walls that it saw before (laser odometry); the wheels tell it where to look.
    Where the truth is known, a table says how far both together, the laser alone and the wheels drift.
    """
    if output is not None:
        check_output(output, force)
    if mcap is not None:
        check_suffix(mcap, ".mcap", "the name of a log ends in .mcap")
        check_output(mcap, force)
    from pipeline import odometry as capability
    from pipeline.evaluate.drift import read_relations
    from pipeline.logs.tum import read_tum, write_tum

    truth = read_tum(reference) if reference is not None else None
    checked = read_relations(relations) if relations is not None else None
    effective = effective_config(config, settings, None)
    opened = open_log(log, None, reading)
    if mcap is not None and mcap.exists() and mcap.samefile(opened.path):
        raise MclError("the output is the input", "give it another name", path=mcap)
    alone = laser_alone or effective.odometry == "laser"
    found = capability.laser_odometry(opened, effective, alone=alone, progress=console.progress)
    judged: list[Judged] = []
    if truth is not None or checked is not None or opened.ground_truth is not None:
        beside = capability.reckonings_beside(opened, effective, found, console.progress)
        judged = capability.judge(
            opened,
            beside,
            truth,
            checked,
            reference_frame="laser" if reference_frame is ReferenceFrame.laser else "base_link",
        )
    if output is not None:
        with replacing(output) as partial:
            write_tum(partial, found.trajectory)
    if mcap is not None:
        capability.write_mcap(mcap, opened, found)
    written = {name: str(path) for name, path in (("trajectory", output), ("mcap", mcap)) if path is not None}
    if as_json:
        about = {"log": opened.name, "scans": len(opened), "duration": opened.duration, "by": found.by}
        shown = judged or capability.judge(opened, [found])
        console.emit_json({**written, **about, "odometries": [each.to_dict() for each in shown]})
        return
    _tell(opened.name, opened.duration, found, judged)
    for path in written.values():
        console.result(path)


def _tell(name: str, duration: float, found: DeadReckoning, judged: list[Judged]) -> None:
    from pipeline import odometry as capability

    rows = [
        ("scans", f"{len(found.stamps):,} in {duration:.1f} s"),
        ("told by", found.by),
        ("driven", f"{found.driven:.1f} m"),
        ("speed", f"{found.milliseconds:.2f} ms a scan (median)"),
    ]
    console.note(facts(name, rows))
    for fault in found.faults:
        console.note(f"note: {fault}")
    if drifts := capability.drift_table(judged):
        console.result(columns("drift, medians", drifts, capability.DRIFT_COLUMNS))
    if errors := capability.relation_table(judged):
        console.result(columns("relations, mean ± deviation", errors, capability.RELATION_COLUMNS))
