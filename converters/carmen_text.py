"""CARMEN's text logs: lines of lasers, ODOM and TRUEPOS, metres and radians.

``FLASER n r1 ... rn x y theta x y theta ipc host logger``: the ranges, the laser's pose and the robot's, both in the
odometry frame, and the stamp that counts, that of the sender (ipc). RAWLASER1 to 4 and LASER3 to 5 say no poses: then
the robot is where the ODOM lines have it. Lines of unknown types are skipped and counted.
"""

from __future__ import annotations

import bz2
import math
import re
from collections import Counter
from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import pairwise
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from converters.text import BZIP2_MAGIC, begins_anew, in_order, measured, read_log_bytes, settle
from pipeline.errors import MclError
from pipeline.logs.columns import planar_poses
from pipeline.logs.odometry import odometry_at
from pipeline.logs.sound import FARTHEST, unlikely_constants
from pipeline.logs.stamps import format_stamp, parse_stamp
from pipeline.logs.stretches import GAP, numbered

MAX_STAMP = (2**31 - 1) * 1_000_000_000  # seconds are a signed 32-bit number in ROS 2
_PLACED = ("ROBOTLASER1", "FLASER", "RLASER", "ROBOTLASER2")
_RAW = ("RAWLASER1", "RAWLASER2", "RAWLASER3", "RAWLASER4", "LASER3", "LASER4", "LASER5")
LASERS = (*_PLACED, *_RAW)
"""Line types of scans, the ones to be preferred first: ROBOTLASER1 says its own angles, RLASER looks back, and raw ones
do not say where the robot was."""
REAR = ("RLASER", "ROBOTLASER2", "RAWLASER2")

_LINE = re.compile(
    rb"^(?:[FR]?LASER\d? \d+ |(?:ROBOT|RAW)LASER\d \d+ |ODOM [-\d.]+ |PARAM \w+ |TRUEPOS [-\d.]+ |# CARMEN)",
    re.MULTILINE,
)
_LENGTHS = {b"ODOM": 10, b"TRUEPOS": 10}
_ROBOTLASER_HEAD, _ROBOTLASER_TAIL, _RAW_TAIL = 9, 14, 3  # tokens before the ranges; after the remissions
_FLASER_HEAD, _FLASER_TAIL = 2, 9
_FIELDS = {
    **{n: (-math.pi / 2, math.radians(1.0)) for n in (180, 181)},
    **{n: (-math.pi / 2, math.radians(0.5)) for n in (360, 361)},
    **{n: (math.radians(-50.0), math.radians(0.25)) for n in (400, 401)},
}
"""First angle and step by the count of an FLASER line, which says no more: those of a SICK laser, as CARMEN guesses.

Any other count reaches from -90 to 90 degrees. With 400 and 401 CARMEN begins at -90 as well, but that mode of
the laser looks 50 degrees to either side.
"""


@dataclass(frozen=True)
class Beams:
    """Directions of a scan's beams in the laser's frame, radians; ``max_range``: metres, None if no line says."""

    count: int
    angle_min: float
    angle_increment: float
    max_range: float | None = None


@dataclass(frozen=True)
class CarmenLog:
    """The m scans of one laser, in the order of the file: ``lines`` (m,) 1-based, ``stamps`` (m,) int64 ns, increasing.

    ``laser_poses`` (None if no line says them) and ``robot_poses`` (m, 3) m, m, rad in the odometry frame, zeros
    without ``wheels``; ``ranges`` (m, beams) metres as written, NaN where a scan of another count has no beam.
    ``truth_stamps`` (k,), ``truth_poses`` (k, 3): the robot in a simulator's world. ``params``: the PARAM lines.
    ``counts``: lines by type. ``repaired``: scans whose stamp had to change because time ran backwards. ``restarts``:
    rows before which the clock began anew; their stamps follow, 10 s later, shifted by ``shifts`` (stretches,) ns.
    ``remarks``: what was left out or changed.
    """

    kind: str
    beams: Beams
    lines: NDArray[np.int64]
    stamps: NDArray[np.int64]
    laser_poses: NDArray[np.float64] | None
    robot_poses: NDArray[np.float64]
    ranges: NDArray[np.float64]
    truth_stamps: NDArray[np.int64]
    truth_poses: NDArray[np.float64]
    params: dict[str, str]
    counts: dict[str, int]
    repaired: int
    wheels: bool = True
    restarts: tuple[int, ...] = ()
    shifts: tuple[int, ...] = (0,)
    remarks: tuple[str, ...] = ()

    def __len__(self) -> int:
        return len(self.stamps)

    def take(self, keep: NDArray[np.bool_]) -> CarmenLog:
        """The scans where ``keep`` (m,) is true."""
        columns = ["lines", "stamps", "robot_poses", "ranges"]
        if self.laser_poses is not None:
            columns.append("laser_poses")
        return replace(self, **{name: getattr(self, name)[keep] for name in columns})


