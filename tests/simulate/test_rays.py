"""Rays against a slow and obvious twin, and against distances known by hand."""

from __future__ import annotations

import math

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from pipeline.simulate.rays import disc_hits, segment_hits


def walk(origin, direction, inside, limit=12.0, step=1e-3):
    """Goes along the ray in small steps until ``inside`` says so: the obvious way."""
    for i in range(1, int(limit / step)):
        if inside(origin[0] + i * step * direction[0], origin[1] + i * step * direction[1]):
            return i * step
    return math.inf


def solved(origin, direction, segment):
    """The same as two linear equations, solved one ray and one segment at a time."""
    x0, y0, x1, y1 = segment
    matrix = np.array([[direction[0], x0 - x1], [direction[1], y0 - y1]])
    if abs(np.linalg.det(matrix)) < 1e-9:
        return math.inf
    distance, along = np.linalg.solve(matrix, [x0 - origin[0], y0 - origin[1]])
    return float(distance) if distance > 0 and 0 <= along <= 1 else math.inf


coordinate = st.floats(-5, 5)


@given(
    st.tuples(coordinate, coordinate),
    st.lists(st.floats(-math.pi, math.pi), min_size=1, max_size=4),
    st.lists(st.tuples(coordinate, coordinate, coordinate, coordinate), min_size=1, max_size=4),
)
def test_segments_agree_with_linear_equations(origin, angles, segments) -> None:
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    found = segment_hits(np.array(origin), directions, np.array(segments))
    for i, direction in enumerate(directions):
        for j, segment in enumerate(segments):
            expected = solved(origin, direction, segment)
            grazes = not np.isclose(found[i, j], expected, atol=1e-6, rtol=1e-6)
            assert not grazes or _undecided(origin, direction, segment)


def _undecided(origin, direction, segment) -> bool:
    """Whether rounding decides: the ray starts on the segment's line, or passes within a hair of one of its ends."""
    ends = np.array(segment).reshape(2, 2) - origin
    off = np.abs(direction[0] * ends[:, 1] - direction[1] * ends[:, 0])
    length = math.hypot(*(ends[1] - ends[0]))
    start_off = abs(ends[0, 0] * ends[1, 1] - ends[0, 1] * ends[1, 0])
    return bool(off.min() < 1e-6 or length < 1e-6 or start_off < 1e-6 * length)


def test_discs_agree_with_walking_there() -> None:
    rng = np.random.default_rng(1)
    discs = np.column_stack([rng.uniform(-4, 4, (6, 2)), rng.uniform(0.1, 1.0, 6)])
    angles = rng.uniform(-np.pi, np.pi, 8)
    directions = np.stack([np.cos(angles), np.sin(angles)], axis=-1)
    found = disc_hits(np.zeros(2), directions, discs)
    for j, (cx, cy, radius) in enumerate(discs):
        if math.hypot(cx, cy) < radius:
            continue
        for i, direction in enumerate(directions):
            walked = walk((0, 0), direction, lambda x, y, c=(cx, cy), r=radius: math.hypot(x - c[0], y - c[1]) <= r)
            if walked == math.inf:
                chord = radius - abs(direction[0] * cy - direction[1] * cx)
                assert found[i, j] == math.inf or chord < 1e-6
            else:
                assert abs(found[i, j] - walked) < 2e-3


def test_known_distances() -> None:
    east, north = [1.0, 0.0], [0.0, 1.0]
    wall = np.array([[3.0, -1.0, 3.0, 1.0]])
    assert segment_hits(np.zeros(2), np.array([east, north]), wall).tolist() == [[3.0], [math.inf]]
    assert segment_hits(np.array([4.0, 0.0]), np.array([east]), wall).tolist() == [[math.inf]]
    disc = np.array([[0.0, 5.0, 2.0]])
    assert disc_hits(np.zeros(2), np.array([east, north]), disc).tolist() == [[math.inf], [3.0]]


def test_no_ray_slips_between_two_walls_that_meet() -> None:
    corner = np.array([[0.1, 0.7, 3.3, 2.9], [3.3, 2.9, 5.1, -1.7]])
    direction = np.array([[3.3, 2.9]]) / math.hypot(3.3, 2.9)
    nearest = segment_hits(np.zeros(2), direction, corner).min()
    assert abs(nearest - math.hypot(3.3, 2.9)) < 1e-6


def test_nothing_to_meet() -> None:
    direction = np.array([[1.0, 0.0]])
    assert segment_hits(np.zeros(2), direction, np.empty((0, 4))).shape == (1, 0)
    assert disc_hits(np.zeros(2), direction, np.empty((0, 3))).shape == (1, 0)
