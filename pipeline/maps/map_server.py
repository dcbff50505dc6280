"""Maps as ROS keeps them: a YAML file and an image, read by the same rules as nav2's map_server.

A pixel's darkness is its occupancy (its lightness if ``negate``). *trinary* tells occupied, free and unknown apart
by two thresholds, *scale* stretches what lies between them over 0 to 100 %, *raw* takes grey levels as percent.
The rules are those of ``nav2_map_server/src/map_io.cpp``; its numbers are 16 bits wide, and its YAML is of version 1.1.
"""

from __future__ import annotations

import math
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path, PureWindowsPath
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import MclError
from pipeline.geometry import Pose, compose
from pipeline.maps.occupancy_grid import LARGE, OccupancyGrid, check_cells, cropped, part_that_is_known

MODES = ("trinary", "scale", "raw")
OCCUPIED_THRESHOLD, FREE_THRESHOLD = 0.65, 0.196  # 0.196: an unknown pixel (205) is not below it, as it is with 0.25
FINEST, COARSEST = 1e-4, 100.0
"""Metres: no map has smaller or larger pixels."""
FARTHEST, MOST_TURNS = 1e7, 1000.0
"""Metres, rad: no map's origin is farther away, or turned farther."""
MOST_MEMORY = 4e9
"""Bytes that reading an image may take."""
_BYTES_GREY, _BYTES_COLOUR = 3, 120  # of a pixel, while it is read
_ROWS = 1024  # that are looked at together, so that little memory is needed
_NANS = ("nan", "nan(ind)", "1.#ind", "1.#qnan")
_FREE, _OCCUPIED, _UNKNOWN = 254, 0, 205
_WHITE = 65535.0
_FROM_8_BITS = 257.0
_YES, _NO = ("y", "yes", "true", "on"), ("n", "no", "false", "off")


def load_map(path: Path) -> OccupancyGrid:
    """The map that a map_server YAML and the image beside it describe.

    Occupancy is 1, 0 or NaN (trinary), or keeps its percent (scale, raw). Of an image of many millions of pixels only
    the part that says anything is kept. What was taken otherwise than it is said is a remark. Raises MclError if a file
    is missing, unreadable or too large, or a key is missing or not what map_server expects.
    """
    path = Path(path)
    values = _read_yaml(path)
    if not values.keys() & {"image", "resolution"}:
        raise MclError("not a map_server YAML", "expected keys: image, resolution, origin, ...", path=path)
    remarks: list[str] = []
    resolution = _number(values, "resolution", path)
    if resolution <= 0:
        raise MclError("resolution must be positive, metres per pixel", path=path)
    if not FINEST <= resolution <= COARSEST:
        raise MclError(f"resolution is {resolution:g}: no map has pixels of so many metres", path=path)
    origin = _origin(values, path, remarks)
    occupied, free = _share(values, "occupied_thresh", path), _share(values, "free_thresh", path)
    mode = str(values.get("mode", "trinary")).lower()
    if mode not in MODES:
        raise MclError(f"unknown mode {mode!r}, expected one of {', '.join(MODES)}", path=path)
    if mode == "scale" and occupied <= free:
        raise MclError("occupied_thresh must be above free_thresh", path=path)
    reading = _Reading(mode, _flag(values.get("negate"), path), occupied, free)
    name = values.get("image")
    if not isinstance(name, str) or not name:
        raise MclError("no image is named in this file", "expected a key: image: map.pgm", path=path)
    cells, bottom, left = _read_image(_image(path, name, remarks), reading, remarks)
    if bottom or left:
        x, y, _ = compose(origin, (left * resolution, bottom * resolution, 0.0)).tolist()
        origin = (x, y, origin[2])
    return OccupancyGrid(np.ascontiguousarray(cells[::-1]), resolution, origin, tuple(remarks))


