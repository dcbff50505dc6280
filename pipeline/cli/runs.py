"""Commands around one run: localize, demo, inspect."""

from __future__ import annotations

import math
import shutil
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path
from string import ascii_uppercase
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline import console
from pipeline.cli.checking import warn
from pipeline.cli.lines import columns, facts, note_damage
from pipeline.cli.parameters import (
    ConfigOption,
    ConnectOption,
    JsonOption,
    MapOption,
    ParticlesOption,
    SetOption,
    effective_config,
    named_runs,
)
from pipeline.cli.reading import LogArgument, Reading, open_log, parse_pose, reads_logs
from pipeline.cli.summary import report
from pipeline.errors import MclError
from pipeline.outputs import check_suffix

if TYPE_CHECKING:
    from pipeline.config import Config
    from pipeline.logs.messages import Log
    from pipeline.recording.run_folder import RunFolder
    from pipeline.replay import Replay
    from pipeline.world.seen import Seen

NOT_FOUND = 3
"""Exit code of a run at whose end the robot is not found, for those who ask."""
ABREAST = 5
"""Runs that are shown in columns, which fit into a terminal; more have a row each."""

_CONFIGURED = ("config", "settings", "particles", "init", "pose")
_SHOWN = ("record", "view", "connect", "mcap", "as_json", "require_found", "sink", "substeps")
_NOT_OF_THE_INPUT = (*_CONFIGURED, *_SHOWN, "quiet", "verbose", "log", "seed", "threads", "output")

SeedOption = Annotated[int, typer.Option(min=0, max=2**63 - 1, help="Of all random numbers: same seed, same result.")]
ThreadsOption = Annotated[
    int | None, typer.Option(min=1, help="Threads; all cores if not given. The result does not depend on it.")
]


@reads_logs
def localize(
    context: typer.Context,
    log: LogArgument,
    reading: Reading,
    map_path: MapOption = None,
    config: ConfigOption = None,
    settings: SetOption = None,
    seed: SeedOption = 0,
    threads: ThreadsOption = None,
    particles: ParticlesOption = None,
    init: Annotated[
        str | None, typer.Option(metavar="WHERE", help="Where the search begins; see `init` in `mcl config`.")
    ] = None,
    pose: Annotated[
        str | None, typer.Option(metavar="X,Y,YAW", help="Begin here (m, rad, in the map); implies --init pose.")
    ] = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="DIR", help="The run's folder; recordings/LOG/TIME if not given."),
    ] = None,
    record: Annotated[bool, typer.Option("--record/--no-record", help="Write a recording.")] = True,
    mcap: Annotated[
        Path | None,
        typer.Option("--output-mcap", metavar="OUT.mcap", help="Also the result, for RViz, Foxglove and nav2's tools."),
    ] = None,
    memory: Annotated[
        list[Path] | None,
        typer.Option(
            metavar="RUN",
            callback=named_runs,
            help="Begin with what an earlier run, or `latest`, has shown of the building; repeatable.",
        ),
    ] = None,
    passes: Annotated[
        int,
        typer.Option(min=1, max=9, help="Go through the log so many times, each with the memory of the time before."),
    ] = 1,
    substeps: Annotated[
        str | None,
        typer.Option(
            metavar="FROM:TO",
            help="Record predicting, weighing and resampling one by one, between these seconds since the first scan.",
        ),
    ] = None,
    sink: Annotated[
        list[str] | None,
        typer.Option(metavar="FILE.py:NAME", help="Also give every step to a part of your own; repeatable."),
    ] = None,
    require_found: Annotated[
        bool, typer.Option("--require-found", help="End with exit code 3 if the robot is not found at the end.")
    ] = False,
    view: Annotated[bool, typer.Option("--view", help="Show it in rerun's viewer while it runs.")] = False,
    connect: ConnectOption = None,
    as_json: JsonOption = False,
) -> None:
    """Find the robot: recording, trajectory, and what came out."""
    from pipeline.presets import warning
    from pipeline.recording.run_folder import create
    from pipeline.world.seen import seen_in

    if (view or connect) and not record:
        raise typer.BadParameter("what is shown is the recording: --no-record leaves nothing to --view")

    if substeps and not record:
        raise typer.BadParameter("sub-steps are in the recording: --no-record leaves nothing to put --substeps into")
    between = _interval(substeps)

    if mcap is not None:
        check_suffix(mcap, ".mcap", "the name of the result ends in .mcap")
        if mcap.exists():
            raise MclError("this file exists already", "results are never overwritten", path=mcap)

    start = parse_pose(pose)
    if start is not None and init not in (None, "pose"):
        raise typer.BadParameter(f"--pose begins at that pose, --init {init} does not: give one of them")
    effective = effective_config(config, settings, particles, init="pose" if start else init, initial_pose=start)
    opened = open_log(log, map_path, reading)
    seen = seen_in(memory or [])
    viewer = _viewer_at(connect) if connect or view else None
    given, folder = _given(context), create(opened.name, output)  # whoever stops it from here on leaves no folder
    run = _run(
        opened, effective, folder, seed=seed, threads=threads, record=record, given=given, mcap=mcap, viewer=viewer,
        seen=seen, passes=passes, sinks=sink or (), substeps=between,
    )  # fmt: skip
    if told := warning(config):
        console.note(f"warning: {told}")
    warn(opened, effective)  # not before: where the run itself refuses something, that is the one line
    if as_json:
        written = {} if mcap is None else {"mcap": str(mcap)}
        console.emit_json({"folder": str(run.folder.path), **written, **run.to_dict()})
    else:
        report(run, map_path, config)
        if mcap is not None:
            console.result(str(mcap))
        console.result(str(run.folder.path))
    if require_found and not run.found_at_end:
        raise typer.Exit(NOT_FOUND)


