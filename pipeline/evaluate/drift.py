"""How far dead reckoning drifts, with no map: arrays in, numbers out.

Three measures. Over so many scans: the motion from one scan to a later one against the reference's. Per metre driven:
the same over stretches of a length (Geiger, Lenz, Urtasun 2012, "Are we ready for autonomous driving?"; evo's RPE).
And the error in hand-checked relations between scans (Kuemmerle et al. 2009, "On measuring the accuracy of SLAM
algorithms"), which needs no reference trajectory. In all of them the frames of the two need not agree: only motions
are compared.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from pipeline.errors import MclError
from pipeline.evaluate.metrics import Array
from pipeline.geometry import between
from pipeline.logs.stamps import parse_stamp
from pipeline.logs.tum import read_lines

SCANS = 200
"""How many scans apart the ends of a window are."""
LENGTHS = (1.0, 5.0, 10.0)
"""m: lengths of the stretches over which the drift per metre is taken."""
RELATIONS = "lines of a relations file: t1 t2 x y z roll pitch yaw"
_COUNTS = 0.1
"""m: a robot that stands still drives nothing, however its reference trembles: so far it must be from where it was."""
_SAME = 1_000_000
"""ns: a relation is of a scan whose stamp is so close."""


# --- against a reference --------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class ScanDrift:
    """Median error of the motion over ``scans`` scans: ``position`` in m, ``heading`` in degrees, in ``windows``."""

    scans: int
    position: float
    heading: float
    windows: int


@dataclass(frozen=True)
class MetreDrift:
    """Median error over ``length`` metres, for each metre: ``position`` in %, ``heading`` in deg/m, in ``windows``."""

    length: float
    position: float
    heading: float
    windows: int


@dataclass(frozen=True)
class Drift:
    """How far a dead-reckoned trajectory drifts; None where the log is too short for a single window."""

    over_scans: ScanDrift | None
    per_metre: tuple[MetreDrift | None, ...]

    def to_dict(self) -> dict[str, Any]:
        """As plain values, ready for JSON; ``per_metre`` in the order of ``LENGTHS``."""
        return asdict(self)


def drift(poses: Array, truth: Array) -> Drift:
    """Drift of poses (n, 3) against truth (n, 3) at the same scans, m and rad, each in a frame of its own.

    Rows of ``truth`` that are NaN are not scored (``metrics.interpolate`` makes them).
    """
    return Drift(over_scans(poses, truth), per_metre(poses, truth))


def over_scans(poses: Array, truth: Array, scans: int = SCANS, stride: int | None = None) -> ScanDrift | None:
    """Median error of the motion from scan i to scan i + ``scans``, for poses (n, 3) against truth (n, 3), m and rad.

    ``stride``: scans from the start of a window to that of the next; windows lie end to end if None. Returns None
    where the truth knows no window.
    """
    starts = np.arange(0, len(poses) - scans, stride or scans)
    position, heading = _errors(poses, truth, starts, starts + scans)
    if not len(position):
        return None
    return ScanDrift(scans, float(np.median(position)), float(np.degrees(np.median(heading))), len(position))


def per_metre(poses: Array, truth: Array, lengths: Sequence[float] = LENGTHS) -> tuple[MetreDrift | None, ...]:
    """Median drift for each metre driven, over stretches of each of the ``lengths`` (m): one from every scan.

    ``poses`` (n, 3) against ``truth`` (n, 3), m and rad. A stretch ends at the first scan by which the truth has
    driven so far, and its error is divided by what it has driven. None for a length that the log does not reach.
    """
    path = driven(truth)
    return tuple(_over(length, poses, truth, path) for length in lengths)


def driven(truth: Array) -> Array:
    """Metres driven by every scan, (n,), of the poses truth (n, 3) in m; steps count from 0.1 m on.

    Rows that are NaN repeat what was driven before.
    """
    path, last = np.zeros(len(truth)), None
    for i, (x, y, _) in enumerate(truth.tolist()):
        path[i] = path[i - 1] if i else 0.0
        if math.isnan(x):
            continue
        step = 0.0 if last is None else math.hypot(x - last[0], y - last[1])
        if last is None or step >= _COUNTS:
            path[i] += step
            last = (x, y)
    return path


def _over(length: float, poses: Array, truth: Array, path: Array) -> MetreDrift | None:
    ends = np.searchsorted(path, path + length)
    starts = np.flatnonzero(ends < len(path))
    ends = ends[starts]
    position, heading = _errors(poses, truth, starts, ends, each=path[ends] - path[starts])
    if not len(position):
        return None
    return MetreDrift(length, float(100 * np.median(position)), float(np.degrees(np.median(heading))), len(position))


def _errors(
    poses: Array, truth: Array, starts: NDArray[np.int64], ends: NDArray[np.int64], each: Array | float = 1.0
) -> tuple[Array, Array]:
    """Errors of the motions in m and rad, divided by ``each``, where the truth knows both ends."""
    off = between(between(truth[starts], truth[ends]), between(poses[starts], poses[ends]))
    position, heading = np.hypot(off[:, 0], off[:, 1]) / each, np.abs(off[:, 2]) / each
    sure = np.isfinite(position)
    return position[sure], heading[sure]


# --- against relations ----------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Relations:
    """m pairs of scans and how the laser moved between them: ``stamps`` (m, 2) int64 ns, ``motions`` (m, 3) m, rad."""

    stamps: NDArray[np.int64]
    motions: Array

    def __len__(self) -> int:
        return len(self.stamps)


@dataclass(frozen=True)
class Spread:
    """Mean and standard deviation of some errors, in their own unit."""

    mean: float
    std: float

    @classmethod
    def of(cls, values: Array) -> Spread:
        """Of values (n,), n at least 1."""
        return cls(float(np.mean(values)), float(np.std(values)))


@dataclass(frozen=True)
class RelationErrors:
    """Errors in relations: absolute, in m and degrees, and squared, in m^2 and degrees^2.

    ``used`` of the ``total`` relations are between scans that the trajectory has.
    """

    translation: Spread
    rotation: Spread
    squared_translation: Spread
    squared_rotation: Spread
    used: int
    total: int

    def to_dict(self) -> dict[str, Any]:
        """As plain values, ready for JSON."""
        return asdict(self)


def read_relations(path: Path) -> Relations:
    """The relations of a file of the Freiburg SLAM benchmark: ``t1 t2 x y z roll pitch yaw`` a line, ``#`` a comment.

    Seconds, metres, radians; z, roll and pitch are ignored. Raises MclError naming file and line for anything but
    eight finite numbers, and for a file without relations.
    """
    stamps: list[tuple[int, int]] = []
    motions: list[tuple[float, float, float]] = []
    for number, line in enumerate(read_lines(Path(path), f"expected {RELATIONS}"), start=1):
        words = line.partition("#")[0].split()
        if not words:
            continue
        if len(words) != 8:
            raise MclError(
                f"expected 8 numbers (t1 t2 x y z roll pitch yaw), found {len(words)}", path=path, line=number
            )
        try:
            first, second, values = parse_stamp(words[0]), parse_stamp(words[1]), [float(word) for word in words[2:]]
        except ValueError as error:
            raise MclError(f"not a number: {error}", path=path, line=number) from error
        if not all(map(math.isfinite, values)):
            raise MclError("NaN or an infinite number in a relation", path=path, line=number)
        stamps.append((first, second))
        motions.append((values[0], values[1], values[5]))
    if not stamps:
        raise MclError("no relations in this file", f"expected {RELATIONS}", path=path)
    return Relations(np.array(stamps, dtype=np.int64), np.array(motions, dtype=np.float64))


def relation_errors(stamps: NDArray[np.int64], poses: Array, relations: Relations) -> RelationErrors:
    """How far the motions of the laser between pairs of scans are off, as the Freiburg SLAM benchmark counts it.

    ``stamps`` (n,) int64 ns, never decreasing; ``poses`` (n, 3) of the *laser*, m and rad, in any frame. A relation
    counts if both of its stamps are those of scans, to a millisecond. Raises MclError if none does.
    """
    at, known = _scans_at(stamps, relations.stamps)
    if not known.any():
        raise MclError("none of the relations is between two scans of the log", "relations of another log?")
    ends = at[known]
    off = between(relations.motions[known], between(poses[ends[:, 0]], poses[ends[:, 1]]))
    translation, rotation = np.hypot(off[:, 0], off[:, 1]), np.degrees(np.abs(off[:, 2]))
    return RelationErrors(
        translation=Spread.of(translation),
        rotation=Spread.of(rotation),
        squared_translation=Spread.of(translation**2),
        squared_rotation=Spread.of(rotation**2),
        used=len(ends),
        total=len(relations),
    )


def _scans_at(stamps: NDArray[np.int64], wanted: NDArray[np.int64]) -> tuple[NDArray[np.int64], NDArray[np.bool_]]:
    """The scans nearest to stamps (m, 2), and for which of the m both are near enough to be meant."""
    after = np.clip(np.searchsorted(stamps, wanted), 0, len(stamps) - 1)
    before = np.clip(after - 1, 0, None)
    nearest = np.where(np.abs(stamps[after] - wanted) < np.abs(stamps[before] - wanted), after, before)
    return nearest, np.all(np.abs(stamps[nearest] - wanted) <= _SAME, axis=1)
