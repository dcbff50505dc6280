"""The command that runs many seeds and says how good they are."""

from __future__ import annotations

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline import console
from pipeline.cli.lines import columns, percent
from pipeline.cli.parameters import (
    ConfigOption,
    FaultOption,
    ForceOption,
    JsonOption,
    MapOption,
    ParticlesOption,
    SetOption,
    asked_faults,
    effective_config,
)
from pipeline.cli.reading import LogArguments, Reading, open_log, reads_logs
from pipeline.errors import MclError
from pipeline.outputs import check_folder, check_output, replacing

if TYPE_CHECKING:
    from pipeline.evaluate import Calibration, Comparison

LIMIT_FAILED = 3
PICTURES = (".png", ".pdf", ".svg")


class ReferenceFrame(StrEnum):
    """Whose trajectory a reference is."""

    base = "base"
    laser = "laser"


@reads_logs
def evaluate(
    logs: LogArguments,
    reading: Reading,
    references: Annotated[
        list[Path] | None,
        typer.Option("--reference", metavar="TRUTH.tum", help="The truth, one per log; the log's own if not given."),
    ] = None,
    runs: Annotated[int, typer.Option(min=1, help="Runs per log, with seeds SEED, SEED + 1, ...")] = 100,
    seed: Annotated[int, typer.Option(min=0, help="The first seed.")] = 0,
    map_path: MapOption = None,
    config: ConfigOption = None,
    settings: SetOption = None,
    particles: ParticlesOption = None,
    vary: Annotated[
        list[str] | None,
        typer.Option(metavar="KEY=V1,V2", help="Compare values of a parameter; given again, every combination."),
    ] = None,
    jobs: Annotated[int | None, typer.Option(min=1, help="Processes; as many as cores if not given.")] = None,
    kidnapped_at: Annotated[
        list[float] | None,
        typer.Option(
            metavar="SECONDS",
            help="When the robot, carried off, measures again: seconds since the first scan; else the log's own note.",
        ),
    ] = None,
    faults: FaultOption = None,
    failures: Annotated[
        list[float] | None,
        typer.Option(
            metavar="PER_METRE",
            help="Make so many failures per metre of the way, placed anew for every seed: turned by 180 degrees, "
            "shifted, or put elsewhere (Fox, Burgard and Thrun 1999). Several rates are compared; --plot draws them.",
        ),
    ] = None,
    perturb_map: Annotated[
        list[str] | None,
        typer.Option(
            metavar="KIND:SHARE,...",
            help="Make the map wrong on purpose, anew for every seed: change this share of the wall that is seen. "
            "The kinds: doors (open instead of shut, or shut instead of open), shut (walls across the robot's way), "
            "erased (the walls of a patch are removed), unknown (a patch becomes unknown), boxes (boxes are added), "
            "moved (pieces of wall are shifted). A SHARE alone mixes all kinds. Example: 0.1 or doors:0.1,0.2. "
            "Several are compared; --plot draws them.",
        ),
    ] = None,
    calibration: Annotated[
        bool,
        typer.Option(
            "--calibration", help="Tell whether stated probabilities and covariances are true; --plot draws it."
        ),
    ] = False,
    reference_frame: Annotated[
        ReferenceFrame, typer.Option(help="Whether the references say where the robot's centre was, or its laser.")
    ] = ReferenceFrame.base,
    plot: Annotated[
        Path | None, typer.Option(metavar="OUT.png", help="Draw errors over time and paths on the map.")
    ] = None,
    table: Annotated[
        Path | None,
        typer.Option(metavar="OUT.csv|OUT.tex", help="Write the table, with tests of --vary: all figures, or LaTeX."),
    ] = None,
    keep: Annotated[
        Path | None,
        typer.Option(metavar="FOLDER", help="Keep finished runs here; those that are kept already are not run again."),
    ] = None,
    require_success: Annotated[
        float | None,
        typer.Option(min=0.0, max=1.0, help="Exit with 3 unless, on every log, this share of the runs succeeds."),
    ] = None,
    as_json: JsonOption = False,
    force: ForceOption = False,
) -> None:
    """Localize with many seeds and score every run against the truth.

    Where nobody knows the truth, it is told how far the seeds agree, what they explain and what they state.
    """
    if plot is not None:
        _check_plot(plot, force)
    if keep is not None:
        check_folder(keep, (), force)
    from pipeline import evaluate as evaluation
    from pipeline.logs.tum import read_tum

    if table is not None:
        evaluation.check_table(table)
        check_output(table, force)
    keys, variants = evaluation.variants(
        vary or (), lambda values: effective_config(config, [*(settings or ()), *values], particles)
    )
    keys, variants = evaluation.with_failures(keys, variants, failures or ())
    changes = [change for text in perturb_map or () for change in evaluation.parse_changes(text)]
    keys, variants = evaluation.with_changes(keys, variants, changes)
    truths = [read_tum(path) for path in references] if references else [None] * len(logs)
    opened = [open_log(log, map_path, reading) for log in logs]
    for option, given in (("--calibration", calibration), ("--require-success", require_success is not None)):
        if given and not references and (unknown := [log for log in opened if log.ground_truth is None]):
            hint = "give --reference truth.tum"
            raise MclError(f"{option} asks for the truth, which this log does not know", hint, path=unknown[0].path)
    done = evaluation.compare(
        opened,
        truths,
        [variant.config for variant in variants],
        runs,
        jobs,
        seed,
        console.progress,
        reference_frame="laser" if reference_frame is ReferenceFrame.laser else "base_link",
        kidnapped_at=kidnapped_at or (),
        faults=asked_faults(faults),
        failures=[variant.failures for variant in variants],
        changes=[variant.change for variant in variants],
        keep=keep,
    )
    comparison = evaluation.Comparison(keys, variants, done)
    told = comparison if keys else done[0]
    calibrations = _calibrations(comparison) if calibration else []
    if plot is not None:
        with replacing(plot) as partial:
            if calibration:
                evaluation.plot_calibration(calibrations, partial)
            elif changes:
                evaluation.plot_changes(comparison, partial)
            elif failures:
                evaluation.plot_recovery(comparison, partial)
            else:
                evaluation.plot(told, partial)
    if table is not None:
        with replacing(table) as partial:
            evaluation.write_table(comparison, partial)
    if as_json:
        plain = {name: one.to_dict() for name, one in calibrations}
        console.emit_json(told.to_dict() | ({"calibration": plain} if plain else {}))
    else:
        _tell(comparison, runs)
        _tell_calibration(calibrations)
        for written in filter(None, (plot, table)):
            console.result(str(written))
    if require_success is not None:
        _require(require_success, comparison)


