"""Static transforms from a file, for recordings that were made without /tf_static.

The file is YAML: what ``ros2 topic echo --once /tf_static`` prints on the robot (ROS 1: ``rostopic echo -n 1``), or a
list that somebody typed, ``- {parent: base_link, child: laser, x: 0.2, yaw: 1.57}``: metres and radians, roll about
x first, then pitch about y, then yaw about z. Numbers that are left out are 0.
"""

from __future__ import annotations

import math
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any, NamedTuple

from pipeline.errors import MclError

FORM = "expected a list of {parent, child, x, y, z, roll, pitch, yaw}, or what ros2 topic echo --once /tf_static prints"
_TYPED = ("x", "y", "z", "roll", "pitch", "yaw")
_FARTHEST, _MOST = 1e7, 1000.0
_NORM = (0.9, 1.1)


class GivenTransform(NamedTuple):
    """``child`` in ``parent``: ``position`` x, y, z (m) and ``orientation``, a quaternion x, y, z, w of length 1."""

    parent: str
    child: str
    position: tuple[float, float, float]
    orientation: tuple[float, float, float, float]


def read_transforms(path: Path) -> tuple[GivenTransform, ...]:
    """The transforms of a file; of a child that is named several times the last counts.

    Raises MclError for a file that is none, and for numbers and names that cannot be.
    """
    from ruamel.yaml import YAML
    from ruamel.yaml.error import MarkedYAMLError, YAMLError

    try:
        text = path.read_text(encoding="utf-8")
        documents = [document for document in YAML(typ="safe").load_all(text) if document is not None]
    except FileNotFoundError as error:
        raise MclError("no such file", path=path) from error
    except UnicodeDecodeError as error:
        raise MclError("not a text file", FORM, path=path) from error
    except OSError as error:
        raise MclError(f"cannot be read: {error.strerror}", path=path) from error
    except YAMLError as error:
        mark = error.problem_mark if isinstance(error, MarkedYAMLError) else None
        raise MclError("not YAML", FORM, path=path, line=None if mark is None else mark.line + 1) from error
    except Exception as error:  # numbers and dates that Python cannot hold
        raise MclError("not YAML", FORM, path=path) from error
    found: dict[str, GivenTransform] = {}
    for number, item in enumerate(_items(documents, path), start=1):
        try:
            given = _echoed(item) if "transform" in item else _typed(item)
        except (KeyError, TypeError, ValueError, OverflowError) as error:
            said = f"{error.args[0]!r} is missing" if isinstance(error, KeyError) else str(error)
            raise MclError(f"transform {number}: {said}", FORM, path=path) from error
        found[given.child] = given
    if not found:
        raise MclError("no transforms in this file", FORM, path=path)
    return tuple(found.values())


def _items(documents: Iterable[Any], path: Path) -> Iterable[Mapping[str, Any]]:
    for document in documents:
        items = document.get("transforms") if isinstance(document, Mapping) else document
        if not isinstance(items, list) or not all(isinstance(item, Mapping) for item in items):
            raise MclError("not a list of transforms", FORM, path=path)
        yield from items


def _typed(item: Mapping[str, Any]) -> GivenTransform:
    if unknown := sorted(str(key) for key in item.keys() - {"parent", "child", *_TYPED}):
        raise ValueError(f"it has {unknown[0]!r}, which is none of parent, child, {', '.join(_TYPED)}")
    x, y, z, roll, pitch, yaw = (_number(item.get(key, 0.0), key) for key in _TYPED)
    half = [angle / 2.0 for angle in (roll, pitch, yaw)]
    (cr, cp, cy), (sr, sp, sy) = map(math.cos, half), map(math.sin, half)
    turn = (
        sr * cp * cy - cr * sp * sy,
        cr * sp * cy + sr * cp * sy,
        cr * cp * sy - sr * sp * cy,
        cr * cp * cy + sr * sp * sy,
    )
    return _made(item["parent"], item["child"], (x, y, z), turn)


def _echoed(item: Mapping[str, Any]) -> GivenTransform:
    place, turn = item["transform"]["translation"], item["transform"]["rotation"]
    x, y, z = (_number(place[key], key) for key in "xyz")
    a, b, c, d = (_number(turn[key], f"rotation {key}") for key in "xyzw")
    return _made(item["header"]["frame_id"], item["child_frame_id"], (x, y, z), (a, b, c, d))


def _made(
    parent: Any, child: Any, position: tuple[float, float, float], turn: tuple[float, float, float, float]
) -> GivenTransform:
    names = [name.lstrip("/") if isinstance(name, str) else "" for name in (parent, child)]
    if not all(names) or names[0] == names[1]:
        raise ValueError(f"{parent!r} -> {child!r} are no two frames")
    if max(map(abs, position)) > _FARTHEST:
        raise ValueError(f"nothing on a robot is {max(map(abs, position)):g} m away")
    length = math.hypot(*turn)
    if not _NORM[0] <= length <= _NORM[1]:
        raise ValueError(f"its rotation is a quaternion of length {length:g}, not 1")
    a, b, c, d = (part / length for part in turn)
    return GivenTransform(names[0], names[1], position, (a, b, c, d))


def _number(value: Any, name: str) -> float:
    if isinstance(value, bool) or not isinstance(value, int | float) or not abs(value) < 10 * _FARTHEST:
        raise ValueError(f"{name} is {value!r}, which is no number that a robot has")
    if name in ("roll", "pitch", "yaw") and abs(value) > _MOST:
        raise ValueError(f"{name} is {value:g}: radians are expected")
    return float(value)
