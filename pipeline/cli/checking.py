"""The command that looks at a log before anything else is done with it."""

from __future__ import annotations

import sys
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline import console
from pipeline.cli.lines import columns, facts
from pipeline.cli.parameters import (
    ConfigOption,
    ForceOption,
    JsonOption,
    MapOption,
    ParticlesOption,
    SetOption,
    effective_config,
)
from pipeline.cli.reading import LogArgument, Reading, reads_logs
from pipeline.errors import MclError
from pipeline.outputs import check_output, check_suffix
from pipeline.printable import one_line

if TYPE_CHECKING:
    from collections.abc import Sequence

    from pipeline.check.findings import Finding
    from pipeline.config import Config
    from pipeline.logs.messages import Log

AT_MOST = 3
"""Lines of `localize`."""
FAULTY = 1


@reads_logs
def check(
    log: LogArgument,
    reading: Reading,
    map_path: MapOption = None,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="PAGE.html", help="Also write a page, with a timeline of the messages."),
    ] = None,
    config: ConfigOption = None,
    settings: SetOption = None,
    particles: ParticlesOption = None,
    strict: Annotated[bool, typer.Option("--strict", help="Exit with 1 also where something is doubtful.")] = False,
    as_json: JsonOption = False,
    force: ForceOption = False,
) -> None:
    """Tell what is in a log, what is wrong with it, and what to do.

    Its topics, clocks and gaps, laser, wheels, transforms, map and parameters are looked at, each against the others.
    Exits with 1 if something is broken.
    """
    from converters import read_map
    from pipeline.check.looking import look
    from pipeline.check.page import row, write_page

    if output is not None:
        check_suffix(output, ".html", "a page's name ends in .html")
        check_output(output, force)
    effective = effective_config(config, settings, particles)
    grid = None if map_path is None else read_map(map_path)
    report = look(log, effective, names=reading.names, grid=grid, step=_doing)
    if output is not None:
        write_page(report, output)
    if as_json:
        console.emit_json(report.to_dict())
    else:
        if report.facts:
            console.result(facts(str(log), report.facts))
        if report.topics:
            console.result(columns("topics", list(map(row, report.topics)), ("", "", "messages", "a second", "gap")))
        _tell(report.findings)
    if output is not None:
        (console.note if as_json else console.result)(str(output))
    grades = {finding.grade for finding in report.findings}
    if "broken" in grades or (strict and "doubtful" in grades):
        raise typer.Exit(FAULTY)


def check_parameters(source: str | None, log_path: Path | None, map_path: Path | None, as_json: bool) -> None:
    """Look at a parameter file of AMCL, beside a log if there is one; exits with 1 if something is broken."""
    from pipeline.check.amcl_file import checked, findings_of_file
    from pipeline.check.findings import worst_first

    if source is None:
        raise MclError("--check needs a file of AMCL's parameters", "mcl config --check nav2_params.yaml [LOG]")
    file, found = checked(Path(source))
    found += findings_of_file(file)
    if log_path is not None:
        from pipeline.check.amcl_log import findings_of_log
        from pipeline.cli.reading import open_log
        from pipeline.config import load_config

        found += findings_of_log(file, open_log(log_path, map_path, Reading()), load_config())
    elif map_path is not None:
        raise MclError("--map goes with a log")
    findings = worst_first(found)
    if as_json:
        console.emit_json({"file": source, "findings": [finding.to_dict() for finding in findings]})
    else:
        console.result(one_line(source))
        _tell(findings)
    if any(finding.grade == "broken" for finding in findings):
        raise typer.Exit(FAULTY)


def _tell(findings: Sequence[Finding]) -> None:
    from pipeline.check.page import verdict

    console.result(f"findings: {verdict(findings)}")
    for finding in findings:
        console.result(one_line(f"  {finding.grade:<8}  {finding.about}: {finding.text}"))
        console.result(one_line(f"            {finding.do}"))


def warn(log: Log, config: Config) -> None:
    """At most three lines about what is wrong with a log that can be seen at once; none about a sound one."""
    from pipeline.check.looking import at_a_glance

    found: Sequence[Finding] = [finding for finding in at_a_glance(log, config) if finding.grade != "noted"]
    for finding in found[: AT_MOST - 1] if len(found) > AT_MOST else found:
        console.note(one_line(f"{finding.grade}: {finding.text} {finding.do}"))
    if len(found) > AT_MOST:
        console.note(f"and {len(found) - AT_MOST + 1} more: mcl check tells them")


def _doing(what: str) -> None:
    if sys.stderr.isatty():
        console.note(f"{what} ...")
