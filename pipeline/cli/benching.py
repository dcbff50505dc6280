"""The command that measures speed."""

from __future__ import annotations

import json
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from pipeline import console
from pipeline.cli.lines import columns
from pipeline.cli.parameters import ForceOption, JsonOption
from pipeline.cli.reading import open_log
from pipeline.outputs import check_folder, told

if TYPE_CHECKING:
    from pipeline.bench import Benchmark

WRITTEN = ("bench.txt", "bench.json", "bench.png")


def bench(
    log: Annotated[Path | None, typer.Argument(metavar="[LOG]", help="The embedded sample if not given.")] = None,
    repeats: Annotated[int, typer.Option(min=1, help="Measurements of each row; the median counts.")] = 5,
    output: Annotated[
        Path | None,
        typer.Option("--output", "-o", metavar="DIR", help=f"Also write {', '.join(WRITTEN)} there."),
    ] = None,
    as_json: JsonOption = False,
    force: ForceOption = False,
) -> None:
    """Measure how fast the commands and the kernels are on this machine."""
    import tempfile

    if output is not None:
        check_folder(output, WRITTEN, force)
    from pipeline.bench import bench as measure

    with tempfile.TemporaryDirectory() as folder:
        done = measure(open_log(log or _sample(Path(folder)), None), repeats)
    text = _table(done)
    if output is not None:
        from pipeline.bench.picture import plot

        table, figures, picture = (output / name for name in WRITTEN)
        with told(output):
            output.mkdir(parents=True, exist_ok=True)
            table.write_text(text + "\n", encoding="utf-8")
            figures.write_text(json.dumps(done.to_dict(), indent=2) + "\n", encoding="utf-8")
            plot(done, picture)
    if as_json:
        console.emit_json(done.to_dict())
        return
    console.result(text)


def _table(done: Benchmark) -> str:
    heading = ("", "median", "least", "most", "unit")
    rows = [(r.name, f"{r.value:.3g}", f"{r.least:.3g}", f"{r.most:.3g}", r.unit) for r in done.rows]
    title = f"{done.machine}, {done.cores} cores; {done.log}; median of {done.repeats}"
    grown = [
        (curve.name, f"{point:,.0f}", curve.over, f"{value:.3g}", curve.unit)
        for curve in done.growth
        for point, value in zip(curve.points, curve.values, strict=True)
    ]
    growth = columns("how costs grow, with all threads", grown, ("", "at", "of", "median", "unit"))
    return columns(title, rows, heading) + "\n" + growth


def _sample(folder: Path) -> Path:
    from converters import convert
    from pipeline.simulate import sample_dir

    sample = sample_dir()
    convert([sample / "office.log.gz"], folder / "office.mcap", map_path=sample / "office.dat.gz")
    return folder / "office.mcap"