@dataclass(frozen=True)
class _Reading:
    """How pixels become occupancy."""

    mode: str
    negate: bool
    occupied: float
    free: float

    def __call__(
        self, colours: NDArray[np.float64], alpha: NDArray[np.float64] | None = None
    ) -> tuple[NDArray[np.float32], NDArray[np.float64]]:
        """Cells and shades of pixels: red, green, blue (height, width, 3), and opacity (height, width): 0 to 65535."""
        counted = colours
        if self.mode == "trinary" and alpha is not None:
            counted = np.concatenate([colours, alpha[..., None]], axis=2)  # so map_server does it
        shade = counted.mean(axis=2) / _WHITE
        occupancy = shade if self.negate else 1.0 - shade
        cells = np.full(shade.shape, np.nan)
        if self.mode == "raw":
            level = np.round(shade * 255.0)
            cells[level <= 100.0] = level[level <= 100.0] / 100.0
        else:
            if self.mode == "scale":
                cells = np.rint((occupancy - self.free) / (self.occupied - self.free) * 100.0) / 100.0
            cells[occupancy < self.free] = 0.0
            cells[occupancy > self.occupied] = 1.0
            if self.mode == "scale" and alpha is not None:
                cells[alpha < _WHITE] = np.nan
        return cells.astype(np.float32), shade


def save_map(grid: OccupancyGrid, path: Path, mode: str = "trinary") -> list[Path]:
    """Writes the YAML ``path`` and an image beside it; gives back both paths.

    *trinary*: a PGM; more than 0.65 is occupied, less than 0.196 free, as the YAML says. *scale*, a PNG whose unknown
    cells are transparent, and *raw*, a PGM of levels 0 to 100, keep every per cent.
    """
    from PIL import Image
    from ruamel.yaml import YAML

    path = Path(path)
    occupied, free = OCCUPIED_THRESHOLD, FREE_THRESHOLD
    percent = np.where(grid.known, np.round(grid.occupancy * 100.0), 255.0).astype(np.uint8)
    if mode == "trinary":
        pixels = np.full(grid.occupancy.shape, _UNKNOWN, dtype=np.uint8)
        pixels[grid.occupancy < FREE_THRESHOLD] = _FREE
        pixels[grid.occupancy > OCCUPIED_THRESHOLD] = _OCCUPIED
    elif mode == "raw":
        pixels = percent
    elif mode == "scale":
        grey = np.rint((100.0 - np.where(grid.known, percent, 50)) * 2.55).astype(np.uint8)
        opacity = np.where(grid.known, 255, 0).astype(np.uint8)
        pixels = np.stack([grey, grey, grey, opacity], axis=2)
        occupied, free = 1.0, 0.0  # nothing to stretch: what is written is what is read
    else:
        raise MclError(f"unknown mode {mode!r}, expected one of {', '.join(MODES)}", path=path)
    image = path.with_suffix(".png" if mode == "scale" else ".pgm")
    Image.fromarray(pixels[::-1]).save(image)
    values = {
        "image": image.name,
        "mode": mode,
        "resolution": float(grid.resolution),
        "origin": [float(value) for value in grid.origin],
        "negate": 0,
        "occupied_thresh": occupied,
        "free_thresh": free,
    }
    yaml = YAML()
    yaml.default_flow_style = None
    with path.open("w", encoding="utf-8") as file:
        yaml.dump(values, file)
    return [path, image]


def _unknown_read_as_free(
    shade: NDArray[np.float64], cells: NDArray[np.float32], counts: NDArray[np.int64] | None, free: float
) -> list[str]:
    """A remark where the pixels that ROS's map_saver writes for unknown cells (205) come out free.

    ``counts``: how many pixels have each of the shades; None if there is one of each.
    """
    weights = np.ones(shade.shape, np.int64) if counts is None else counts
    there = weights > 0
    unknown = there & (np.abs(shade * 255.0 - _UNKNOWN) < 0.5)
    share = float(weights[unknown].sum() / weights.sum())
    if share < 0.01 or cells[unknown].any() or not (there & (shade * 255.0 > _UNKNOWN + 0.5)).any():
        return []
    return [
        f"{100 * share:.0f} % of the map is grey {_UNKNOWN}, which map_saver writes for unknown, and reads as "
        f"free by its free_thresh {free:g}; with {FREE_THRESHOLD} it would be unknown"
    ]


