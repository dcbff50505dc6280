"""What the witnesses of motion say, as rerun's columns and in rerun's looks."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
import rerun as rr

from pipeline.filter.step import Step
from pipeline.recording import entities, palette
from pipeline.recording.columns import Columns, lift, timelines, transforms
from pipeline.recording.witnesses import Heard, Said

Row = tuple[Step, Heard]

COARSE = 1 / 64  # metres, of remembered points: some are as far off their walls, and fewer bytes tell
HEAD = 0.7  # metres
_line, _thick, _arrow = rr.Radius.ui_points(1.0), rr.Radius.ui_points(2.0), rr.Radius.ui_points(2.0)
CURVES = (entities.APART, entities.FIT, entities.FOLLOWED)


def witness_columns(rows: Sequence[Row], shown: bool) -> list[Columns]:
    """What these steps (at least one) add; ``shown``: a contradiction is on the map from the batch before."""
    steps, heard = [s for s, _ in rows], [h for _, h in rows]
    index = _index(steps)
    columns: list[Columns] = [
        (entities.LASER_PATH, index, _path([h.before[1] for h in heard], [h.laser for h in heard], 0.03)),
        (entities.BELIEVED_PATH, index, _path([h.before[2] for h in heard], [h.believed for h in heard], 0.05)),
        (entities.HEADS, index, _heads(heard)),
        (entities.FIT, index, _scalars([h.fits for h in heard])),
        (entities.WALLS, index, transforms(np.stack([h.frame for h in heard]), z=-0.03)),
        *_apart(rows),
        *_followed(rows),
        *_walls(rows),
        *_said(rows, shown),
    ]
    told = [(s, h.before[0], h.wheels) for s, h in rows if h.wheels is not None and h.before[0] is not None]
    if told:
        path = _path([a for _, a, _ in told], [b for _, _, b in told], 0.04)
        columns.append((entities.WHEELS_PATH, _index([s for s, _, _ in told]), path))
    return columns


def witness_styles(wheels: bool) -> dict[str, list[Any]]:
    """Static archetypes by entity, with or without wheels to be heard."""
    who = [(palette.LASER, "laser"), (palette.ESTIMATE, "believed")]
    who = [(palette.WHEELS, "wheels"), *who] if wheels else who
    fits = ["share of beams that fit where the laser says", "... where the wheels say"]
    other = "... the wheels" if wheels else "... neither"
    found: dict[str, list[Any]] = {
        entities.LASER_PATH: [rr.LineStrips3D.from_fields(radii=_thick, colors=palette.LASER)],
        entities.BELIEVED_PATH: [rr.LineStrips3D.from_fields(radii=_line, colors=palette.ESTIMATE)],
        entities.HEADS: [
            rr.Arrows3D.from_fields(
                radii=_arrow, colors=[c for c, _ in who], labels=[name for _, name in who], show_labels=True
            )
        ],
        entities.WALLS: [rr.Points3D.from_fields(radii=rr.Radius.ui_points(2.0), colors=palette.WALLS)],
        entities.FIT: [_curves(fits[: 1 + wheels], [palette.LASER, palette.WHEELS][: 1 + wheels])],
        entities.FOLLOWED: [
            _curves(["share of the belief that follows the laser", other], [palette.LASER, palette.WHEELS])
        ],
    }
    if wheels:
        found |= {
            entities.WHEELS_PATH: [rr.LineStrips3D.from_fields(radii=_thick, colors=palette.WHEELS)],
            entities.SAID_WHEELS: [rr.Arrows3D.from_fields(radii=_arrow, colors=palette.WHEELS, show_labels=True)],
            entities.SAID_LASER: [rr.Arrows3D.from_fields(radii=_arrow, colors=palette.LASER, show_labels=True)],
            entities.SAID_SCAN: [rr.Points3D.from_fields(radii=rr.Radius.ui_points(2.5), colors=palette.WHEELS)],
            entities.APART: [
                _curves(["how far wheels and laser are apart", "farther is chance in 1 of 100"], [palette.CURVE, palette.NEUTRAL])
            ],
        }  # fmt: skip
    return found


def _index(steps: Sequence[Step]) -> list[Any]:
    return timelines([s.index for s in steps], [s.time for s in steps])


def _path(begin: Sequence[Any], end: Sequence[Any], z: float) -> list[Any]:
    strips = np.stack([np.stack(begin)[:, :2], np.stack(end)[:, :2]], axis=1)
    return list(rr.LineStrips3D.columns(strips=lift(strips, z)).partition([1] * len(strips)))


def _heads(heard: Sequence[Heard]) -> list[Any]:
    rows = [[p for p in (h.wheels, h.laser, h.believed) if p is not None] for h in heard]
    poses = np.array([p for row in rows for p in row])
    ahead = lift(HEAD * np.column_stack([np.cos(poses[:, 2]), np.sin(poses[:, 2])]), 0.0)
    return list(
        rr.Arrows3D.columns(origins=lift(poses[:, :2], 0.06), vectors=ahead).partition([len(row) for row in rows])
    )


def _scalars(rows: Sequence[Sequence[float]]) -> list[Any]:
    values = np.round(np.array([v for row in rows for v in row]), 3)
    return list(rr.Scalars.columns(scalars=values).partition([len(row) for row in rows]))


def _apart(rows: Sequence[Row]) -> list[Columns]:
    told = [(s, (h.apart, 1.0)) for s, h in rows if h.apart is not None]
    return [(entities.APART, _index([s for s, _ in told]), _scalars([v for _, v in told]))] if told else []


def _followed(rows: Sequence[Row]) -> list[Columns]:
    told = [(s, h.followed) for s, h in rows if h.followed is not None]
    return [(entities.FOLLOWED, _index([s for s, _ in told]), _scalars([v for _, v in told]))] if told else []


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

    def arrows(tips: list[Any], labels: list[str]) -> list[Any]:
        starts = np.array([said.start[:2] for said in found]).reshape(-1, 2)
        ways = np.array([tip[:2] for tip in tips]).reshape(-1, 2) - starts
        made = rr.Arrows3D.columns(origins=lift(starts, 0.13), vectors=lift(ways, 0.0), labels=labels)
        return list(made.partition(lengths))

    shares = [f"laser, believed by {100 * said.followed:.0f} %" for said in found]
    scans = [np.empty((0, 2)) if said is None else said.scan for _, said in kept]
    points = rr.Points3D.columns(positions=lift(np.concatenate(scans), 0.07)).partition([len(scan) for scan in scans])
    return [
        (entities.SAID_WHEELS, index, arrows([s.wheels for s in found], ["wheels"] * len(found))),
        (entities.SAID_LASER, index, arrows([s.laser for s in found], shares)),
        (entities.SAID_SCAN, index, list(points)),
    ]


def _curves(names: Sequence[str], colours: Sequence[palette.Colour]) -> Any:
    return rr.SeriesLines(colors=list(colours), names=list(names), widths=[1.5] * len(names))
