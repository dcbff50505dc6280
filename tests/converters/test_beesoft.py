from __future__ import annotations

import gzip
from pathlib import Path

import numpy as np
import pytest
from cmu_samples import small_log, write_lines
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp

from converters import read_map
from converters.beesoft import file_values, format_beesoft, parse_beesoft, read_beesoft, write_beesoft
from pipeline.errors import MclError
from pipeline.maps.map_server import save_map
from pipeline.maps.occupancy_grid import OccupancyGrid

HEADER = """robot_specifications->global_mapsize_x                 30
robot_specifications->global_mapsize_y                 20
robot_specifications->resolution                       10
robot_specifications->autoshifted_x                    0
robot_specifications->autoshifted_y                    0

global_map[0]: 3 2
"""
CELLS = "-1.000 0.000\n1.000 0.250\n0.003 0.999\n"

cells = hnp.arrays(
    np.float32,
    hnp.array_shapes(min_dims=2, max_dims=2, max_side=6),
    elements=st.one_of(
        st.just(np.nan), st.integers(0, 1000).map(lambda n: np.float32(n / 1000)), st.floats(0, 1, width=32)
    ),
)


def write(path: Path, text: str) -> Path:
    path.write_text(text)
    return path


def test_the_first_index_is_x_and_the_value_is_free(tmp_path: Path) -> None:
    grid = read_beesoft(write(tmp_path / "a.dat", HEADER + CELLS))
    assert (grid.width, grid.height, grid.resolution, grid.origin) == (3, 2, 0.1, (0.0, 0.0, 0.0))
    expected = np.array([[np.nan, 0.0, 0.997], [1.0, 0.75, 0.001]], dtype=np.float32)
    np.testing.assert_allclose(grid.occupancy, expected, atol=1e-6)
    assert grid.occupancy.dtype == np.float32


@given(cells)
def test_write_and_read_give_the_same_cells(tmp_path_factory: pytest.TempPathFactory, occupancy: np.ndarray) -> None:
    path = tmp_path_factory.mktemp("map") / "a.dat.gz"
    write_beesoft(path, OccupancyGrid(occupancy, 0.05))
    again = read_beesoft(path)
    np.testing.assert_allclose(again.occupancy, occupancy, rtol=0, atol=1e-16)  # what a float64 near 1 can tell apart
    assert again.resolution == 0.05


@given(hnp.arrays(np.float64, (3, 2), elements=st.one_of(st.just(-1.0), st.integers(0, 1000).map(lambda n: n / 1000))))
def test_three_decimals_survive_float32(values: np.ndarray) -> None:
    text = HEADER + "\n".join(" ".join(f"{v:.3f}" for v in row) for row in values)
    raw = parse_beesoft(text.encode(), Path("a.dat"))
    np.testing.assert_array_equal(file_values(raw.grid), values)
    assert format_beesoft(raw.header, raw.grid).split() == text.split()


BAD_MAPS = {
    "fewer cells than promised": (HEADER + "-1 0 1 0.5\n0.5\n", 9, "promises 6 cells, the file has 5"),
    "more cells than promised": (HEADER + CELLS + "0.5\n", 11, "promises 6 cells, the file has 7"),
    "no cells": (HEADER, 7, "promises 6 cells, the file has 0"),
    "letters in a cell": (HEADER + CELLS.replace("0.250", "wall"), 9, "'wall' is not a number"),
    "a value beyond 1": (HEADER + CELLS.replace("0.250", "1.25"), 9, "neither -1 (unknown) nor a probability"),
    "a negative value": (HEADER + CELLS.replace("0.250", "-0.5"), 9, "neither -1 (unknown) nor a probability"),
    "NaN": (HEADER + CELLS.replace("0.250", "nan"), 9, "neither -1 (unknown) nor a probability"),
    "a size in letters": (HEADER.replace(": 3 2", ": three 2") + CELLS, 7, "'three' is not a positive whole number"),
    "a resolution of zero": (
        HEADER.replace("resolution                       10", "resolution 0") + CELLS,
        3,
        "positive",
    ),
    "no resolution": (
        HEADER.replace("->resolution", "->scale") + CELLS,
        None,
        "no line 'robot_specifications->resolution",
    ),
    "no size": (HEADER.replace("global_map[0]", "local_map") + CELLS, None, "no global_map header"),
}


@pytest.mark.parametrize("case", BAD_MAPS)
def test_bad_maps_are_named(tmp_path: Path, case: str) -> None:
    text, line, said = BAD_MAPS[case]
    path = write(tmp_path / "bad.dat", text)
    with pytest.raises(MclError) as caught:
        read_beesoft(path)
    assert caught.value.line == line
    assert str(path) in str(caught.value)
    assert said in str(caught.value)


def test_a_map_is_known_by_its_content(tmp_path: Path) -> None:
    assert read_map(write(tmp_path / "map.yaml", HEADER + CELLS)).width == 3
    grid = read_beesoft(tmp_path / "map.yaml")
    save_map(grid, tmp_path / "other.txt")
    assert read_map(tmp_path / "other.txt").width == 3


def test_what_is_no_map(tmp_path: Path) -> None:
    save_map(OccupancyGrid(np.zeros((2, 2), np.float32), 0.1), tmp_path / "m.yaml")
    with pytest.raises(MclError, match=r"give the \.yaml"):
        read_map(tmp_path / "m.pgm")
    with pytest.raises(MclError, match="this is a log, not a map"):
        read_map(write_lines(tmp_path / "a.log", small_log()))
    with pytest.raises(MclError, match="neither a beesoft map nor"):
        read_map(write(tmp_path / "prose.txt", "once upon a time"))
    with pytest.raises(MclError, match="no such file"):
        read_map(tmp_path / "missing")
    with pytest.raises(MclError, match="a log"):
        read_beesoft(tmp_path / "a.log")


def test_the_real_map_comes_back_byte_for_byte(shared_data: Path, tmp_path: Path) -> None:
    source = shared_data / "cmu" / "wean.dat.gz"
    grid = read_map(source)
    assert grid.occupancy.shape == (800, 800)
    assert int((grid.occupancy == 1.0).sum()) == 9896
    write_beesoft(tmp_path / "again.dat", grid)
    assert (tmp_path / "again.dat").read_bytes() == gzip.decompress(source.read_bytes())