def demo(seed: SeedOption = 0, threads: ThreadsOption = None) -> None:
    """Find the robot in the embedded building, raw log to recording."""
    from converters import convert
    from pipeline.config import load_config
    from pipeline.logs.reader import read_log
    from pipeline.recording.run_folder import create
    from pipeline.simulate import sample_dir

    sample = sample_dir()
    folder = create("office")
    path = folder.path / "office.mcap"
    with _fresh(folder):
        convert(
            [sample / "office.log.gz"],
            path,
            map_path=sample / "office.dat.gz",
            ground_truth=sample / "office_truth.tum",
        )
        log = read_log(path)
    run = _run(log, load_config(), folder, seed=seed, threads=threads)
    report(run)
    console.result(str(folder.path))


def inspect(
    runs: Annotated[
        list[Path],
        typer.Argument(
            metavar="RUN",
            callback=named_runs,
            help="A run's folder, its run.rrd or `latest`; several for a table.",
        ),
    ],
    at: Annotated[
        float | None, typer.Option(metavar="SECONDS", help="Only where the robot was, so long after the first scan.")
    ] = None,
    export: Annotated[
        Path | None, typer.Option(metavar="OUT.tum", help="Write the trajectory that the recording holds.")
    ] = None,
    as_json: JsonOption = False,
) -> None:
    """Read a recording back, without a viewer; of several a table."""
    if len(runs) > 1:
        if at is not None or export is not None:
            raise typer.BadParameter("--at and --export ask one run, and several were given")
        _table(runs, as_json)
        return
    (run,) = runs
    from dataclasses import asdict

    from pipeline.inspect import export_trajectory
    from pipeline.inspect import inspect as read_run

    found = read_run(run)
    if at is not None:
        pose = found.pose_at(at)
        if gap := found.gap_at(at):
            between = f"there is none from {gap[0]:.1f} s to {gap[1]:.1f} s"
            console.note(f"no scan near {at:g} s, {between}: this is scan {pose.scan}, {at - pose.time:.1f} s earlier")
        said = found.statements.at(pose.scan)
        if as_json:
            console.emit_json(asdict(pose) | ({} if said is None else {"witnesses": asdict(said)}))
        else:
            console.result(
                f"{pose.time:.3f} s, scan {pose.scan}: x {pose.x:.3f} m, y {pose.y:.3f} m, "
                f"yaw {math.degrees(pose.yaw):.1f} deg (sigma {pose.sigma_x:.3f} m, {pose.sigma_y:.3f} m, "
                f"{math.degrees(pose.sigma_yaw):.1f} deg)"
            )
            if pose.verdict is not None:
                console.result(f"{pose.verdict}: right with probability {pose.probability:.2f}")
            if said is not None:
                console.result(said.sentence)
    elif as_json:
        console.emit_json(found.to_dict())
    elif export is None:
        console.result(facts(str(found.path), found.summary_rows()))
        console.result(columns("events", found.event_rows()))
        console.result(columns("entities: rows, bytes", found.entity_rows()))
    if export is not None:
        export_trajectory(run, export)
        (console.note if as_json else console.result)(str(export))


