from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra import numpy as hnp
from PIL import Image

from pipeline.errors import MclError
from pipeline.maps import load_map
from pipeline.maps.map_server import save_map
from pipeline.maps.occupancy_grid import OccupancyGrid

NAN = np.nan
YAML = """image: {image}
resolution: 0.05
origin: [1.5, -2.0, 0.5]
negate: {negate}
occupied_thresh: {occupied}
free_thresh: {free}
"""


def drawn(
    tmp_path: Path,
    pixels: np.ndarray,
    mode: str | None = None,
    *,
    negate: str = "0",
    occupied: float = 0.65,
    free: float = 0.196,
    name: str = "m.png",
    palette: bool = False,
) -> list[list[float]]:
    """Occupancy of the image's pixels, top row first."""
    image = Image.fromarray(pixels)
    (image.convert("P") if palette else image).save(tmp_path / name)
    text = YAML.format(image=name, negate=negate, occupied=occupied, free=free)
    (tmp_path / "m.yaml").write_text(text + (f"mode: {mode}\n" if mode else ""))
    return np.round(load_map(tmp_path / "m.yaml").occupancy[::-1].astype(float), 6).tolist()


def grey(*levels: int) -> np.ndarray:
    return np.array([levels], dtype=np.uint8)


def same(actual: list[list[float]], *expected: float) -> bool:
    return np.array_equal(actual, [expected], equal_nan=True)


@pytest.mark.parametrize("name", ["m.pgm", "m.png", "m.bmp"])
def test_trinary_by_the_thresholds(tmp_path: Path, name: str) -> None:
    assert same(drawn(tmp_path, grey(0, 89, 90, 204, 205, 206, 254, 255), name=name), 1, 1, NAN, NAN, NAN, 0, 0, 0)


def test_an_unknown_pixel_is_free_by_a_generous_threshold(tmp_path: Path) -> None:
    """205 is 0.196 occupied: what map_server does too, trap or not."""
    assert same(drawn(tmp_path, grey(0, 205, 254), free=0.25), 1, 0, 0)


def test_the_thresholds_themselves_are_unknown(tmp_path: Path) -> None:
    assert same(drawn(tmp_path, grey(0, 51, 102, 255), occupied=0.8, free=0.6), 1, NAN, NAN, 0)


@pytest.mark.parametrize("negate", ["1", "true"])
def test_negate(tmp_path: Path, negate: str) -> None:
    assert same(drawn(tmp_path, grey(0, 50, 166, 255), negate=negate), 0, NAN, 1, 1)


def test_colours_are_averaged(tmp_path: Path) -> None:
    pixels = np.array([[[255, 0, 0], [205, 205, 205], [255, 255, 255], [0, 0, 60]]], dtype=np.uint8)
    assert same(drawn(tmp_path, pixels), 1, NAN, 0, 1)
    assert same(drawn(tmp_path, pixels, palette=True), 1, NAN, 0, 1)


def test_opacity_counts_as_a_colour_in_trinary(tmp_path: Path) -> None:
    """Black: (0 + 0 + 0 + opacity) / 4; so opaque black is 0.75 occupied, and transparent white 0.25."""
    pixels = np.array([[[0, 0, 0, 255], [0, 0, 0, 0], [255, 255, 255, 255], [255, 255, 255, 0]]], dtype=np.uint8)
    assert same(drawn(tmp_path, pixels), 1, 1, 0, NAN)


def test_scale_stretches_between_the_thresholds(tmp_path: Path) -> None:
    assert same(
        drawn(tmp_path, grey(0, 51, 102, 153, 204, 255), "scale", occupied=0.8, free=0.2), 1, 1, 0.67, 0.33, 0, 0
    )


def test_scale_takes_what_is_not_opaque_for_unknown(tmp_path: Path) -> None:
    pixels = np.array([[[0, 0, 0, 255], [0, 0, 0, 254], [255, 255, 255, 255], [127, 127, 127, 0]]], dtype=np.uint8)
    assert same(drawn(tmp_path, pixels, "Scale"), 1, NAN, 0, NAN)


def test_raw_takes_grey_levels_for_percent(tmp_path: Path) -> None:
    assert same(drawn(tmp_path, grey(0, 1, 50, 100, 101, 255), "raw"), 0, 0.01, 0.5, 1, NAN, NAN)


def test_sixteen_bits(tmp_path: Path) -> None:
    pixels = np.array([[0, 205 * 257, 65535]], dtype=np.uint16)
    assert same(drawn(tmp_path, pixels), 1, NAN, 0)


def test_the_image_hangs_by_its_lower_left_corner(tmp_path: Path) -> None:
    assert drawn(tmp_path, np.array([[0, 254], [254, 254], [254, 254]], dtype=np.uint8))[0] == [1, 0]
    grid = load_map(tmp_path / "m.yaml")
    assert grid.occupancy.tolist() == [[0, 0], [0, 0], [1, 0]]
    assert (grid.resolution, grid.origin) == (0.05, (1.5, -2.0, 0.5))
    assert grid.occupancy.dtype == np.float32


