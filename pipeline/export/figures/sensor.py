"""The sensor model of a run, beside what the laser read where the map has a wall at such a range."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import MclError
from pipeline.export.figures.ground import DASHED
from pipeline.export.figures.paper import Paper, rgb
from pipeline.export.run import Run
from pipeline.judgement.verdict import KINDS
from pipeline.recording import entities
from pipeline.recording.sensor_parts import PARTS

if TYPE_CHECKING:
    from matplotlib.figure import Figure

Array = NDArray[np.float64]

NEAR = 0.2
"""Share of the true range by which a wall may be nearer or farther to be taken along."""
WHOLE = f"{entities.PARTS}/{PARTS[0]}"
"""Where the recording has the sum of all parts of the model, in per cent of the readings in each bin."""
SAME_BEAM = 0.004
"""m: positions are recorded to so much, and so a reading and what is expected of it do not quite lie on one ray."""


def sensor(run: Run, paper: Paper) -> Figure:
    """p(z | z*) of the beam model at the range that the recording has it for, and the readings at such walls.

    Each reading is shifted by as much as its wall is nearer or farther; readings are those of scans at which the robot
    was found. Raises MclError if the recording has no sensor model.
    """
    edges, density = recorded_density(run)
    wall = float(edges[-1]) / 2
    read = readings(run, wall)
    theme = paper.theme
    figure = paper.figure((0.42 if paper.wide else 0.75) * paper.width)
    axes = figure.subplots()
    if len(read):
        measured, _ = np.histogram(read, edges, density=False)
        axes.stairs(
            measured / (len(read) * np.diff(edges)), edges, fill=True, color=rgb(theme.hindsight), alpha=0.6,
            label=f"{len(read):,} readings",
        )  # fmt: skip
    model = "beam model" if run.told.config.get("sensor_model") == "beam" else "beam model, for searches"
    axes.stairs(density, edges, color=rgb(theme.estimate), linewidth=1.2, label=model)
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


def recorded_density(run: Run) -> tuple[Array, Array]:
    """(k + 1,) edges of the bins of z, m, from 0 to twice the true range, and (k,) the mean density in each, per metre.

    Raises MclError if none is recorded.
    """
    for chunk in run.file.chunks:
        if chunk.entity_path == WHOLE:
            batch = chunk.to_record_batch()
            at, percent = (
                batch.column(f"BarChart:{name}").to_pylist()[0][0]["buffer"] for name in ("abscissa", "values")
            )
            width = float(at[1]) - float(at[0])
            # The last bar is for readings without return.
            density = np.array(percent[:-1], dtype=np.float64) / (100.0 * width)
            return width * np.arange(len(density) + 1, dtype=np.float64), density
    raise MclError("the recording has no sensor model", path=run.told.path)


def readings(run: Run, wall: float) -> Array:
    """Readings (m,) m where the map expects about ``wall`` metres, each shifted to a wall exactly there."""
    scenes, found = run.scenes, KINDS.index("found")
    rows = np.flatnonzero(run.told.verdicts == found) if len(run.told.verdicts) else np.arange(len(scenes))
    kept = [np.empty(0)]
    for row in rows.tolist():
        x, y, _ = scenes.lasers[row]
        ends = np.concatenate([scenes.hits[row], scenes.shorts[row], scenes.longs[row]]) - (x, y)
        expected = scenes.expected[row] - (x, y)
        if not len(ends) or not len(expected):
            continue
        near = np.argsort(bearing := np.arctan2(expected[:, 1], expected[:, 0]))
        expected, bearing = expected[near], bearing[near]
        z, star = np.hypot(*ends.T), np.hypot(*expected.T)
        at = np.arctan2(ends[:, 1], ends[:, 0])
        after = np.searchsorted(bearing, at)
        pair = np.stack([(after - 1) % len(bearing), after % len(bearing)])
        apart = np.abs(np.angle(np.exp(1j * (bearing[pair] - at))))
        beam = np.take_along_axis(pair, apart.argmin(axis=0)[None], axis=0)[0]
        off = apart.min(axis=0) * np.minimum(z, star[beam])
        chosen = (off < SAME_BEAM) & (np.abs(star[beam] - wall) < NEAR * wall)
        kept.append(z[chosen] - star[beam][chosen] + wall)
    return np.concatenate(kept)
