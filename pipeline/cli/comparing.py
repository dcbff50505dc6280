"""Commands about several runs: compare, view."""

from __future__ import annotations

import tempfile
from pathlib import Path
from string import ascii_uppercase
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline import console
from pipeline.cli.lines import columns, look_at, note_damage
from pipeline.cli.parameters import ConnectOption, ForceOption, JsonOption, MapOption, named_runs
from pipeline.cli.reading import Reading, open_log, reads_logs
from pipeline.errors import MclError

if TYPE_CHECKING:
    from pipeline.compare import Comparison

LISTED = 12
"""Stretches that are listed."""


def compare(
    compared: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN RUN_OR_TUM...",
            callback=named_runs,
            help="Folders of runs, their run.rrd or `latest`, two to six; the first is what the others are compared "
            "with. After it also the ways of other filters, AMCL's for instance, as TUM files.",
        ),
    ],
    output: Annotated[
        Path | None,
        typer.Option(
            "--output",
            "-o",
            metavar="PAGE.html",
            help="Write a page that shows all of them side by side, on one clock; or, by the name of a recording, "
            "ALL.rrd, what rerun's viewer shows of them.",
        ),
    ] = None,
    as_json: JsonOption = False,
    force: ForceOption = False,
) -> None:
    """Tell how runs differ and where they part."""
    from pipeline.compare import compare as compare_with
    from pipeline.compare import config_rows, figure_rows, read_compared, record
    from pipeline.export.run import Run
    from pipeline.share import pages

    if len(compared) < 2:
        raise typer.BadParameter("give two runs or more; mcl inspect tells of one")
    page = output is not None and output.suffix.lower() in pages.SUFFIXES
    if output is not None and page:
        pages.check(output, force)
    found = read_compared(compared)
    first = found[0]
    assert isinstance(first, Run)
    note_damage([one for one in found if isinstance(one, Run)])
    pairs = [compare_with(first, other) for other in found[1:]]
    if output is not None:
        (pages.share_comparison if page else record)(found, output, force=force)
    if as_json:
        console.emit_json(pairs[0].to_dict() if len(pairs) == 1 else [pair.to_dict() for pair in pairs])
    else:
        letters = ascii_uppercase[: len(found)]
        console.result(columns("figures", figure_rows(found), ("", *letters)))
        if parameters := config_rows(found):
            console.result(columns("parameters that differ", parameters, ("", *letters)))
        elif sum(isinstance(one, Run) for one in found) > 1:
            console.result("parameters\n  all alike")
        for letter, pair in zip(letters[1:], pairs, strict=True):
            console.result(_apart(pair, "estimates" if len(pairs) == 1 else f"estimates of {letter} and A"))
    if not as_json:
        if not all(pair.same_log for pair in pairs):
            console.note("note: the runs are of different logs")
        if not all(pair.same_map for pair in pairs):
            console.note("note: the runs are on different maps")
    if output is not None:
        console.note(f"{output.name}: {output.stat().st_size / 1e6:.1f} MB" if page else look_at(output))
        (console.note if as_json else console.result)(str(output))


def _apart(pair: Comparison, who: str) -> str:
    """When two were apart, as it is printed."""
    if not pair.common:
        return f"{who}\n  no scan has the same stamp in both"
    if not pair.apart:
        return f"{who}\n  never apart; at most {pair.distances.max():.3f} m in {pair.common:,} scans"
    more = f"; of {len(pair.apart)} stretches the first {LISTED}" if len(pair.apart) > LISTED else ""
    title = f"{who} are apart, by more than 0.5 m or 10 deg ({pair.common:,} common scans{more})"
    return columns(title, pair.apart_rows()[:LISTED])


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
