"""What the witnesses of motion say, as rerun's columns and in rerun's looks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import rerun as rr

from pipeline.filter.step import Step
from pipeline.recording import entities, palette
from pipeline.recording.columns import Columns, curve_stops, lift, timelines, transforms
from pipeline.recording.witnesses import Heard, Said

Row = tuple[Step, Heard]

COARSE = 1 / 64  # metres, of remembered points: some are as far off their walls, and fewer bytes tell
HEAD = 0.7  # metres
HEIGHTS = (0.03, 0.04, 0.05)  # metres: what is believed lies on top
LABEL = 1.8  # metres
_thin, _line, _dot, _thick = (rr.Radius.ui_points(size) for size in (0.5, 1.0, 2.0, 2.5))
_arrow = _dot
CURVES = (entities.APART, entities.FIT, entities.FOLLOWED)


def witness_columns(rows: Sequence[Row], *, shown: bool, silent: Sequence[float] = ()) -> list[Columns]:
    """What these steps (at least one) add; ``shown``: a contradiction is on the map from the batch before; ``silent``:
    times, s, since when nothing was measured for long."""
    steps, heard = [s for s, _ in rows], [h for _, h in rows]
    index, wheels = _index(steps), heard[0].now[0] is not None
    return [
        (entities.WAYS, index, _ways(heard)),
        (entities.HEADS, index, _heads(heard)),
        (entities.FIT, index, _scalars([h.fits for h in heard])),
        (entities.WALLS, index, transforms(np.stack([h.frame for h in heard]), z=-0.03)),
        *_apart(rows),
        *_followed(rows),
        *_won(rows),
        *_walls(rows),
        *_said(rows, shown),
        *(curve_stops(entity, silent) for entity in CURVES if silent and (entity != entities.APART or wheels)),
    ]


def witness_styles(wheels: bool) -> dict[str, list[Any]]:
    """Static archetypes by entity, with or without wheels to be heard."""
    colours = [palette.WHEELS, palette.LASER, palette.ESTIMATE][1 - wheels :]
    widths = [_thick, _thick, _line][1 - wheels :]
    fits = ["share of beams that fit where the laser says", "... where the wheels say"]
    other = "... the wheels" if wheels else "... neither"
    told = [palette.LASER, palette.WHEELS]
    found: dict[str, list[Any]] = {
        entities.WAYS: [rr.LineStrips3D.from_fields(radii=widths, colors=colours)],
        entities.HEADS: [rr.Arrows3D.from_fields(radii=_arrow, colors=colours)],
        entities.WALLS: [rr.Points3D.from_fields(radii=_dot, colors=palette.WALLS)],
        entities.FIT: [_curves(fits[: 1 + wheels], told[: 1 + wheels])],
        entities.FOLLOWED: [_curves(["share of the belief that follows the laser", other], told)],
    }
    if wheels:
        apart = ["how far wheels and laser are apart", "farther apart by chance: 1 of 100"]
        found |= {
            entities.SAID_WHEELS: [rr.Arrows3D.from_fields(radii=_arrow, colors=palette.WHEELS)],
            entities.SAID_LASER: [rr.Arrows3D.from_fields(radii=_arrow, colors=palette.LASER)],
            entities.SAID_SCAN: [rr.Points3D.from_fields(radii=_dot, colors=palette.WHEELS)],
            entities.SAID_SHARE: [rr.Points3D.from_fields(radii=_thin, colors=palette.LETTERING, show_labels=True)],
            entities.APART: [_curves(apart, [palette.CURVE, palette.NEUTRAL])],
        }
    return found


def _index(steps: Sequence[Step]) -> list[Any]:
    return timelines([s.index for s in steps], [s.time for s in steps])


def _ways(heard: Sequence[Heard]) -> list[Any]:
    """A segment of each path: in one entity, since a row of an entity of its own costs more than a segment."""
    every = [(a, b, z) for h in heard for a, b, z in zip(h.before, h.now, HEIGHTS, strict=True)]
    ends = [(a, b, z) for a, b, z in every if a is not None and b is not None]
    strips = np.array([(a[:2], b[:2]) for a, b, _ in ends])
    lifted = lift(strips, 0.0)
    lifted[..., 2] = np.array([z for _, _, z in ends], np.float32)[:, None]
    each = len(ends) // len(heard)
    return list(rr.LineStrips3D.columns(strips=lifted).partition([each] * len(heard)))


def _heads(heard: Sequence[Heard]) -> list[Any]:
    poses = np.array([pose for h in heard for pose in h.now if pose is not None])
    ahead = lift(HEAD * np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])]), 0.0)
    each = len(poses) // len(heard)
    columns = rr.Arrows3D.columns(origins=lift(poses[:, :2], HEIGHTS[2] + 0.01), vectors=ahead)
    return list(columns.partition([each] * len(heard)))


def _scalars(rows: Sequence[Sequence[float]]) -> list[Any]:
    values = np.round(np.array([v for row in rows for v in row]), 3)
    return list(rr.Scalars.columns(scalars=values).partition([len(row) for row in rows]))


def _apart(rows: Sequence[Row]) -> list[Columns]:
    told = [(s, (h.apart, 1.0)) for s, h in rows if h.apart is not None]
    return [(entities.APART, _index([s for s, _ in told]), _scalars([v for _, v in told]))] if told else []


def _followed(rows: Sequence[Row]) -> list[Columns]:
    told = [(s, h.followed) for s, h in rows if h.followed is not None]
    return [(entities.FOLLOWED, _index([s for s, _ in told]), _scalars([v for _, v in told]))] if told else []


def _won(rows: Sequence[Row]) -> list[Columns]:
    told = [(s, h.won) for s, h in rows if h.won is not None]
    if not told:
        return []
    return [(entities.WON, _index([s for s, _ in told]), list(rr.StateChange.columns(state=[w for _, w in told])))]


def _walls(rows: Sequence[Row]) -> list[Columns]:
    changed = [(s, h.walls) for s, h in rows if h.walls is not None]
    if not changed:
        return []
    flat = np.round(np.concatenate([walls for _, walls in changed]) / COARSE) * COARSE
    points = np.column_stack([flat, np.zeros(len(flat))]).astype(np.float32)
    columns = rr.Points3D.columns(positions=points).partition([len(walls) for _, walls in changed])
    return [(entities.WALLS, _index([s for s, _ in changed]), list(columns))]


def _said(rows: Sequence[Row], shown: bool) -> list[Columns]:
    """A row where there is a contradiction, and an empty one behind it, which takes it away."""
    kept: list[tuple[Step, Said | None]] = []
    for step, heard in rows:
        if heard.said is not None or shown:
            kept.append((step, heard.said))
        shown = heard.said is not None
    if not kept:
        return []
    index, found = _index([s for s, _ in kept]), [said for _, said in kept if said is not None]
    lengths = [int(said is not None) for _, said in kept]

    starts = np.array([said.start[:2] for said in found]).reshape(-1, 2)
    wheels, laser = (np.array(t).reshape(-1, 3)[:, :2] for t in ([s.wheels for s in found], [s.laser for s in found]))

    def arrows(tips: Any, z: float) -> list[Any]:
        return list(rr.Arrows3D.columns(origins=lift(starts, z), vectors=lift(tips - starts, 0.0)).partition(lengths))

    scans = [np.empty((0, 2)) if said is None else said.scan for _, said in kept]
    points = rr.Points3D.columns(positions=lift(np.concatenate(scans), 0.07)).partition([len(scan) for scan in scans])
    shares = [f"{100 * said.followed:.0f} % follow the laser" for said in found]
    labels = rr.Points3D.columns(positions=lift(_beside(starts, wheels, laser), 0.13), labels=shares)
    return [
        (entities.SAID_WHEELS, index, arrows(wheels, 0.12)),
        (entities.SAID_LASER, index, arrows(laser, 0.13)),
        (entities.SAID_SCAN, index, list(points)),
        (entities.SAID_SHARE, index, list(labels.partition(lengths))),
    ]


def _beside(starts: Any, wheels: Any, laser: Any) -> Any:
    """Where a label hides none of the arrows, (n, 2): beside them, away from the longer of the two."""
    longer = np.where((np.hypot(*(wheels - starts).T) > np.hypot(*(laser - starts).T))[:, None], wheels, laser) - starts
    across = np.column_stack([-longer[:, 1], longer[:, 0]]) / np.maximum(np.hypot(*longer.T), 1e-6)[:, None]
    return starts + LABEL * across


def _curves(names: Sequence[str], colours: Sequence[palette.Colour]) -> Any:
    return rr.SeriesLines(colors=list(colours), names=list(names), widths=[1.5] * len(names))
