"""What scans have shown of the world: counts that become walls and floor, a renewed map, and a file."""

from __future__ import annotations

import dataclasses
from pathlib import Path

import numpy as np
import pytest

from pipeline.errors import MclError
from pipeline.geometry import Pose
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.maps.range_table import range_codes
from pipeline.world.seen import FREE, MEMORY, UNKNOWN, WALL, Seen, read_seen, seen_in
from pipeline.world.world import MARGIN, MOST, World

SAME_AS_MAPPED, NEW_WALL, GONE, NEW_FLOOR = 0, 1, 2, 3
MARGIN_CELLS = 3


def seen(hits: np.ndarray | None = None, passes: np.ndarray | None = None, origin: Pose = (2.0, -1.0, 0.4)) -> Seen:
    """Of a map of 20 x 12 cells of 0.1 m: floor, a wall in column 15 (12 of the map), unknown to the right of it."""
    mapped = np.full((18, 26), UNKNOWN, np.uint8)
    mapped[3:15, 3:15] = FREE
    mapped[3:15, 15] = WALL
    nothing = np.zeros(mapped.shape, np.float32)
    return Seen(
        mapped,
        nothing if hits is None else hits.astype(np.float32),
        nothing if passes is None else passes.astype(np.float32),
        MARGIN_CELLS,
        0.1,
        origin,
        "a" * 64,
    )


def counts(**cells: float) -> np.ndarray:
    out = np.zeros((18, 26))
    for name, value in cells.items():
        row, col = map(int, name[1:].split("_"))
        out[row, col] = value
    return out


def test_nothing_seen_is_as_mapped() -> None:
    nothing = seen()
    assert not nothing.changed.any()
    np.testing.assert_array_equal(nothing.kinds, nothing.mapped)


@pytest.mark.parametrize(
    ("hits", "passes", "kind"),
    [
        (1.0, 0.0, FREE),  # somebody stood there once
        (2.0, 0.0, WALL),
        (4.0, 5.0, WALL),
        (4.0, 6.0, FREE),  # no more than four in ten ended there
        (20.0, 0.0, WALL),
    ],
)
def test_how_many_scans_make_a_wall(hits: float, passes: float, kind: int) -> None:
    assert seen(counts(c8_8=hits), counts(c8_8=passes)).kinds[8, 8] == kind


@pytest.mark.parametrize(("hits", "passes", "kind"), [(0.0, 2.0, WALL), (0.0, 3.0, FREE), (1.0, 8.0, WALL)])
def test_how_many_scans_take_a_wall_away(hits: float, passes: float, kind: int) -> None:
    assert seen(counts(c8_15=hits), counts(c8_15=passes)).kinds[8, 15] == kind


def test_new_walls_gone_walls_and_new_floor_are_told_apart() -> None:
    hits, passes = counts(c8_8=5.0), np.zeros((18, 26))
    passes[5, 14:24] = 6.0  # through the wall, and on through what was unknown
    found = seen(hits, passes).changed
    expected = np.zeros((18, 26), np.uint8)
    expected[8, 8], expected[5, 15], expected[5, 16:24] = NEW_WALL, GONE, NEW_FLOOR
    np.testing.assert_array_equal(found, expected)


def test_a_wall_that_is_almost_where_it_was_is_where_it_was() -> None:
    """Maps are drawn no better: seen two cells before the mapped one, which beams pass, it has not moved."""
    hits, passes = np.zeros((18, 26)), np.zeros((18, 26))
    hits[3:15, 13], passes[3:15, 15] = 9.0, 9.0
    assert not seen(hits, passes).changed.any()
    # A metre before it, it is another one, and the mapped one is gone.
    hits[:, 13], hits[3:15, 5] = 0.0, 9.0
    found = seen(hits, passes).changed
    assert set(found[3:15, 5]) == {NEW_WALL}
    assert set(found[3:15, 15]) == {GONE}


def test_on_a_map_without_walls_every_wall_is_new() -> None:
    bare = dataclasses.replace(seen(counts(c8_8=5.0)), mapped=np.full((18, 26), UNKNOWN, np.uint8))
    assert np.argwhere(bare.changed).tolist() == [[8, 8]]


# --- the renewed map -------------------------------------------------------------------------------------------------


