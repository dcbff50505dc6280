"""True ranges three ways, each against its slow twin and against the others."""

from __future__ import annotations

import math
from unittest.mock import patch

import numpy as np
import pytest
import reference
from hypothesis import given, settings
from hypothesis import strategies as st

from pipeline import kernels
from pipeline.kernels import raycast
from pipeline.maps import range_table
from pipeline.maps.range_table import HEADINGS, HIT_CODES, LOG_OFFSET, UNKNOWN_CODES, RangeCodes, opaque_cells

seeds = st.integers(0, 2**32 - 1)
NOWHERE = math.inf


def random_map(rng, height: int = 24, width: int = 31, specks: float = 0.04) -> np.ndarray:
    """Boxes of wall and of unknown land, and single cells: what is thick, thin and touches at corners."""
    opaque = np.where(rng.random((height, width)) < specks, rng.integers(1, 3, (height, width)), 0)
    for kind in (1, 1, 2):
        row, col = rng.integers(0, height - 4), rng.integers(0, width - 4)
        opaque[row : row + rng.integers(1, 6), col : col + rng.integers(1, 6)] = kind
    return opaque.astype(np.uint8)


def random_poses(rng, opaque, n: int) -> np.ndarray:
    """Anywhere on the map and up to two cells beside it."""
    height, width = opaque.shape
    return np.column_stack(
        [rng.uniform(-2, width + 2, n), rng.uniform(-2, height + 2, n), rng.uniform(-np.pi, np.pi, n)]
    )


def cast(opaque, poses, angles, max_range=200.0, *, bresenham=False) -> np.ndarray:
    out = np.empty((len(poses), len(angles)), np.float32)
    raycast.cast(opaque, np.asarray(poses, float), np.asarray(angles, float), float(max_range), bool(bresenham), out)
    return out


def cast_table(opaque, cells, codes: RangeCodes, *, parallel: bool = False) -> np.ndarray:
    """Codes of the table for cells of one metre."""
    rows = np.empty((len(cells), HEADINGS), np.uint8)
    with patch.object(kernels, "PARALLEL_WORK", 0 if parallel else 10**12):
        range_table.RangeCaster(opaque, codes, 1.0).cast(cells.astype(np.int32), rows)
    return rows


def code_of(distance: float, kind: int, max_range: float) -> int:
    return reference.encode(distance, kind, max_range, LOG_OFFSET, HIT_CODES, UNKNOWN_CODES)


@given(seeds)
@settings(max_examples=40, deadline=None)
def test_dda_finds_what_its_twin_finds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    opaque, max_range = random_map(rng), rng.choice([7.5, 20.0, 100.0])
    poses = random_poses(rng, opaque, 12)
    found = cast(opaque, poses, [0.0], max_range)[:, 0]
    expected = [reference.ray(opaque, *pose, max_range)[0] for pose in poses]
    np.testing.assert_allclose(found, expected, rtol=1e-6, atol=1e-6)


@given(seeds)
@settings(max_examples=40, deadline=None)
def test_bresenham_finds_what_its_twin_finds(seed: int) -> None:
    rng = np.random.default_rng(seed)
    opaque, max_range = random_map(rng), rng.choice([7.5, 20.0, 60.0])
    poses = random_poses(rng, opaque, 12)
    found = cast(opaque, poses, [0.0], max_range, bresenham=True)[:, 0]
    expected = [reference.ray_bresenham(opaque, *pose, max_range)[0] for pose in poses]
    np.testing.assert_allclose(found, expected, rtol=1e-6)


@pytest.mark.parametrize("bresenham", [False, True])
def test_the_ray_says_what_stopped_it(bresenham: bool) -> None:
    one_ray = raycast.bresenham if bresenham else raycast.dda
    twin = reference.ray_bresenham if bresenham else reference.ray
    rng = np.random.default_rng(3)
    opaque = random_map(rng)
    for x, y, angle in random_poses(rng, opaque, 200):
        _, kind = one_ray(opaque, x, y, math.cos(angle), math.sin(angle), 100.0)
        assert kind == twin(opaque, x, y, angle, 100.0)[1]


def test_distances_known_by_hand() -> None:
    opaque = np.zeros((9, 12), np.uint8)
    opaque[:, 10], opaque[8, :] = 1, 2
    pose = [[2.5, 3.25, 0.0]]
    straight = cast(opaque, pose, [0.0, math.pi / 2, math.pi, -math.pi / 2])
    assert straight[0].tolist() == [7.5, 4.75, NOWHERE, NOWHERE]  # to borders; west and south leave the map
    centres = cast(opaque, pose, [0.0, math.pi / 2, math.pi, -math.pi / 2], 30.0, bresenham=True)
    assert centres[0].tolist() == [8.0, 5.0, NOWHERE, NOWHERE]  # from cell to cell
    diagonal = cast(opaque, [[4.25, 2.5, math.pi / 4]], [0.0])
    assert diagonal[0, 0] == pytest.approx(5.5 * math.sqrt(2))