@dataclass(frozen=True)
class _Row:
    line: int
    stamp: int
    poses: list[float]
    ranges: list[float]
    beams: Beams | None = None


def is_carmen_text(path: Path, head: bytes) -> bool:
    """Whether a file whose first bytes are ``head`` looks like a CARMEN log, packed with bzip2 or not."""
    if head.startswith(BZIP2_MAGIC):
        try:
            with bz2.open(path) as file:
                head = file.read1(1 << 16)
        except (OSError, EOFError):
            return False
    return _LINE.search(head) is not None


def read_carmen(path: Path) -> CarmenLog:
    """Reads a log, plain, gzipped or packed with bzip2; stamps exact to the nanosecond.

    Lines of a known type with a wrong count of numbers, what is no number that a robot measures, and a last line that
    is cut are left out while they are few; else MclError names the first, as it does a file without scans.
    """
    data, remarks = read_log_bytes(path)
    return parse_carmen(data, path, remarks)


def parse_carmen(data: bytes, path: Path, known: Sequence[str] = ()) -> CarmenLog:
    """The same from bytes that are already unpacked; ``path`` names them in errors, ``known`` are remarks on them."""
    counts: Counter[str] = Counter()
    params: dict[str, str] = {}
    truth: list[_Row] = []
    odometry: list[_Row] = []
    scans: dict[str, list[_Row]] = {kind: [] for kind in LASERS}
    errors: list[MclError] = []
    number = 0
    for number, line in enumerate(data.split(b"\n"), start=1):
        tokens = line.split()
        if not tokens or tokens[0].startswith(b"#"):
            continue
        kind = tokens[0].decode("ascii", errors="replace")
        counts[kind] += 1
        try:
            if kind in scans:
                scans[kind].append(_scan(kind, tokens, number))
            elif kind == "PARAM":
                params[_text(tokens, 1)] = _text(tokens, 2)
            elif tokens[0] in _LENGTHS:
                _expect(tokens, _LENGTHS[tokens[0]])
                row = _Row(number, _stamp(tokens[-3]), _finite(tokens[1:7]), [])
                (truth if kind == "TRUEPOS" else odometry).append(row)
        except ValueError as error:
            errors.append(MclError(f"{kind}: {error}", path=path, line=number))
    remarks = [*known, *settle(errors, sum(counts.values()), number if not data.endswith(b"\n") else None)]
    kind = next((k for k in LASERS if scans[k]), "")
    if not kind:
        found = ", ".join(f"{count} {name}" for name, count in counts.most_common(5)) or "nothing"
        raise MclError(f"no laser scans ({', '.join(LASERS)}) in this log, but {found}", "; ".join(remarks), path=path)
    if others := [f"{len(scans[k]):,} {k}" for k in LASERS if k != kind and scans[k]]:
        remarks.append(f"{kind} is taken, and not {', '.join(others)}")
    rows = scans[kind]
    beams, ranges = _on_common_beams(rows, remarks)
    begins, shifts, stamps, rows, ranges = _in_time(rows, ranges, remarks)
    at = [rows[row].line for row in begins]
    if at:
        remarks.append(begins_anew(at))
    repaired = int((stamps != _column([row.stamp for row in rows]) + _shifts(rows, at, shifts)).sum())
    poses = np.array([row.poses for row in rows], dtype=np.float64)
    log = CarmenLog(
        kind=kind,
        beams=beams,
        lines=_column([row.line for row in rows]),
        stamps=stamps,
        laser_poses=poses[:, :3] if kind in _PLACED else None,
        robot_poses=poses[:, 3:] if kind in _PLACED else np.zeros((len(rows), 3)),
        ranges=ranges,
        truth_stamps=in_order(_column([row.stamp for row in truth]) + _shifts(truth, at, shifts)),
        truth_poses=np.array([row.poses[:3] for row in truth], dtype=np.float64).reshape(-1, 3),
        params=params,
        counts=dict(counts),
        repaired=repaired,
        restarts=tuple(begins),
        shifts=tuple(shifts),
        remarks=tuple(remarks),
    )
    return log if kind in _PLACED else _placed(log, odometry, at)


