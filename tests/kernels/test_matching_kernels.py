"""Matching a scan to remembered walls, against twins that compare everything with everything."""

from __future__ import annotations

import math

import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline.kernels import kernel, matching

SIZE, CELLS, REACH, SCALE = 0.1, 256, 0.5, 0.05
seeds = st.integers(0, 2**32 - 1)


@kernel
def nearest_of_all(x, y, points, cells, inverse_cell, index, squared):
    for k in range(len(x)):
        index[k], squared[k] = matching.nearest(x[k], y[k], points, cells, inverse_cell)


def memory(points) -> tuple[np.ndarray, np.ndarray, float]:
    points = np.ascontiguousarray(points, np.float32)
    cells = np.full((CELLS, CELLS), -1, np.int32)
    matching.enter(points, 0, points.shape[1], cells, 1.0 / SIZE, REACH)
    return points, cells, 1.0 / SIZE


def room(spacing: float = 0.05, half=(3.0, 2.0)) -> np.ndarray:
    """Points (4, n) all along the walls of a rectangle with a bay, whose normals face inwards."""
    corners = np.array([(-3, -2), (3, -2), (3, 2), (0.8, 2), (0.8, 1.2), (-0.6, 1.2), (-0.6, 2), (-3, 2)], float)
    corners *= np.array(half) / (3, 2)
    walls = []
    for a, b in zip(corners, np.roll(corners, -1, axis=0), strict=True):
        along = (b - a) / np.linalg.norm(b - a)
        for t in np.arange(spacing / 2, np.linalg.norm(b - a), spacing):
            walls.append([*(a + t * along), -along[1], along[0]])
    return np.array(walls).T


def as_seen_from(points, pose) -> np.ndarray:
    """The same points in the frame of a pose."""
    c, s = math.cos(pose[2]), math.sin(pose[2])
    dx, dy = points[0] - pose[0], points[1] - pose[1]
    out = [c * dx + s * dy, c * dy - s * dx, c * points[2] + s * points[3], c * points[3] - s * points[2]]
    return np.array(out, np.float32)


def aligned(seen, guess, points, reach: float = REACH) -> tuple[np.ndarray, np.ndarray, float]:
    pose, normal = np.empty(3), np.empty((3, 3))
    seen = np.ascontiguousarray(seen, np.float32)
    fit = matching.align(seen, seen.shape[1], np.array(guess, float), *memory(points), reach, SCALE, pose, normal)
    return pose, normal, fit


def some_walls(rng, n: int) -> np.ndarray:
    turned = rng.uniform(-np.pi, np.pi, n)
    return np.array([*rng.uniform(-2.0, 2.0, (2, n)), np.cos(turned), np.sin(turned)], np.float32)


@given(seeds, st.integers(1, 60))
@settings(max_examples=40, deadline=None)
def test_every_cell_knows_the_point_nearest_to_its_centre(seed: int, n: int) -> None:
    rng = np.random.default_rng(seed)
    points, cells, inverse = memory(some_walls(rng, n))
    centres = (np.stack(np.meshgrid(np.arange(-28, 28), np.arange(-28, 28)), axis=-1).reshape(-1, 2) + 0.5) * SIZE
    index, squared = np.empty(len(centres), np.int64), np.empty(len(centres))
    nearest_of_all(*np.ascontiguousarray(centres.T), points, cells, inverse, index, squared)
    expected, margin = reference.nearest_to_cells(points[:2].astype(float), centres, REACH)
    sure = margin > 1e-6
    np.testing.assert_array_equal(index[sure], expected[sure])
    away = np.hypot(*(centres.T - points[:2, index]))
    np.testing.assert_allclose(squared[index >= 0], away[index >= 0] ** 2, atol=1e-6)
    assert np.isinf(squared[index < 0]).all()


def test_points_may_be_entered_in_parts_and_in_any_order() -> None:
    rng = np.random.default_rng(0)
    points = np.ascontiguousarray(some_walls(rng, 80))
    _, whole, inverse = memory(points)
    parts = np.full((CELLS, CELLS), -1, np.int32)
    for first, last in ((40, 80), (0, 17), (17, 40)):
        matching.enter(points, first, last, parts, inverse, REACH)
    np.testing.assert_array_equal(whole, parts)


