"""From steps of the filter to rerun's columns, a batch at a time. What is drawn is rounded; RECORD is exact.

A column call costs far more than the rows in it, and an entity's rows compress together: hence batches.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
import pyarrow as pa
import rerun as rr
from numpy.typing import ArrayLike, NDArray

from pipeline.filter.step import Estimate, Step
from pipeline.judgement.verdict import KINDS
from pipeline.recording import entities, palette
from pipeline.recording.captions import letter

Columns = tuple[str, list[Any], list[Any]]  # entity, timelines, components: the arguments of send_columns
IsHit = Callable[[NDArray[np.float64], NDArray[np.float64]], NDArray[np.bool_]]
"""What the sensor model says of readings (k,) m where the map's ranges are (k,) m."""

DISPLAY_STEP = 1 / 256  # metres: below a pixel on any screen, and a third of the bytes
HEADING_LENGTH = 0.3  # metres
LABEL_OFFSET = np.array([0.0, -0.6])  # metres: beside what it belongs to, not on it
NAMED = 0.05  # share from which on a hypothesis is worth its name
STUB_LENGTH = 1.5  # metres: a beam without return has no length of its own
_DEGREES = np.deg2rad(np.arange(360))
_HEADINGS = np.zeros((360, 3), np.float32)
_HEADINGS[:, 0], _HEADINGS[:, 1] = HEADING_LENGTH * np.cos(_DEGREES), HEADING_LENGTH * np.sin(_DEGREES)


@dataclass(frozen=True)
class Frame:
    """A step with the particles that are recorded of it, and what was counted over all of them.

    ``particles`` (m, 3) and ``levels`` (m,) are the drawn ones; ``count`` is how many there were;
    ``bars`` and ``weight_bars`` (bins,) are percent of the particles and of their weight;
    ``joined``: the path goes on from ``previous``, a pose (3,), without a jump;
    ``silent_since``: the time of the scan before, s, if that is long ago.
    """

    step: Step
    particles: NDArray[np.float32]
    levels: NDArray[np.int64]
    count: int
    bars: NDArray[np.float32]
    weight_bars: NDArray[np.float32]
    previous: NDArray[np.float64]
    joined: bool
    silent_since: float | None = None


def timelines(indices: ArrayLike, seconds: ArrayLike) -> list[Any]:
    """Both timelines for rows at these scans: indices (n,) and seconds (n,) since the first scan."""
    nanoseconds = np.round(np.asarray(seconds, dtype=np.float64) * 1e9).astype("timedelta64[ns]")
    return [
        rr.TimeColumn(entities.SCAN, sequence=np.asarray(indices, dtype=np.int64)),
        rr.TimeColumn(entities.TIME, duration=nanoseconds),
    ]


def batch_columns(frames: Sequence[Frame], is_hit: IsHit) -> list[Columns]:
    """Everything that these frames (at least one) add to the recording; beams that are no hits are shorts or longs."""
    steps = [frame.step for frame in frames]
    index = timelines([s.index for s in steps], [s.time for s in steps])
    parts: list[tuple[str, list[Any]]] = [
        (entities.RECORD, _record(steps)),
        (entities.PARTICLES, _particles(frames)),
        *_beams(steps, is_hit),
        (entities.ESTIMATE, transforms(np.stack([s.estimate.pose for s in steps]), z=0.1)),
        (entities.COVARIANCE, ellipses([(s.estimate,) for s in steps])),
        *_hypotheses(steps),
        (entities.PATH, _path(frames)),
        (entities.WEIGHTS, bar_charts(np.stack([f.bars for f in frames]))),
        (entities.WEIGHT_SHARE, bar_charts(np.stack([f.weight_bars for f in frames]))),
        *((entity, rr.Scalars.columns(scalars=[curve(f) for f in frames])) for entity, curve in _CURVES.items()),
    ]
    ends = [f.silent_since for f in frames if f.silent_since is not None]
    stops = [curve_stops(entity, ends) for entity in _CURVES] if ends else []
    return [(entity, index, components) for entity, components in parts] + stops + _events(steps)