def _placed(log: CarmenLog, odometry: list[_Row], begins: list[int]) -> CarmenLog:
    """The log with the robot where the ODOM lines have it; without scans before the first of them or after the last."""
    if not odometry:
        return replace(log, wheels=False, remarks=(*log.remarks, "no ODOM lines: the laser alone tells the motion"))
    stamps = in_order(_column([row.stamp for row in odometry]) + _shifts(odometry, begins, log.shifts))
    poses = np.array([row.poses[:3] for row in odometry], dtype=np.float64)
    columns = planar_poses(stamps, _column([row.line for row in odometry]), poses, "odom")
    places, inside = odometry_at(log.stamps, log.lines, columns)
    if not inside.any():
        raise MclError(f"no {log.kind} line lies within the time of the ODOM lines", "two clocks?")
    remarks = log.remarks
    if outside := int((~inside).sum()):
        remarks += (f"{outside:,} {log.kind} lines left out: before the first ODOM line or after the last",)
    # Of some stretches no scan may be left.
    stretch = np.searchsorted(log.restarts, np.arange(len(log)), side="right")[inside]
    restarts = tuple((np.flatnonzero(np.diff(stretch)) + 1).tolist())
    shifts = tuple(log.shifts[k] for k in np.unique(stretch).tolist())
    placed = replace(log, robot_poses=places).take(inside)
    return replace(placed, restarts=restarts, shifts=shifts, remarks=remarks)


def _on_common_beams(rows: list[_Row], remarks: list[str]) -> tuple[Beams, NDArray[np.float64]]:
    """The beams that most scans have, and the ranges of all on them: NaN where another scan has none there."""
    shapes = [row.beams for row in rows]
    beams, common = Counter(shapes).most_common(1)[0]
    assert beams is not None
    if common == len(rows):
        return beams, np.array([row.ranges for row in rows], dtype=np.float64)
    others = f"{len(rows) - common:,} of {len(rows):,} scans have other beams than the rest"
    remarks.append(f"{others}: they are brought onto the same angles")
    ranges = np.full((len(rows), beams.count), np.nan)
    angles = beams.angle_min + beams.angle_increment * np.arange(beams.count)
    for out, row in zip(ranges, rows, strict=True):
        own = row.beams
        if own == beams:
            out[:] = row.ranges
        elif own is not None and own.angle_increment:
            with np.errstate(all="ignore"):  # an increment of almost nothing leads nowhere
                place = np.nan_to_num(np.rint((angles - own.angle_min) / own.angle_increment), nan=-1.0)
            nearest = np.clip(place, -1, own.count).astype(np.int64)
            inside = (nearest >= 0) & (nearest < own.count)
            out[inside] = np.array(row.ranges)[nearest[inside]]
    return beams, ranges


def _in_time(
    rows: list[_Row], ranges: NDArray[np.float64], remarks: list[str]
) -> tuple[list[int], list[int], NDArray[np.int64], list[_Row], NDArray[np.float64]]:
    """Where the clock begins anew, each stretch's shift, increasing stamps, and the scans that have one."""
    stamps = _column([row.stamp for row in rows])
    number = numbered(stamps)
    if number is None:
        return [], [0], in_order(stamps), rows, ranges
    if (stray := number < 0).any():
        first = rows[int(np.flatnonzero(stray)[0])].line
        remarks.append(f"{int(stray.sum())} scans left out, their stamps are far from those around: line {first}")
        rows = [row for row, left_out in zip(rows, stray, strict=True) if not left_out]
        stamps, ranges, number = stamps[~stray], ranges[~stray], number[~stray]
    begins = (np.flatnonzero(np.diff(number)) + 1).tolist()
    parts: list[NDArray[np.int64]] = []
    shifts: list[int] = []
    for start, end in pairwise([0, *begins, len(stamps)]):
        part = in_order(stamps[start:end])
        shifts.append(0 if not parts else int(parts[-1][-1]) + GAP - int(part[0]))
        parts.append(part + shifts[-1])
    return begins, shifts, np.concatenate(parts), rows, ranges


