"""Maps as ROS keeps them: a YAML file and an image, read by the same rules as nav2's map_server.

A pixel's darkness is its occupancy (its lightness if ``negate``). *trinary* tells occupied, free and unknown apart
by two thresholds, *scale* stretches what lies between them over 0 to 100 %, *raw* takes grey levels as percent.
The rules are those of ``nav2_map_server/src/map_io.cpp``; its numbers are 16 bits wide, and its YAML is of version 1.1.
"""

from __future__ import annotations

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import MclError
from pipeline.maps.occupancy_grid import OccupancyGrid

MODES = ("trinary", "scale", "raw")
OCCUPIED_THRESHOLD, FREE_THRESHOLD = 0.65, 0.196  # 0.196: an unknown pixel (205) is not below it, as it is with 0.25
_FREE, _OCCUPIED, _UNKNOWN = 254, 0, 205
_WHITE = 65535.0
_FROM_8_BITS = 257.0
_YES, _NO = ("y", "yes", "true", "on"), ("n", "no", "false", "off")


def load_map(path: Path) -> OccupancyGrid:
    """The map that a map_server YAML and the image beside it describe.

    Occupancy is 1, 0 or NaN (trinary), or keeps its percent (scale, raw). Raises MclError if a
    file is missing or unreadable, or a key is missing or not what map_server expects.
    """
    path = Path(path)
    values = _read_yaml(path)
    if not values.keys() & {"image", "resolution"}:
        raise MclError("not a map_server YAML", "expected keys: image, resolution, origin, ...", path=path)
    resolution = _number(values, "resolution", path)
    if resolution <= 0:
        raise MclError("resolution must be positive, metres per pixel", path=path)
    origin = values.get("origin")
    if not (isinstance(origin, list) and len(origin) == 3 and None not in map(_as_number, origin)):
        raise MclError(f"origin must be three numbers [x, y, yaw], not {origin!r}", path=path)
    occupied, free = _number(values, "occupied_thresh", path), _number(values, "free_thresh", path)
    mode = str(values.get("mode", "trinary")).lower()
    if mode not in MODES:
        raise MclError(f"unknown mode {mode!r}, expected one of {', '.join(MODES)}", path=path)
    if mode == "scale" and occupied <= free:
        raise MclError("occupied_thresh must be above free_thresh", path=path)
    negate = _flag(values.get("negate"), path)
    name = values.get("image")
    if not isinstance(name, str) or not name:
        raise MclError("no image is named in this file", "expected a key: image: map.pgm", path=path)

    image = path.parent / name
    if not image.exists():
        raise MclError(f"its image is missing: {image}", "the key image names it", path=path)
    colours, alpha = _read_image(image)
    counted = colours
    if mode == "trinary" and alpha is not None:
        counted = np.concatenate([colours, alpha[..., None]], axis=2)  # so map_server does it
    shade = counted.mean(axis=2) / _WHITE
    occupancy = shade if negate else 1.0 - shade
    cells = np.full(shade.shape, np.nan)
    if mode == "raw":
        level = np.round(shade * 255.0)
        cells[level <= 100.0] = level[level <= 100.0] / 100.0
    else:
        if mode == "scale":
            cells = np.rint((occupancy - free) / (occupied - free) * 100.0) / 100.0
        cells[occupancy < free] = 0.0
        cells[occupancy > occupied] = 1.0
        if mode == "scale" and alpha is not None:
            cells[alpha < _WHITE] = np.nan
    x, y, yaw = map(float, origin)
    remarks = _unknown_read_as_free(shade, cells, free) if mode != "raw" and not negate else ()
    cells = np.ascontiguousarray(cells[::-1])
    return OccupancyGrid(cells.astype(np.float32), resolution, (x, y, yaw), remarks)


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


def _unknown_read_as_free(shade: NDArray[np.float64], cells: NDArray[np.float64], free: float) -> tuple[str, ...]:
    """A remark where the pixels that ROS's map_saver writes for unknown cells (205) come out free."""
    unknown = np.abs(shade * 255.0 - _UNKNOWN) < 0.5
    if unknown.mean() < 0.01 or cells[unknown].any() or not (shade * 255.0 > _UNKNOWN + 0.5).any():
        return ()
    return (
        f"{100 * unknown.mean():.0f} % of the map is grey {_UNKNOWN}, which map_saver writes for unknown, and reads as "
        f"free by its free_thresh {free:g}; with {FREE_THRESHOLD} it would be unknown",
    )


def _read_image(path: Path) -> tuple[NDArray[np.float64], NDArray[np.float64] | None]:
    """Red, green, blue (height, width, 3), top row first, and opacity (height, width) if there is any: 0 to 65535.

    Levels stay whole numbers, so that means and thresholds come out to the last bit as in map_server.
    """
    from PIL import Image, UnidentifiedImageError

    try:
        with Image.open(path) as image:
            if image.mode.startswith("I"):  # 16 bits of grey
                grey = np.asarray(image, dtype=np.float64)
                return np.repeat(grey[..., None], 3, axis=2), None
            has_alpha = image.has_transparency_data
            pixels = np.asarray(image.convert("RGBA"), dtype=np.float64) * _FROM_8_BITS
    except (UnidentifiedImageError, OSError, ValueError, SyntaxError) as error:
        raise MclError(f"cannot be read as an image: {error}", path=path) from error
    return pixels[..., :3], pixels[..., 3] if has_alpha else None


def _read_yaml(path: Path) -> Mapping[str, Any]:
    from ruamel.yaml import YAML
    from ruamel.yaml.error import MarkedYAMLError, YAMLError

    try:
        values = YAML(typ="safe").load(path.read_text(encoding="utf-8"))
    except FileNotFoundError as error:
        raise MclError("no such map", path=path) from error
    except (OSError, UnicodeDecodeError) as error:
        raise MclError("cannot be read as a map_server YAML file", path=path) from error
    except YAMLError as error:
        mark = error.problem_mark if isinstance(error, MarkedYAMLError) else None
        line = mark.line + 1 if mark is not None else None
        raise MclError("not a map: neither a beesoft map nor YAML", path=path, line=line) from error
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


def _as_number(value: Any) -> float | None:
    """A finite number, also one in quotes; None for anything else."""
    if isinstance(value, bool) or not isinstance(value, int | float | str):
        return None
    try:
        number = float(value)
    except ValueError:
        return None
    return number if np.isfinite(number) else None
