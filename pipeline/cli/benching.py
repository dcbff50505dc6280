"""The command that measures speed."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

import typer

from pipeline import console
from pipeline.cli.lines import columns
from pipeline.cli.parameters import JsonOption, open_log


def bench(
    log: Annotated[Path | None, typer.Argument(metavar="[LOG.mcap]", help="The embedded sample if not given.")] = None,
    repeats: Annotated[int, typer.Option(min=1, help="Measurements of each row; the median counts.")] = 5,
    as_json: JsonOption = False,
) -> None:
    """Measure how fast the commands and the kernels are on this machine."""
    import tempfile

    from pipeline.bench import bench as measure

    with tempfile.TemporaryDirectory() as folder:
        done = measure(open_log(log or _sample(Path(folder)), None), repeats)
    if as_json:
        console.emit_json(done.to_dict())
        return
    heading = ("", "median", "least", "most", "unit")
    rows = [(r.name, f"{r.value:.3g}", f"{r.least:.3g}", f"{r.most:.3g}", r.unit) for r in done.rows]
    title = f"{done.machine}, {done.cores} cores; {done.log}; median of {repeats}"
    console.result(columns(title, rows, heading))


def _sample(folder: Path) -> Path:
    from converters import convert
    from pipeline.simulate import sample_dir

    sample = sample_dir()
    convert([sample / "office.log.gz"], folder / "office.mcap", map_path=sample / "office.dat.gz")
    return folder / "office.mcap"