def _shifts(rows: list[_Row], begins: list[int], shifts: Sequence[int]) -> NDArray[np.int64]:
    """The shift of each line, by the lines with which stretches begin."""
    return np.array(shifts, np.int64)[np.searchsorted(begins, [row.line for row in rows], side="right")]


def _scan(kind: str, tokens: list[bytes], number: int) -> _Row:
    if kind.startswith(("ROBOTLASER", "RAWLASER")):
        return _with_angles(tokens, number, _ROBOTLASER_TAIL if kind.startswith("ROBOT") else _RAW_TAIL)
    n = _count(tokens, 1)
    tail = _FLASER_TAIL
    if kind in _RAW and len(tokens) == _FLASER_HEAD + n + _RAW_TAIL:
        tail = _RAW_TAIL
    _expect(tokens, _FLASER_HEAD + n + tail)
    beams = Beams(n, *_FIELDS.get(n, (-math.pi / 2, math.pi / (n - 1))))
    ranges, rest = tokens[_FLASER_HEAD : _FLASER_HEAD + n], tokens[_FLASER_HEAD + n :]
    return _Row(number, _stamp(rest[-3]), _finite(rest[: tail - _RAW_TAIL]), _finite(ranges), beams)


def _with_angles(tokens: list[bytes], number: int, tail: int) -> _Row:
    n = _count(tokens, _ROBOTLASER_HEAD - 1)
    end = _ROBOTLASER_HEAD + n
    remissions = _count(tokens, end, least=0)
    _expect(tokens, end + 1 + remissions + tail)
    angle_min, _, increment, max_range = _finite(tokens[2:6])
    if wrong := unlikely_constants((angle_min, increment, 0.0, max_range), n):
        raise ValueError(wrong)
    rest = tokens[end + 1 + remissions :]
    poses = _finite(rest[:6]) if tail == _ROBOTLASER_TAIL else []
    beams = Beams(n, angle_min, increment, max_range if max_range > 0.0 else None)
    return _Row(number, _stamp(rest[-3]), poses, _finite(tokens[_ROBOTLASER_HEAD:end]), beams)


def _count(tokens: list[bytes], at: int, least: int = 2) -> int:
    text = _text(tokens, at)
    if not text.isdecimal() or int(text) < least:
        raise ValueError(f"{text[:40]!r} is no number of readings")
    return int(text)


def _expect(tokens: list[bytes], words: int) -> None:
    if len(tokens) != words:
        raise ValueError(f"expected {words} words, found {len(tokens)}")


def _text(tokens: list[bytes], at: int) -> str:
    if at >= len(tokens):
        raise ValueError("the line is cut")
    return tokens[at].decode("ascii", errors="replace")


def _finite(tokens: list[bytes]) -> list[float]:
    try:
        values = list(map(float, tokens))
    except ValueError:
        values = [math.nan]
    if not measured(values, FARTHEST):
        bad = next((t for t in tokens if not _is_finite(t)), None)
        if bad is not None:
            raise ValueError(f"{bad[:40].decode('ascii', errors='replace')!r} is not a finite number")
        raise ValueError(f"{max(values, key=abs):g} is no number that a robot measures")
    return values


def _is_finite(token: bytes) -> bool:
    try:
        return math.isfinite(float(token))
    except ValueError:
        return False


def _stamp(token: bytes) -> int:
    stamp = parse_stamp(token.decode("ascii", errors="replace"))
    if not 0 <= stamp <= MAX_STAMP:
        raise ValueError(f"the stamp {format_stamp(stamp)} is out of bounds")
    return stamp


def _column(values: list[int]) -> NDArray[np.int64]:
    return np.array(values, dtype=np.int64)