def curve_stops(entity: str, times: ArrayLike) -> Columns:
    """Rows without a value, right after these times (n,) s: the curve stops instead of going straight on to the next.

    On the timeline t alone, for among the scans none is missing.
    """
    after = np.round(np.asarray(times, dtype=np.float64) * 1e9).astype("timedelta64[ns]") + np.timedelta64(1, "ns")
    nothing = rr.Scalars.columns(scalars=[]).partition([0] * len(after))
    return (entity, [rr.TimeColumn(entities.TIME, duration=after)], list(nothing))


_CURVES: dict[str, Callable[[Frame], float]] = {
    entities.ESS: lambda f: f.step.ess,
    entities.PARTICLE_COUNT: lambda f: float(f.count),
    entities.LIKELIHOOD: lambda f: f.step.mean_likelihood,
    entities.EXPLAINED: lambda f: f.step.explained,
    entities.SPREAD: lambda f: f.step.spread,
    entities.SHORT: lambda f: f.step.short,
    entities.THROUGH: lambda f: f.step.through,
    entities.PROBABILITY: lambda f: f.step.verdict.probability,
}


def _record(steps: Sequence[Step]) -> list[Any]:
    def column(name: str, values: NDArray[Any]) -> Any:
        columns = rr.DynamicArchetype.columns(entities.RECORD_TYPE, components={name: values.reshape(-1)})
        return columns.partition([values[0].size] * len(values))

    return [
        *column("stamp", np.array([s.stamp for s in steps], dtype=np.int64)),
        *column("pose", np.stack([np.asarray(s.estimate.pose, dtype=np.float64) for s in steps])),
        *column("probability", np.array([s.verdict.probability for s in steps])),
        *column("verdict", np.array([KINDS.index(s.verdict.kind) for s in steps], dtype=np.int64)),
        *column("covariance", np.stack([np.asarray(s.estimate.covariance, dtype=np.float64) for s in steps])),
    ]


def _particles(frames: Sequence[Frame]) -> list[Any]:
    lengths = [len(f.particles) for f in frames]
    particles = np.concatenate([f.particles for f in frames])
    levels = np.concatenate([f.levels for f in frames])
    degrees = np.round(np.rad2deg(particles[:, 2])).astype(np.int64) % 360
    # Their order means nothing to the filter. Equal colours and headings side by side halve the file, and
    # of points at one height the last is drawn on top: the heaviest.
    rows = np.repeat(np.arange(len(frames)), lengths)
    order = np.argsort((rows * len(palette.WEIGHT_COLOURS) + levels) * 360 + degrees)
    positions = lift(particles[order, :2], 0.02)
    return [
        *rr.Points3D.columns(positions=positions, colors=_WEIGHT_RGBA[levels[order]]).partition(lengths),
        *rr.Arrows3D.columns(vectors=_HEADINGS[degrees[order]]).partition(lengths),
    ]


def _beams(steps: Sequence[Step], is_hit: IsHit) -> list[tuple[str, list[Any]]]:
    beams = [s.beams for s in steps]
    counts = [len(b.angles) for b in beams]
    rows = np.repeat(np.arange(len(beams)), counts)
    angles = np.concatenate([b.angles for b in beams])
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    measured = np.concatenate([b.measured for b in beams]).astype(np.float64)
    expected = np.concatenate([b.expected for b in beams]).astype(np.float64)
    returned, lost, ended = np.isfinite(measured), np.isposinf(measured), np.isfinite(expected)
    hits = returned & is_hit(np.where(returned, measured, 0.0), expected)
    shorts = returned & ~hits & (measured < expected)

    def ends(chosen: NDArray[np.bool_], ranges: NDArray[np.float64]) -> NDArray[np.float32]:
        return lift(directions[chosen] * ranges[chosen, None], 0.0)

    def lengths(chosen: NDArray[np.bool_]) -> NDArray[np.int64]:
        return np.bincount(rows[chosen], minlength=len(beams))

    def rays(chosen: NDArray[np.bool_], ranges: NDArray[np.float64]) -> Any:
        tips = ends(chosen, ranges)
        strips = np.stack([np.zeros_like(tips), tips], axis=1)
        return rr.LineStrips3D.columns(strips=strips).partition(lengths(chosen))

    return [
        (entities.LASER, transforms(np.stack([b.laser for b in beams]), z=0.04)),
        (entities.HITS, list(rays(hits, measured))),
        (entities.SHORTS, list(rays(shorts, measured))),
        (entities.LONGS, list(rays(returned & ~hits & ~shorts, measured))),
        (entities.NO_RETURN, list(rays(lost, np.full_like(measured, STUB_LENGTH)))),
        (entities.EXPECTED, list(rr.Points3D.columns(positions=ends(ended, expected)).partition(lengths(ended)))),
    ]