def test_the_grid_goes_round() -> None:
    """A point far outside is found where it is; places that share a cell with it are far from it."""
    points, cells, inverse = memory([[1003.21], [-507.4], [1.0], [0.0]])
    index, squared = np.empty(2, np.int64), np.empty(2)
    x = np.array([1003.25, 1003.25 + CELLS * SIZE])
    nearest_of_all(x, np.array([-507.4, -507.4]), points, cells, inverse, index, squared)
    assert index.tolist() == [0, 0]
    assert squared[0] == pytest.approx(0.04**2, rel=0.02)
    assert squared[1] > (CELLS * SIZE - 1.0) ** 2


@given(seeds)
@settings(max_examples=25, deadline=None)
def test_align_is_the_iteration_of_the_twin(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pose = rng.uniform([-1, -1, -3], [1, 0.5, 3])
    walls = room()[:, ::2]
    seen = as_seen_from(room()[:, rng.choice(room().shape[1], 50, replace=False)], pose)
    seen[:2] += rng.normal(0.0, 0.01, (2, 50)).astype(np.float32)
    guess = pose + rng.normal(0.0, [0.05, 0.05, 0.03])
    remembered = reference.Walls(walls.astype(np.float32), SIZE, REACH)
    expected, equations, undecided = reference.align(seen, guess, remembered, REACH, SCALE, matching.FACING)
    if undecided:
        return
    found, normal, fit = aligned(seen, guess, walls)
    np.testing.assert_allclose(found, expected, atol=1e-6)
    np.testing.assert_allclose(normal, equations, rtol=1e-4, atol=1e-4)
    again, undecided = reference.fit(seen, found, remembered, SCALE, matching.FACING)
    assert undecided or fit == pytest.approx(again, abs=1e-6)


@given(seeds)
@settings(max_examples=60, deadline=None)
def test_a_room_is_found_from_near_by(seed: int) -> None:
    """Without noise, from 0.15 m and 6 degrees away, to a millimetre and a milliradian."""
    rng = np.random.default_rng(seed)
    pose = rng.uniform([-2, -1.5, -3], [2, 0.5, 3])
    seen = as_seen_from(room()[:, rng.choice(room().shape[1], 120, replace=False)], pose)
    found, normal, fit = aligned(seen, pose + rng.uniform(-1, 1, 3) * [0.15, 0.15, 0.1], room())
    np.testing.assert_allclose(found, pose, atol=1e-3)
    assert fit > 0.9, "in a corner some points find the other wall first"
    assert np.linalg.eigvalsh(normal).min() > 1.0


def test_a_hallway_is_found_across_and_left_open_along() -> None:
    x = np.arange(-8, 8, 0.05)
    walls = np.vstack(
        [np.tile(x, 2), np.repeat([-1.0, 1.0], len(x)), np.zeros(2 * len(x)), np.repeat([1.0, -1.0], len(x))]
    )
    pose = np.array([0.3, 0.2, 0.5])
    near = walls[:, np.abs(walls[0]) < 4][:, ::3]
    guess = pose + np.array([0.4, 0.1, 0.05])
    found, normal, fit = aligned(as_seen_from(near, pose), guess, walls)
    np.testing.assert_allclose(found[1:], pose[1:], atol=1e-3)
    assert found[0] == pytest.approx(guess[0], abs=0.05), "nothing pulls along it"
    assert normal[0, 0] < 1e-3 * normal[1, 1]
    assert fit > 0.99


def test_walls_have_two_sides() -> None:
    """A scan of the far side of every wall fits none of them."""
    pose = np.array([0.1, -0.2, 0.4])
    seen = as_seen_from(room(), pose)
    seen[2:] *= -1.0
    _, normal, fit = aligned(seen, pose, room())
    assert fit == 0.0
    assert not normal.any()


def test_a_scan_of_nothing_stays_where_it_was_guessed() -> None:
    found, normal, fit = aligned(np.empty((4, 0), np.float32), (1.0, 2.0, 0.5), room())
    assert found.tolist() == [1.0, 2.0, 0.5]
    assert not normal.any()
    assert fit == 0.0


@given(seeds)
@settings(max_examples=40, deadline=None)
def test_fit(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pose = rng.uniform([-1, -1, -3], [1, 0.5, 3])
    seen = np.ascontiguousarray(as_seen_from(room()[:, ::3], pose))
    seen[:2] += rng.normal(0.0, 0.05, seen[:2].shape).astype(np.float32)
    seen[2:, ::7] *= -1.0
    at = pose + rng.normal(0.0, [0.05, 0.05, 0.02])
    points = room().astype(np.float32)
    expected, undecided = reference.fit(seen, at, reference.Walls(points, SIZE, REACH), SCALE, matching.FACING)
    if not undecided:
        assert matching.fit(seen, seen.shape[1], at, *memory(points), SCALE) == pytest.approx(expected, abs=1e-6)


@given(seeds)
@settings(max_examples=10, deadline=None)
def test_sweep_finds_the_best_heading_and_the_best_place_there(seed: int) -> None:
    rng = np.random.default_rng(seed)
    pose = rng.uniform([-1, -1, -3], [1, 0.5, 3])
    seen = np.ascontiguousarray(as_seen_from(room()[:, rng.choice(room().shape[1], 25, replace=False)], pose))
    centre, points = pose + rng.uniform(-0.3, 0.3, 3), room().astype(np.float32)
    angles = centre[2] - 0.4 + 0.1 * np.arange(9)
    poses, scores = np.empty((9, 3)), np.empty(9)
    matching.sweep(seen, 25, centre, 0.8, 0.2, 0.4, 0.1, *memory(points), 0.2, poses, scores)
    # Around the best of the double steps two single ones are looked at on every side, also beyond the window.
    expected = reference.sweep(seen, centre, 1.2, 0.2, angles, reference.Walls(points, SIZE, REACH), 0.2)
    best = expected.reshape(9, -1).max(axis=1)
    # The window is looked through in double steps first, so that a wrong heading's best place may be missed: what it
    # has is less then. A point on the border of a cell may be counted here and not there.
    border = 1.01 / 25
    assert (scores <= best + border).all()
    assert abs(scores.max() - best.max()) <= border
    np.testing.assert_allclose(poses[:, 2], angles, atol=1e-12)
    top = int(np.argmax(scores))
    row, col = (round((poses[top, axis] - centre[axis]) / 0.2) + 6 for axis in (1, 0))
    assert abs(expected.reshape(9, 13, 13)[top, row, col] - best.max()) <= border


def test_a_sweep_prefers_what_is_near_where_all_fits_alike() -> None:
    seen = np.ascontiguousarray(as_seen_from(room()[:, ::5], (0.0, 0.0, 0.0)))
    poses, scores = np.empty((3, 3)), np.empty(3)
    nothing = np.full((4, 1), 500.0, np.float32)
    matching.sweep(
        seen, seen.shape[1], np.array([1.0, 2.0, 0.3]), 1.0, 0.2, 0.1, 0.1, *memory(nothing), 0.2, poses, scores
    )
    np.testing.assert_allclose(poses, [[1.0, 2.0, 0.2], [1.0, 2.0, 0.3], [1.0, 2.0, 0.4]], atol=1e-12)
    assert scores.argmax() == 1


@given(seeds)
@settings(max_examples=20, deadline=None)
def test_carry(seed: int) -> None:
    rng = np.random.default_rng(seed)
    seen, pose = some_walls(rng, 30), rng.uniform([-5, -5, -3], [5, 5, 3])
    out = np.empty((4, 30), np.float32)
    matching.carry(seen, pose, out)
    np.testing.assert_allclose(out, np.vstack(reference.posed(seen, pose)), atol=2e-6)
    np.testing.assert_allclose(as_seen_from(out, pose), seen, atol=1e-5)
