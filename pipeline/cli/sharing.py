"""The command that makes pages of runs."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipeline import console
from pipeline.cli.parameters import ForceOption, named_runs


def share(
    runs: Annotated[
        list[Path],
        typer.Argument(metavar="RUN", callback=named_runs, help="Folders of runs, their run.rrd, or `latest`."),
    ],
    output: Annotated[
        Path | None, typer.Option("--output", "-o", metavar="PAGE.html", help="The page to write, of one run.")
    ] = None,
    folder: Annotated[
        Path | None, typer.Option(metavar="DIR", help="Write a page for each run, and an index of them.")
    ] = None,
    viewer: Annotated[
        bool,
        typer.Option(
            "--viewer", help="Put rerun's own viewer into the page, with all its views: 20 MB more, needs WebGL 2."
        ),
    ] = False,
    force: ForceOption = False,
) -> None:
    """Make a page of a run that opens by a double click.

    Nothing need be installed to open it, and it asks no server for anything.
    """
    if (output is None) == (folder is None) or (output is not None and len(runs) != 1):
        raise typer.BadParameter("give --output PAGE.html for one run, or --folder DIR for any number of them")
    from pipeline.share import pages

    if output is not None:
        pages.check(output, force)
    player = pages.rerun_viewer() if viewer else None
    if output is not None:
        pages.share(runs[0], output, viewer=player, force=force)
        written = [output]
    else:
        assert folder is not None
        written = pages.share_folder(runs, folder, viewer=player, force=force)
    for path in written:
        console.note(f"{path.name}: {path.stat().st_size / 1e6:.1f} MB")
    console.result(str(written[-1]))
