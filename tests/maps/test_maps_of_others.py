"""Maps as they come from other machines, other programs and large buildings."""

from __future__ import annotations

import warnings
from pathlib import Path

import numpy as np
import pytest
from PIL import Image

from pipeline.errors import MclError
from pipeline.maps import load_map
from pipeline.maps import occupancy_grid as grids
from pipeline.maps.occupancy_grid import OccupancyGrid

LINES = {
    "image": "m.png",
    "resolution": "0.1",
    "origin": "[1.0, -2.0, 0.5]",
    "negate": "0",
    "occupied_thresh": "0.65",
    "free_thresh": "0.196",
}


def room(height: int = 40, width: int = 60) -> np.ndarray:
    """A room with a wall around it amid the unknown; something in one corner tells it from its mirror image."""
    pixels = np.full((height, width), 205, np.uint8)
    pixels[5:30, 8:50] = 254
    pixels[[5, 29], 8:50] = pixels[5:30, 8] = pixels[5:30, 49] = 0
    pixels[7:10, 10:14] = 0
    return pixels


def written(tmp_path: Path, pixels: np.ndarray | None = None, separator: str = " ", **lines: str) -> Path:
    Image.fromarray(room() if pixels is None else pixels).save(tmp_path / "m.png")
    text = "".join(f"{key}:{separator}{value}\n" for key, value in (LINES | lines).items())
    (tmp_path / "m.yaml").write_text(text)
    return tmp_path / "m.yaml"


def same(grid: OccupancyGrid, other: OccupancyGrid) -> bool:
    return np.array_equal(grid.occupancy, other.occupancy, equal_nan=True) and grid.resolution == other.resolution


@pytest.mark.parametrize(
    "image",
    [
        "maps/m.png",
        "/robots/theirs/catkin_ws/src/maps/m.png",
        "../elsewhere/m.png",
        "'C:\\maps\\of\\m.png'",
        "package://my_robot/maps/m.png",
    ],
)
def test_an_image_of_another_machine_is_the_one_beside_the_yaml(tmp_path: Path, image: str) -> None:
    grid = load_map(written(tmp_path, image=image))
    assert grid.sha256 == load_map(written(tmp_path)).sha256
    assert grid.remarks == (f"image: {image.strip(chr(39))} is not there; m.png beside the YAML is taken",)


def test_an_image_that_is_there_is_taken_as_it_is_said(tmp_path: Path) -> None:
    (tmp_path / "maps").mkdir()
    Image.fromarray(room()[:, ::-1].copy()).save(tmp_path / "maps" / "m.png")
    grid = load_map(written(tmp_path, image="maps/m.png"))
    assert np.array_equal(grid.occupancy[:, ::-1], load_map(written(tmp_path)).occupancy, equal_nan=True)
    assert grid.remarks == ()


@pytest.mark.parametrize("yaw", ["-nan", "nan", ".nan", "-.NaN", "-nan(ind)", "NaN"])
def test_a_yaw_that_is_no_number_is_none(tmp_path: Path, yaw: str) -> None:
    grid = load_map(written(tmp_path, origin=f"[1.0, -2.0, {yaw}]"))
    assert grid.origin == (1.0, -2.0, 0.0)
    assert grid.remarks == ("the yaw of its origin is no number: taken for 0",)


@pytest.mark.parametrize(
    "lines",
    [
        {"origin": "[nan, -2.0, 0.0]"},
        {"origin": "[1e300, -2.0, 0.0]"},
        {"origin": "[1.0, -2.0, inf]"},
        {"origin": "[1.0, -2.0, 1e30]"},
        {"resolution": ".nan"},
        {"resolution": ".inf"},
        {"resolution": "1e-300"},
        {"resolution": "1e9"},
        {"occupied_thresh": ".nan"},
        {"occupied_thresh": "65"},
        {"free_thresh": "-0.5"},
        {"resolution": "1" + "0" * 5000},
    ],
)
def test_a_number_that_no_map_has_is_one_line(tmp_path: Path, lines: dict[str, str]) -> None:
    path = written(tmp_path, **lines)
    with pytest.raises(MclError) as caught:
        load_map(path)
    assert str(caught.value).startswith(str(path))
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("separator", ["\t", " \t ", "\t\t"])
def test_tabs_after_colons(tmp_path: Path, separator: str) -> None:
    assert load_map(written(tmp_path, separator=separator)).sha256 == load_map(written(tmp_path)).sha256


def test_a_byte_order_mark_windows_line_ends_and_another_alphabet(tmp_path: Path) -> None:
    plain = load_map(written(tmp_path))
    text = "# Büro\n" + (tmp_path / "m.yaml").read_text()
    (tmp_path / "m.yaml").write_bytes(b"\xef\xbb\xbf" + text.replace("\n", "\r\n").encode())
    assert load_map(tmp_path / "m.yaml").sha256 == plain.sha256
    (tmp_path / "m.yaml").write_bytes(text.encode("latin-1"))
    assert load_map(tmp_path / "m.yaml").sha256 == plain.sha256