def centre(row: int, col: int) -> np.ndarray:
    """Of a cell of the raster, in the map frame, where the map was."""
    grid = OccupancyGrid(np.zeros((12, 20), np.float32), 0.1, seen().origin)
    return grid.to_map([(col - MARGIN_CELLS + 0.5) * 0.1, (row - MARGIN_CELLS + 0.5) * 0.1, 0.0])


def at(grid: OccupancyGrid, place: np.ndarray) -> float:
    col, row = np.floor(grid.to_grid(place)[:2] / grid.resolution).astype(int)
    return float(grid.occupancy[row, col])


def test_every_cell_of_the_renewed_map_lies_where_it_lay() -> None:
    """Cut to what is known, left and below the old map's corner too; the origin's yaw stays."""
    hits, passes = counts(c1_2=5.0, c16_20=5.0), np.zeros((18, 26))
    passes[5, 14:24] = 6.0
    found = seen(hits, passes)
    grid = found.renewed()
    assert (grid.resolution, grid.origin[2]) == (0.1, 0.4)
    kinds = found.kinds
    rows, cols = np.nonzero(kinds != UNKNOWN)
    assert grid.occupancy.shape == (np.ptp(rows) + 1, np.ptp(cols) + 1)
    assert (rows.min(), cols.min()) == (1, 2)
    for row, col in zip(rows, cols, strict=True):
        assert at(grid, centre(row, col)) == (1.0 if kinds[row, col] == WALL else 0.0)
    assert np.isnan(grid.occupancy).sum() == grid.occupancy.size - len(rows)


def test_a_map_of_which_nothing_changed_is_renewed_to_itself() -> None:
    grid = seen().renewed()
    np.testing.assert_allclose(grid.origin, seen().origin)
    assert grid.occupancy.shape == (12, 13)
    assert (grid.occupancy[:, :12] == 0.0).all()
    assert (grid.occupancy[:, 12] == 1.0).all()


def test_of_nothing_known_there_is_a_map_of_one_unknown_cell() -> None:
    nothing = dataclasses.replace(seen(), mapped=np.full((18, 26), UNKNOWN, np.uint8))
    assert np.isnan(nothing.renewed().occupancy).tolist() == [[True]]


# --- several runs, and files -----------------------------------------------------------------------------------------


def test_what_two_runs_saw_adds_up() -> None:
    once = seen(counts(c8_8=1.0), counts(c5_15=2.0))
    both = once.merged(once)
    assert not once.changed.any()
    assert both.changed[8, 8] == NEW_WALL
    assert both.changed[5, 15] == GONE


def test_runs_on_different_maps_do_not_add_up() -> None:
    for other in (
        dataclasses.replace(seen(), map_sha256="b" * 64),
        dataclasses.replace(seen(), mapped=np.zeros((2, 2))),
    ):
        with pytest.raises(MclError, match="different maps"):
            seen().merged(other)


