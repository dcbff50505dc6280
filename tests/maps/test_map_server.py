from __future__ import annotations

import math
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


@pytest.mark.parametrize("negate", ["1", "true", "yes", "On", "Y"])
def test_negate(tmp_path: Path, negate: str) -> None:
    assert same(drawn(tmp_path, grey(0, 50, 166, 255), negate=negate), 0, NAN, 1, 1)


@pytest.mark.parametrize("negate", ["0", "false", "no", "Off", "n"])
def test_no_negation_in_any_of_yamls_words(tmp_path: Path, negate: str) -> None:
    assert same(drawn(tmp_path, grey(0, 50, 166, 255), negate=negate), 1, 1, NAN, 0)


def test_numbers_in_quotes_are_numbers(tmp_path: Path) -> None:
    drawn(tmp_path, grey(0, 254))
    text = (tmp_path / "m.yaml").read_text()
    (tmp_path / "m.yaml").write_text(text.replace("0.05", "'0.05'").replace("[1.5,", "['1.5',"))
    grid = load_map(tmp_path / "m.yaml")
    assert (grid.resolution, grid.origin) == (0.05, (1.5, -2.0, 0.5))


def map_io(pixels: np.ndarray, mode: str, negate: bool, occupied: float, free: float) -> np.ndarray:
    """Pixel by pixel as nav2's map_io.cpp goes about it, with GraphicsMagick's quanta of 16 bits: the slow twin."""
    height, width, channels = pixels.shape
    result = np.empty((height, width), dtype=np.int64)
    for y in range(height):
        for x in range(width):
            quanta = [int(c) * 257 for c in pixels[y, x]]
            averaged = quanta if mode == "trinary" else quanta[:3]
            shade = float(sum(averaged)) / len(averaged) / 65535.0
            occ = shade if negate else 1.0 - shade
            if mode == "raw":
                percent = math.floor(shade * 255 + 0.5)
                result[y, x] = percent if 0 <= percent <= 100 else -1
            elif mode == "scale" and channels == 4 and quanta[3] != 65535:
                result[y, x] = -1
            elif occupied < occ:
                result[y, x] = 100
            elif occ < free:
                result[y, x] = 0
            else:
                result[y, x] = -1 if mode == "trinary" else round((occ - free) / (occupied - free) * 100.0)
    return result


@given(
    hnp.arrays(np.uint8, st.tuples(st.integers(1, 4), st.integers(1, 4), st.sampled_from([3, 4]))),
    st.sampled_from(["trinary", "scale", "raw"]),
    st.booleans(),
    st.sampled_from([0.65, 0.5, 0.9, 0.0]),
    st.sampled_from([0.196, 0.25, 0.1, 0.8]),
)
def test_every_pixel_as_map_io_reads_it(
    tmp_path_factory: pytest.TempPathFactory, pixels: np.ndarray, mode: str, negate: bool, occupied: float, free: float
) -> None:
    if mode == "scale" and occupied <= free:
        return
    found = drawn(tmp_path_factory.mktemp("m"), pixels, mode, negate=str(int(negate)), occupied=occupied, free=free)
    cells = np.where(np.isnan(found), -1, np.round(np.nan_to_num(found) * 100)).astype(np.int64)
    twin = map_io(pixels, mode, negate, occupied, free)
    if mode == "trinary" and pixels.shape[2] == 4 and not (twin == 0).any():
        return  # no floor at all: what transparency then means has a test of its own
    np.testing.assert_array_equal(cells, twin)


@pytest.mark.parametrize(
    "text",
    [b"P2\n# by hand\n3 1\n255\n0 205 254\n", b"P5\n3 1\n255\n\x00\xcd\xfe", b"P5 3 1 65535 \0\0\xcd\xcd\xfe\xfe"],
)
def test_every_kind_of_grey_map(tmp_path: Path, text: bytes) -> None:
    drawn(tmp_path, grey(0, 254), name="m.pgm")
    (tmp_path / "m.pgm").write_bytes(text)
    assert same(load_map(tmp_path / "m.yaml").occupancy.tolist(), 1, NAN, 0)