def _read_image(path: Path, reading: _Reading, remarks: list[str]) -> tuple[NDArray[np.float32], int, int]:
    """Cells, top row first, and how many rows below and columns to the left of them were left out.

    Levels stay whole numbers, so that means and thresholds come out to the last bit as in map_server.
    """
    from PIL import Image

    remarked = reading.mode != "raw" and not reading.negate
    try:
        with _any_size(), Image.open(path) as image:
            grey = image.mode == "L" and not image.has_transparency_data
            _check_size(image.size, _BYTES_GREY if grey else _BYTES_COLOUR, path)
            if grey:
                return _read_grey(np.asarray(image), reading, remarks, remarked, path)
            if image.mode.startswith("I"):  # 16 bits of grey
                colours, alpha = np.repeat(np.asarray(image, dtype=np.float64)[..., None], 3, axis=2), None
            else:
                pixels = np.asarray(image.convert("RGBA"), dtype=np.float64) * _FROM_8_BITS
                colours, alpha = pixels[..., :3], pixels[..., 3] if image.has_transparency_data else None
    except MclError:
        raise
    except Exception as error:  # Pillow raises whatever the reader of a format stumbles over
        raise MclError(f"cannot be read as an image: {' '.join(str(error).split())[:120]}", path=path) from error
    cells, shade = reading(colours, alpha)
    if alpha is not None and reading.mode == "trinary" and not (cells == 0.0).any():
        through = 100 * float((alpha < _WHITE).mean())
        on_white, shade = reading(colours * (alpha / _WHITE)[..., None] + (_WHITE - alpha)[..., None])
        if through > 0.0 and (on_white == 0.0).any():
            remarks.append(
                f"{through:.0f} % of the image is transparent, which map_server's rule makes occupied or unknown, and "
                "leaves no floor at all: read as if it lay on white"
            )
            cells = on_white
    if remarked:
        remarks += _unknown_read_as_free(shade, cells, None, reading.free)
    return cells, 0, 0


def _read_grey(
    levels: NDArray[np.uint8], reading: _Reading, remarks: list[str], remarked: bool, path: Path
) -> tuple[NDArray[np.float32], int, int]:
    """As ``_read_image``, for 8 bits of grey: what each level means is worked out once."""
    of_level, shade = reading(np.repeat(np.arange(256.0)[None, :, None] * _FROM_8_BITS, 3, axis=2))
    counts = np.zeros(256, np.int64)
    for row in range(0, len(levels), _ROWS):
        counts += np.bincount(levels[row : row + _ROWS].reshape(-1), minlength=256)
    if remarked:
        remarks += _unknown_read_as_free(shade[0], of_level[0], counts, reading.free)
    rows, columns = slice(0, levels.shape[0]), slice(0, levels.shape[1])
    if levels.size > LARGE:
        rows, columns = part_that_is_known(levels, ~np.isnan(of_level[0]))
        remarks.append(cropped(levels.shape, rows, columns))
    part = levels[rows, columns]
    check_cells(part.shape, path)
    return of_level[0][part], levels.shape[0] - rows.stop, columns.start


@contextmanager
def _any_size() -> Iterator[None]:
    """Without Pillow's own guess of what is too large, which it calls an attack: ``_check_size`` says it better."""
    from PIL import Image

    before = Image.MAX_IMAGE_PIXELS
    Image.MAX_IMAGE_PIXELS = None
    try:
        yield
    finally:
        Image.MAX_IMAGE_PIXELS = before


def _check_size(size: tuple[int, int], bytes_each: int, path: Path) -> None:
    width, height = size
    if (need := width * height * bytes_each) > MOST_MEMORY:
        raise MclError(
            f"to read {width:,} x {height:,} pixels would take about {need / 1e9:.1f} GB of memory",
            "save it with larger pixels, or in 8 bits of grey",
            path=path,
        )


