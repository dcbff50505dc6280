"""The sensor model of a run, beside what the laser read where the map has a wall at such a range."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import MclError
from pipeline.export.figures.ground import DASHED
from pipeline.export.figures.paper import Paper, rgb
from pipeline.export.run import Run
from pipeline.recording import entities
from pipeline.recording.sensor_parts import PARTS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

WHOLE = f"{entities.PARTS}/{PARTS[0]}"
"""Where the recording has the sum of all parts of the model, in per cent of the readings in each bin."""


def sensor(run: Run, paper: Paper) -> Figure:
    """p(z | z*) of the beam model at the range that the recording has it for, and what was measured of such walls.

    Raises MclError if the recording has no sensor model.
    """
    model = recorded_density(run, WHOLE)
    if model is None:
        raise MclError("the recording has no sensor model", path=run.told.path)
    edges, density = model
    wall = float(edges[-1]) / 2
    theme = paper.theme
    figure = paper.figure((0.42 if paper.wide else 0.75) * paper.width)
    axes = figure.subplots()
    measured = recorded_density(run, entities.MEASURED)
    if measured is not None and measured[1].any():
        axes.stairs(measured[1], edges, fill=True, color=rgb(theme.hindsight), alpha=0.6, label="measured")
    name = "beam model" if run.told.config.get("sensor_model") == "beam" else "beam model, for searches"
    axes.stairs(density, edges, color=rgb(theme.estimate), linewidth=1.2, label=name)
    axes.axvline(wall, color=rgb(theme.ink), linewidth=0.7, linestyle=DASHED, label=f"wall of the map, z* = {wall:g} m")
    axes.set_yscale("log")
    axes.set_ylim(bottom=max(float(density.min()) / 3, 1e-5))
    axes.yaxis.set_major_formatter(lambda value, _: f"{value:g}")
    axes.yaxis.set_minor_formatter(lambda *_: "")
    axes.set_xlim(0.0, float(edges[-1]))
    axes.set_xlabel("measured range z (m)")
    axes.set_ylabel("p(z | z*) (1/m)")
    axes.grid(visible=True)
    axes.spines[["top", "right"]].set_visible(False)
    paper.legend(figure)
    return figure


def recorded_density(run: Run, entity: str) -> tuple[Array, Array] | None:
    """(k + 1,) edges of the bins of z, m, from 0 to twice the true range, and (k,) the mean density in each, per metre,
    of the chart that was last recorded there; None if there is none."""
    charts = [chunk for chunk in run.file.chunks if chunk.entity_path == entity]
    if not charts:
        return None
    batch = charts[-1].to_record_batch()
    at, percent = (batch.column(f"BarChart:{name}").to_pylist()[-1][0]["buffer"] for name in ("abscissa", "values"))
    width = float(at[1]) - float(at[0])
    # The last bar is for readings without return.
    density = np.array(percent[:-1], dtype=np.float64) / (100.0 * width)
    return width * np.arange(len(density) + 1, dtype=np.float64), density