def test_unknown_pixels_that_read_as_free_are_remarked_upon(tmp_path: Path) -> None:
    drawn(tmp_path, grey(0, 205, 205, 254), free=0.25)
    (remark,) = load_map(tmp_path / "m.yaml").remarks
    assert remark.startswith("50 % of the map is grey 205, which map_saver writes for unknown, and reads as free")
    drawn(tmp_path, grey(0, 205, 205, 254))
    assert load_map(tmp_path / "m.yaml").remarks == ()
    drawn(tmp_path, grey(0, 205), free=0.25)  # nothing is lighter: then it may well be what is free
    assert load_map(tmp_path / "m.yaml").remarks == ()


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
    "an image that is not there": ("m.png", "n.png", "m.yaml: its image is missing: "),
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
    (tmp_path / "other.yaml").write_text("walls: []\n")
    with pytest.raises(MclError, match=r"other.yaml: not a map_server YAML .expected keys: image"):
        load_map(tmp_path / "other.yaml")
    (tmp_path / "list.yaml").write_text("[1, 2]")
    with pytest.raises(MclError, match="neither"):
        load_map(tmp_path / "list.yaml")
    (tmp_path / "image.yaml").write_bytes(b"P5\n\xff\xfe")
    with pytest.raises(MclError, match="neither"):
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


@given(
    hnp.arrays(np.int64, hnp.array_shapes(min_dims=2, max_dims=2, max_side=12), elements=st.integers(-1, 100)),
    st.sampled_from(["scale", "raw"]),
)
def test_scale_and_raw_keep_every_per_cent(
    tmp_path_factory: pytest.TempPathFactory, percent: np.ndarray, mode: str
) -> None:
    path = tmp_path_factory.mktemp("map") / "m.yaml"
    cells = np.where(percent < 0, NAN, percent / 100.0).astype(np.float32)
    save_map(OccupancyGrid(cells, 0.05), path, mode)
    np.testing.assert_allclose(load_map(path).occupancy, cells, atol=1e-6)


def test_what_was_saved_is_saved_again_byte_by_byte(tmp_path: Path) -> None:
    rng = np.random.default_rng(0)
    cells = rng.choice(np.float32([0, 1, NAN]), (17, 31))
    first = save_map(OccupancyGrid(cells, 0.05, (-1.25, 3.3, 0.1)), tmp_path / "m.yaml")
    before = [file.read_bytes() for file in first]
    assert [file.read_bytes() for file in save_map(load_map(tmp_path / "m.yaml"), tmp_path / "m.yaml")] == before


def test_an_unknown_mode(tmp_path: Path) -> None:
    with pytest.raises(MclError, match="unknown mode 'ternary'"):
        save_map(OccupancyGrid(np.zeros((1, 1), np.float32), 0.1), tmp_path / "m.yaml", "ternary")


@pytest.mark.parametrize(
    ("file", "lost"),
    [
        ("maps/carmen_wean5300.yaml", 0.0),
        ("maps/tb3_sandbox.yaml", 0.0),
        ("uob_pioneer/map.yaml", 0.0),
        ("uob_pioneer/map_from_trace1/map.yaml", 0.0),
        ("carmen/intel/map.yaml", 0.0),
        ("carmen/fr079/map_early/map.yaml", 0.0),
        ("carmen/aces/map.yaml", 0.0),
        ("maps/robolabINB1004.yaml", 0.008),  # free drawn as 255 as well
        ("maps/depot.yaml", 0.048),  # what was drawn unknown reads as free, and is written so
        ("maps/willow-full-0.1.yaml", 0.16),  # many levels of grey
        ("olin_mac/mac_1st_floor_9_23.yaml", 0.664),
    ],
)
def test_real_maps_come_back_pixel_by_pixel(shared_data: Path, tmp_path: Path, file: str, lost: float) -> None:
    """Trinary drawings of map_saver's three levels; of others their meaning. A comment in the PGM is not kept."""
    path, grid = shared_data / file, load_map(shared_data / file)
    written, image = save_map(grid, tmp_path / "m.yaml")
    assert load_map(written).sha256 == grid.sha256
    (drawing,) = [word for word in path.read_text().split() if word.endswith(".pgm")]
    data = (path.parent / drawing).read_bytes()
    size = grid.width * grid.height
    before, after = (np.frombuffer(content[-size:], np.uint8) for content in (data, image.read_bytes()))
    assert (before != after).mean() == pytest.approx(lost, abs=1e-3)


@pytest.mark.parametrize(
    ("file", "remarked"),
    [("olin_mac/mac_1st_floor_9_23.yaml", True), ("maps/depot.yaml", True), ("maps/DISB1.yaml", False),
     ("maps/willow-full-0.1.yaml", False), ("uob_pioneer/map.yaml", False)],
)  # fmt: skip
def test_real_maps_whose_unknown_reads_as_free(shared_data: Path, file: str, remarked: bool) -> None:
    assert bool(load_map(shared_data / file).remarks) == remarked


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
