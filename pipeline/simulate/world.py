"""The building as geometry: everything that can stop a ray, as it stands or as the map has it."""

from __future__ import annotations

import itertools
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike, NDArray

from pipeline.errors import MclError
from pipeline.simulate.building import Building, Door, Furniture, Glass, Opening, Person, Point

Array = NDArray[np.float64]

DOOR_THICKNESS = 0.04
ON_THE_WALL = 0.02  # metres that an opening may lie off the wall it opens


@dataclass(frozen=True)
class Stroke:
    """A straight piece of something: its centre line, half its thickness (m), and how surely a beam returns from it."""

    start: Point
    end: Point
    half_thickness: float = 0.0
    seen: float = 1.0


@dataclass(frozen=True)
class World:
    """What beams meet: opaque ``edges`` (n, 4) and ``discs`` (c, 3), ``panes`` (g, 4) of glass.

    A beam returns from a pane with probability ``seen`` (g,). All in metres, map frame. ``strokes`` are
    what the edges and panes are the outlines of.
    """

    strokes: tuple[Stroke, ...]
    edges: Array
    panes: Array
    seen: Array
    discs: Array


def build_world(building: Building, *, mapped: bool) -> World:
    """The building as it stood when the map was made (``mapped``), or as it stands now.

    Raises MclError for a door, passage or pane that lies on no wall.
    """
    strokes = _walls(building)
    strokes += [_leaf(door, mapped=mapped) for door in building.doors]
    strokes += [Stroke(pane.start, pane.end, seen=pane.seen) for pane in building.glass]
    furniture = [piece for piece in building.furniture if piece.mapped or not mapped]
    for piece in furniture:
        strokes += _outline(piece)
    panes = [s for s in strokes if s.seen < 1.0]
    return World(
        strokes=tuple(strokes),
        edges=_rows([edge for s in strokes if s.seen >= 1.0 for edge in _edges(s)], 4),
        panes=_rows([(*s.start, *s.end) for s in panes], 4),
        seen=np.array([s.seen for s in panes]),
        discs=_rows([(*p.at, p.radius) for p in furniture if p.radius is not None], 3),
    )


def people_at(people: Sequence[Person], times: ArrayLike) -> Array:
    """Where the people are at ``times`` (...,) s: discs (..., p, 3) x, y, radius in m."""
    times = np.asarray(times, dtype=np.float64)
    discs = np.empty((*times.shape, len(people), 3))
    for i, person in enumerate(people):
        discs[..., i, 0], discs[..., i, 1] = _walked(person, times)
        discs[..., i, 2] = person.radius
    return discs


def _walked(person: Person, times: Array) -> tuple[Array, Array]:
    path = np.asarray(person.path)
    lengths = np.concatenate([[0.0], np.cumsum(np.hypot(*np.diff(path, axis=0).T))])
    walked = person.speed * np.maximum(times - person.start, 0.0) % (2.0 * lengths[-1])
    at = np.minimum(walked, 2.0 * lengths[-1] - walked)  # to and fro
    return np.interp(at, lengths, path[:, 0]), np.interp(at, lengths, path[:, 1])


def _walls(building: Building) -> list[Stroke]:
    lines: list[tuple[Point, Point]] = []
    for room in building.rooms:
        x0, y0, x1, y1 = room.box
        corners = [(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)]
        lines += list(itertools.pairwise(corners))
    for wall in building.walls:
        lines += list(itertools.pairwise(wall))
    openings: Sequence[Opening] = [*building.doors, *building.passages, *building.glass]
    used = [False] * len(openings)
    strokes: list[Stroke] = []
    for start, end in lines:
        gaps = [_gap(start, end, opening) for opening in openings]
        used = [was or gap is not None for was, gap in zip(used, gaps, strict=True)]
        strokes += _pieces(start, end, [gap for gap in gaps if gap is not None], building.wall_thickness / 2)
    for opening, was_used in zip(openings, used, strict=True):
        if not was_used:
            kind = {Door: "door", Glass: "glass"}.get(type(opening), "passage")
            place = f"{kind} from {opening.start} to {opening.end}"
            raise MclError(f"the {place} lies on no wall", "move it onto a wall's line")
    return strokes


def _gap(start: Point, end: Point, opening: Opening) -> tuple[float, float] | None:
    """The part of the wall from ``start`` to ``end`` that the opening takes, in metres from the start."""
    a, wall = np.asarray(start), np.subtract(end, start)
    length = float(np.hypot(*wall))
    if length == 0.0:
        return None
    unit = wall / length
    to = np.array([opening.start, opening.end]) - a
    off = np.abs(unit[0] * to[:, 1] - unit[1] * to[:, 0])
    low, high = np.clip(np.sort(to @ unit), 0.0, length)
    return (float(low), float(high)) if off.max() <= ON_THE_WALL and high > low else None


def _pieces(start: Point, end: Point, gaps: list[tuple[float, float]], half: float) -> list[Stroke]:
    """What the gaps leave of a wall; its own ends reach half a thickness further, which closes the corners."""
    a, wall = np.asarray(start), np.subtract(end, start)
    length = float(np.hypot(*wall))
    if length == 0.0:
        return []
    unit, strokes, at = wall / length, [], -half
    for low, high in [*sorted(gaps), (length + half, length + half)]:
        if low > max(at, 0.0):
            p, q = a + at * unit, a + low * unit
            strokes.append(Stroke((p[0], p[1]), (q[0], q[1]), half))
        at = max(at, high)
    return strokes


def _leaf(door: Door, *, mapped: bool) -> Stroke:
    angle = door.mapped_open_deg if mapped and door.mapped_open_deg is not None else door.open_deg
    turn = np.deg2rad(angle)
    x, y = np.subtract(door.end, door.start)
    end = (door.start[0] + np.cos(turn) * x - np.sin(turn) * y, door.start[1] + np.sin(turn) * x + np.cos(turn) * y)
    return Stroke(door.start, (float(end[0]), float(end[1])), DOOR_THICKNESS / 2)


def _outline(piece: Furniture) -> list[Stroke]:
    if piece.size is None:
        return []
    turn = np.deg2rad(piece.turn_deg)
    corners = np.array([(-1, -1), (1, -1), (1, 1), (-1, 1), (-1, -1)]) * np.asarray(piece.size) / 2
    x = piece.at[0] + np.cos(turn) * corners[:, 0] - np.sin(turn) * corners[:, 1]
    y = piece.at[1] + np.sin(turn) * corners[:, 0] + np.cos(turn) * corners[:, 1]
    points = [(float(px), float(py)) for px, py in zip(x, y, strict=True)]
    return [Stroke(p, q) for p, q in itertools.pairwise(points)]


def _edges(stroke: Stroke) -> list[tuple[float, ...]]:
    """The outline of a stroke: the line itself, or the four sides of the box around it."""
    p, q, half = np.asarray(stroke.start), np.asarray(stroke.end), stroke.half_thickness
    if half == 0.0:
        return [(*p, *q)]
    aside = np.array([p[1] - q[1], q[0] - p[0]]) / np.hypot(*(q - p)) * half
    corners = [p - aside, q - aside, q + aside, p + aside, p - aside]
    return [(*a, *b) for a, b in itertools.pairwise(corners)]


def _rows(rows: Sequence[Sequence[float]], width: int) -> Array:
    return np.array(rows, dtype=np.float64).reshape(-1, width)
