"""Draws the parts of a filter's turn one by one, on a timeline of their own: predict, weigh, resample."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import Any

import numpy as np
import rerun as rr
import rerun.blueprint as rrb
from numpy.typing import NDArray

from pipeline.errors import MclError
from pipeline.filter.substeps import SubStep
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.recording import entities, palette
from pipeline.recording.blueprint import Area, framed, known_area, looking_down
from pipeline.recording.columns import Columns, ellipses, lift, transforms
from pipeline.recording.sampling import draw
from pipeline.recording.styles import drawn_map, robot

MOST = 2000
"""Particles, and teeth of a comb, that are drawn of each sub-step."""
PLOT = (160.0, 100.0)
"""Width and height of the plot of the cumulative weights."""
SMALLEST, LARGEST = 1.5, 6.0
"""Points on the screen: radii of the lightest and of the heaviest particle."""
ASPECT = 1.15  # of the map's view

_DEAD = (*palette.NEUTRAL, 120)
_line, _thin = (rr.Radius.ui_points(size) for size in (1.0, 0.4))


def substep_columns(
    steps: Sequence[SubStep], first: int, seed: int = 0, truth: NDArray[np.float64] | None = None
) -> list[Columns]:
    """What these sub-steps add to a recording, the first of them at ``first`` on the timeline.

    ``truth`` (steps, 3): where the robot was, in the map's frame, NaN where nobody knows.
    """
    columns = []
    for k, step in enumerate(steps):
        at = [rr.TimeColumn(entities.SUBSTEP, sequence=[first + k])]
        chosen = draw(len(step.poses), MOST, seed, step.scan)  # the same particles in all parts of a turn
        parts: list[tuple[str, list[Any]]] = [
            (entities.SUBSTEP_PARTICLES, _particles(step, chosen)),
            (entities.SUBSTEP_MOVES, _moves(step, chosen)),
            (entities.COMB_WEIGHTS, _staircase(step)),
            (entities.COMB_TEETH, _teeth(step, seed)),
            (entities.SUBSTEP_TEXT, list(rr.TextDocument.columns(text=[in_words(step)], media_type=["text/markdown"]))),
            (entities.SUBSTEP_KIND, list(rr.StateChange.columns(state=[step.kind]))),
            (entities.SUBSTEP_ELLIPSE, ellipses([() if step.estimate is None else (step.estimate,)])),
        ]
        if step.estimate is not None:
            parts.append((entities.ESTIMATE, transforms(np.array([step.estimate.pose], np.float64), z=0.1)))
        if truth is not None and np.isfinite(truth[k]).all():
            parts.append((entities.TRUTH, transforms(truth[k : k + 1], z=0.08)))
        columns += [(entity, at, list(part)) for entity, part in parts]
    return columns


def substep_styles() -> dict[str, list[Any]]:
    """Static archetypes by entity."""
    kinds = {"predict": palette.LASER, "weigh": palette.TRUTH, "resample": palette.ESTIMATE}
    return {
        entities.SUBSTEP_MOVES: [rr.Arrows3D.from_fields(radii=_thin, colors=palette.NEUTRAL)],
        entities.SUBSTEP_ELLIPSE: [
            # Without a filling, which would hide the particles.
            rr.Ellipsoids3D.from_fields(
                line_radii=_line, colors=palette.ESTIMATE, fill_mode=rr.components.FillMode.MajorWireframe
            )
        ],
        entities.COMB_WEIGHTS: [rr.LineStrips2D.from_fields(radii=_line, colors=palette.LONG)],
        entities.COMB_TEETH: [rr.LineStrips2D.from_fields(radii=_thin, colors=(*palette.ESTIMATE, 90))],
        entities.SUBSTEP_KIND: [
            rr.StateConfiguration(values=list(kinds), colors=[(*colour, 255) for colour in kinds.values()])
        ],
    }


def substep_tab(area: Area) -> rrb.Container:
    """The map with the particles of a sub-step; beside it what happens, and which particles a draw chooses."""
    contents = [
        entities.MAP,
        *(f"{entity}/**" for entity in (entities.SUBSTEP_WORLD, entities.ESTIMATE, entities.TRUTH)),
    ]
    particles = rrb.Spatial3DView(
        origin=entities.WORLD,
        name="Particles",
        contents=contents,
        eye_controls=looking_down(area, ASPECT),
        line_grid=False,
        background=palette.UNKNOWN,
    )
    width, height = PLOT
    comb = rrb.Spatial2DView(
        origin=entities.COMB,
        name="Cumulative weights, and the places that choose",
        contents=f"{entities.COMB}/**",
        visual_bounds=rrb.VisualBounds2D(x_range=[-0.05 * width, 1.05 * width], y_range=[-8.0, height + 8.0]),
        background=palette.FLOOR,
    )
    beside = rrb.Vertical(
        rrb.TextDocumentView(origin=entities.SUBSTEP_TEXT, name="What happens"),
        comb,
        rrb.StateTimelineView(origin=entities.SUBSTEP_KIND, name="Sub-steps"),
        row_shares=[4, 6, 2],
    )
    name = f"Sub-steps (timeline {entities.SUBSTEP})"
    return rrb.Horizontal(particles, beside, column_shares=[5, 3], name=name)


def write_substeps(
    path: Path, name: str, grid: OccupancyGrid, steps: Sequence[SubStep], truth: NDArray[np.float64]
) -> None:
    """A recording of nothing but sub-steps, zoomed in on where they happen. ``truth`` (steps, 3), map frame.

    Raises MclError where it cannot be written.
    """
    rr.set_strict_mode(True)
    stream = rr.RecordingStream(entities.LESSON_ID, recording_id=name)
    stream.set_log_time_enabled(False)
    try:
        layout = framed(substep_tab(_around(steps, grid)), entities.SUBSTEP)
        stream.save(path, default_blueprint=layout)
        stream.log(entities.WORLD, rr.ViewCoordinates.RIGHT_HAND_Z_UP, static=True)
        stream.log(entities.MAP, drawn_map(grid), static=True)
        bodies = robot(entities.ESTIMATE_BODY, entities.ESTIMATE_HEADING, palette.ESTIMATE)
        bodies |= robot(entities.TRUTH_BODY, entities.TRUTH_HEADING, palette.TRUTH)
        for entity, archetypes in (substep_styles() | bodies).items():
            stream.log(entity, *archetypes, static=True)
        for columns in substep_columns(steps, 0, truth=truth):
            stream.send_columns(*columns)
        stream.flush()
    except Exception as error:
        raise MclError(f"cannot write the recording: {error}", path=path) from error
    finally:
        stream.disconnect()


def in_words(step: SubStep) -> str:
    """What happens in a sub-step, as Markdown."""
    n, title = len(step.poses), f"# Scan {step.scan}, {step.time:.1f} s: {step.kind}\n\n"
    if n == 0:
        told = "The odometry moves the Gaussian and makes it wider." if step.kind == "predict" else (
            "What the robot measures moves the Gaussian, and makes it narrower."
        )  # fmt: skip
        return f"{title}{told} The ellipse is two deviations wide to each side."
    if step.cells:
        told = "The robot moves, and the belief with it: the probability of a cell is now that of all ways into it."
        if step.kind == "weigh":
            told = "The probability of each cell is multiplied by how well the scan fits there, and divided by the sum."
        best = 100 * step.weights.max()
        return f"{title}{told} The darker and larger, the more probable; the best of {n:,} cells has {best:.2g} %."
    if step.kind == "predict":
        assert step.before is not None
        far = np.hypot(*(step.poses[:, :2] - step.before[:, :2]).T)
        return (
            f"{title}The {n:,} particles move as the robot is said to have moved, each with noise of its own. An arrow "
            f"goes from where a particle was to where it is now: {np.median(far):.2f} m in the median, "
            f"{far.max():.2f} m at most. Their colours are the weights that they bring along."
        )
    ess = 1.0 / float(np.square(step.weights).sum())
    if step.kind == "weigh":
        return (
            f"{title}Each of the {n:,} particles is weighed by how well the scan fits where it stands: the darker and "
            f"larger, the heavier. Together they say as much as {ess:,.0f} particles of equal weight would, and the "
            f"heaviest has {100 * step.weights.max():.2g} % of the weight."
        )
    assert step.ancestors is not None
    copies = np.bincount(step.ancestors, minlength=n)
    teeth = "" if step.teeth is None else (
        " The plot has the cumulative weights as a staircase, a step for each particle, as high as its weight; each "
        "line from the left is a place that was drawn, and the particle on whose step it ends survives."
    )  # fmt: skip
    return (
        f"{title}{len(step.ancestors):,} are drawn from the {n:,} particles by their weights: "
        f"{np.count_nonzero(copies):,} survive, the luckiest {copies.max():,} times, and the other "
        f"{np.count_nonzero(copies == 0):,}, drawn in grey, are gone. The larger a dot, the more copies.{teeth}"
    )


def _particles(step: SubStep, chosen: NDArray[np.int64]) -> list[Any]:
    levels = palette.weight_levels(np.log(np.maximum(step.weights, 1e-300)), chosen)
    colours = np.column_stack([palette.WEIGHT_COLOURS[levels], np.full(len(chosen), 255, np.uint8)])
    sizes = SMALLEST + (LARGEST - SMALLEST) * levels / (len(palette.WEIGHT_COLOURS) - 1)
    if step.before is not None:
        sizes = np.full(len(chosen), SMALLEST)
    if step.ancestors is not None:
        copies = np.bincount(step.ancestors, minlength=len(step.poses))[chosen]
        colours[copies == 0] = _DEAD
        sizes = np.minimum(SMALLEST * np.sqrt(np.maximum(copies, 0.5)), 2 * LARGEST)
    order = np.argsort(sizes, kind="stable")  # of points at one height the last is drawn on top
    positions = lift(step.poses[chosen][order, :2], 0.02)
    radii = [rr.Radius.ui_points(float(size)) for size in sizes[order]]
    return list(rr.Points3D.columns(positions=positions, colors=colours[order], radii=radii).partition([len(chosen)]))


def _moves(step: SubStep, chosen: NDArray[np.int64]) -> list[Any]:
    if step.before is None:
        nothing = np.empty((0, 3), np.float32)
        return list(rr.Arrows3D.columns(origins=nothing, vectors=nothing).partition([0]))
    origins = lift(step.before[chosen, :2], 0.03)
    vectors = lift(step.poses[chosen, :2], 0.03) - origins
    return list(rr.Arrows3D.columns(origins=origins, vectors=vectors).partition([len(chosen)]))


def _staircase(step: SubStep) -> list[Any]:
    """A line up the cumulative weights, a step for each particle, once they are weighed."""
    if step.before is not None or len(step.weights) == 0:
        return list(rr.LineStrips2D.columns(strips=np.empty((0, 2, 2), np.float32)).partition([0]))
    n, (width, height) = len(step.weights), PLOT
    upto = np.append(0.0, np.cumsum(step.weights))
    shown = np.unique(np.linspace(0, n, min(n, 2 * MOST) + 1).round().astype(np.int64))
    x = np.repeat(shown / n * width, 2)[1:-1]
    y = np.repeat((1.0 - upto[shown]) * height, 2)
    corners = np.column_stack([x, y[2:]]).astype(np.float32)
    start = np.array([[0.0, height]], np.float32)
    return list(rr.LineStrips2D.columns(strips=[np.concatenate([start, corners])]))


def _teeth(step: SubStep, seed: int) -> list[Any]:
    """A line for each place that chose, from the left to the particle on whose step it ends."""
    if step.ancestors is None or step.teeth is None:
        return list(rr.LineStrips2D.columns(strips=np.empty((0, 2, 2), np.float32)).partition([0]))
    n, (width, height) = len(step.weights), PLOT
    shown = draw(len(step.teeth), MOST, seed, step.scan)
    y = (1.0 - step.teeth[shown]) * height
    ends = np.stack([(step.ancestors[shown] + 0.5) / n * width, y], axis=1)
    starts = np.stack([np.zeros(len(shown)), y], axis=1)
    strips = np.stack([starts, ends], axis=1).astype(np.float32)
    return list(rr.LineStrips2D.columns(strips=strips).partition([len(shown)]))


def _around(steps: Iterable[SubStep], grid: OccupancyGrid) -> Area:
    """A square about the particles, so large that they can be told apart."""
    places = [step.poses[:, :2] for step in steps if len(step.poses)]
    places += [np.array([step.estimate.pose[:2]]) for step in steps if step.estimate is not None]
    if not places:
        return known_area(grid)
    low, high = np.percentile(np.concatenate(places), [1.0, 99.0], axis=0)
    size = max(float((high - low).max()) + 2.0, 4.0)
    centre = (low + high) / 2
    return Area((float(centre[0]), float(centre[1])), (ASPECT * size, size))