@pytest.mark.parametrize("bresenham", [False, True])
def test_edge_cases(bresenham: bool) -> None:
    opaque = np.zeros((5, 6), np.uint8)
    opaque[2, 4] = 1
    toward = [0.0]
    assert cast(opaque, [[4.5, 2.5, 0.7]], toward, 50, bresenham=bresenham)[0, 0] == 0.0  # starts in the obstacle
    for beside in ([-0.5, 2.5], [6.5, 2.5], [1.0, -0.1], [1.0, 5.1]):  # a laser off the map sees nothing, even inwards
        assert cast(opaque, [[*beside, 0.0]], toward, 50, bresenham=bresenham)[0, 0] == NOWHERE
    assert cast(opaque, [[0.5, 2.5, 0.0]], toward, 3.0, bresenham=bresenham)[0, 0] == NOWHERE  # beyond max_range
    assert cast(opaque, [[0.5, 2.5, 0.0]], toward, 4.0, bresenham=bresenham)[0, 0] in (3.5, 4.0)
    opaque[2, 3] = 2
    assert cast(opaque, [[0.5, 2.5, 0.0]], toward, 50, bresenham=bresenham)[0, 0] in (2.5, 3.0)  # unknown land stops


def test_one_map_cell_without_anything() -> None:
    assert cast(np.zeros((1, 1), np.uint8), [[0.5, 0.5, 0.0]], np.linspace(-3, 3, 9)).min() == NOWHERE
    assert cast(np.ones((1, 1), np.uint8), [[0.5, 0.5, 0.0]], np.linspace(-3, 3, 9)).max() == 0.0


@given(st.floats(0.0, 300.0), st.sampled_from([1, 2]), st.floats(3.0, 250.0))
@settings(deadline=None)
def test_encode_rounds_to_the_nearest_code(distance: float, kind: int, max_range: float) -> None:
    codes = RangeCodes(max_range)
    code = raycast.encode(distance, kind, codes.scale, LOG_OFFSET, HIT_CODES, UNKNOWN_CODES)
    twin = code_of(distance, kind, max_range)
    if code != twin:  # halfway between two codes either is nearest
        share = math.log1p(min(distance, max_range) / LOG_OFFSET) * codes.scale
        steps = share * ((HIT_CODES if kind == 1 else UNKNOWN_CODES) - 1)
        assert abs(code - twin) == 1
        assert abs(steps % 1.0 - 0.5) < 1e-9


@given(st.floats(0.0, 1.0), st.sampled_from([1, 2]), st.floats(3.0, 250.0))
@settings(deadline=None)
def test_a_range_comes_back_within_half_a_step(share: float, kind: int, max_range: float) -> None:
    codes = RangeCodes(max_range)
    distance = share * max_range
    code = raycast.encode(distance, kind, codes.scale, LOG_OFFSET, HIT_CODES, UNKNOWN_CODES)
    count = HIT_CODES if kind == 1 else UNKNOWN_CODES
    half_step = math.expm1(
        0.5 / (count - 1) / codes.scale
    )  # relative to distance + LOG_OFFSET: the scale is logarithmic
    assert abs(codes.ranges[code] - distance) <= (distance + LOG_OFFSET) * half_step * (1 + 1e-9) + 1e-9
    assert bool(codes.ends_unknown[code]) == (kind == 2)


def test_the_codes_cover_the_scale() -> None:
    codes = RangeCodes(82.0)
    hit, unknown = codes.ranges[:HIT_CODES], codes.ranges[HIT_CODES:255]
    assert hit[0] == unknown[0] == 0.0
    assert hit[-1] == pytest.approx(82.0)
    assert unknown[-1] == pytest.approx(82.0)
    assert (np.diff(hit) > 0).all()
    assert (np.diff(unknown) > 0).all()
    assert codes.ranges[255] == np.inf
    assert np.diff(hit)[0] < 0.04  # about 3 cm a step at the laser ...
    assert (np.diff(hit)[1:] / hit[1:-1])[-1] < 0.02  # ... and 2 % of the range far away
    assert raycast.encode(np.inf, 0, codes.scale, LOG_OFFSET, HIT_CODES, UNKNOWN_CODES) == 255