def _hypotheses(steps: Sequence[Step]) -> list[tuple[str, list[Any]]]:
    # A single hypothesis is the estimate itself, which has its ellipse already.
    clusters = [s.clusters if len(s.clusters) > 1 else () for s in steps]
    lengths = [len(row) for row in clusters]
    named = [" ".join(filter(None, (letter(row, k), _label(c)))) for row in clusters for k, c in enumerate(row)]
    places = np.array([c.pose[:2] for row in clusters for c in row], dtype=np.float64).reshape(-1, 2) + LABEL_OFFSET
    return [
        (entities.HYPOTHESES, ellipses(clusters)),
        # A label has the colour of what it belongs to; pink on grey cannot be read, so points carry them.
        (entities.SHARES, list(rr.Points3D.columns(positions=lift(places, 0.12), labels=named).partition(lengths))),
    ]


def _label(hypothesis: Estimate) -> str:
    share = f"{100 * hypothesis.weight:.0f} %"
    return f"{share}, {hypothesis.name}" if hypothesis.name and hypothesis.weight >= NAMED else share


def _path(frames: Sequence[Frame]) -> list[Any]:
    joined = [f for f in frames if f.joined]
    strips = np.array([(f.previous[:2], f.step.estimate.pose[:2]) for f in joined]).reshape(-1, 2, 2)
    return list(rr.LineStrips3D.columns(strips=lift(strips, 0.03)).partition([int(f.joined) for f in frames]))


def verdicts(steps: Sequence[Step], before: str) -> list[Columns]:
    """A state wherever the verdict is another than at the step before, which had the verdict ``before``."""
    rows = []
    for step in steps:
        if step.verdict.kind != before:
            rows.append(step)
            before = step.verdict.kind
    if not rows:
        return []
    index = timelines([s.index for s in rows], [s.time for s in rows])
    return [(entities.VERDICT, index, list(rr.StateChange.columns(state=[s.verdict.kind for s in rows])))]


def changes(steps: Sequence[Step]) -> list[Columns]:
    """The cells in which the world is not as mapped, wherever more is known of them."""
    rows = [(s, s.changed) for s in steps if s.changed is not None]
    if not rows:
        return []
    index = timelines([s.index for s, _ in rows], [s.time for s, _ in rows])
    flat = np.concatenate([changed for _, changed in rows])
    points = rr.Points3D.columns(
        positions=lift(flat[:, :2], 0.012), colors=palette.CHANGED_COLOURS[flat[:, 2].astype(np.int64)]
    )
    return [(entities.CHANGED, index, list(points.partition([len(changed) for _, changed in rows])))]


def _events(steps: Sequence[Step]) -> list[Columns]:
    rows = [(s, event) for s in steps for event in s.events]
    if not rows:
        return []
    index = timelines([s.index for s, _ in rows], [s.time for s, _ in rows])
    columns = [
        *rr.TextLog.columns(text=[e.text for _, e in rows], level=[e.level for _, e in rows]),
        *rr.DynamicArchetype.columns(entities.EVENT_TYPE, components={"kind": [e.kind for _, e in rows]}),
    ]
    return [(entities.EVENTS, index, columns)]