def test_the_image_is_found_beside_the_yaml_or_by_its_whole_path(tmp_path: Path) -> None:
    drawn(tmp_path, grey(0, 254))
    (tmp_path / "maps").mkdir()
    (tmp_path / "m.png").rename(tmp_path / "maps" / "m.png")
    text = (tmp_path / "m.yaml").read_text()
    (tmp_path / "m.yaml").write_text(text.replace("m.png", "maps/m.png"))
    assert load_map(tmp_path / "m.yaml").width == 2
    (tmp_path / "m.yaml").write_text(text.replace("m.png", str(tmp_path / "maps" / "m.png")))
    assert load_map(tmp_path / "m.yaml").width == 2


BAD = {
    "no image": ("image: m.png\n", "", "no image is named"),
    "no resolution": ("resolution: 0.05\n", "", "resolution is missing"),
    "resolution in words": ("0.05", "fine", "resolution must be a number, not 'fine'"),
    "resolution zero": ("0.05", "0.0", "resolution must be positive"),
    "origin of two": ("[1.5, -2.0, 0.5]", "[1.5, -2.0]", "origin must be three numbers"),
    "origin in words": ("[1.5, -2.0, 0.5]", "[here, -2.0, 0.0]", "origin must be three numbers"),
    "no free_thresh": ("free_thresh: 0.196\n", "", "free_thresh is missing"),
    "negate in words": ("negate: 0", "negate: perhaps", "negate must be 0 or 1"),
    "no negate": ("negate: 0\n", "", "negate must be 0 or 1"),
    "unknown mode": ("negate: 0", "negate: 0\nmode: ternary", "unknown mode 'ternary'"),
    "an image that is not there": ("m.png", "n.png", "no such image"),
    "an image that is none": ("m.png", "m.yaml", "cannot be read as an image"),
    "nothing to scale": ("free_thresh: 0.196", "free_thresh: 0.7\nmode: scale", "occupied_thresh must be above"),
    "no YAML": ("[1.5, -2.0, 0.5]", "[1.5, -2.0, 0.5", "neither a beesoft map nor YAML"),
}


@pytest.mark.parametrize("case", BAD)
def test_bad_maps_are_named(tmp_path: Path, case: str) -> None:
    drawn(tmp_path, grey(0, 254))
    before, after, said = BAD[case]
    text = (tmp_path / "m.yaml").read_text()
    assert before in text
    (tmp_path / "m.yaml").write_text(text.replace(before, after))
    with pytest.raises(MclError) as caught:
        load_map(tmp_path / "m.yaml")
    assert said in str(caught.value)
    assert str(caught.value).startswith(str(tmp_path))
    assert "\n" not in str(caught.value)


def test_files_that_are_no_map(tmp_path: Path) -> None:
    with pytest.raises(MclError, match="no such map"):
        load_map(tmp_path / "missing.yaml")
    (tmp_path / "list.yaml").write_text("[1, 2]")
    with pytest.raises(MclError, match="neither"):
        load_map(tmp_path / "list.yaml")
    (tmp_path / "image.yaml").write_bytes(b"P5\n\xff\xfe")
    with pytest.raises(MclError, match="cannot be read as a map_server YAML"):
        load_map(tmp_path / "image.yaml")


@given(
    hnp.arrays(np.float32, hnp.array_shapes(min_dims=2, max_dims=2), elements=st.sampled_from([0.0, 1.0, NAN])),
    st.tuples(*[st.floats(-1e3, 1e3)] * 3),
    st.floats(0.01, 1.0),
)
def test_what_is_saved_is_loaded(
    tmp_path_factory: pytest.TempPathFactory, cells: np.ndarray, origin: tuple[float, float, float], resolution: float
) -> None:
    path = tmp_path_factory.mktemp("map") / "m.yaml"
    grid = OccupancyGrid(cells, resolution, origin)
    save_map(grid, path)
    assert load_map(path).sha256 == grid.sha256


def test_probabilities_are_saved_by_the_thresholds(tmp_path: Path) -> None:
    save_map(OccupancyGrid(np.array([[0.1, 0.3, 0.6, 0.7]], np.float32), 0.1), tmp_path / "m.yaml")
    np.testing.assert_array_equal(load_map(tmp_path / "m.yaml").occupancy, [[0.0, NAN, NAN, 1.0]])


@pytest.mark.parametrize(
    ("file", "free"),
    [
        ("maps/DISB1.yaml", 0.152),  # free_thresh 0.2 and unknown at grey 192: unknown all the same
        ("maps/depot.yaml", 0.968),  # free_thresh 0.25: what was drawn unknown (205) reads as free
        ("maps/willow-full-0.1.yaml", 0.439),
        ("maps/robolabINB1004.yaml", 0.205),
        ("olin_mac/mac_1st_floor_9_23.yaml", 0.978),
        ("uob_pioneer/map.yaml", 0.238),
    ],
)
def test_real_maps(shared_data: Path, file: str, free: float) -> None:
    assert float((load_map(shared_data / file).occupancy == 0.0).mean()) == pytest.approx(free, abs=6e-4)