def _tell(comparison: Comparison, runs: int) -> None:
    """Every table that has a row."""
    from pipeline import evaluate as evaluation

    if comparison.keys:
        of, main = "row", (comparison.table(), comparison.columns)
        alone = comparison.agreement_table(), comparison.agreement_columns
        recoveries = comparison.recovery_table(), comparison.recovery_columns
        faults = comparison.fault_table(), comparison.fault_columns
        certain = comparison.certainty_table(), comparison.certain_columns
    else:
        (done,) = comparison.evaluations
        of, main = "log", (evaluation.table(done), evaluation.COLUMNS)
        alone = evaluation.agreement_table(done), evaluation.AGREEMENT_COLUMNS
        recoveries = evaluation.recovery_table(done), evaluation.RECOVERY_COLUMNS
        faults = evaluation.fault_table(done), evaluation.FAULT_COLUMNS
        certain = evaluation.certainty_table(done), evaluation.CERTAIN_COLUMNS
    paired = comparison.paired_table(), comparison.paired_columns
    if not any(done.config.filter == "grid" for done in comparison.evaluations):
        certain = [], ()
    for title, (rows, headings) in (
        (f"{runs} runs per {of}", main),
        ("the truth is not known: whether seeds agree, what is explained and what is stated", alone),
        (f"seed by seed against {comparison.variants[0].label}", paired),
        ("kidnapped", recoveries),
        ("faults", faults),
        ("maps made wrong", (comparison.change_table(), evaluation.CHANGE_COLUMNS)),
        ("90 % of the belief at the true place", certain),
    ):
        if rows:
            console.result(columns(title, rows, headings))
    _note_few(comparison)


def _calibrations(comparison: Comparison) -> list[tuple[str, Calibration]]:
    """Of every log and variant, and of all logs together where there are several."""
    from pipeline import evaluate as evaluation

    found: list[tuple[str, Calibration]] = []
    for label, done in comparison.labelled:
        sets = [(log.name, log.runs) for log in done.logs]
        if len(sets) > 1:
            sets.append(("all logs", tuple(run for log in done.logs for run in log.runs)))
        found += [(f"{name}, {label}" if label else name, evaluation.calibration(runs)) for name, runs in sets]
    return found


def _tell_calibration(calibrations: list[tuple[str, Calibration]]) -> None:
    from pipeline import evaluate as evaluation

    for title, table, headings in (
        ("right, where a probability was stated", evaluation.reliability_table, evaluation.RELIABILITY_COLUMNS),
        ("scores, less is better", evaluation.score_table, evaluation.SCORE_COLUMNS),
        ("errors against covariances", evaluation.region_table, evaluation.REGION_COLUMNS),
    ):
        rows = [row for name, told in calibrations for row in table(name, told)]
        if rows:
            console.result(columns(title, rows, headings))


def _note_few(comparison: Comparison) -> None:
    """Where there were too few failures for a share to mean much."""
    from pipeline import evaluate as evaluation

    for label, done in comparison.labelled:
        for log in done.logs if done.failures is not None else ():
            made = len(dict(log.faults).get(evaluation.ANY, ()))
            if made < evaluation.ENOUGH:
                name = f"{log.name}, {label}" if label else log.name
                console.note(
                    f"note: {name}: {made} failures in {len(log.runs)} runs; a share wants {evaluation.ENOUGH}: "
                    "more --runs, or more --failures"
                )


def _require(share: float, comparison: Comparison) -> None:
    failed = [
        (f"{log.name}, {label}" if label else log.name, log)
        for label, done in comparison.labelled
        for log in done.logs
        if log.success_rate < share
    ]
    for name, log in failed:
        console.error(f"{name}: {log.successes} of {len(log.runs)} runs succeeded, {percent(share)} required")
    if failed:
        raise typer.Exit(LIMIT_FAILED)


def _check_plot(path: Path, force: bool) -> None:
    """What would be known only after an hour of runs."""
    if path.suffix.lower() not in PICTURES:
        raise MclError(f"a plot is one of {', '.join(PICTURES)}, told apart by its suffix", path=path)
    check_output(path, force)