def _table(paths: Sequence[Path], as_json: bool) -> None:
    """Several runs: the parameters in which they differ, and what came out."""
    from dataclasses import asdict

    from pipeline.compare import figures, table
    from pipeline.export.run import differing, read_run

    runs = [read_run(path) for path in paths]
    note_damage(runs)
    if as_json:
        config = differing(runs)
        console.emit_json(
            [
                {
                    "run": str(path),
                    **asdict(figures(run)),
                    "config": {name: values[k] for name, values in config.items()},
                }
                for k, (path, run) in enumerate(zip(paths, runs, strict=True))
            ]
        )
        return
    rows, names = table(runs), [str(path) for path in paths]
    if len(runs) <= ABREAST:
        letters = ascii_uppercase[: len(runs)]  # as the viewer calls them
        console.result(columns(f"{len(runs)} runs", list(zip(letters, names, strict=True))))
        console.result(columns("side by side", [(label, *texts) for label, texts in rows.items()], ("", *letters)))
        return
    alike = [label for label, texts in rows.items() if len(set(texts)) == 1]
    if alike:
        console.result(facts("alike in all", [(label, rows.pop(label)[0]) for label in alike]))
    console.result(columns(f"{len(runs)} runs", list(zip(names, *rows.values(), strict=True)), ("run", *rows)))


def _given(context: typer.Context) -> list[str]:
    """The options typed that say how to read the log: not what a configuration holds, nor what changes no result."""
    typed: list[str] = []
    for option in context.command.params:
        value = context.params.get(str(option.name))
        if option.name in _NOT_OF_THE_INPUT or value is None or value == option.default:
            continue
        for each in value if isinstance(value, list | tuple) else [value]:
            typed += [option.opts[0], str(each)]
    return typed


def _run(
    log: Log,
    config: Config,
    folder: RunFolder,
    *,
    seed: int,
    threads: int | None,
    record: bool = True,
    given: Sequence[str] = (),
    mcap: Path | None = None,
    viewer: str | None = None,
    seen: Seen | None = None,
    passes: int = 1,
    sinks: Sequence[str] = (),
    substeps: tuple[float, float] | None = None,
) -> Replay:
    with _fresh(folder):
        # Loading these takes a while, in which somebody may think better of it.
        from pipeline.kernels import compiled
        from pipeline.replay import replay

        if not compiled():
            console.note("the first run compiles its loops: about half a minute, once")
        return replay(
            log,
            config,
            folder,
            seed=seed,
            threads=threads,
            record=record,
            progress=console.progress,
            given=given,
            mcap=mcap,
            viewer=viewer,
            seen=seen,
            passes=passes,
            own_sinks=sinks,
            substeps=substeps,
        )


def _interval(text: str | None) -> tuple[float, float] | None:
    """Two moments as they are typed: FROM:TO, seconds."""
    if text is None:
        return None
    try:
        first, last = (float(part) for part in text.split(":"))
    except ValueError:
        first, last = 1.0, 0.0
    if not 0.0 <= first <= last < math.inf:
        raise typer.BadParameter(f"{text!r} is not FROM:TO in seconds since the first scan, like 12:14.5")
    return first, last


def _viewer_at(address: str | None) -> str:
    """Where the viewer is that shall show a run; one that is opened now if no address is given."""
    from pipeline.recording.viewer import check_address, open_empty

    if address is None:
        return open_empty()
    check_address(address)
    return address


@contextmanager
def _fresh(folder: RunFolder) -> Iterator[None]:
    """Whatever ends a run before anything was recorded, its folder is not left behind to block another try."""
    try:
        yield
    except BaseException as error:
        recorded = folder.recording.exists()
        if not recorded:
            shutil.rmtree(folder.path, ignore_errors=True)
        if isinstance(error, KeyboardInterrupt | SystemExit):
            told = f"recorded until then: {folder.recording}" if recorded else "nothing was recorded, nothing is left"
            console.note(f"stopped; {told}")
        raise