def segments(poses: NDArray[np.float64], z: float, joined: NDArray[np.bool_] | None = None) -> list[Any]:
    """A path through poses (n, 3), one segment per row from its predecessor; none in the first row, and none where
    ``joined`` (n,) says that a row does not go on from the one before."""
    drawn = np.ones(len(poses), np.bool_) if joined is None else joined.copy()
    drawn[0] = False
    strips = np.stack([poses[:-1, :2], poses[1:, :2]], axis=1)[drawn[1:]]
    return list(rr.LineStrips3D.columns(strips=lift(strips, z)).partition(drawn.astype(np.int64)))


def transforms(poses: NDArray[np.float64], z: float) -> list[Any]:
    """One transform to the map frame per pose (n, 3), at height z."""
    return list(rr.Transform3D.columns(translation=lift(poses[:, :2], z), quaternion=_turns(poses[:, 2])))


def ellipses(rows: Sequence[Sequence[Estimate]]) -> list[Any]:
    """The 2-sigma ellipses of position of a row's estimates; rows may be empty."""
    estimates = [e for row in rows for e in row]
    poses = np.array([e.pose for e in estimates], dtype=np.float64).reshape(-1, 3)
    covariances = np.array([e.covariance for e in estimates], dtype=np.float64).reshape(-1, 3, 3)[:, :2, :2]
    variances, axes = np.linalg.eigh(covariances)
    half_sizes = lift(2.0 * np.sqrt(np.maximum(variances, 0.0)), 0.0)
    return list(
        rr.Ellipsoids3D.columns(
            half_sizes=half_sizes,
            centers=lift(poses[:, :2], 0.05),
            quaternions=_turns(np.arctan2(axes[:, 1, 0], axes[:, 0, 0])),
        ).partition([len(row) for row in rows])
    )


def bar_charts(heights: NDArray[np.float32]) -> list[Any]:
    """One bar chart per row of heights (n, bins).

    ``BarChart.columns`` takes one chart only (tensors have no batches), so its arrow array, a dense
    union inside a struct, is built here for all rows at once, after the pattern of a single one.
    """
    rows, bins = heights.shape
    single = rr.components.TensorDataBatch(heights[0]).as_arrow_array()
    shape, names, buffer = single.type
    code = single.field(2).type_codes[0].as_py()
    children = [single.field(2).field(i) for i in range(buffer.type.num_fields)]
    children[code] = _lists(heights, children[code].type)
    codes = pa.array(np.full(rows, code), pa.int8())
    offsets = pa.array(np.arange(rows), pa.int32())
    union = pa.UnionArray.from_buffers(
        buffer.type, rows, [None, codes.buffers()[1], offsets.buffers()[1]], children=children
    )
    sizes = _lists(np.full((rows, 1), bins, np.uint64), shape.type)
    tensors = pa.StructArray.from_arrays([sizes, pa.nulls(rows, names.type), union], fields=[shape, names, buffer])
    return [rr.ComponentColumn(rr.BarChart.descriptor_values(), _Arrow(tensors))]


class _Arrow:
    """Hands an arrow array to rerun as it is."""

    def __init__(self, array: Any) -> None:
        self.array = array

    def as_arrow_array(self) -> Any:
        return self.array


def _lists(values: NDArray[Any], kind: Any) -> Any:
    offsets = pa.array(np.arange(0, values.size + 1, values.shape[1]), pa.int32())
    return pa.ListArray.from_arrays(offsets, pa.array(values.reshape(-1), kind.value_type)).cast(kind)


def lift(points: ArrayLike, z: float) -> NDArray[np.float32]:
    """Points (..., 2) at height z, (..., 3), rounded to what a screen can show."""
    flat = np.asarray(points, dtype=np.float64)
    lifted = np.full((*flat.shape[:-1], 3), z, np.float32)
    lifted[..., :2] = np.round(flat / DISPLAY_STEP) * DISPLAY_STEP
    return lifted


def _turns(yaw: NDArray[np.float64]) -> NDArray[np.float32]:
    turns = np.zeros((len(yaw), 4), np.float32)
    turns[:, 2], turns[:, 3] = np.sin(yaw / 2), np.cos(yaw / 2)
    return turns


_WEIGHT_RGBA = np.concatenate([palette.WEIGHT_COLOURS, np.full((len(palette.WEIGHT_COLOURS), 1), 255, np.uint8)], 1)
