"""The table of ranges and its cache: what is read is what would be built, or it is built again."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np
import pytest
import reference

from pipeline.errors import MclError
from pipeline.kernels import raycast
from pipeline.maps import range_table
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.maps.range_table import (
    HEADINGS,
    HIT_CODES,
    build_range_table,
    cache_dir,
    load_range_table,
    opaque_cells,
    range_codes,
)

MAX_RANGE = 8.0


def grid(seed: int = 0) -> OccupancyGrid:
    """3 m x 2 m: walls of all probabilities, unknown land."""
    rng = np.random.default_rng(seed)
    cells = rng.random((20, 30)).astype(np.float32)
    cells[rng.random((20, 30)) < 0.7] = 0.02
    cells[:, 25:] = np.nan
    return OccupancyGrid(cells, 0.1, (1.0, 2.0, 0.5))


@pytest.fixture
def cache(tmp_path, monkeypatch) -> Path:
    monkeypatch.setenv("MCL_CACHE_DIR", str(tmp_path / "cache"))
    return tmp_path / "cache"


@pytest.fixture
def built(monkeypatch) -> list[float]:
    """Thresholds of the tables that had to be built."""
    made: list[float] = []
    build = range_table.build_range_table

    def counted(grid, threshold, max_range, span):
        made.append(threshold)
        return build(grid, threshold, max_range, span)

    monkeypatch.setattr(range_table, "build_range_table", counted)
    return made


def only_file(folder: Path) -> Path:
    (path,) = folder.iterdir()
    return path


def assert_same(table, fresh) -> None:
    np.testing.assert_array_equal(table.rows, fresh.rows)
    np.testing.assert_array_equal(table.cells, fresh.cells)
    np.testing.assert_array_equal(table.row_of_cell, fresh.row_of_cell)
    assert table.codes.max_range == fresh.codes.max_range


def test_read_from_the_cache_it_equals_a_fresh_build(cache, built) -> None:
    fresh = build_range_table(grid(), 0.65, MAX_RANGE)
    assert_same(load_range_table(grid(), 0.65, MAX_RANGE), fresh)
    assert built == [0.65]
    assert_same(load_range_table(grid(), 0.65, MAX_RANGE), fresh)
    assert built == [0.65]  # the second time it was read
    assert only_file(cache).stat().st_size > fresh.rows.nbytes


def test_rows_from_the_cache_cannot_be_changed(cache) -> None:
    load_range_table(grid(), 0.65, MAX_RANGE)
    rows = load_range_table(grid(), 0.65, MAX_RANGE).rows
    with pytest.raises(ValueError, match="read-only"):
        rows[0, 0] = 1


def flip(path: Path, at: int) -> None:
    content = bytearray(path.read_bytes())
    content[at] ^= 1
    path.write_bytes(content)


DAMAGE = {
    "one bit of a range": lambda path: flip(path, -100),
    "one bit of the first range": lambda path: flip(path, path.stat().st_size // 2),
    "one bit of the header": lambda path: flip(path, 3),
    "one bit of the checksum": lambda path: flip(path, 100),
    "cut": lambda path: path.write_bytes(path.read_bytes()[:-1]),
    "longer": lambda path: path.write_bytes(path.read_bytes() + b"\0"),
    "empty": lambda path: path.write_bytes(b""),
    "something else": lambda path: path.write_bytes(b"not a table" * 1000),
    "nothing but zeros": lambda path: path.write_bytes(bytes(path.stat().st_size)),
}


@pytest.mark.parametrize("damage", DAMAGE)
def test_a_damaged_file_is_built_again(cache, built, damage: str) -> None:
    load_range_table(grid(), 0.65, MAX_RANGE)
    fresh = build_range_table(grid(), 0.65, MAX_RANGE)
    whole = only_file(cache).read_bytes()
    DAMAGE[damage](only_file(cache))
    assert only_file(cache).read_bytes() != whole
    assert_same(load_range_table(grid(), 0.65, MAX_RANGE), fresh)
    assert len(built) == 2
    assert only_file(cache).read_bytes() == whole  # and mended


def test_the_table_of_another_map_is_not_taken(cache, built) -> None:
    """The same size, the same open cells, another wall: only the name and the header could tell."""
    cells = np.full((12, 12), 0.1, np.float32)
    cells[:, 8] = 0.9
    mirrored = OccupancyGrid(np.ascontiguousarray(cells[:, ::-1]), 0.1)
    load_range_table(OccupancyGrid(cells, 0.1), 0.65, MAX_RANGE)
    first = only_file(cache)
    load_range_table(mirrored, 0.65, MAX_RANGE)
    (second,) = set(cache.iterdir()) - {first}
    second.write_bytes(first.read_bytes())
    assert_same(load_range_table(mirrored, 0.65, MAX_RANGE), build_range_table(mirrored, 0.65, MAX_RANGE))
    assert len(built) == 3


def test_every_map_threshold_and_laser_has_its_own_table(cache, built) -> None:
    finer = OccupancyGrid(grid().occupancy, 0.05, grid().origin)
    for args in [
        (grid(0), 0.65, 8.0),
        (grid(1), 0.65, 8.0),
        (grid(0), 0.5, 8.0),
        (grid(0), 0.65, 1.0),
        (finer, 0.65, 8.0),
    ]:
        assert_same(load_range_table(*args), build_range_table(*args))
    assert len(built) == len(list(cache.iterdir())) == 5


def test_a_table_that_nobody_asks_for_makes_room_for_others(cache, built) -> None:
    """Unless it has been asked for since."""
    for threshold in (0.3, 0.5):
        load_range_table(grid(), threshold, MAX_RANGE)
    for path in cache.iterdir():
        os.utime(path, (0, 0))
    load_range_table(grid(), 0.5, MAX_RANGE)
    load_range_table(grid(), 0.8, MAX_RANGE)
    assert len(list(cache.iterdir())) == 2
    load_range_table(grid(), 0.5, MAX_RANGE)
    assert built == [0.3, 0.5, 0.8]


@pytest.mark.skipif(not hasattr(os, "geteuid") or os.geteuid() == 0, reason="root may write anywhere")
def test_a_folder_that_cannot_be_written_costs_only_time(tmp_path, monkeypatch) -> None:
    tmp_path.chmod(0o500)
    monkeypatch.setenv("MCL_CACHE_DIR", str(tmp_path))
    assert_same(load_range_table(grid(), 0.65, MAX_RANGE), build_range_table(grid(), 0.65, MAX_RANGE))
    tmp_path.chmod(0o700)
    assert not list(tmp_path.iterdir())


def test_no_folder_can_be_made_there(tmp_path, monkeypatch, built) -> None:
    """Works for root too: a file stands where the folder should be."""
    (tmp_path / "file").write_text("in the way")
    monkeypatch.setenv("MCL_CACHE_DIR", str(tmp_path / "file" / "cache"))
    fresh = build_range_table(grid(), 0.65, MAX_RANGE)
    for _ in range(2):
        assert_same(load_range_table(grid(), 0.65, MAX_RANGE), fresh)
    assert len(built) == 2


def test_something_stands_where_the_file_should_be(cache) -> None:
    fresh = load_range_table(grid(), 0.65, MAX_RANGE)
    path = only_file(cache)
    path.unlink()
    (path / "folder").mkdir(parents=True)
    assert_same(load_range_table(grid(), 0.65, MAX_RANGE), fresh)
    assert only_file(cache) == path  # and nothing half-made is left beside it


def test_an_interrupt_leaves_nothing_half_made(cache, monkeypatch) -> None:
    def interrupted(*_):
        raise KeyboardInterrupt

    monkeypatch.setattr(Path, "replace", interrupted)
    with pytest.raises(KeyboardInterrupt):
        load_range_table(grid(), 0.65, MAX_RANGE)
    assert not list(cache.iterdir())


def test_where_tables_are_kept(monkeypatch, tmp_path) -> None:
    monkeypatch.setenv("MCL_CACHE_DIR", str(tmp_path / "mine"))
    assert cache_dir() == tmp_path / "mine"
    monkeypatch.delenv("MCL_CACHE_DIR")
    monkeypatch.setenv("XDG_CACHE_HOME", str(tmp_path / "xdg"))
    assert cache_dir() == tmp_path / "xdg" / "mcl-replay"
    monkeypatch.delenv("XDG_CACHE_HOME")
    monkeypatch.setenv("HOME", str(tmp_path))
    assert cache_dir() == tmp_path / ".cache" / "mcl-replay"


def test_what_stops_a_ray() -> None:
    cells = np.array([[0.0, 0.6, 0.65, 1.0, np.nan]], np.float32)
    assert opaque_cells(OccupancyGrid(cells, 0.1), 0.65).tolist() == [[0, 0, 1, 1, raycast.UNKNOWN]]


def test_open_cells_have_rows_and_the_others_none(cache) -> None:
    table = build_range_table(grid(), 0.65, MAX_RANGE)
    is_open = opaque_cells(grid(), 0.65) == 0
    np.testing.assert_array_equal(table.row_of_cell >= 0, is_open)
    np.testing.assert_array_equal(table.row_of_cell.reshape(-1)[table.cells], np.arange(len(table.cells)))
    assert table.rows.shape == (is_open.sum(), HEADINGS)


def test_ranges_are_metres() -> None:
    """From the middle of a corridor 2 m wide to its walls, at 5 cm a cell; east and west it ends in unknown land."""
    cells = np.full((50, 100), 0.0, np.float32)
    cells[:5] = cells[45:] = 1.0
    cells[:, :10] = cells[:, 90:] = np.nan
    table = build_range_table(OccupancyGrid(cells, 0.05), 0.65, 50.0)
    code = table.rows[table.row_of_cell[25, 50]]
    ranges = table.codes.ranges[code]
    assert ranges[90] == pytest.approx(0.975, abs=0.02)
    assert ranges[270] == pytest.approx(1.025, abs=0.02)
    assert ranges[0] == pytest.approx(1.975, abs=0.2)  # unknown land has coarser codes
    assert ranges[180] == pytest.approx(2.025, abs=0.2)
    assert table.codes.ends_unknown[code[[0, 90, 180, 270]]].tolist() == [True, False, True, False]


def test_the_scale_ends_at_the_maps_diagonal_or_the_lasers_range() -> None:
    assert range_codes(grid(), 80.0).max_range == pytest.approx(0.1 * np.hypot(20, 30))
    assert range_codes(grid(), 2.0).max_range == 2.0
    assert range_codes(grid(), 2.0).ranges[HIT_CODES - 1] == pytest.approx(2.0)


def test_every_code_stands_for_the_ranges_that_are_rounded_to_it() -> None:
    codes = range_codes(grid(), 2.0)
    low, high = codes.steps
    assert (low[:-1] <= codes.ranges[:-1]).all()
    assert (codes.ranges[:-1] <= high[:-1]).all()
    np.testing.assert_array_equal(high[: HIT_CODES - 1], low[1:HIT_CODES])
    assert (low[0], high[HIT_CODES - 1], low[HIT_CODES]) == (0.0, pytest.approx(2.0), 0.0)
    assert np.isinf([low[255], high[255]]).all()
    for code in (0, 1, 57, 223):
        for inside in (low[code] + 1e-6, high[code] - 1e-6):
            assert reference.encode(inside, 1, 2.0, range_table.LOG_OFFSET, HIT_CODES, 31) == code


def test_padded_rows_go_round() -> None:
    table = build_range_table(grid(), 0.65, MAX_RANGE)
    padded = table.padded(181)
    assert padded.shape[1] == HEADINGS + 181
    headings = np.arange(HEADINGS + 181)
    np.testing.assert_array_equal(padded, table.rows[:, headings % HEADINGS])
    np.testing.assert_array_equal(table.padded(0), table.rows)


@pytest.mark.parametrize("cells", [np.ones((4, 4)), np.full((4, 4), np.nan)])
def test_a_map_without_an_open_cell(cells, cache) -> None:
    with pytest.raises(MclError, match="no cell in which a robot could stand"):
        load_range_table(OccupancyGrid(cells.astype(np.float32), 0.1), 0.65, MAX_RANGE)


def test_a_map_too_large_for_a_table(monkeypatch, cache) -> None:
    monkeypatch.setattr(range_table, "MAX_TABLE_BYTES", 1000)
    with pytest.raises(MclError, match="ray_caster=dda"):
        load_range_table(grid(), 0.65, MAX_RANGE)