@given(seeds)
@settings(max_examples=8, deadline=None)
def test_the_table_holds_the_rays_from_the_centres_of_the_cells(seed: int) -> None:
    rng = np.random.default_rng(seed)
    opaque = random_map(rng, 11, 14)
    codes = RangeCodes(12.0)
    cells = rng.choice(np.flatnonzero(opaque == 0), 4, replace=False)
    rows = cast_table(opaque, cells, codes)
    for row, cell in zip(rows, cells, strict=True):
        y, x = cell // 14 + 0.5, cell % 14 + 0.5
        for heading in range(0, HEADINGS, 6):  # never 45 degrees, which run exactly through corners
            distance, kind = reference.ray(opaque, x, y, math.radians(heading), codes.max_range)
            assert row[heading] == code_of(distance, kind, codes.max_range)


def test_the_table_in_every_heading_corners_included() -> None:
    rng = np.random.default_rng(5)
    opaque = random_map(rng, 15, 15, specks=0.0)
    codes = RangeCodes(22.0)
    cells = np.flatnonzero(opaque == 0)[::7]
    rows = cast_table(opaque, cells, codes)
    ranges = codes.ranges[rows]
    for i, cell in enumerate(cells):
        for heading in range(HEADINGS):
            x, y, angle = cell % 15 + 0.5, cell // 15 + 0.5, math.radians(heading)
            # A diagonal ray runs exactly through corners, where it may pass on either side.
            low, high = reference.around(opaque, x, y, angle, codes.max_range, sideways=1e-9)
            step = (ranges[i, heading] + LOG_OFFSET) * 0.06 if rows[i, heading] != 255 else 0.0
            assert low - step <= ranges[i, heading] <= high + step


def test_the_table_is_the_same_with_all_threads() -> None:
    opaque = random_map(np.random.default_rng(8), 40, 40)
    cells, codes = np.flatnonzero(opaque == 0), RangeCodes(30.0)
    np.testing.assert_array_equal(cast_table(opaque, cells, codes), cast_table(opaque, cells, codes, parallel=True))


@pytest.mark.parametrize("bresenham", [False, True])
def test_casting_for_particles_agrees_with_the_twin(bresenham: bool) -> None:
    rng = np.random.default_rng(11)
    opaque, codes = random_map(rng), RangeCodes(40.0)
    poses = random_poses(rng, opaque, 150).astype(np.float32)
    laser, angles = (1.5, -0.5, 0.3), np.linspace(-1.5, 1.5, 7)
    found, again = np.empty((150, 7), np.uint8), np.empty((150, 7), np.uint8)
    place = (opaque, *np.ascontiguousarray(poses.T), *laser, angles, 40.0, bresenham)
    scale = codes.scale, LOG_OFFSET, HIT_CODES, UNKNOWN_CODES
    raycast.cast_codes(0, *place, *scale, found)
    raycast.cast_codes(10**9, *place, *scale, again)
    np.testing.assert_array_equal(found, again)

    twin = reference.ray_bresenham if bresenham else reference.ray
    expected = np.empty_like(found)
    for i, (x, y, theta) in enumerate(poses.astype(float)):
        at_x = x + math.cos(theta) * laser[0] - math.sin(theta) * laser[1]
        at_y = y + math.sin(theta) * laser[0] + math.cos(theta) * laser[1]
        for k, angle in enumerate(angles):
            expected[i, k] = code_of(*twin(opaque, at_x, at_y, theta + laser[2] + angle, 40.0), 40.0)
    # Single precision moves a ray by some 1e-6 cells: rarely across a corner, or from one code to the next.
    assert np.mean(found != expected) < 0.005


# --- the three ways against each other -------------------------------------------------------------------------------

BESIDE = np.linspace(-1.0, 1.0, 61)


def rays_beside(opaque, pose, max_range: float, reach: float, turned: float) -> tuple[float, float]:
    """Shortest and longest range of rays shifted sideways by up to ``reach`` cells and turned by up to ``turned``."""
    x, y, a = pose
    starts = np.column_stack([x - reach * BESIDE * math.sin(a), y + reach * BESIDE * math.cos(a), 0 * BESIDE + a])
    seen = cast(opaque, starts, np.linspace(-turned, turned, 21), max_range)
    return float(seen.min()), float(seen.max())


@pytest.fixture(scope="module")
def buildings(office) -> dict[str, np.ndarray]:
    rng = np.random.default_rng(2)
    return {
        "boxes": np.kron(rng.random((12, 16)) < 0.15, np.ones((9, 9))).astype(np.uint8),
        "random": scattered(rng, 90, 120),
        "office": opaque_cells(office.grid, 0.65),
    }