def test_what_is_written_is_read_back(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    left = seen(rng.integers(0, 20, (18, 26)), rng.integers(0, 20, (18, 26)))
    left.write(tmp_path / MEMORY)
    found = read_seen(tmp_path / MEMORY)
    for name in ("mapped", "hits", "passes"):
        there, here = getattr(found, name), getattr(left, name)
        assert there.dtype == here.dtype
        np.testing.assert_array_equal(there, here)
    for name in ("margin", "resolution", "origin", "map_sha256"):
        assert getattr(found, name) == getattr(left, name)
    (tmp_path / "run.rrd").touch()
    for run in (tmp_path, tmp_path / "run.rrd"):  # its folder, or its recording
        together = seen_in([run, tmp_path])
        assert together is not None
        np.testing.assert_array_equal(together.hits, 2 * left.hits)
    assert seen_in([]) is None


def bad_files(folder: Path) -> dict[str, Path]:
    seen().write(folder / "good.npz")
    whole = (folder / "good.npz").read_bytes()
    (folder / "cut.npz").write_bytes(whole[: len(whole) // 2])
    (folder / "empty.npz").touch()
    (folder / "letter.npz").write_text("Dear robot,\n")
    np.savez(folder / "other.npz", walls=np.zeros(3))
    np.save(folder / "array.npy", np.zeros(3))
    with np.load(folder / "good.npz") as file:
        parts = dict(file)
    np.savez(folder / "shapes.npz", **(parts | {"hits": np.zeros((2, 2), np.float16)}))
    np.savez(folder / "flat.npz", **(parts | {name: np.zeros(9, np.float16) for name in ("mapped", "hits", "passes")}))
    np.savez(folder / "origin.npz", **(parts | {"origin": np.zeros(5)}))
    np.savez(folder / "margin.npz", **(parts | {"margin": np.zeros(5)}))
    np.savez(folder / "words.npz", **(parts | {"hits": np.full((18, 26), "many")}))
    np.savez(folder / "scalar.npz", **(parts | {"origin": np.array(1.0)}))
    return {path.name: path for path in folder.iterdir() if path.name != "good.npz"}


def test_what_is_no_memory_is_said_so_in_one_line(tmp_path: Path) -> None:
    files = bad_files(tmp_path)
    assert len(files) == 11
    for name, path in files.items():
        with pytest.raises(MclError, match="no memory of a run") as raised:
            read_seen(path)
        assert name in str(raised.value)
        assert "\n" not in str(raised.value)
    with pytest.raises(MclError, match="no memory of a run"):
        seen_in([tmp_path])


def test_damaged_bytes_never_end_in_a_traceback(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    seen(rng.integers(0, 9, (18, 26))).write(tmp_path / "whole.npz")
    whole, refused = (tmp_path / "whole.npz").read_bytes(), 0
    for k in range(200):
        broken = bytearray(whole[: int(rng.integers(20, len(whole)))] if k % 2 else whole)
        at = int(rng.integers(0, len(broken) - 8))
        broken[at : at + 8] = rng.bytes(8)
        (tmp_path / "broken.npz").write_bytes(broken)
        try:
            read_seen(tmp_path / "broken.npz")
        except MclError:
            refused += 1
    assert refused > 150


# --- the world that begins with it -----------------------------------------------------------------------------------


def world_of(grid: OccupancyGrid) -> World:
    return World(grid, 0.65, range_codes(grid, 5.0), 368)


def some_map(occupied: float = 1.0) -> OccupancyGrid:
    cells = np.zeros((12, 20), np.float32)
    cells[:, 12] = occupied
    return OccupancyGrid(cells, 0.1, (1.0, 2.0, -0.5))


def test_a_world_counts_on_from_earlier_runs_and_outweighs_them_in_time() -> None:
    grid = some_map()
    before = dataclasses.replace(world_of(grid).seen, within=None)
    before.hits[5 + before.margin, 5 + before.margin] = 500.0
    before.passes[5 + before.margin, 12 + before.margin] = 3.0
    after = world_of(grid)
    after.begin_with(before)
    assert after.version == 1
    assert after.kinds[5 + after.margin, 5 + after.margin] == WALL
    assert after.kinds[5 + after.margin, 12 + after.margin] == FREE
    total = after.seen.hits + after.seen.passes
    assert total.max() == MOST
    after.forget()
    np.testing.assert_array_equal(after.seen.hits + after.seen.passes, total)  # what earlier runs saw is kept


def test_a_memory_of_another_map_is_refused() -> None:
    with pytest.raises(MclError, match="another map"):
        world_of(some_map()).begin_with(world_of(some_map(0.9)).seen)


def test_a_map_in_fortran_order_gives_the_same_world() -> None:
    grid = some_map()
    turned = dataclasses.replace(grid, occupancy=np.asfortranarray(grid.occupancy))
    here, there = world_of(grid), world_of(turned)
    assert here.margin == round(MARGIN / 0.1)
    np.testing.assert_array_equal(here.mapped, there.mapped)
    for world in (here, there):
        for _ in range(4):
            world.look(np.array([0.35, 0.65, 0.1]), np.linspace(-1, 1, 90), np.full(90, 1.4, np.float32))
        world.renew()
    np.testing.assert_array_equal(here.kinds, there.kinds)
    cells = np.array([5 * here.mapped.shape[1] + 7], np.int64)
    np.testing.assert_array_equal(here.first.codes[here.first.rows(cells)], there.first.codes[there.first.rows(cells)])
    assert (here.kinds != here.mapped).any()