def _image(path: Path, name: str, remarks: list[str]) -> Path:
    """Where the image is: where the YAML says, or, where it speaks of another machine's folders, beside the YAML."""
    image = path.parent / name
    if image.is_file():
        return image
    beside = path.parent / PureWindowsPath(name).name  # which knows both kinds of slashes
    if not beside.is_file():
        raise MclError(f"its image is missing: {image}", "the key image names it", path=path)
    remarks.append(f"image: {name} is not there; {beside.name} beside the YAML is taken")
    return beside


def _origin(values: Mapping[str, Any], path: Path, remarks: list[str]) -> Pose:
    origin = values.get("origin")
    if not isinstance(origin, list) or len(origin) != 3:
        raise MclError(f"origin must be three numbers [x, y, yaw], not {origin!r}", path=path)
    x, y, yaw = map(_as_number, origin)
    if yaw is None and _is_nan(origin[2]):
        remarks.append("the yaw of its origin is no number: taken for 0")
        yaw = 0.0
    if x is None or y is None or yaw is None:
        raise MclError(f"origin must be three numbers [x, y, yaw], not {origin!r}", path=path)
    if max(abs(x), abs(y)) > FARTHEST or abs(yaw) > MOST_TURNS:
        raise MclError(f"origin is {origin!r}: no map lies there", path=path)
    return x, y, yaw


def _read_yaml(path: Path) -> Mapping[str, Any]:
    from ruamel.yaml import YAML
    from ruamel.yaml.error import MarkedYAMLError, YAMLError

    try:
        text = path.read_bytes().decode("utf-8-sig", errors="replace")
    except FileNotFoundError as error:
        raise MclError("no such map", path=path) from error
    except OSError as error:
        raise MclError("cannot be read as a map_server YAML file", path=path) from error
    try:
        try:
            values = YAML(typ="safe").load(text)
        except YAMLError:
            if "\t" not in text:
                raise
            values = YAML(typ="safe").load(text.replace("\t", " "))  # as other readers of YAML take them
    except YAMLError as error:
        mark = error.problem_mark if isinstance(error, MarkedYAMLError) else None
        line = mark.line + 1 if mark is not None else None
        raise MclError("not a map: neither a beesoft map nor YAML", path=path, line=line) from error
    except Exception as error:  # numbers and dates that Python cannot hold
        raise MclError("not a map: neither a beesoft map nor YAML", path=path) from error
    if not isinstance(values, Mapping):
        raise MclError("not a map: neither a beesoft map nor a map_server YAML", path=path)
    return values


def _flag(value: Any, path: Path) -> bool:
    """A whole number or one of YAML 1.1's many words."""
    word = str(value).lower()
    if isinstance(value, int) or word in _YES + _NO:
        return word in _YES or (isinstance(value, int) and value != 0)
    raise MclError(f"negate must be 0 or 1, not {value!r}", path=path)


def _number(values: Mapping[str, Any], key: str, path: Path) -> float:
    value = values.get(key)
    number = _as_number(value)
    if number is None:
        raise MclError(f"{key} is missing" if value is None else f"{key} must be a number, not {value!r}", path=path)
    return number


def _share(values: Mapping[str, Any], key: str, path: Path) -> float:
    share = _number(values, key, path)
    if not 0.0 <= share <= 1.0:
        raise MclError(f"{key} must lie between 0 and 1, not at {share:g}", path=path)
    return share


def _is_nan(value: Any) -> bool:
    """Whether somebody wrote a NaN, as C++ prints it or YAML."""
    return (isinstance(value, float) and math.isnan(value)) or str(value).strip().lower().lstrip("+-.") in _NANS


def _as_number(value: Any) -> float | None:
    """A finite number, also one in quotes; None for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        number = float(value)
    except (ValueError, OverflowError):
        return None
    return number if np.isfinite(number) else None