def test_black_walls_on_a_transparent_layer(tmp_path: Path) -> None:
    layer = np.zeros((*room().shape, 4), np.uint8)
    layer[..., 3] = 255 * (room() == 0)
    grid = load_map(written(tmp_path, layer))
    np.testing.assert_array_equal(grid.occupancy == 1.0, room()[::-1] == 0)
    np.testing.assert_array_equal(grid.occupancy == 0.0, room()[::-1] != 0)
    assert "% of the image is transparent" in grid.remarks[0]
    assert "read as if it lay on white" in grid.remarks[0]


def test_an_opaque_layer_is_read_as_ever(tmp_path: Path) -> None:
    opaque = np.stack([room()] * 3 + [np.full(room().shape, 255, np.uint8)], axis=2)
    assert not any("transparent" in remark for remark in load_map(written(tmp_path, opaque)).remarks)


# --- large maps


@pytest.fixture
def small_is_large(monkeypatch: pytest.MonkeyPatch) -> None:
    from pipeline.maps import map_server

    monkeypatch.setattr(map_server, "LARGE", 2000)


@pytest.mark.usefixtures("small_is_large")
@pytest.mark.parametrize("turn", ["0.0", "0.5"])
def test_of_a_large_map_the_part_is_kept_that_says_anything(tmp_path: Path, turn: str) -> None:
    origin = f"[1.0, -2.0, {turn}]"
    whole = OccupancyGrid(_read_small(tmp_path, origin), 0.1, (1.0, -2.0, float(turn)))
    grid = load_map(written(tmp_path, origin=origin))
    assert (grid.width, grid.height) == (42, 25)
    assert grid.remarks == ("of its 60 x 40 cells the 42 x 25 are kept that say anything",)
    rows, columns = np.nonzero(grid.known)
    centres = np.column_stack([(columns + 0.5) * 0.1, (rows + 0.5) * 0.1, 0.0 * rows])
    there = whole.to_grid(grid.to_map(centres))  # the same places on the whole map
    col, row = np.rint(there[:, :2] / 0.1 - 0.5).astype(int).T
    np.testing.assert_array_equal(grid.occupancy[rows, columns], whole.occupancy[row, col])
    assert int(whole.known.sum()) == len(rows)


def _read_small(tmp_path: Path, origin: str) -> np.ndarray:
    levels = {0: 1.0, 205: np.nan, 254: 0.0}
    return np.vectorize(levels.get)(room()[::-1]).astype(np.float32)


@pytest.mark.usefixtures("small_is_large")
def test_a_large_map_that_says_nothing_stays_whole(tmp_path: Path) -> None:
    assert load_map(written(tmp_path, np.full((50, 50), 205, np.uint8))).occupancy.shape == (50, 50)


def test_twenty_thousand_pixels_wide(tmp_path: Path) -> None:
    """Pillow would call it an attack."""
    pixels = np.full((6000, 20_000), 205, np.uint8)
    pixels[-40:, :60] = room()
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        grid = load_map(written(tmp_path, pixels))
    assert (grid.width, grid.height) == (42, 25)
    np.testing.assert_array_equal(grid.occupancy, _read_small(tmp_path, "")[10:35, 8:50])
    assert grid.origin == pytest.approx(
        (1.0 + 0.8 * np.cos(0.5) - np.sin(0.5), -2.0 + 0.8 * np.sin(0.5) + np.cos(0.5), 0.5)
    )
    assert Image.MAX_IMAGE_PIXELS is not None  # as it was


def test_a_map_that_would_fill_the_memory_is_one_line(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(grids, "MOST_CELLS", 500)
    path = written(tmp_path)
    with pytest.raises(MclError, match="a map of 60 x 40 cells would need about 0 GB of memory") as caught:
        load_map(path)
    assert str(caught.value).startswith(str(tmp_path / "m.png"))
    from pipeline.maps import map_server

    monkeypatch.setattr(map_server, "MOST_MEMORY", 1000)
    with pytest.raises(MclError, match="to read 60 x 40 pixels would take about"):
        load_map(path)


@pytest.mark.parametrize("cut", [10, 40, 70])
def test_an_image_that_is_cut_is_one_line(tmp_path: Path, cut: int) -> None:
    path = written(tmp_path)
    (tmp_path / "m.png").write_bytes((tmp_path / "m.png").read_bytes()[:cut])
    with pytest.raises(MclError, match="cannot be read as an image") as caught:
        load_map(path)
    assert "\n" not in str(caught.value)
