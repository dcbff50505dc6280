"""Commands about several runs: compare, view."""

from __future__ import annotations

import tempfile
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline import console
from pipeline.cli.lines import columns, look_at, note_damage
from pipeline.cli.parameters import ConnectOption, ForceOption, JsonOption, MapOption, named_run, named_runs
from pipeline.cli.reading import Reading, open_log, reads_logs
from pipeline.errors import MclError

if TYPE_CHECKING:
    pass

LISTED = 12
"""Stretches that are listed."""


def compare(
    a: Annotated[
        Path,
        typer.Argument(metavar="RUN_A", callback=named_run, help="The folder of a run, its run.rrd, or `latest`."),
    ],
    b: Annotated[Path, typer.Argument(metavar="RUN_B", callback=named_run, help="Another one.")],
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="BOTH.rrd", help="Write a recording that shows both, on one time line."),
    ] = None,
    as_json: JsonOption = False,
    force: ForceOption = False,
) -> None:
    """Tell how two runs differ and where they part."""
    from pipeline.compare import compare as compare_runs
    from pipeline.compare import record
    from pipeline.export.run import read_run

    runs = (read_run(a), read_run(b))
    note_damage(runs)
    found = compare_runs(*runs)
    if output is not None:
        record(runs, output, force=force)
    if as_json:
        console.emit_json(found.to_dict())
    else:
        console.result(columns("figures", found.figure_rows(), ("", "A", "B")))
        if found.config:
            console.result(columns("parameters that differ", found.config_rows(), ("", "A", "B")))
        else:
            console.result("parameters\n  all alike")
        if not found.common:
            console.result("estimates\n  no scan has the same stamp in both")
        elif not found.apart:
            console.result(f"estimates\n  never apart; at most {found.distances.max():.3f} m in {found.common:,} scans")
        else:
            more = f"; of {len(found.apart)} stretches the first {LISTED}" if len(found.apart) > LISTED else ""
            title = f"estimates are apart, by more than 0.5 m or 10 deg ({found.common:,} common scans{more})"
            console.result(columns(title, found.apart_rows()[:LISTED]))
        if not found.same_log:
            console.note("note: the runs are of different logs")
        if not found.same_map:
            console.note("note: the runs are on different maps")
    if output is not None:
        console.note(look_at(output))
        (console.note if as_json else console.result)(str(output))


@reads_logs
def view(
    runs: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN",
            callback=named_runs,
            help="Folders of runs, their run.rrd or `latest`; or one log.",
        ),
    ],
    reading: Reading,
    map_path: MapOption = None,
    connect: ConnectOption = None,
) -> None:
    """Show runs, or a log, in rerun's viewer.

    Several runs share one time line; a log shows its map, and apart from it odometry and scans.
    """
    from pipeline.recording import viewer

    if connect is not None:
        viewer.check_address(connect)
    log = next((path for path in runs if not _is_run(path)), None)
    if log is not None and len(runs) > 1:
        raise MclError("a log is viewed alone", "runs are viewed together: mcl localize makes one of a log", path=log)
    if log is None and (map_path is not None or reading != Reading()):
        raise typer.BadParameter("--map, and how to read it, is said of a log; a run has had its own")
    if log is not None:
        _view_log(log, map_path, reading, connect)
    else:
        _view_runs(runs, connect)


def _is_run(path: Path) -> bool:
    """Whether a path is a run's, as far as it can be told; what is missing, or an empty folder, is called a run."""
    if path.is_dir():
        return any(path.glob("*.rrd")) or not any(path.iterdir())
    return path.suffix == ".rrd" or not path.exists()


def _view_log(path: Path, map_path: Path | None, reading: Reading, connect: str | None) -> None:
    from pipeline.recording import viewer
    from pipeline.recording.raw_log import send_raw_log, write_raw_log

    log = open_log(path, map_path, reading)
    if connect is not None:
        send_raw_log(connect, log)
        return
    with tempfile.TemporaryDirectory() as folder:
        recording = Path(folder) / f"{log.name}.rrd"
        write_raw_log(recording, log)
        viewer.show(recording)


def _view_runs(runs: list[Path], connect: str | None) -> None:
    from pipeline.compare import record, send
    from pipeline.export.run import read_run
    from pipeline.inspect import SeveralRunsError
    from pipeline.recording import viewer

    try:
        read = [read_run(run) for run in runs]
    except SeveralRunsError:
        if len(runs) > 1 or connect is not None:
            raise
        viewer.show(runs[0])  # what `mcl compare -o` wrote, as it is
        return
    note_damage(read)
    if connect is not None:
        send(read, connect)
        return
    with tempfile.TemporaryDirectory() as folder:
        path = read[0].told.path
        if len(read) > 1 or read[0].told.damage:  # the viewer refuses a file that was cut within a write
            path = Path(folder) / "runs.rrd"
            record(read, path)
        viewer.show(path)