def without_leaks(opaque) -> np.ndarray:
    """Obstacles that touch at a corner only are joined: Bresenham's line steps through there, no ray does."""
    opaque = opaque.copy()
    while True:
        a, b, c, d = (opaque[i : i + opaque.shape[0] - 1, j : j + opaque.shape[1] - 1] for i in (0, 1) for j in (0, 1))
        rising, falling = (a == 0) & (d == 0) & (b > 0) & (c > 0), (a > 0) & (d > 0) & (b == 0) & (c == 0)
        if not (rising | falling).any():
            return opaque
        a[rising], b[falling] = 1, 1


@pytest.mark.parametrize("name", ["boxes", "random", "office"])
def test_bresenham_and_dda_agree_within_a_cell(buildings, name: str) -> None:
    """Bresenham counts from centre to centre, each half a diagonal from where the ray starts and ends: sqrt(2) cells.
    And his line runs up to 1.5 cells beside the ray: it begins and ends at centres, and steps from cell to cell."""
    opaque = without_leaks(buildings[name])
    poses = open_poses(np.random.default_rng(0), opaque, 1500)
    exact, line = cast(opaque, poses, [0.0], 300.0)[:, 0], cast(opaque, poses, [0.0], 300.0, bresenham=True)[:, 0]
    close = agree(exact, line, math.sqrt(2))
    assert close.mean() > 0.85
    # The others graze an obstacle: some ray beside theirs does see what Bresenham sees, but for a few
    # where his staircase slips through a gap too crooked for any straight ray.
    slipped = 0
    for pose, found in zip(poses[~close], line[~close], strict=True):
        low, high = rays_beside(opaque, pose, 300.0, reach=1.5, turned=0.005)
        assert low - math.sqrt(2) <= found
        slipped += found > high + math.sqrt(2)
    assert slipped <= 3  # of 1500


def agree(a, b, within) -> np.ndarray:
    with np.errstate(invalid="ignore"):
        return (a == b) | (np.abs(a - b) <= within)  # equal where both are inf


@pytest.mark.parametrize("name", ["boxes", "random", "office"])
def test_the_table_and_dda_agree_within_a_cell_and_a_heading(buildings, name: str) -> None:
    """The table knows a ray from the centre of its cell (0.71 cells away at most), at a heading half a degree off at
    most, in a code half a step off at most: 1 % of the range and a fifth of a cell here."""
    opaque = buildings[name]
    rng = np.random.default_rng(1)
    poses = open_poses(rng, opaque, 1500)
    codes = RangeCodes(float(np.hypot(*opaque.shape)))
    col, row = np.floor(poses[:, 0]).astype(int), np.floor(poses[:, 1]).astype(int)
    cells = np.flatnonzero(opaque == 0)
    row_of_cell = np.full(opaque.size, -1)
    row_of_cell[cells] = np.arange(len(cells))
    rows = cast_table(opaque, cells, codes, parallel=True)
    heading = np.round(np.degrees(poses[:, 2])).astype(int) % HEADINGS
    code = rows[row_of_cell[row * opaque.shape[1] + col], heading]
    exact, read = cast(opaque, poses, [0.0], codes.max_range)[:, 0], codes.ranges[code]
    # A ray that ends in unknown land has a coarser code: half of a step of 1/30 of the logarithmic scale.
    step = np.where(codes.ends_unknown[code], math.expm1(0.5 / (UNKNOWN_CODES - 1) / codes.scale), 0.012)
    with np.errstate(invalid="ignore"):
        close = agree(exact, read, 1.0 + step * (exact + LOG_OFFSET))
    assert close.mean() > 0.75
    for i in np.flatnonzero(~close):
        low, high = rays_beside(opaque, poses[i], codes.max_range, reach=0.75, turned=math.radians(0.51))
        slack = 1.0 + step[i] * (read[i] + LOG_OFFSET) if np.isfinite(read[i]) else 0.0
        assert low - slack <= read[i] <= high + slack


def scattered(rng, height: int, width: int) -> np.ndarray:
    """Many overlapping boxes of wall and unknown land."""
    opaque = np.zeros((height, width), np.uint8)
    for row, col in zip(rng.integers(0, height, 60), rng.integers(0, width, 60), strict=True):
        opaque[row : row + rng.integers(2, 9), col : col + rng.integers(2, 9)] = rng.integers(1, 3)
    return opaque


def open_poses(rng, opaque, n: int) -> np.ndarray:
    cells = rng.choice(np.flatnonzero(opaque == 0), n)
    at = rng.random((2, n))
    return np.column_stack(
        [cells % opaque.shape[1] + at[0], cells // opaque.shape[1] + at[1], rng.uniform(-np.pi, np.pi, n)]
    )
