"""Any map as a map_server YAML: beesoft maps, other YAMLs, and the maps in recordings."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from converters import convert, convert_map, read_map
from converters.beesoft import write_beesoft
from pipeline.errors import MclError
from pipeline.logs.reader import read_log
from pipeline.maps.occupancy_grid import OccupancyGrid
from pipeline.simulate import sample_dir
from recordings import ordinary

NAN = np.nan
CELLS = np.array([[0.0, 0.25, 0.97], [1.0, NAN, 0.1]], np.float32)


def recorded(path: Path) -> Path:
    recording = ordinary()
    recording.grid(np.array([[0, 100], [-1, 50]], np.int8), 0.05, 1.0, -2.0, 0.5)
    return recording.write(path)


def test_a_beesoft_map_becomes_a_yaml_with_its_image(tmp_path: Path) -> None:
    write_beesoft(tmp_path / "m.dat.gz", OccupancyGrid(CELLS, 0.1))
    grid, written = convert_map(tmp_path / "m.dat.gz", tmp_path / "deep" / "m.yaml")
    assert written == [tmp_path / "deep" / "m.yaml", tmp_path / "deep" / "m.pgm"]
    np.testing.assert_allclose(grid.occupancy, CELLS, atol=1e-6)
    np.testing.assert_array_equal(read_map(written[0]).occupancy, np.float32([[0, NAN, 1], [1, NAN, 0]]))
    assert sorted(file.name for file in (tmp_path / "deep").iterdir()) == ["m.pgm", "m.yaml"]


@pytest.mark.parametrize("mode", ["scale", "raw"])
def test_smeared_walls_are_kept_on_request(tmp_path: Path, mode: str) -> None:
    write_beesoft(tmp_path / "m.dat", OccupancyGrid(CELLS, 0.1))
    _, (yaml, _) = convert_map(tmp_path / "m.dat", tmp_path / "m.yaml", mode)
    np.testing.assert_allclose(read_map(yaml).occupancy, CELLS, atol=1e-6)


def test_the_map_in_a_recording(tmp_path: Path) -> None:
    _, (yaml, _) = convert_map(recorded(tmp_path / "theirs.mcap"), tmp_path / "a.yaml")
    grid = read_map(yaml)
    np.testing.assert_array_equal(grid.occupancy, np.float32([[0, 1], [NAN, NAN]]))
    np.testing.assert_allclose((grid.resolution, *grid.origin), (0.05, 1.0, -2.0, 0.5))


def test_the_map_in_a_log_of_ours_and_back(tmp_path: Path) -> None:
    sample = sample_dir()
    convert([sample / "office.log.gz"], tmp_path / "o.mcap", map_path=sample / "office.dat.gz")
    convert_map(tmp_path / "o.mcap", tmp_path / "log.yaml", "raw")
    convert_map(sample / "office.dat.gz", tmp_path / "map.yaml", "raw")
    assert (tmp_path / "log.pgm").read_bytes() == (tmp_path / "map.pgm").read_bytes()
    first = [(tmp_path / name).read_bytes() for name in ("map.pgm", "map.yaml")]
    convert_map(tmp_path / "map.yaml", tmp_path / "map.yaml", "raw")
    assert [(tmp_path / name).read_bytes() for name in ("map.pgm", "map.yaml")] == first
    grid = read_log(tmp_path / "o.mcap").grid
    assert grid is not None
    np.testing.assert_allclose(read_map(tmp_path / "map.yaml").occupancy, grid.occupancy, atol=0.00501)


def test_the_map_in_a_bag(tmp_path: Path) -> None:
    from test_bag import driven, ros1

    _, (yaml, _) = convert_map(ros1(driven(), tmp_path / "a.bag"), tmp_path / "a.yaml", "raw")
    np.testing.assert_allclose(read_map(yaml).occupancy, np.float32([[0, 1], [NAN, 0.5]]), atol=1e-6)


def test_a_recording_without_a_map_says_what_it_has(tmp_path: Path) -> None:
    with pytest.raises(MclError, match=r"a\.mcap: no map .* in this file: it has /tf_static"):
        convert_map(ordinary().write(tmp_path / "a.mcap"), tmp_path / "a.yaml")
    (tmp_path / "a.log").write_text("O 1 2 3 4\n")
    (tmp_path / "b.log").write_text("FLASER 1 2.0 0 0 0 0 0 0 1.0 robot 1.0\n")
    for log in ("a.log", "b.log"):
        with pytest.raises(MclError, match=r"this is a log, .*name the output \.mcap"):
            convert_map(tmp_path / log, tmp_path / "a.yaml")
        with pytest.raises(MclError, match="this is a log, not a map"):
            read_map(tmp_path / log)
    assert not (tmp_path / "a.yaml").exists()


def test_wean_hall_as_a_yaml(shared_data: Path, tmp_path: Path) -> None:
    _, (yaml, image) = convert_map(shared_data / "cmu" / "wean.dat.gz", tmp_path / "wean.yaml")
    assert image.stat().st_size == 800 * 800 + len(b"P5\n800 800\n255\n")
    grid, raw = read_map(yaml), read_map(shared_data / "cmu" / "wean.dat.gz")
    np.testing.assert_array_equal(grid.occupancy == 1.0, raw.occupancy > 0.65)
    np.testing.assert_array_equal(grid.occupancy == 0.0, raw.occupancy < np.float32(0.196))
